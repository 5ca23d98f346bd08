"""A library of changes: what it holds, when a machine learns from it, and what it refuses."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from commandline import run
from saved_kinds import plant
from tiny_prior import write_prior

from swashtwin.diagnosis import (
    ChangeLibrary,
    LibraryPump,
    LibraryUse,
    PriorClassifier,
    fit_with_library,
    join_libraries,
    make_prior,
    measure_library,
    order_band_powers,
    weigh_library,
)
from swashtwin.foundation import DataError, LeakError, MPa, rpm
from swashtwin.pump import Nameplate, load_pump
from swashtwin.recordings import Recording, build_manifest, write_index, write_recording
from swashtwin.signals import OrderBands

PUMP = load_pump("25scy14-1b")
BANDS = OrderBands(7)
CHANNELS = ("x", "y")
SHAPE = (len(CHANNELS), len(BANDS.names))
FAULTS = ("swash_plate", "cylinder_block", "piston", "valve_plate")
PLATE = Nameplate(45e-6, 7, rpm(1500), MPa(25))


# ---- libraries of invented changes, which no waveform shows


@cache
def step(name: str) -> np.ndarray:
    """Return the change of the band powers by a fault."""
    return np.random.default_rng([*name.encode()]).normal(0, 0.1, SHAPE)


@cache
def vague_prior(resemblance_of_faults: float = 0.1) -> PriorClassifier:
    """Return a prior whose faults resemble the true ones a little."""
    rng = np.random.default_rng(1)
    classes = ("normal", *FAULTS, "other")
    n_pumps = 21
    changes = []
    for name in classes:
        resemblance = resemblance_of_faults if name in FAULTS else 0.0
        scattered = rng.normal(0, 0.1, (n_pumps, *SHAPE))
        changes.append(resemblance * step(name) + scattered)
    prior = make_prior(
        np.concatenate(changes),
        np.repeat(classes, n_pumps),
        np.tile(np.arange(n_pumps), len(classes)),
        np.full((n_pumps, *SHAPE), 0.1),
        np.ones(n_pumps, dtype=bool),
        pump=replace(PUMP, sensors=PUMP.sensors[:2]),
        speed=(10.0, 500.0),
        pressure=(1e6, 5e7),
    )
    return replace(prior, channels=CHANNELS)


def spectrum(number: int) -> np.ndarray:
    """Return the healthy spectrum of a machine of one kind."""
    common = np.random.default_rng(5).normal(0, 1.0, SHAPE)
    return common + np.random.default_rng([6, number]).normal(0, 0.1, SHAPE)


def invented_pump(number: int) -> LibraryPump:
    rng = np.random.default_rng([7, number])
    labels = FAULTS * 4
    faulty = np.stack([step(label) for label in labels])
    return LibraryPump(
        name=f"pump {number}",
        nameplate=PLATE,
        channels=CHANNELS,
        spectrum=spectrum(number),
        healthy=rng.normal(0, 0.1, (8, *SHAPE)),
        change=faulty + rng.normal(0, 0.1, faulty.shape),
        label=labels,
        severity=("",) * len(labels),
        manifest={f"pump {number}": (f"{number:032x}",)},
    )


def library(count: int = 4) -> ChangeLibrary:
    return ChangeLibrary(tuple(invented_pump(number) for number in range(count)))


@cache
def machine(resemblance_of_faults: float = 0.1) -> PriorClassifier:
    """Return the prior with the healthy recordings of a machine that is not in the library."""
    rng = np.random.default_rng(8)
    n_healthy = 6
    return replace(
        vague_prior(resemblance_of_faults).for_machine(CHANNELS, "m/s^2"),
        band_powers=spectrum(99) + rng.normal(0, 0.1, (n_healthy, *SHAPE)),
        specimen=("mine",) * n_healthy,
        point_speed=np.full(n_healthy, 100.0),
        point_pressure=np.full(n_healthy, 1e7),
        manifest={"mine": ("f" * 32,)},
    )


@cache
def like_use() -> LibraryUse:
    return weigh_library(machine(), library())


def test_a_library_of_similar_machines_is_used_and_helps() -> None:
    use = like_use()

    assert use.weight > 0
    assert use.n_pumps == 4
    assert use.taught == dict.fromkeys(FAULTS, 16)
    assert set(use.manifest) == {f"pump {number}" for number in range(4)}
    assert use.accuracy[use.weight] > use.accuracy[0] + 0.05
    assert f"{use.accuracy[use.weight]:.2f} with the others" in use.sentence


def test_a_prior_that_knows_nothing_does_not_doubt_the_labels() -> None:
    use = weigh_library(machine(resemblance_of_faults=0.0), library())

    assert use.weight > 0
    assert "exchanged" not in use.sentence


def test_its_changes_raise_the_probability_of_the_right_fault() -> None:
    tests = invented_pump(50).change
    targets = [vague_prior().classes.index(name) for name in FAULTS * 4]

    def probability(model: PriorClassifier) -> float:
        assert model.head is not None
        return float(model.head.predict_proba(tests)[np.arange(len(tests)), targets].mean())

    alone = machine().fit_band_powers()
    assert probability(machine().fit_band_powers(library=like_use().changes)) > probability(alone)


def changed(**values: Callable[[LibraryPump], object]) -> ChangeLibrary:
    """Return the library with other values of each machine."""
    pumps = []
    for pump in library().pumps:
        new_values = {name: function(pump) for name, function in values.items()}
        pumps.append(replace(pump, **new_values))
    return ChangeLibrary(tuple(pumps))


def shuffled(pump: LibraryPump) -> tuple[str, ...]:
    seed = int(pump.name.split()[1])
    return tuple(np.random.default_rng(seed).permutation(pump.label).tolist())


def exchanged(pump: LibraryPump) -> tuple[str, ...]:
    following = dict(zip(FAULTS, (*FAULTS[1:], FAULTS[0]), strict=True))
    return tuple(following[label] for label in pump.label)


def without_last_band(values: np.ndarray) -> np.ndarray:
    shorter = values.copy()
    shorter[..., 60:] = np.nan
    return shorter


@pytest.mark.parametrize(
    ("unsuitable", "reason", "note"),
    [
        pytest.param(library(1), "1 of its 1 machine can be used", "", id="one machine"),
        pytest.param(
            changed(spectrum=lambda pump: pump.spectrum[:, ::-1]),
            "0 of its 4 machines can be used and resemble",
            "",
            id="unlike machines",
        ),
        pytest.param(
            changed(label=shuffled), "does not help|exchanged classes", "", id="shuffled labels"
        ),
        pytest.param(
            changed(label=exchanged),
            "clearly better with exchanged classes",
            "",
            id="exchanged labels",
        ),
        pytest.param(
            changed(channels=lambda pump: ("x", "z")),
            "0 of its 4 machines can be used",
            "it has no channel y",
            id="other sensors",
        ),
        pytest.param(
            changed(
                channels=lambda pump: ("x",),
                spectrum=lambda pump: pump.spectrum[:1],
                healthy=lambda pump: pump.healthy[:, :1],
                change=lambda pump: pump.change[:, :1],
            ),
            "0 of its 4 machines can be used",
            "it has no channel y",
            id="fewer sensors",
        ),
        pytest.param(
            changed(spectrum=lambda pump: without_last_band(pump.spectrum)),
            "0 of its 4 machines can be used",
            "sampled at a lower rate",
            id="lower rate",
        ),
        pytest.param(
            changed(manifest=lambda pump: {pump.name: ("f" * 32,)}),
            "0 of its 4 machines can be used",
            "it is this machine",
            id="the machine itself",
        ),
        pytest.param(
            changed(label=lambda pump: ("cavitation",) * len(pump.label)),
            "0 of its 4 machines can be used",
            "no fault that the prior knows",
            id="unknown faults",
        ),
    ],
)
def test_an_unsuitable_library_is_not_used(
    unsuitable: ChangeLibrary, reason: str, note: str
) -> None:
    use = weigh_library(machine(), unsuitable)

    # Without changes the classifier is that of the prior alone.
    assert use.changes is None
    assert use.weight == 0
    assert not use.manifest
    assert use.sentence.startswith("The library is not used: ")
    assert re.search(reason, use.sentence)
    assert all(note in text for text in use.notes) if note else not use.notes


def test_a_machine_with_more_sensors_teaches_by_those_of_the_adapted_one() -> None:
    def with_third(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values[..., :1, :], values], axis=-2)

    more = changed(
        channels=lambda pump: ("z", *CHANNELS),
        spectrum=lambda pump: with_third(pump.spectrum),
        healthy=lambda pump: with_third(pump.healthy),
        change=lambda pump: with_third(pump.change),
    )

    assert weigh_library(machine(), more).accuracy == like_use().accuracy


# ---- libraries of recordings


def test_a_library_holds_changes_of_band_powers_and_no_waveform(tmp_path: Path) -> None:
    recordings = [
        recording.replace(attributes={"severity": "80 um"}) if recording.label else recording
        for recording in plant()
    ]
    measured = measure_library(recordings, PUMP)
    loaded = ChangeLibrary.load(measured.save(tmp_path / "pumps.safetensors"))
    first = loaded.pumps[0]
    powers = [order_band_powers(recording, BANDS) for recording in recordings[:7]]

    assert [pump.name for pump in loaded.pumps] == ["A", "B", "C"]
    assert first.label == ("piston",) * 3
    assert first.severity == ("80 um",) * 3
    assert first.nameplate.piston_count == 7
    assert np.allclose(first.spectrum, np.mean(powers[:4], axis=0), equal_nan=True)
    expected = powers[4] - np.mean(powers[:4], axis=0)
    assert np.allclose(first.change[0], expected, equal_nan=True)
    assert len(first.healthy) == 4
    assert set(first.manifest) == {recording.recording_id for recording in recordings[:7]}
    assert (tmp_path / "pumps.safetensors").stat().st_size < 200_000


def test_libraries_join_and_a_recording_is_in_one_only() -> None:
    first = measure_library(plant()[:7], PUMP)
    second = measure_library(plant()[7:], PUMP)

    assert [pump.name for pump in join_libraries([first, second]).pumps] == ["A", "B", "C"]
    with pytest.raises(DataError, match=r"hold a recording twice \(recording A 0"):
        join_libraries([first, second, first])


@pytest.mark.parametrize(
    ("recordings", "message"),
    [
        (plant()[:4], "No fault of A was recorded"),
        (plant()[4:7], "No healthy recording of A was recorded"),
        ([plant()[0].replace(label=None)], "has no class"),
        ([plant()[0].replace(synthetic=True)], "is synthetic"),
    ],
)
def test_unsuitable_recordings_are_refused(recordings: list[Recording], message: str) -> None:
    with pytest.raises(DataError, match=message):
        measure_library(recordings, PUMP)


def faults_at_another_speed() -> list[Recording]:
    """Return the recordings of a machine, with its faults at a speed of no healthy one."""
    first, *others = plant()[4:7]
    assert first.condition is not None
    faster = first.condition.replace(speed=rpm(1200))
    faulty = [member.replace(condition=faster) for member in (first, *others)]
    return [*plant()[:4], *faulty]


def test_a_change_of_speed_is_not_learned_as_a_fault(folder: Path) -> None:
    message = r"3 recordings of faults ran at another speed .*\(A 4: 1200 rev/min, healthy: 960 "
    with pytest.raises(DataError, match=message):
        measure_library(faults_at_another_speed(), PUMP)

    # a machine's own faults teach its classifier as well
    prior = PriorClassifier.load(folder / "prior.safetensors")
    with pytest.raises(DataError, match=message):
        prior.fit(faults_at_another_speed())


def test_an_index_is_not_taken_for_a_damaged_library(folder: Path) -> None:
    for index in (folder / "plant", folder / "plant" / "recordings.toml"):
        arguments = (folder / "prior.safetensors", folder / "healthy", "--library", index)
        refused = run("model", "adapt", *arguments, "--out", folder / "none.safetensors", code=3)
        message = " ".join(refused.stderr.split())
        assert "is an index of recordings, not a library" in message
        assert "swashtwin model library" in message


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a plant of three machines, a fourth one's recordings, and a poor prior."""
    folder = tmp_path_factory.mktemp("library")
    fourth = plant("D")
    parts = {"plant": plant(), "healthy": fourth[:4]}
    for name, recordings in parts.items():
        files = [
            write_recording(recording, folder / name / f"{recording.recording_id}.h5")
            for recording in recordings
        ]
        write_index(list(recordings), files, folder / name)
    # Its worn pistons change the vibration in the wrong direction.
    write_prior(folder / "prior.safetensors", plant()[4], plant()[0])
    return folder


def test_the_commands_go_from_a_plant_s_faults_to_another_machine(folder: Path) -> None:
    pumps = folder / "pumps.safetensors"
    model = folder / "model.safetensors"
    run("model", "library", folder / "plant", "--specimen", "A", "--out", folder / "a.safetensors")
    written = run("model", "library", folder / "plant", "--out", pumps, "--json")
    machines = json.loads(written.stdout)["machines"]
    assert [entry["faults"] for entry in machines] == [{"piston": 3}] * 3
    assert machines[0]["severities"] == {"piston": [""] * 3}
    assert machines[0]["nameplate"]["piston_count"] == 7

    arguments = (folder / "prior.safetensors", folder / "healthy", "--library", pumps)
    adapted = run("model", "adapt", *arguments, "--out", model, "--json")
    result = json.loads(adapted.stdout)
    assert result["faults"] == {}
    assert result["recordings"] == [f"D {number}" for number in range(4)]
    use = result["library"]
    assert use["faults"] == {"piston": 9}
    assert len(use["recordings"]) == 21
    assert use["weight"] > 0
    assert use["machines"] == 3
    assert use["accuracy"]["0"] < use["accuracy"][f"{use['weight']:g}"]

    # A recording of the library had a part in the model, so that it proves nothing.
    refused = run("evaluate", model, folder / "plant", code=3)
    assert "21 that the model was trained on" in " ".join(refused.stderr.split())
    diagnosis = run("diagnose", model, folder / "plant" / "A 4.h5", "--json", code=4)
    assert "No healthy recording is of the machine A" in diagnosis.stdout
    twice = (*arguments, "--library", folder / "a.safetensors", "--out", model, "--force")
    refused = run("model", "adapt", *twice, code=3)
    assert "hold a recording twice" in " ".join(refused.stderr.split())


def test_a_machine_may_be_in_one_of_several_indexes(folder: Path) -> None:
    names = ("--specimen", "A", "--specimen", "D")
    out = ("--out", folder / "several.safetensors")
    # D is in the second index, which has no fault of it
    refused = run("model", "library", folder / "plant", folder / "healthy", *names, *out, code=3)
    assert "No fault of D was recorded" in " ".join(refused.stderr.split())

    refused = run("model", "library", folder / "plant", *names, *out, code=3)
    assert "No source has the machine 'D'" in " ".join(refused.stderr.split())
    names = ("--specimen", "Z")
    refused = run("model", "library", folder / "plant", *names, *out, code=3)
    assert "has no recording of the machine 'Z'" in " ".join(refused.stderr.split())


def test_recordings_of_the_library_are_not_scored(folder: Path) -> None:
    prior = PriorClassifier.load(folder / "prior.safetensors")
    networks: list[tuple[int, int]] = []

    def progress(count: int, total: int, activity: str) -> None:
        if activity == "weighing the library":
            networks.append((count, total))

    library = measure_library(plant(), PUMP)
    model, use = fit_with_library(prior, plant("D")[:4], library, progress=progress)

    # the prior alone, and two weights with each of three machines held out
    assert networks == [(count, 7) for count in range(1, 8)]
    assert use.weight > 0
    assert use.taught == {"piston": 9}
    assert not model.taught
    with pytest.raises(LeakError, match="A 4 and 2 more had a part in the model"):
        model.evaluate(plant()[4:7])
    assert build_manifest(plant("D")[:1]).items() <= model.manifest.items()
