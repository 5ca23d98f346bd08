"""A classifier from a pump prior: faults that nobody measured, what it refuses, its file and its
commands.
"""

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.signal
from commandline import run

from swashtwin.cli.diagnosing import _verdict_row
from swashtwin.diagnosis import (
    Diagnosis,
    FaultClassifier,
    PriorClassifier,
    make_prior,
    prior_head,
)
from swashtwin.diagnosis.fault_separation import describe_separation
from swashtwin.diagnosis.prior_classifier import SHIPPED
from swashtwin.foundation import (
    ArtifactError,
    DataError,
    InputError,
    LeakError,
    MPa,
    deg,
    read_artifact,
    rpm,
    um,
    write_artifact,
)
from swashtwin.monitoring.alarms.suspect import Suspect
from swashtwin.physics import Twin
from swashtwin.pump import (
    BoreDefect,
    Fault,
    GrooveErosion,
    OperatingCondition,
    PistonWear,
    SealingLandScratch,
    load_pump,
)
from swashtwin.recordings import Recording, write_index, write_recording
from swashtwin.report.diagnosis_part import build_diagnosis_part
from swashtwin.signals import recording_density
from swashtwin.synthesis import (
    OrderChanges,
    PumpPrior,
    operating_range,
    simulate_changes,
)

# A fault that is not a class of the prior.
SCRATCH = SealingLandScratch(conductance=2e-12)

CONDITION = OperatingCondition(speed=rpm(1000), discharge_pressure=MPa(10))
RATE = 16384.0
FAULTS: dict[str, Fault | None] = {
    "normal": None,
    "piston": PistonWear(clearance=um(80)),
    "cylinder_block": BoreDefect(depth=um(250)),
    "valve_plate": GrooveErosion(advance=deg(5)),
}


@cache
def recording(
    label: str, number: int = 0, *, condition: OperatingCondition = CONDITION
) -> Recording:
    """Return the nominal twin's simulation in noise, with slightly different damping each time."""
    draw = np.random.default_rng([number, *label.encode()])
    fault = SCRATCH if label == "sealing_land" else FAULTS[label]
    twin = Twin(load_pump("25scy14-1b"), condition, fault, bandwidth=6000.0)
    values = twin.values.numpy() * np.exp(draw.normal(0, 0.05, 6))
    twin = twin.with_interfaces(type(twin.pump.interfaces).from_values(values))
    clean = twin.simulate(1.5, RATE, recording_id=f"{label} {number}")
    noise = draw.normal(0, 0.05, clean.signal.shape)

    return replace(
        clean,
        signal=(clean.signal + noise).astype(np.float32),
        label=label,
        synthetic=False,
        specimen="A",
    )


@cache
def changes() -> OrderChanges:
    return simulate_changes(PumpPrior(), 60, seed=3)


@cache
def trained() -> PriorClassifier:
    prior = PumpPrior()
    simulated = changes()
    speed, pressure = operating_range(prior.pump, prior)
    arrays = (
        simulated.change,
        simulated.label,
        simulated.pump,
        simulated.scatter,
        simulated.has_own_drawing,
    )
    return make_prior(*arrays, pump=prior.pump, speed=speed, pressure=pressure)


def healthy(count: int = 3) -> list[Recording]:
    return [recording("normal", number) for number in range(count)]


@cache
def adapted() -> PriorClassifier:
    return trained().fit(healthy())


def test_a_virtual_pump_does_not_depend_on_the_number_of_pumps() -> None:
    few = simulate_changes(PumpPrior(), 2, seed=3)

    assert np.array_equal(few.change, changes().change[: len(few.change)])
    assert set(few.label.tolist()) == {
        "normal",
        "swash_plate",
        "piston",
        "cylinder_block",
        "valve_plate",
        "other",
    }


def test_a_fault_changes_band_powers_more_than_another_healthy_recording() -> None:
    size = np.abs(changes().change.astype(float)).mean(axis=(1, 2))
    normal = changes().label == "normal"
    assert np.median(size[~normal]) > 1.5 * np.median(size[normal])


def test_the_shipped_prior_names_faults_without_a_measured_example() -> None:
    shipped = PriorClassifier.load("25scy14-1b").fit(healthy())
    verdicts = [shipped.diagnose(recording(label, 9)) for label in FAULTS]

    assert [verdict.label for verdict in verdicts] == list(FAULTS)
    assert all(abs(sum(verdict.probabilities.values()) - 1) < 1e-6 for verdict in verdicts)


def test_a_scratched_sealing_land_is_not_called_a_piston_without_a_word() -> None:
    # Both leak from one chamber once a turn: no line distinguishes them, so the answer names both.
    verdict = adapted().diagnose(recording("sealing_land", 9))
    worn = adapted().diagnose(recording("piston", 9))

    assert verdict.unknown or "scratched sealing land" in " ".join(verdict.notes)
    assert worn.label == "piston"
    assert "scratched sealing land" in " ".join(worn.notes)
    assert not adapted().diagnose(recording("normal", 9)).notes


def test_a_gain_changes_no_probability() -> None:
    louder = trained().fit([replace(member, signal=4 * member.signal) for member in healthy()])
    test = recording("piston", 9)

    assert np.allclose(
        louder.predict_proba([replace(test, signal=4 * test.signal)]),
        adapted().predict_proba([test]),
        atol=1e-6,
    )


def test_a_measured_fault_raises_the_probability_of_its_class() -> None:
    without_example = adapted().predict_proba([recording("piston", 9)])[0]
    faulty = replace(recording("piston", 1), label="Verschleiß")
    taught = trained().fit([*healthy(), faulty], fault_of={"Verschleiß": "piston"})
    with_example = taught.predict_proba([recording("piston", 9)])[0]
    index = taught.classes.index("piston")

    assert with_example[index] > without_example[index]
    assert taught.taught == {"piston": 1}
    assert "1 of piston" in repr(taught)

    test = replace(recording("piston", 9), label="Verschleiß")
    assert taught.evaluate([test]).classes[0].label == "piston"


def test_changes_are_in_units_of_the_spread_of_healthy_recordings() -> None:
    scattered = [
        replace(member, signal=(1 + 0.3 * number) * member.signal)
        for number, member in enumerate(healthy())
    ]
    moving = trained().fit(scattered)
    still = adapted()
    changes = moving.healthy_changes()
    band_powers = moving.band_powers

    assert np.allclose(changes[0], (band_powers[0] - band_powers[1:].mean(axis=0)) * np.sqrt(2 / 3))
    assert moving.head is not None
    assert still.head is not None
    assert (moving.head.scale > still.head.scale).mean() > 0.9
    assert len(trained().fit(healthy(1)).healthy_changes()) == 0


def test_a_risen_noise_floor_alone_names_no_fault() -> None:
    rng = np.random.default_rng(1)
    member = recording("normal", 9)
    hiss = rng.normal(0, 0.4, member.signal.shape).astype(np.float32)
    verdict = adapted().diagnose(replace(member, signal=member.signal + hiss))

    assert verdict.verdict in ("unknown", "normal")


@pytest.mark.parametrize("order", [5, 29, 61])
def test_a_line_in_a_risen_noise_floor_is_unknown_as_all_bands_changed_alike(order: int) -> None:
    rng = np.random.default_rng(5)
    member = recording("normal", 9)
    time = np.arange(member.n_samples) / RATE
    line = 0.5 * np.sin(order * rpm(1000) * time)
    signal = member.signal + line + rng.normal(0, 0.3, member.signal.shape)

    verdict = adapted().diagnose(replace(member, signal=signal.astype(np.float32)))
    sentences = (verdict.sentence(), *verdict.notes)

    assert verdict.verdict == "unknown"
    for channel, sentence in zip(member.channels, sentences, strict=True):
        assert re.search(rf"All bands of channel {channel} changed by \+1[56] dB alike", sentence)


def test_a_verdict_on_small_changes_of_lines_states_their_size() -> None:
    model = adapted()
    assert model.head is not None
    quiet = replace(model.head, line_scale=100 * model.head.line_scale)
    verdict = replace(model, head=quiet).diagnose(recording("piston", 9))

    assert verdict.verdict == "unknown"
    assert "(1.5 are needed to name a fault), so piston would be a guess" in verdict.sentence()


def filtered(row: np.ndarray, edge_hz: float, kind: str) -> np.ndarray:
    sections = scipy.signal.butter(4, edge_hz, kind, fs=RATE, output="sos")
    return np.asarray(scipy.signal.sosfilt(sections, row))


def noise(row: np.ndarray, share: float) -> np.ndarray:
    return np.random.default_rng(7).normal(0, share * row.std(), row.size)


@pytest.mark.parametrize("label", ["normal", "piston"])
@pytest.mark.parametrize(
    ("change", "reason"),
    [
        pytest.param(lambda row: noise(row, 1e-4), "channel body_y", id="dead"),
        pytest.param(lambda row: noise(row, 1e-2), "channel body_y", id="cable off"),
        pytest.param(lambda row: filtered(row, 1000, "low"), "noise floor", id="low-pass"),
        pytest.param(lambda row: filtered(row, 300, "low"), "noise floor", id="strong low-pass"),
        pytest.param(lambda row: filtered(row, 500, "high"), "noise floor", id="high-pass"),
        pytest.param(lambda row: 10 * row, "dB alike", id="gain"),
        pytest.param(lambda row: row / 9.81, "dB alike", id="other unit"),
    ],
)
def test_a_changed_sensor_names_no_fault(
    label: str, change: Callable[[np.ndarray], np.ndarray], reason: str
) -> None:
    member = recording(label, 9)
    signal = member.signal.astype(np.float64)
    signal[1] = change(signal[1])
    verdict = adapted().diagnose(replace(member, signal=signal))

    assert verdict.verdict == "unknown"
    assert reason in verdict.sentence()
    assert "which no fault does" in verdict.sentence()


def at_unspecified_speed(speed: float, label: str = "normal") -> Recording:
    """Return a recording at a speed [rev/min], with that of the healthy recordings specified."""
    other = recording(label, 9, condition=CONDITION.replace(speed=rpm(speed)))
    return replace(other, condition=CONDITION)


@pytest.mark.parametrize("label", ["normal", "piston"])
@pytest.mark.parametrize("speed", [880, 900, 970, 1035, 1060, 1100, 1120])
def test_a_speed_that_the_piston_passes_contradict_is_stated(speed: float, label: str) -> None:
    verdict = adapted().diagnose(at_unspecified_speed(speed, label))

    assert verdict.verdict == "unknown"
    assert f"those of {speed} rev/min, not of the specified speed" in verdict.sentence()


def test_the_speed_is_stated_before_the_sensors_that_seem_to_have_changed() -> None:
    other = at_unspecified_speed(1100)
    signal = other.signal.copy()
    signal[1] *= 10
    verdict = adapted().diagnose(replace(other, signal=signal))

    assert "those of 1100 rev/min, not of the specified speed" in verdict.sentence()


@pytest.mark.parametrize("speed", [700, 820, 1150, 1300])
def test_a_speed_too_far_from_the_specified_one_is_not_guessed(speed: float) -> None:
    verdict = adapted().diagnose(at_unspecified_speed(speed))

    assert verdict.verdict == "unknown"
    assert "ran at another speed than specified" in verdict.sentence()
    assert "rev/min" not in verdict.sentence()


def test_a_diagnosis_computes_one_order_spectrum(monkeypatch: pytest.MonkeyPatch) -> None:
    model = adapted()
    n_spectra = 0

    def density(*arguments: Any) -> np.ndarray:
        nonlocal n_spectra
        n_spectra += 1
        return recording_density(*arguments)

    monkeypatch.setattr(prior_head, "recording_density", density)
    model.diagnose(recording("normal", 9))

    assert n_spectra == 1


def test_a_doubled_channel_is_noted() -> None:
    member = recording("normal", 9)
    signal = member.signal.copy()
    signal[2] = 0.5 * np.roll(signal[0], 1)
    verdict = adapted().diagnose(replace(member, signal=signal))

    assert any("contains the signal of channel cover_z, 1 sample later" in n for n in verdict.notes)


@pytest.mark.parametrize("label", list(FAULTS))
def test_no_fault_is_taken_for_a_changed_sensor(label: str) -> None:
    verdict = adapted().diagnose(recording(label, 9))
    assert "which no fault does" not in " ".join((verdict.sentence(), *verdict.notes))


@pytest.mark.parametrize(
    ("probabilities", "sentence"),
    [
        (
            (0.1, 0.05, 0.79, 0.01, 0.02, 0.03),
            "Not certain: cylinder block or normal (cylinder_block 0.790, ",
        ),
        (
            (0.3, 0.0, 0.2, 0.1, 0.35, 0.05),
            "Not certain: valve plate or normal or cylinder block (",
        ),
        ((0.05, 0.05, 0.8, 0.02, 0.03, 0.05), "cylinder_block (cylinder_block 0.800, "),
    ],
)
def test_an_answer_of_a_prior_below_80_percent_is_not_certain(
    probabilities: tuple[float, ...], sentence: str
) -> None:
    by_class = dict(zip(trained().classes, probabilities, strict=True))
    likeliest = max(by_class, key=by_class.__getitem__)
    verdict = Diagnosis("new", "prior", label=likeliest, probabilities=by_class)

    assert verdict.sentence().startswith(sentence)


@pytest.mark.parametrize(
    ("candidates", "channels", "sentence"),
    [
        (
            ("piston", "cylinder_block"),
            ("cover_z", "body_y"),
            "than a repeated recording (77 %): check both parts.",
        ),
        (("cylinder_block", "piston"), ("body_x",), "a sensor at body_y separates them in 72 %."),
        (("piston", "valve_plate"), ("cover_z",), "at the same operating point gives 97 %."),
        (("piston", "normal"), ("cover_z",), ""),
        (("piston",), ("cover_z",), ""),
        (("piston", "cylinder_block"), ("x",), ""),
    ],
)
def test_two_faults_that_are_not_separated_name_what_would_separate_them(
    candidates: tuple[str, ...], channels: tuple[str, ...], sentence: str
) -> None:
    text = describe_separation(candidates, channels)
    assert text.endswith(sentence)
    assert bool(text) == bool(sentence)


def test_an_answer_of_two_faults_holds_their_separation(monkeypatch: pytest.MonkeyPatch) -> None:
    model = adapted()
    probability = np.array([[0.0, 0.0, 0.4, 0.6, 0.0, 0.0]])
    monkeypatch.setattr(prior_head.PriorHead, "predict_proba", lambda head, change: probability)
    verdict = model.diagnose(recording("piston", 9))

    assert verdict.candidates == ("piston", "cylinder_block")
    assert verdict.separation == verdict.notes[0]
    assert verdict.to_dict()["candidates"] == ["piston", "cylinder_block"]
    assert "check both parts" in Suspect.of(verdict).sentence


def test_the_page_and_the_table_of_an_uncertain_prior_begin_with_not_certain() -> None:
    by_class = {"normal": 0.2, "swash_plate": 0.0, "piston": 0.6, "valve_plate": 0.2}
    verdict = Diagnosis("new", "prior", label="piston", probabilities=by_class)
    part = build_diagnosis_part(verdict, "d")

    assert part.verdict == "Not certain: piston or normal"
    assert part.tone == "unsure"
    assert _verdict_row(verdict)[1] == "not certain: piston or normal"


def test_a_single_sensor_and_another_number_of_pistons_are_enough() -> None:
    def first(member: Recording) -> Recording:
        return replace(member, channels=member.channels[:1], signal=member.signal[:1])

    single_sensor = trained().fit([first(member) for member in healthy()])
    assert single_sensor.diagnose(first(recording("normal", 9))).label == "normal"

    nine = trained().fit(healthy(), pistons=9)
    assert nine.n_pumps == 30
    assert nine.bands.piston_count == 9


def test_a_recording_without_a_machine_is_assigned_to_the_only_one() -> None:
    verdict = adapted().diagnose(changed(specimen=None))
    assert verdict.label is not None
    assert "does not specify its machine; A" in verdict.notes[0]


def test_an_adapted_classifier_is_not_adapted_again() -> None:
    with pytest.raises(DataError, match="adapted already"):
        adapted().fit(healthy())


def test_healthy_recordings_of_another_machine_are_not_compared() -> None:
    (first,) = healthy(1)
    of_other_machine = replace(first, specimen="B", recording_id=f"B {first.recording_id}")

    assert len(trained().fit([first, of_other_machine]).healthy_changes()) == 0


def test_an_evaluation_counts_alarms_and_names_by_class() -> None:
    sound, faulty = adapted().evaluate([recording("normal", 8), recording("piston", 9)]).classes

    assert sound.label == "normal"
    assert sound.n_recordings == 1
    assert faulty.n_alarms == 1
    assert faulty.n_correct == 1
    assert faulty.auroc == 1.0
    with pytest.raises(LeakError, match="normal 0 and 2 more had a part in the model"):
        adapted().evaluate(healthy())


def test_a_diagnosis_of_a_baseline_recording_has_a_note() -> None:
    assert "proves nothing" in adapted().diagnose(healthy()[0]).notes[0]


def changed(**values: object) -> Recording:
    return replace(recording("normal", 9), **values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("test", "message"),
    [
        (
            changed(condition=CONDITION.replace(speed=rpm(2000))),
            "2000 rev/min; the prior's virtual pumps run at 344",
        ),
        (
            changed(condition=CONDITION.replace(discharge_pressure=MPa(30))),
            "30 MPa; the prior's virtual pumps run",
        ),
        (
            changed(condition=CONDITION.replace(discharge_pressure=MPa(15))),
            "discharge pressure of 15 MPa",
        ),
        (
            changed(condition=None),
            "specifies no speed, which shaft orders need. Set speed (such as 860 rpm).",
        ),
        (
            changed(condition=None, attributes={"speed": "860 rpm"}),
            "specifies no discharge pressure, which the comparison with healthy recordings "
            "requires. Set pressure (such as 15 MPa).",
        ),
        (
            recording("normal", 9).select_channels(["cover_z", "body_y"]),
            "lacks 1 channel of the healthy recordings; not among its channels: body_x.",
        ),
        (
            changed(channels=("a", "b", "c")),
            "has the channels a, b, c, the healthy recordings have cover_z",
        ),
        (changed(specimen="B"), "No healthy recording is of the machine B, only of A"),
        (changed(sample_rate=2500.0), "sampled at 2500 Hz"),
        (changed(sample_rate=8000.0), "lower rate than the healthy"),
        (changed(unit="g"), "is in g, the healthy recordings are in m/s^2"),
        (recording("normal", 9).slice(0, 4096), "lasts 0.25 s"),
    ],
)
def test_a_recording_that_cannot_be_compared_has_no_verdict(test: Recording, message: str) -> None:
    verdict = adapted().diagnose(test)
    assert verdict.label is None
    assert message in str(verdict.no_verdict)


@pytest.mark.parametrize(
    ("recordings", "message"),
    [
        ([recording("piston", 2)], "needs healthy recordings of the machine"),
        (
            [*healthy(1), replace(recording("piston"), label="cavitation")],
            "does not know the class 'cavitation'",
        ),
    ],
)
def test_unsuitable_baseline_recordings_are_refused(
    recordings: Sequence[Recording], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        trained().fit(recordings)


def test_another_design_is_refused_and_the_shipped_prior_is_at_most_8_megabytes() -> None:
    with pytest.raises(InputError, match="No prior of the design nine-pistons is shipped"):
        PriorClassifier.load("nine-pistons")
    assert all(path.stat().st_size <= 8_000_000 for path in SHIPPED.glob("*.safetensors"))


def test_a_speed_without_a_healthy_recording_has_a_note() -> None:
    verdict = adapted().diagnose(
        recording("normal", 9, condition=CONDITION.replace(speed=rpm(1150)))
    )

    assert "at another speed;" in verdict.notes[0]


def test_a_loaded_classifier_answers_as_the_saved_one(tmp_path: Path) -> None:
    loaded = PriorClassifier.load(adapted().save(tmp_path / "model.safetensors"))
    test = [recording("piston", 9)]

    # the file holds single precision
    assert np.allclose(loaded.predict_proba(test), adapted().predict_proba(test), atol=1e-3)
    assert loaded.manifest == adapted().manifest


def test_a_network_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    path = adapted().save(tmp_path / "model.safetensors")
    unstated = ("levels", "speed", "pressure")
    card, tensors = read_artifact(path, PriorClassifier.KIND, 2, advice="", may_be_nan=unstated)
    tensors["head_outer"] = tensors["head_outer"][:, :-1]
    write_artifact(path, PriorClassifier.KIND, 2, card, tensors, may_be_nan=unstated)

    with pytest.raises(ArtifactError, match="does not fit the classes and band powers"):
        PriorClassifier.load(path)


def test_the_commands_go_from_healthy_recordings_to_a_diagnosis(tmp_path: Path) -> None:
    folder = tmp_path / "pump"
    items = [*healthy(2), recording("piston", 9)]
    files = [f"{number}.h5" for number in range(len(items))]

    for member, file in zip(items, files, strict=True):
        write_recording(member, folder / file)

    write_index(items[:2], files[:2], folder / "recordings.toml")
    model = tmp_path / "model.safetensors"
    trained_by = run("model", "adapt", "25scy14-1b", folder, "--out", model, "--json")

    assert json.loads(trained_by.stdout)["healthy"] == 2

    contradicted = run("model", "adapt", "25scy14-1b", folder, "--pistons", "9", code=3)
    assert "of a pump with 7 pistons" in " ".join(contradicted.stderr.split())
    assert "Specify --pistons" in " ".join(contradicted.stderr.split())

    refused = run("diagnose", "25scy14-1b", folder / "2.h5", code=3)
    assert "adapt it to healthy recordings" in refused.stderr
    result = run("diagnose", model, folder / "2.h5", "--json")
    (verdict,) = json.loads(result.stdout)["diagnoses"]

    assert verdict["label"] == "piston"


def test_the_command_twin_prior_writes_a_prior(tmp_path: Path) -> None:
    out = tmp_path / "prior.safetensors"
    result = run("twin", "prior", "--out", out, "--count", "10", "--json")

    assert json.loads(result.stdout)["pumps"] == 10
    assert PriorClassifier.load(out).virtual is not None

    refused = run("model", "adapt", tmp_path, "25scy14-1b", code=3)
    assert "the pump prior comes first" in " ".join(refused.stderr.split())


def training_recordings() -> list[Recording]:
    """Recordings of a training without a worn piston."""
    recordings = healthy(6)
    for label in ("cylinder_block", "valve_plate"):
        recordings.extend(recording(label, number) for number in range(6))

    return recordings


def informed(**settings: Any) -> FaultClassifier:
    """Return a classifier that uses the prior for faults that it was not trained on."""
    settings = {
        "prior": trained(),
        "validation_fraction": 0.4,
        "error_rate": 0.15,
        "epochs": 1,
        **settings,
    }

    return FaultClassifier("band_powers", window=4096, **settings)


@cache
def without_pistons() -> FaultClassifier:
    return informed().fit(training_recordings())


def test_an_untrained_fault_is_unknown_and_named(tmp_path: Path) -> None:
    classifier = without_pistons()
    assert classifier.resemblance_ is not None
    assert classifier.resemblance_.classes == ("swash_plate", "piston")

    loaded = FaultClassifier.load(classifier.save(tmp_path / "model.safetensors"))
    new = recording("piston", 20)
    answer = loaded.diagnose(new)

    assert answer.unknown
    assert "resembles piston, which was not trained" in answer.sentence()
    assert answer.to_dict() == classifier.diagnose(new).to_dict()

    trained_class = loaded.diagnose(recording("cylinder_block", 20))
    assert not any("resembles" in reason for reason in trained_class.reasons)


def test_a_new_machine_is_compared_with_its_baseline() -> None:
    classifier = without_pistons()
    resemblance = classifier.resemblance_

    assert resemblance is not None

    answer = classifier.diagnose(recording("piston", 20))
    new = replace(recording("piston", 21), specimen="B")

    without_baseline = resemblance.extend_diagnosis(answer, new)
    assert "was not asked for faults that were not trained" in without_baseline.notes[-1]

    adapted = resemblance.with_healthy([replace(member, specimen="B") for member in healthy()])
    assert "resembles piston" in adapted.extend_diagnosis(answer, new).reasons[0]

    doubtful = replace(answer, unknown=False, p_value=0.6, prediction_set=("normal", "valve_plate"))
    extended = adapted.extend_diagnosis(doubtful, new)

    assert extended.is_prior_unknown
    assert extended.sentence().startswith("Unknown: It resembles piston, which was not trained")

    label = str(answer.label)
    sure = replace(doubtful, prediction_set=(label,), probabilities={label: 0.9})

    # a single label in the prediction set outweighs the prior
    assert not adapted.extend_diagnosis(sure, new).unknown

    with pytest.raises(DataError, match="is not healthy"):
        resemblance.with_healthy([new])


def test_a_prior_that_cannot_be_used_is_refused_or_reported() -> None:
    pistons = [recording("piston", number) for number in range(12)]
    everything = [
        *training_recordings(),
        *pistons[:6],
        *(replace(member, label="swash_plate") for member in pistons[6:]),
    ]
    relabeled = [
        replace(member, label="riss") if member.label == "valve_plate" else member
        for member in training_recordings()
    ]
    few = informed(validation_fraction=0.0, error_rate=None)

    assert any(
        "needs 9" in note for note in few.fit([*healthy(2), *training_recordings()[6:9]]).notes_
    )
    with pytest.raises(
        InputError, match=r"does not know the class 'riss', .* fault_of='riss=piston'"
    ):
        few.fit(relabeled)

    with pytest.raises(InputError, match="needs recordings"):
        few.fit(np.zeros((4, 1, 64)), ["a", "a", "b", "b"])
    assert few.fit(everything).resemblance_ is None

    without = few.fit(training_recordings())
    assert without.resemblance_ is None
    assert any("pump prior was left out" in note for note in without.notes_)
