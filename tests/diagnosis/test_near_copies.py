"""An altered copy of a training recording is detected; a new recording of the machine is not."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import butter, resample_poly, sosfilt

from swashtwin.diagnosis import FaultClassifier
from swashtwin.foundation import LeakError
from swashtwin.recordings import Recording, build_manifest, find_copies

RATE = 8000.0
ORDERS = 14.3 * np.arange(1, 100)


def recording(number: int, label: str = "normal") -> Recording:
    """One machine: the same orders at a speed that wanders a little, in other noise."""
    draw = np.random.default_rng(number)
    turns = np.cumsum(1 + 0.001 * draw.normal(size=20000).cumsum() / 100) / RATE
    phase = np.random.default_rng(0).uniform(0, 6, ORDERS.size)
    decay = 0.3 if label == "piston" else 0.6
    size = 1 / np.arange(1, 100) ** decay
    tones = np.sin(2 * np.pi * ORDERS[:, None] * turns + phase[:, None])
    lines = (size[:, None] * tones).sum(axis=0)
    signal = np.stack([lines, 0.5 * lines]) + 0.3 * draw.normal(size=(2, turns.size))

    return Recording(signal, RATE, f"{label} {number}", channels=("x", "y"), label=label)


def spiked(x: np.ndarray) -> np.ndarray:
    x = x.copy()
    x[:, 500] += 1
    return x


def filtered(kind: str, edge: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: sosfilt(butter(4, edge, kind, fs=RATE, output="sos"), x)


def reordered(x: np.ndarray, block: int) -> np.ndarray:
    """Return the blocks of a signal in another order."""
    starts = np.random.default_rng(5).permutation(np.arange(0, x.shape[1], block))
    return np.concatenate([x[:, start : start + block] for start in starts], axis=1)


NOISE = np.random.default_rng(99).normal(size=(2, 20000))
SIZE = 2.0  # about the root mean square
KINDS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "the same": lambda x: x,
    "one sample changed": spiked,
    "one sample appended": lambda x: np.pad(x, ((0, 0), (0, 1))),
    "one sample in front": lambda x: np.pad(x, ((0, 0), (1, 0))),
    "last samples left out": lambda x: x[:, :-7],
    "offset": lambda x: x + 5 * SIZE,
    "drift": lambda x: x + np.linspace(0, 5 * SIZE, x.shape[1]),
    "tiny noise": lambda x: x + 0.01 * SIZE * NOISE,
    "louder": lambda x: 3.7 * x,
    "turned over": lambda x: -x,
    "reversed": lambda x: x[:, ::-1],
    "first half": lambda x: x[:, :10000],
    "last half": lambda x: x[:, 10000:],
    "from the middle": lambda x: x[:, 3333:14444],
    "middle, reversed, louder, offset": lambda x: 2 - 3 * x[:, 14444:3333:-1],
    "low-pass": filtered("lowpass", 1000),
    "high-pass": filtered("highpass", 1000),
    "band-pass": filtered("bandpass", [300, 2500]),
    "half the rate": lambda x: resample_poly(x, 1, 2, axis=1),
    "two thirds of the rate": lambda x: resample_poly(x, 2, 3, axis=1),
    "one and a half times the rate": lambda x: resample_poly(x, 3, 2, axis=1),
    "ten bits": lambda x: np.round(x / np.abs(x).max() * 512),
    "exchanged channels": lambda x: 1.01 * x[::-1],
    "one channel": lambda x: 1.01 * x[1:],
    "blocks of 0.25 s in another order": lambda x: reordered(x, 2000),
    "blocks of 125 samples in another order, louder": lambda x: 1 + 2 * reordered(x, 125),
}
RATES = {
    "half the rate": 1 / 2,
    "two thirds of the rate": 2 / 3,
    "one and a half times the rate": 3 / 2,
}


@pytest.fixture(scope="module")
def manifest() -> dict[str, tuple[str, ...]]:
    return build_manifest([recording(number) for number in range(6)])


@pytest.mark.parametrize("kind", KINDS)
def test_an_altered_copy_is_traced_to_its_original(
    manifest: dict[str, tuple[str, ...]], kind: str
) -> None:
    signal = KINDS[kind](recording(3).signal)
    copy = Recording(
        signal, RATE * RATES.get(kind, 1.0), "new", channels=tuple("xy")[: len(signal)]
    )

    assert find_copies(manifest, build_manifest([copy])) == {"new": "normal 3"}


def beating(draw: np.random.Generator) -> np.ndarray:
    """Lines close together, whose levels rise and fall alike in every recording."""
    time = np.arange(20000) / RATE
    phase = draw.uniform(0, 6)
    lines = []
    for frequency in 95.0 * np.arange(1, 20):
        lines.extend(np.sin(2 * np.pi * frequency * time + k * phase) for k in range(3))
    envelope = 1 + 0.8 * np.sin(2 * np.pi * 2.3 * time + phase)

    return np.sum(lines, axis=0) * envelope + draw.normal(size=time.size)


def impacts(draw: np.random.Generator) -> np.ndarray:
    """An inner ring's damage: a burst at nearly equal times."""
    train = np.zeros(20000)
    times = np.arange(draw.uniform(0, 0.01), 2.4, 1 / 107.3)
    train[(times * RATE + 0.5 * draw.normal(size=times.size)).astype(int).clip(0)] = 10
    ring = np.exp(-np.arange(200) / 30) * np.sin(1.1 * np.arange(200))
    return np.convolve(train, ring)[:20000] + 0.05 * draw.normal(size=20000)


def tones(draw: np.random.Generator) -> np.ndarray:
    """Tones in each band without noise between them, which would tell one recording from
    another.
    """
    time = np.arange(20000) / RATE
    return np.sum(
        [np.sin(2 * np.pi * f * time + draw.uniform(0, 6)) for f in (100, 163.3, 340, 1150, 1480)],
        axis=0,
    )


@pytest.mark.parametrize("kind", [beating, impacts, tones])
def test_steady_recordings_of_one_machine_are_not_copies(
    kind: Callable[[np.random.Generator], np.ndarray],
) -> None:
    made = [
        Recording(
            kind(np.random.default_rng(number))[None],
            RATE,
            f"{number}",
            channels=("x",),
        )
        for number in range(12)
    ]

    assert not find_copies(build_manifest(made[:6]), build_manifest(made[6:]))


def test_other_recordings_of_the_machine_are_no_copies(
    manifest: dict[str, tuple[str, ...]],
) -> None:
    assert not find_copies(
        manifest, build_manifest(recording(number) for number in range(100, 130))
    )


def test_a_copy_is_found_among_more_recordings_than_are_compared_at_a_time(
    manifest: dict[str, tuple[str, ...]],
) -> None:
    remaining_manifest = {name: texts for name, texts in manifest.items() if name != "normal 3"}
    padded = {}
    for name, texts in remaining_manifest.items():
        padded.update({f"{number} of {name}": texts[2:] for number in range(20)})

    listed = {
        **padded,
        **manifest,
        "short": build_manifest([recording(0).slice(0, 9000)])["normal 0"],
    }
    half = recording(3).signal[:, 10000:]
    copies = [
        Recording(2 * half, RATE, "new", ("x", "y")),
        recording(9),
        recording(5).replace(recording_id="other"),
    ]

    assert find_copies(listed, build_manifest(copies[:2])) == {"new": "normal 3"}
    assert find_copies(manifest, build_manifest(copies)) == {
        "new": "normal 3",
        "other": "normal 5",
    }


def test_an_evaluation_refuses_an_altered_copy_and_a_diagnosis_compares_samples_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    train = [recording(0), recording(1), recording(0, "piston"), recording(1, "piston")]
    classifier = FaultClassifier("band_powers", window=1000, epochs=1).fit(train)
    copy = recording(1, "piston")
    copy = copy.replace(recording_id="new", signal=1 + 2 * copy.signal[:, 2000:])

    assert classifier.evaluate([recording(7), recording(8, "piston")]).n_recordings == 2
    with pytest.raises(
        LeakError,
        match="recording new, of the same measurement as piston 1",
    ):
        classifier.evaluate([copy])

    monkeypatch.setattr("swashtwin.recordings.manifest.find_altered_copies", None)
    renamed = recording(1, "piston").replace(recording_id="again")

    assert "this very recording, under the name piston 1" in classifier.diagnose(renamed).notes[0]
    assert not any("very recording" in text for text in classifier.diagnose(copy).notes)


def test_a_recording_of_blocks_of_training_recordings_is_refused() -> None:
    train = [recording(number, label) for label in ("normal", "piston") for number in range(3)]
    classifier = FaultClassifier("band_powers", window=1000, epochs=1).fit(train)
    blocks = [part.signal[:, 4000:7000] for part in train[3:]]
    mixture = train[3].replace(recording_id="new", signal=np.concatenate(blocks, axis=1))

    with pytest.raises(LeakError, match="recording new, of the same measurement as piston"):
        classifier.evaluate([mixture])
