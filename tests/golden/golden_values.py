"""What the golden values are: of the twin, the virtual rig, a calibration, synthetic windows and
classifiers.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from golden_rig import pair_recordings

import swashtwin_bench.rivals.networks  # noqa: F401  (makes the rivals known)
from swashtwin.calibration import GaussNewton, Nuisances, calibrate
from swashtwin.diagnosis import load_classifier, save_classifier
from swashtwin.foundation import MPa, mm, rpm, um
from swashtwin.learning import TrainingSettings, WindowSet, build_network, cut_windows, fit
from swashtwin.physics import Twin
from swashtwin.pump import DamScratch, OperatingCondition, PistonWear, SwashPlateDefect, load_pump
from swashtwin.recordings import Recording, Recordings
from swashtwin.synthesis import synthesize

FAULTS = {
    "normal": None,
    "swash_plate": SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.07)),
    "piston": PistonWear(clearance=um(60)),
    "valve_plate": DamScratch(area=0.8e-6),
}
LINES = 20
"""Lines of a spectrum, from the lowest order that has one."""

NETWORKS: dict[str, dict[str, Any]] = {
    "bitcn": {"stride": 32, "channels": (8, 8)},
    "spectral_bitcn": {"channels": (8, 8), "dilations": (1, 2), "hidden": 16},
}
TOLERANCES = {
    "spectrum": (1e-9, 1e-15),
    "rig_recordings": (1e-9, 1e-12),
    "rig_windows": (1e-7, 1e-9),
    "calibration": (1e-5, 0.0),
    "synthesis": (1e-6, 1e-7),
    "classifiers": (1e-3, 5e-4),
    "extra_trees": (1e-9, 1e-12),
}
"""Relative and absolute tolerance of each golden value.

Windows hold single precision. Probabilities of a trained network differ by up to 1.2e-4 between
instruction sets (DEFAULT, AVX2 and AVX512 of torch); the rest by less than 1e-9.
"""


def twin_of(fault: str) -> Twin:
    """The paper's pump with a fault of `FAULTS`, at 860 rev/min and 15 MPa."""
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
    return Twin(load_pump("25scy14-1b"), condition, FAULTS[fault])


def spectrum() -> dict[str, Any]:
    """Amplitudes [m/s^2] of the first lines of each fault's twin, in three directions."""
    spectra = {}
    for fault in FAULTS:
        twin = twin_of(fault)
        lines = twin.acceleration().abs().numpy()[:, :LINES]
        amplitudes = dict(zip(twin.pump.channels, lines.tolist(), strict=True))
        spectra[fault] = {"orders": twin.orders[:LINES].tolist(), "amplitudes": amplitudes}

    return spectra


def rig_recordings(plant: Sequence[Recording]) -> dict[str, Any]:
    """RMS [m/s^2] and a few samples of each recording of two specimens."""
    return {
        recording.recording_id: {
            "shape": list(recording.signal.shape),
            "rms": rms(recording.signal),
            "samples": recording.signal[:, 100::6000].tolist(),
        }
        for recording in pair_recordings(plant)
    }


def rig_windows(plant: Sequence[Recording]) -> dict[str, Any]:
    """Windows cut from the recordings of two specimens: their facts, RMS and a few samples."""
    return facts_of(cut_windows(pair_recordings(plant), length=2048))


def calibration(plant: Sequence[Recording]) -> dict[str, Any]:
    """The six values of specimen A, healthy, in SI units, by Gauss-Newton from one start."""
    recordings = Recordings(plant).where(label="normal", specimen="A")
    calibrated = calibrate(
        twin_of("normal"),
        recordings,
        method=GaussNewton(starts=1),
        nuisances=Nuisances(),
        phases=False,
    )

    return {estimate.name: estimate.value for estimate in calibrated.estimates}


def synthesis(plant: Sequence[Recording]) -> dict[str, Any]:
    """Synthetic windows of the nominal twin, over noise and over nothing."""
    like = cut_windows(pair_recordings(plant), length=2048)
    settings: dict[str, Any] = {"count": 4, "like": like, "seed": 0}
    return {
        background: facts_of(
            synthesize(
                twin_of("normal"), twin_of("swash_plate").fault, background=background, **settings
            )
        )
        for background in ("spectrum", "none")
    }


def classifiers(plant: Sequence[Recording], folder: Path) -> dict[str, Any]:
    """Probabilities that networks give to a few windows after two epochs, saved and loaded
    again.
    """
    windows = cut_windows(pair_recordings(plant), length=2048)
    probabilities = {}
    for name, shape in NETWORKS.items():
        network = build_network(name, windows.n_channels, len(windows.classes), **shape)
        path = save_classifier(
            fit(network, windows, settings=TrainingSettings(epochs=2), seed=0), folder / name
        )
        classifier = load_classifier(path or folder / name)
        probabilities[name] = classifier.predict_proba(every_tenth(windows)).tolist()

    return probabilities


def extra_trees(plant: Sequence[Recording]) -> list[Any]:
    """Probabilities that extremely randomized trees give to a few windows of other pumps."""
    windows = cut_windows(pair_recordings(plant), length=2048)
    remaining = [
        recording
        for recording in plant
        if recording.specimen == "C" and recording.label in windows.classes
    ]
    network = build_network("extra_trees", windows.n_channels, len(windows.classes), trees=20)
    trees = fit(network, windows, settings=TrainingSettings(epochs=1, normalization="none"), seed=0)

    return trees.predict_proba(
        every_tenth(cut_windows(remaining, length=2048, classes=windows.classes))
    ).tolist()


def facts_of(windows: WindowSet) -> dict[str, Any]:
    """What tells one set of windows from another."""
    return {
        "classes": list(windows.classes),
        "layout": [windows.sample_rate, list(windows.channels), windows.unit, windows.length],
        "count": len(windows),
        "label": windows.label[::7].tolist(),
        "recording_id": windows.recording_id[::7].tolist(),
        "start": windows.start[::7].tolist(),
        "rms": rms(windows.signal.astype(float).transpose(1, 0, 2).reshape(windows.n_channels, -1)),
        "samples": windows.signal[::7, :, 100::1000].astype(float).tolist(),
    }


def every_tenth(windows: WindowSet) -> WindowSet:
    """A few windows of all recordings."""
    return windows.subset(np.arange(0, len(windows), 10))


def rms(signal: np.ndarray) -> list[float]:
    """Root mean square of each channel."""
    values: list[float] = np.sqrt((signal**2).mean(axis=-1)).tolist()
    return values


VALUES: dict[str, Callable[[Sequence[Recording], Path], Any]] = {
    "spectrum": lambda plant, folder: spectrum(),
    "rig_recordings": lambda plant, folder: rig_recordings(plant),
    "rig_windows": lambda plant, folder: rig_windows(plant),
    "calibration": lambda plant, folder: calibration(plant),
    "synthesis": lambda plant, folder: synthesis(plant),
    "classifiers": classifiers,
    "extra_trees": lambda plant, folder: extra_trees(plant),
}
"""Every golden value by name, from the recordings of the rig and a folder to write to."""
