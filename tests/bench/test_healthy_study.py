"""The studies of detectors from healthy recordings alone: on the rig, and on bearings run until they failed."""

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest

from swashtwin.bench import HealthyStudySettings, read_public_set, run_bearing_life, run_healthy
from swashtwin.bench.public.bearing_life import N_HEALTHY, life_values, plain_alarm, watch_alarm
from swashtwin.pump import CLASSES
from swashtwin.recordings import Recording


def test_the_study_on_the_rig_states_false_alarms_and_the_auroc_of_each_fault() -> None:
    tiny = HealthyStudySettings(pumps=1, healthy=(2,), healthy_tests=1, faulty_tests=1, duration=0.7)
    study = run_healthy(seeds=(0,), settings=tiny)
    table = json.loads(json.dumps(study.to_dict()["rows"]))
    assert [row["label"] for row in table] == list(CLASSES)
    assert all(row["error_rate"]["mean"] == 0.143 for row in table)
    assert all(0 <= row["auroc"]["mean"] <= 1 for row in table[1:])
    assert "From 6 healthy recordings at a stated false-alarm rate of 0.143" in study.answer[0]
    assert "on 3 healthy recordings" in study.answer[0]


def life(rises: list[float]) -> list[Recording]:
    """A bearing's recordings in order of time; a band around 3 kHz rises by so many dB."""
    recordings = []
    for number, rise in enumerate(rises):
        draw = np.random.default_rng(number)
        tone = np.sin(2 * np.pi * 3000 * np.arange(1280) / 12800 + draw.uniform(0, 6)) * 10 ** (rise / 20)
        signal = draw.normal(size=(1, 1280)) + tone
        recordings.append(Recording(signal, 12800.0, f"s{number}", attributes={"snapshot": str(number + 1)}))
    return recordings


@pytest.mark.parametrize(
    ("rises", "alarm_at"),
    [
        ([0.0] * 44, math.nan),
        ([0.0] * 34 + [12.0] * 10, 36 / 44),
        ([0.0] * 34 + [12.0] + [0.0] * 9, math.nan),
        ([0.0] * 34 + [-30.0] * 10, math.nan),
    ],
)
def test_an_alarm_stands_when_a_level_has_risen_twice_in_a_row_and_not_when_it_fell(
    rises: list[float], alarm_at: float
) -> None:
    values = life_values(life(rises))
    assert values["recordings"] == 44
    np.testing.assert_equal(values["alarm_at"], alarm_at)


@pytest.mark.parametrize(
    ("rises", "first", "last"),
    [([0.0] * 44, 2, 0), ([0.0] * 34 + [40.0] * 10, 36 / 44, 43 / 44), ([0.0] * 34 + [-30.0] * 10, 2, 0)],
)
def test_the_watch_and_the_plain_rule_alarm_after_a_rise_and_not_before(
    rises: list[float], first: float, last: float
) -> None:
    for alarm_at in (watch_alarm(life(rises)), plain_alarm(life(rises))):
        assert first <= alarm_at <= last or (first > last and math.isnan(alarm_at))


def test_the_bearings_are_read_in_order_of_time(tmp_path: Path) -> None:
    rows = "\n".join(f"9,39,39,{n},{n % 7 / 10},{n % 5 / 10}" for n in range(2560))
    for name in ("Bearing2_1_00007", "Bearing2_1_00001"):
        (tmp_path / f"{name}.csv.gz").write_bytes(gzip.compress(rows.encode()))
    (tmp_path / "files.csv").write_text("file,of\nBearing2_1_00001.csv.gz,911\n")
    first, second = read_public_set("bearing_run_to_failure", tmp_path)
    assert (first.specimen, first.label, first.unit, first.sample_rate) == ("Bearing2_1", None, "m/s^2", 25600.0)
    assert first.channels == ("horizontal", "vertical")
    assert first.attributes["snapshots"] == "911"
    assert (first.attributes["snapshot"], second.attributes["snapshot"]) == ("1", "7")
    assert first.signal[0, 1] == pytest.approx(0.1 * 9.80665)
    with pytest.raises(Exception, match=f"{2 * N_HEALTHY} are needed"):
        run_bearing_life(tmp_path)
