"""The study of the public sets keeps groups apart, chooses settings inside, and shows a leak as a
leak.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from swashtwin.diagnosis import FaultClassifier
from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording
from swashtwin_bench import Work
from swashtwin_bench.public.study import AT_RANDOM, PublicSettings, _drop_constant_channels, public

RATE = 1600.0
LAG = {"healthy": 2.2e-5, "cavitation50": 1.5e-5, "cavitation100": 0.9e-5}
"""Lag [rev/min] over the speed squared of each state of the made-up pump."""


def write_pump(
    folder: Path, speeds: tuple[int, ...], states: tuple[str, ...], count: int = 6720
) -> Path:
    """A made-up pump_cavitation with three repeats of each state; only the slip tells the state."""
    random = np.random.default_rng(0)
    recordings_folder = folder / "pump_cavitation" / "recordings"
    recordings_folder.mkdir(parents=True)
    time = np.arange(count) / RATE
    for speed in speeds:
        for run, state in enumerate(states):
            for repeat in (1, 2, 3):
                field = 1.03 * speed
                shaft = field - LAG[state] * field**2
                lines = [2 * k * field for k in (1, 2, 3, 6, 12)] + [
                    k * shaft for k in (1, 2, 3, 5, 6, 7)
                ]
                tones = sum(
                    0.4 * np.sin(2 * np.pi * at / 60 * time + random.uniform(0, 6)) for at in lines
                )
                signal = tones + random.normal(size=(5, count))
                table = np.column_stack([time, signal.T])
                header = "% made up\n" * 7 + "Time\tch 0\tch 1\tch 2\tch 3\tch 4"
                path = recordings_folder / f"{run:02d}_{repeat}_s{speed}_{state}.dat"
                np.savetxt(path, table, "%.6f", "\t", header=header, comments="")
    return folder


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pump(
        tmp_path_factory.mktemp("small"), (700, 1000, 1200), ("healthy", "cavitation100")
    )


def test_the_ordinary_training_is_read_again_where_it_was_finished(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = public(Work(out=tmp_path), PublicSettings(("extra_trees",)), small)
    row, leaky = study.rows()
    assert (row["split"], row["classifier"]) == ("pump_cavitation/speed", "extra_trees")
    assert 0.3 < row["recording_balanced_accuracy"]["mean"] <= 1.0
    assert row["floor"]["mean"] == 0.38
    assert leaky["classifier"] == AT_RANDOM
    assert leaky["balanced_accuracy"]["mean"] > 0.5
    assert [fold["fold"] for fold in study.details["folds"]] == ["700 rpm", "1000 rpm", "1200 rpm"]
    json.dumps(study.to_dict(), allow_nan=False)
    monkeypatch.delattr(FaultClassifier, "fit")
    assert (
        public(Work(out=tmp_path), PublicSettings(("extra_trees",)), small).rows() == study.rows()
    )
    with pytest.raises(InputError, match="Invalid classifier 'trees': must be one of chosen, "):
        public(Work(), PublicSettings(("trees",)), small)


def test_what_no_training_takes_is_said_and_a_channel_without_a_signal_is_left_out(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: FaultClassifier, recordings: list[Recording]) -> None:
        raise DataError("too short.")

    monkeypatch.setattr(FaultClassifier, "fit", refuse)
    study = public(Work(), PublicSettings(("chosen",)), small)
    assert study.rows()[0]["balanced_accuracy"]["mean"] is None
    assert "pump_cavitation/speed, chosen: too short." in study.notes
    signal = np.random.default_rng(0).normal(size=(2, 50))
    dead = Recording(signal * [[1.0], [0.0]], 10.0, "dead", channels=("x", "y"))
    live = Recording(signal, 10.0, "live", channels=("x", "y"))
    assert [recording.channels for recording in _drop_constant_channels([dead, live])] == [
        ("x",),
        ("x",),
    ]


def test_a_folder_without_any_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="pump_cavitation"):
        public(Work(), PublicSettings(), tmp_path)
    one_speed = write_pump(tmp_path, (1000,), ("healthy", "cavitation100"))
    with pytest.raises(DataError, match="one group"):
        public(Work(), PublicSettings(), one_speed)
    with pytest.raises(InputError, match="Invalid set"):
        public(Work(), PublicSettings(sets=("paderborn",)), tmp_path)
