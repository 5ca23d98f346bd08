"""A detector of healthy recordings: false alarms, reported changes, missing verdicts, files."""

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
    """Return a machine whose orders and noise follow the pressure [MPa].

    Order 9 of channel x is raised by `rise` [dB].
    """
    draw = np.random.default_rng([*name.encode()])
    time = np.arange(LENGTH) / RATE
    scatter = 10 ** (draw.normal(0, 1.0, (2, 12)) / 20)
    amplitude = pressure / 10 * scatter
    amplitude[0, 8] *= 10 ** (rise / 20)
    phase = draw.uniform(0, 2 * math.pi, (2, 12, 1))
    angle = 2 * math.pi * SHAFT * np.arange(1, 13)[:, None] * time
    signal = (amplitude[..., None] * np.sin(angle + phase)).sum(axis=1)
    noise_rms = 0.3 * pressure / 10 * 10 ** (draw.normal(0, 0.5) / 20)
    signal = signal + noise_rms * draw.normal(size=signal.shape)
    condition = OperatingCondition(2 * math.pi * SHAFT, st.MPa(pressure))

    return Recording(
        signal,
        RATE,
        name,
        channels=("x", "y"),
        label=label,
        condition=condition,
        specimen="A",
    )


@pytest.fixture(scope="module")
def healthy() -> list[Recording]:
    return [recording(f"h{n}", pressure=(5.0, 10.0)[n % 2]) for n in range(20)]


@pytest.fixture(scope="module")
def detector(healthy: list[Recording]) -> st.AnomalyDetector:
    detector = st.AnomalyDetector().fit(healthy)

    assert detector.fitted_.n_recordings == 20
    assert detector.notes_ == ()  # no recording deviates
    return detector


def test_a_risen_line_is_an_alarm_that_names_order_channel_and_decibels(
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
        new = replace(healthy[1], recording_id="new", condition=condition)
        assert detector.diagnose(new).alarm is not None


def test_false_alarms_stay_within_the_specified_rate(healthy: list[Recording]) -> None:
    """Over draws of both the healthy recordings and the new ones, as conformal p-values promise."""
    alarms = []
    for part in range(6):
        few = [recording(f"{part} h{n}", pressure=(5.0, 10.0)[n % 2]) for n in range(9)]
        detector = st.AnomalyDetector(error_rate=0.1).fit(few)

        for number in range(20):
            new = recording(f"{part} t{number}", pressure=(5.0, 10.0)[number % 2])
            alarms.append(detector.diagnose(new).alarm)

    # two binomial standard deviations above the rate
    assert np.mean(alarms) <= 0.1 + 2 * math.sqrt(0.1 * 0.9 / len(alarms))
    assert any(alarms)


def burst(signal: np.ndarray) -> np.ndarray:
    is_burst = np.arange(LENGTH) // 40 % 20 == 7
    return signal + 20 * is_burst * np.random.default_rng(0).normal(size=signal.shape)


def gain(signal: np.ndarray) -> np.ndarray:
    return signal * [[1.0], [0.4]]


def other_point(signal: np.ndarray) -> np.ndarray:
    """A recording at 5 MPa that is listed as one at 10 MPa."""
    return signal / 2


@pytest.mark.parametrize(
    ("disturb", "message"),
    [
        (burst, "dB at 524 to 660 Hz"),
        (gain, "dB in all bands of channel y (changed gain"),
        (other_point, "resembles those at A, 1200 rev/min, 5 MPa"),
    ],
)
def test_two_deviating_recordings_of_twenty_are_excluded_by_name_and_hide_no_fault(
    healthy, disturb, message: str
) -> None:
    """Two that deviate alike hide neither each other nor a fault; the rate is that of the remaining
    recordings.
    """
    disturbed = healthy[1:5:2]
    deviating = [
        member.replace(signal=disturb(member.signal), recording_id=f"odd{n}")
        for n, member in enumerate(disturbed)
    ]
    remaining = [member for member in healthy if member not in disturbed]

    detector = st.AnomalyDetector().fit([*deviating, *remaining])
    without_deviating = st.AnomalyDetector().fit(remaining)
    first, second, cost, few = detector.notes_
    assert "odd0 is left out" in first
    assert message in first
    assert "odd1 is left out" in second
    expected = (
        r"With odd0, odd1 a change must be \d+\.\d times as large .* false-alarm rate is 0.14"
    )
    assert re.search(expected, cost)
    assert "18 healthy recordings allow no false-alarm rate below 0.053" in few

    fault = recording("fault", rise=12.0)
    assert detector.diagnose(fault).to_dict() == without_deviating.diagnose(fault).to_dict()
    assert detector.diagnose(fault).alarm
    assert detector.diagnose(
        deviating[0].replace(recording_id="new", signal=deviating[0].signal + 1e-6)
    ).alarm
    with pytest.raises(
        InputError,
        match=r"needs at least 19 healthy recordings; there are 18 without odd0, odd1",
    ):
        st.AnomalyDetector(error_rate=0.05).fit([*deviating, *remaining])


def test_many_deviating_recordings_stay_and_an_inconsistent_operating_point_is_excluded(
    healthy,
) -> None:
    state = [member.replace(signal=gain(member.signal)) for member in healthy[:6]]
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


def test_the_detectable_rise_is_that_of_a_single_band_power(
    detector: st.AnomalyDetector,
) -> None:
    """Half of `detectable_rise` in one band power is rarely an alarm, twice as much mostly is."""
    fitted = detector.fitted_
    n_band_powers = fitted.band_powers.shape[1]
    rise = detectable_rise(fitted.band_powers, fitted.point_index, 0.05) * np.eye(n_band_powers)
    alarms = []

    # every sixteenth band power, for all of them would take minutes
    for row, column in product(range(20), range(0, len(rise), 16)):
        without_row = fitted.subset(np.arange(20) != row)
        point = fitted.points[fitted.point_index[row]]
        risen = [fitted.band_powers[row] + factor * rise[column] for factor in (0.5, 2.0)]
        index = without_row.points.index(point)
        alarms.append([without_row.deviation_of(row, index).p_value <= 0.05 for row in risen])
    half, twice = np.mean(alarms, axis=0)
    assert half < 0.3
    assert twice > 0.6


def test_the_p_value_does_not_depend_on_the_order_of_the_healthy_recordings(
    healthy: list[Recording], detector: st.AnomalyDetector
) -> None:
    new = recording("new", rise=3.0)
    reversed_detector = st.AnomalyDetector().fit(healthy[::-1])

    assert reversed_detector.diagnose(new).p_value == detector.diagnose(new).p_value


def test_a_changed_gain_is_reported_for_the_channel_and_not_for_its_lines(
    detector: st.AnomalyDetector,
) -> None:
    loud = recording("loud")
    verdict = detector.diagnose(loud.replace(signal=loud.signal * np.array([[4.0], [1.0]])))

    assert verdict.alarm
    assert len(verdict.shifts) == 1
    assert "in all bands of channel x" in verdict.shifts[0]
    assert not [change for change in verdict.changes if change.change > 9]


@pytest.mark.parametrize(
    ("change", "message"),
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
def test_a_recording_that_the_healthy_ones_do_not_cover_has_no_verdict(
    detector: st.AnomalyDetector, change: dict, message: str
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
    assert message in str(verdict.no_verdict)
    assert verdict.p_value is None


def test_a_missing_pressure_is_assumed_if_only_one_was_recorded() -> None:
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


def test_the_rate_that_few_recordings_allow_is_reported_and_a_lower_one_is_refused(
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


def test_a_fault_and_a_copy_among_the_healthy_recordings_are_detected(
    healthy: list[Recording],
) -> None:
    with pytest.raises(DataError, match="'piston'"):
        st.AnomalyDetector().fit([*healthy, recording("p", label="piston")])

    detector = st.AnomalyDetector().fit([*healthy, healthy[0].replace(recording_id="z")])
    assert detector.notes_ == (
        "z holds samples of the same measurement as h0 (altered, overlapping or equal); "
        "excluded from the baseline.",
    )
    assert "proves nothing" in detector.diagnose(healthy[0]).notes[0]


def test_notes_on_many_excluded_recordings_are_one_for_each_kind(
    healthy: list[Recording],
) -> None:
    copies = [healthy[n].replace(recording_id=f"z{n}") for n in range(5)]
    singles = [recording(f"s{n}").replace(specimen=f"pump {n}") for n in range(4)]

    copy_note, single_note = st.AnomalyDetector().fit([*healthy, *copies, *singles]).notes_

    assert copy_note == (
        "5 recordings, z0, z1, z2 and 2 more, hold samples of the same measurements as others "
        "(altered, overlapping or equal); excluded from the baseline."
    )
    assert single_note == (
        "4 recordings are the only ones at their operating points and are excluded: s0, s1, s2 and "
        "1 more."
    )


def test_another_sample_rate_is_refused_with_a_remedy(
    detector: st.AnomalyDetector,
) -> None:
    with pytest.raises(DataError, match="set resample='2000 Hz'"):
        detector.diagnose(replace(recording("new"), sample_rate=1000.0))


def test_scores_count_alarms_by_class_and_refuse_training_recordings(
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


def test_a_loaded_detector_answers_as_the_saved_one(
    detector: st.AnomalyDetector, tmp_path: Path
) -> None:
    loaded = st.AnomalyDetector.load(detector.save(tmp_path / "d.safetensors"))
    new = recording("new", rise=4.0)

    assert loaded.diagnose(new).to_dict() == detector.diagnose(new).to_dict()
    assert loaded.notes_ == detector.notes_
    assert loaded.error_rate_ == detector.error_rate_
    assert loaded.manifest == detector.manifest


@pytest.mark.parametrize(
    "false_entries",
    [
        {"shortest": 3},
        {"specimen": ["A"]},
        {"manifest": {}},
        {"specimen": [str(n) for n in range(20)]},
        {"layout": {"n_orders": 10**30}},
        {"layout": {"length": 10**12}},
        {"layout": {"sample_rate": -1.0}},
        {"layout": {"channels": []}},
        {"layout": {"length": 0}},
        {"layout": {"channels": ["x"] * 3}},
    ],
)
def test_an_inconsistent_card_is_refused_in_one_line(
    detector: st.AnomalyDetector, tmp_path: Path, false_entries: dict
) -> None:
    kind = st.AnomalyDetector.KIND
    path = detector.save(tmp_path / "d.safetensors")
    card, tensors = read_artifact(path, kind, 3, advice="", may_be_nan=None)
    healthy = card["healthy"]

    for name, value in false_entries.items():
        healthy[name] = {**healthy[name], **value} if name == "layout" else value

    for changed in (
        card,
        {**card, "error_rate": 0.001},
        {**card, "error_rate": "x"},
        {**card, "notes": None},
    ):
        path = write_artifact(
            tmp_path / "lie.safetensors", kind, 3, changed, tensors, may_be_nan=None
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
    for name, members in (
        ("healthy", healthy),
        ("all", [*healthy, *faults, recording("t1")]),
    ):
        (folder / name).mkdir()
        files = [Path(f"{member.recording_id}.h5") for member in members]
        for member, file in zip(members, files, strict=True):
            write_recording(member, folder / name / file)

        write_index(members, files, folder / name / "recordings.toml")

    return folder


def test_train_evaluate_and_diagnose_work_on_healthy_recordings_alone(
    folder: Path,
) -> None:
    model = folder / "model.safetensors"
    trained = json.loads(
        run("train", str(folder / "healthy"), "--out", str(model), "--json").stdout
    )

    assert trained["kind"] == "anomaly detector"
    assert trained["error_rate"] == 0.05
    assert len(trained["recordings"]) == 20
    scored = json.loads(run("evaluate", str(model), str(folder / "all"), "--json").stdout)
    n_recordings = {scores["label"]: scores["n_recordings"] for scores in scored["classes"]}
    assert n_recordings == {"normal": 1, "piston": 2}
    page = folder / "page.html"
    answer = run(
        "diagnose",
        str(model),
        str(folder / "all" / "p0.h5"),
        "--report",
        str(page),
        "--json",
    )
    (verdict,) = json.loads(answer.stdout)["diagnoses"]

    assert verdict["alarm"] is True
    assert verdict["changes"][0]["band"] == "shaft order 9 (180 Hz)"
    assert "Change of the band powers" in page.read_text(encoding="utf-8")

    printed = run(
        "diagnose",
        str(model),
        str(folder / "all" / "t1.h5"),
        "--pressure",
        "20 MPa",
        code=3,
    )

    assert "20" in one_line(printed)


def test_check_reports_that_healthy_recordings_suffice_for_a_detector(
    folder: Path,
) -> None:
    printed = run("check", str(folder / "healthy")).stdout
    assert "20 healthy recordings allow a false-alarm rate of 0.05" in printed
    assert "The data are sound and enough for an anomaly detector." in printed


def test_a_classifier_of_healthy_recordings_alone_is_refused(
    folder: Path, healthy: list[Recording]
) -> None:
    refused = run("train", str(folder / "healthy"), "--network", "bitcn", code=3)
    assert "anomaly" in refused.stderr
    with pytest.raises((DataError, InputError), match="AnomalyDetector"):
        st.FaultClassifier(window=512).fit(healthy[:6])


@pytest.mark.parametrize(
    ("words", "parameter", "option"),
    [
        (("--window", 256), "window (256)", "--window"),
        (("--test-fraction", 0.2), "test_fraction (0.2)", "--test-fraction"),
        (("--validation-fraction", 0.3), "validation_fraction (0.3)", "--validation-fraction"),
        (("--group", "specimen"), "group ('specimen')", "--group"),
        (("--prior", "25scy14-1b"), "prior ('25scy14-1b')", "--prior"),
        (("--network", "bitcn", "--set", "epochs=2"), "network ('bitcn')", "--network"),
        (("--preset", "paper"), "network ('bitcn')", "--network"),
    ],
)
def test_a_detector_takes_no_parameter_of_a_classifier(
    folder: Path, tmp_path: Path, words: tuple[object, ...], parameter: str, option: str
) -> None:
    out = tmp_path / "model.safetensors"
    line = one_line(run("train", folder / "healthy", *words, "--out", out, code=3))

    assert f"{parameter} belongs to a classifier, but all recordings are healthy" in line
    assert f"Omit {option}, or add recordings of a fault." in line
    assert not out.exists()


def test_a_verdict_without_band_powers_has_a_page_too(tmp_path: Path) -> None:
    verdict = Diagnosis("a", "detector", no_verdict="the file is damaged.", error_rate=0.05)
    text = st.write_report(verdict, folder=tmp_path / "page").read_text(encoding="utf-8")
    assert "The file is damaged" in text
