"""A detector from healthy recordings alone: false alarms, what it says that moved, when it says
nothing, its file.
"""

import json
import math
import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from commandline import one_line, run

import swashtwin as st
from swashtwin.diagnosis import Diagnosis
from swashtwin.foundation import (
    ArtifactError,
    DataError,
    InputError,
    LeakError,
    read_artifact,
    write_artifact,
)
from swashtwin.learning import detectable_rise
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, write_index, write_recording

RATE = 2000.0
LENGTH = 2000
SHAFT = 20.0


def recording(name: str, *, pressure: float = 10.0, rise: float = 0.0, label: str = "normal"):
    """A machine whose orders and noise follow the pressure [MPa]; order 9 of channel x is raised by
    `rise` [dB].
    """
    draw = np.random.default_rng([*name.encode()])
    time = np.arange(LENGTH) / RATE
    scatter = 10 ** (draw.normal(0, 1.0, (2, 12)) / 20)
    amplitude = pressure / 10 * scatter
    amplitude[0, 8] *= 10 ** (rise / 20)
    phase = draw.uniform(0, 2 * math.pi, (2, 12, 1))
    angle = 2 * math.pi * SHAFT * np.arange(1, 13)[:, None] * time
    signal = (amplitude[..., None] * np.sin(angle + phase)).sum(axis=1)
    signal = signal + 0.3 * pressure / 10 * 10 ** (draw.normal(0, 0.5) / 20) * draw.normal(
        size=signal.shape
    )
    condition = OperatingCondition(2 * math.pi * SHAFT, st.MPa(pressure))

    return Recording(
        signal, RATE, name, channels=("x", "y"), label=label, condition=condition, specimen="A"
    )


@pytest.fixture(scope="module")
def healthy() -> list[Recording]:
    return [recording(f"h{n}", pressure=(5.0, 10.0)[n % 2]) for n in range(20)]


@pytest.fixture(scope="module")
def detector(healthy: list[Recording]) -> st.AnomalyDetector:
    """Nothing is odd in it."""
    detector = st.AnomalyDetector().fit(healthy)
    assert (detector.fitted_.n_recordings, detector.notes_) == (20, ())
    return detector


def test_a_line_that_rose_is_an_alarm_that_names_order_channel_and_decibels(
    detector: st.AnomalyDetector,
) -> None:
    verdict = detector.diagnose(recording("fault", rise=12.0))
    assert verdict.alarm
    assert verdict.p_value == pytest.approx(1 / 21)

    first = verdict.changes[0]
    assert (first.channel, first.band) == ("x", "shaft order 9 (180 Hz)")
    assert first.change == pytest.approx(12.0, abs=3.0)
    assert first.sentence in verdict.sentence()
    assert "alarm at a false-alarm rate of 5 %" in verdict.sentence()


@pytest.mark.wrong_types
def test_a_pressure_in_whole_pascals_or_single_precision_is_compared_like_any_other(
    detector: st.AnomalyDetector, healthy: list[Recording]
) -> None:
    for pressure in (10_100_000, np.float32(10.1e6)):
        condition = OperatingCondition(np.float32(2 * math.pi * SHAFT), pressure)
        assert (
            detector.diagnose(replace(healthy[1], recording_id="again", condition=condition)).alarm
            is not None
        )


def test_false_alarms_stay_within_the_stated_rate(healthy: list[Recording]) -> None:
    """Over draws of both the healthy recordings and the new ones, as conformal p-values promise."""
    alarms = []
    for part in range(6):
        few = [recording(f"{part} h{n}", pressure=(5.0, 10.0)[n % 2]) for n in range(9)]
        detector = st.AnomalyDetector(error_rate=0.1).fit(few)
        verdicts = [
            detector.diagnose(recording(f"{part} t{n}", pressure=(5.0, 10.0)[n % 2]))
            for n in range(20)
        ]
        alarms += [verdict.alarm for verdict in verdicts]

    assert np.mean(alarms) <= 0.1 + 2 * math.sqrt(0.1 * 0.9 / len(alarms))
    assert any(alarms)


def burst(signal: np.ndarray) -> np.ndarray:
    return signal + 20 * (np.arange(LENGTH) // 40 % 20 == 7) * np.random.default_rng(0).normal(
        size=signal.shape
    )


def gain(signal: np.ndarray) -> np.ndarray:
    return signal * [[1.0], [0.4]]


def other_point(signal: np.ndarray) -> np.ndarray:
    """A recording at 5 MPa that is listed as one at 10 MPa."""
    return signal / 2


@pytest.mark.parametrize(
    ("disturb", "words"),
    [
        (burst, "dB at 524 to 660 Hz"),
        (gain, "dB in all bands of channel y (changed gain"),
        (other_point, "resembles those at A, 1200 rev/min, 5 MPa"),
    ],
)
def test_two_odd_recordings_of_twenty_are_named_and_left_out_and_hide_no_fault(
    healthy, disturb, words: str
) -> None:
    """Two that are odd alike hide neither each other nor a fault; the rate is that of the
    recordings left.
    """
    odd = [
        one.replace(signal=disturb(one.signal), recording_id=f"odd{n}")
        for n, one in enumerate(healthy[1:5:2])
    ]
    usual = [one for one in healthy if one not in healthy[1:5:2]]
    detector = st.AnomalyDetector().fit([*odd, *usual])
    without = st.AnomalyDetector().fit(usual)
    first, second, cost, few = detector.notes_

    assert "odd0 is left out" in first
    assert words in first
    assert "odd1 is left out" in second
    assert re.search(
        r"With odd0, odd1 a change must be \d+\.\d times as large .* false-alarm rate is 0.14",
        cost,
    )
    assert "18 healthy recordings allow no false-alarm rate below 0.053" in few

    fault = recording("fault", rise=12.0)
    assert detector.diagnose(fault).to_dict() == without.diagnose(fault).to_dict()
    assert detector.diagnose(fault).alarm
    assert detector.diagnose(odd[0].replace(recording_id="new", signal=odd[0].signal + 1e-6)).alarm
    with pytest.raises(
        InputError, match=r"needs at least 19 healthy recordings; there are 18 without odd0, odd1"
    ):
        st.AnomalyDetector(error_rate=0.05).fit([*odd, *usual])


def test_recordings_of_another_state_are_too_many_to_leave_out_and_a_point_that_disagrees_is(
    healthy,
) -> None:
    state = [one.replace(signal=gain(one.signal)) for one in healthy[:6]]
    detector = st.AnomalyDetector().fit([*state, *healthy[6:]])

    assert detector.fitted_.n_recordings == 20
    assert (
        "6 of 20 healthy recordings differ from the others (h0, h1, h2, h3, h4, h5), too many"
        in detector.notes_[0]
    )

    pair = [recording("p0", pressure=15.0), recording("p1", pressure=15.0)]
    pair[1] = pair[1].replace(signal=gain(pair[1].signal))
    detector = st.AnomalyDetector().fit([*healthy, *pair])

    assert detector.fitted_.n_recordings == 20
    assert (
        "p0 is left out: the recordings of its operating point differ from each other"
        in detector.notes_[0]
    )
    assert (
        "No healthy recording is at the pressure 15 MPa"
        in detector.diagnose(recording("q", pressure=15.0)).sentence()
    )


def test_the_cost_of_odd_recordings_is_that_of_a_level_that_rises(
    detector: st.AnomalyDetector,
) -> None:
    """Half of `detectable_rise` in one level is seldom an alarm, twice as much mostly is."""
    fitted = detector.fitted_
    rise = detectable_rise(fitted.band_powers, fitted.point_index, 0.05) * np.eye(
        fitted.band_powers.shape[1]
    )
    alarms = []

    for row, column in product(range(20), range(0, len(rise), 16)):
        others = fitted.subset(np.arange(20) != row)
        point = fitted.points[fitted.point_index[row]]
        risen = [fitted.band_powers[row] + factor * rise[column] for factor in (0.5, 2.0)]
        alarms.append(
            [others.deviation_of(one, others.points.index(point)).p_value <= 0.05 for one in risen]
        )

    half, twice = np.mean(alarms, axis=0)
    assert half < 0.3
    assert twice > 0.6


def test_the_p_value_does_not_depend_on_the_order_of_the_healthy_recordings(
    healthy: list[Recording], detector: st.AnomalyDetector
) -> None:
    new = recording("new", rise=3.0)
    assert (
        st.AnomalyDetector().fit(healthy[::-1]).diagnose(new).p_value
        == detector.diagnose(new).p_value
    )


def test_a_changed_gain_is_said_of_the_channel_and_not_of_its_lines(
    detector: st.AnomalyDetector,
) -> None:
    loud = recording("loud")
    verdict = detector.diagnose(loud.replace(signal=loud.signal * np.array([[4.0], [1.0]])))

    assert verdict.alarm
    assert len(verdict.shifts) == 1
    assert "in all bands of channel x" in verdict.shifts[0]
    assert not [change for change in verdict.changes if change.change > 9]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"pressure": 7.0},
            "No healthy recording is at the pressure 7 MPa (recorded: 5 MPa, 10 MPa)",
        ),
        ({"specimen": "B"}, "No healthy recording is of specimen B (recorded: A)"),
        ({"condition": None}, "does not specify its speed and pressure"),
        ({"length": 900}, "lasts 0.45 s (900 samples); its band powers need 0.5 s"),
        ({"signal": 1e200}, "larger than a window can hold"),
    ],
)
def test_what_the_healthy_recordings_do_not_cover_has_no_verdict(
    detector: st.AnomalyDetector, change: dict, words: str
) -> None:
    new = recording("new", pressure=change.get("pressure", 10.0))
    if "length" in change:
        new = new.slice(0, change["length"])
    elif "signal" in change:
        new = new.replace(signal=new.signal * change["signal"])
    elif "pressure" not in change:
        new = new.replace(**change)
    verdict = detector.diagnose(new)

    assert verdict.alarm is None
    assert words in str(verdict.no_verdict)
    assert verdict.p_value is None


def test_a_missing_pressure_is_assumed_where_only_one_was_recorded() -> None:
    detector = st.AnomalyDetector().fit([recording(f"h{n}") for n in range(6)])
    verdict = detector.diagnose(
        recording("new").replace(condition=None, specimen=None, attributes={"speed": "20 Hz"})
    )

    assert verdict.alarm is not None
    assert verdict.notes == (
        "It does not specify its specimen and pressure; A, 1200 rev/min, 10 MPa was assumed.",
    )


def test_recordings_without_a_speed_are_compared_by_bands() -> None:
    plain = [recording(f"h{n}").replace(condition=None) for n in range(6)]
    detector = st.AnomalyDetector().fit(plain)

    assert detector.layout.n_orders == 0
    assert "orders are not compared" in detector.notes_[0]
    assert detector.diagnose(recording("new", rise=25.0).replace(condition=None)).alarm


def test_few_recordings_say_which_rate_they_allow_and_a_lower_one_is_refused(
    healthy: list[Recording],
) -> None:
    detector = st.AnomalyDetector().fit(healthy[:8])
    assert detector.error_rate_ == 0.112
    assert (
        "8 healthy recordings allow no false-alarm rate below 0.112; 0.05 needs 19."
        in detector.notes_
    )
    with pytest.raises(InputError, match="needs at least 99 healthy recordings; there are 20"):
        st.AnomalyDetector(error_rate=0.01).fit(healthy)
    with pytest.raises(InputError, match="needs at least 99"):
        detector.diagnose(healthy[0], error_rate=0.01)
    with pytest.raises(DataError, match="5 are needed, and 20 for"):
        st.AnomalyDetector().fit(healthy[:4])


def test_a_fault_and_a_copy_among_the_healthy_recordings_are_noticed(
    healthy: list[Recording],
) -> None:
    with pytest.raises(DataError, match="'piston'"):
        st.AnomalyDetector().fit([*healthy, recording("p", label="piston")])

    detector = st.AnomalyDetector().fit([*healthy, healthy[0].replace(recording_id="z")])
    assert detector.notes_ == ("z holds the same samples as h0 and is excluded.",)
    assert "proves nothing" in detector.diagnose(healthy[0]).notes[0]


def test_another_rate_is_refused_with_what_to_do(detector: st.AnomalyDetector) -> None:
    with pytest.raises(DataError, match="set resample='2000 Hz'"):
        detector.diagnose(replace(recording("new"), sample_rate=1000.0))


def test_scores_count_alarms_by_class_and_refuse_what_was_seen(
    healthy: list[Recording], detector: st.AnomalyDetector
) -> None:
    test = [recording(f"t{n}", label="gut") for n in range(4)]
    test += [recording(f"p{n}", rise=15.0, label="piston") for n in range(3)]
    test += [recording("far", pressure=20.0, label="piston")]
    scores = detector.evaluate(test)
    good, piston = scores.classes

    assert (good.label, good.n_recordings) == ("gut", 4)
    assert good.auroc is None
    assert (piston.n_alarms, piston.n_no_verdict, piston.auroc) == (3, 1, 1.0)
    assert json.dumps(scores.to_dict()["classes"][1]["interval"])
    with pytest.raises(LeakError, match="h0 had a part in the model"):
        detector.evaluate(healthy[:1])


def test_a_saved_detector_answers_as_before(detector: st.AnomalyDetector, tmp_path: Path) -> None:
    again = st.AnomalyDetector.load(detector.save(tmp_path / "d.safetensors"))
    new = recording("new", rise=4.0)

    assert again.diagnose(new).to_dict() == detector.diagnose(new).to_dict()
    assert (again.notes_, again.error_rate_) == (detector.notes_, detector.error_rate_)
    assert again.manifest == detector.manifest


@pytest.mark.parametrize(
    "lie",
    [
        {"shortest": 3}, {"specimen": ["A"]}, {"manifest": {}}, {"specimen": [str(n) for n in range(20)]},
        {"layout": {"n_orders": 10**30}}, {"layout": {"length": 10**12}}, {"layout": {"sample_rate": -1.0}},
        {"layout": {"channels": []}}, {"layout": {"length": 0}}, {"layout": {"channels": ["x"] * 3}},
    ],
)  # fmt: skip
def test_a_card_that_lies_is_refused_in_one_line(
    detector: st.AnomalyDetector, tmp_path: Path, lie: dict
) -> None:
    kind = st.AnomalyDetector.KIND
    path = detector.save(tmp_path / "d.safetensors")
    card, tensors = read_artifact(path, kind, 2, advice="", may_be_nan=None)
    healthy = card["healthy"]

    for name, value in lie.items():
        healthy[name] = {**healthy[name], **value} if name == "layout" else value

    for changed in (
        card,
        {**card, "error_rate": 0.001},
        {**card, "error_rate": "x"},
        {**card, "notes": None},
    ):
        path = write_artifact(
            tmp_path / "lie.safetensors", kind, 2, changed, tensors, may_be_nan=None
        )

        with pytest.raises(ArtifactError) as caught:
            st.AnomalyDetector.load(path)
        assert len(str(caught.value).splitlines()) == 1
        assert len(str(caught.value)) < 600


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, healthy: list[Recording]) -> Path:
    """Folders ``healthy`` and ``all`` with an index each."""
    folder = tmp_path_factory.mktemp("plant")
    faults = [recording(f"p{n}", rise=15.0, label="piston") for n in range(2)]
    for name, members in (("healthy", healthy), ("all", [*healthy, *faults, recording("t1")])):
        (folder / name).mkdir()
        files = [Path(f"{member.recording_id}.h5") for member in members]
        for member, file in zip(members, files, strict=True):
            write_recording(member, folder / name / file)

        write_index(members, files, folder / name / "recordings.toml")

    return folder


def test_train_evaluate_and_diagnose_work_on_healthy_recordings_alone(folder: Path) -> None:
    model = folder / "model.safetensors"
    trained = json.loads(
        run("train", str(folder / "healthy"), "--out", str(model), "--json").stdout
    )

    assert (trained["kind"], trained["error_rate"], len(trained["recordings"])) == (
        "anomaly detector",
        0.05,
        20,
    )

    scored = json.loads(run("evaluate", str(model), str(folder / "all"), "--json").stdout)
    assert [(item["label"], item["n_recordings"]) for item in scored["classes"]] == [
        ("normal", 1),
        ("piston", 2),
    ]

    page = folder / "page.html"
    answer = run(
        "diagnose", str(model), str(folder / "all" / "p0.h5"), "--report", str(page), "--json"
    )
    (verdict,) = json.loads(answer.stdout)["diagnoses"]

    assert verdict["alarm"] is True
    assert verdict["changes"][0]["band"] == "shaft order 9 (180 Hz)"
    assert "Change of the levels" in page.read_text(encoding="utf-8")

    shown = run(
        "diagnose", str(model), str(folder / "all" / "t1.h5"), "--pressure", "20 MPa", code=3
    )

    assert "20" in one_line(shown)


def test_check_finds_healthy_recordings_alone_enough_for_a_detector(folder: Path) -> None:
    shown = run("check", str(folder / "healthy")).stdout
    assert "20 healthy recordings allow a false-alarm rate of 0.05" in shown
    assert "The data are sound and enough for an anomaly detector." in shown


def test_a_classifier_of_healthy_recordings_alone_is_refused(
    folder: Path, healthy: list[Recording]
) -> None:
    refused = run("train", str(folder / "healthy"), "--network", "bitcn", code=2)
    assert "anomaly" in refused.stderr
    with pytest.raises((DataError, InputError), match="AnomalyDetector"):
        st.FaultClassifier(window=512).fit(healthy[:6])


def test_a_verdict_without_levels_has_a_page_too(tmp_path: Path) -> None:
    verdict = Diagnosis("a", "detector", no_verdict="the file is damaged.", error_rate=0.05)
    text = st.write_report(verdict, folder=tmp_path / "page").read_text(encoding="utf-8")
    assert "The file is damaged" in text
