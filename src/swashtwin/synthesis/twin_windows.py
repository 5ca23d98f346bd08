"""Windows made with a twin.

The first floor where physics and learning meet. A synthetic window is the twin's steady acceleration with what varies
from one moment to the next drawn anew, laid over noise as the machine makes it; or a measured healthy window with the
change that the fault makes in the twin. It carries ``synthetic=True``, which `evaluate` refuses.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
import torch

from swashtwin.calibration import Calibration, Posterior
from swashtwin.foundation import InputError, derive_seed, stream
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.physics import Twin, accelerations
from swashtwin.pump import Fault, OperatingCondition, is_same_class
from swashtwin.recordings import Recording, join_manifests, usual_window
from swashtwin.signals import synchronous_signal
from swashtwin.synthesis.background import Background, BackgroundNoise, background_noise
from swashtwin.synthesis.fault_change import change_windows
from swashtwin.synthesis.filler import build_windows, require_count
from swashtwin.synthesis.machine_check import require_same_machine
from swashtwin.synthesis.synthetic_windows import SyntheticWindows, comparable_windows
from swashtwin.synthesis.variation import DEFAULT_VARIATION, Variation, draw_twin

_CHUNK = 64
"""Windows simulated at once: this limits memory, and Ctrl-C is handled between chunks."""


def synthesize(
    source: Calibration | Twin,
    fault: Fault | None,
    *,
    count: int,
    like: WindowSet | Iterable[Recording],
    seed: int = 0,
    condition: OperatingCondition | None = None,
    variation: Variation = DEFAULT_VARIATION,
    background: Background = "spectrum",
    window: int | None = None,
) -> SyntheticWindows:
    """Synthetic windows of a fault, labeled with its class; their `fidelity` compares them with measured ones.

    Parameters
    ----------
    source : a calibration, from whose posterior the values of each window are drawn; or a twin, whose values all
        windows share.
    fault : what the windows show; None is a healthy pump. The source need not have been calibrated on it.
    count : how many.
    like : measured training windows, or the training recordings; they give layout, classes and noise, and must not be
        test data.
    seed : addresses every draw.
    condition : operating condition of the windows; by default the source's, which must then be one that the recordings
        state, as far as they state one (`require_same_machine`). Windows of a calibration at several
        operating points take turns among these.
    variation, background : what differs from window to window, and what the windows are laid over, see
        `simulate_windows`.
    window : samples per window where `like` is recordings; by default as in `FaultClassifier` (`usual_window`).

    Raises
    ------
    InputError
        The channels differ, there is nothing to lay the windows over, or the twin is of another pump or operating
        point.

    Examples
    --------
    ``synthesize(calibration, SwashPlateDefect(depth=mm(0.07)), count=150, like=train)``
    """
    require_count(count)
    twin = source.twin if isinstance(source, Calibration) else source
    if not isinstance(twin, Twin):
        raise InputError(f"the source is a {type(source).__name__}; it must be a calibration or a twin.")
    twin = twin.with_fault(fault)
    conditions = [twin.condition] if condition is None else [condition]
    if condition is None and isinstance(source, Calibration):
        conditions = [fit.condition for fit in source.fits]
    is_free = condition is not None
    if not isinstance(like, WindowSet):
        recordings = list(like)
        labels = sorted({recording.label for recording in recordings if recording.label is not None})
        classes = sorted({*labels, _class_among(labels, twin)})
        like = cut_windows(recordings, length=window or usual_window(recordings), classes=classes)
        require_same_machine(twin, conditions, recordings, speed=not is_free, pressure=not is_free)
    else:
        require_same_machine(twin, conditions, like, speed=not is_free, pressure=not is_free)
    twin = replace(twin, bandwidth=min(twin.bandwidth, like.sample_rate / 2.56))
    posterior = [source.posterior] * len(conditions) if isinstance(source, Calibration) else None
    calibrated_on = source.recording_hashes if isinstance(source, Calibration) else {}
    specimen = specimen_among(like, calibrated_on)
    twins = [twin.at(condition) for condition in conditions]
    windows = simulate_windows(
        twins,
        count=count,
        like=like,
        seed=seed,
        variation=variation,
        background=background,
        posterior=posterior,
        specimens=[specimen] * len(twins) if background == "healthy" else None,
    )
    windows = replace(windows, manifest=join_manifests([windows.manifest, calibrated_on]))
    return SyntheticWindows.of(windows, comparable_windows(like, windows, specimen), seed)


def simulate_windows(
    twin: Twin | Sequence[Twin],
    *,
    count: int,
    like: WindowSet,
    seed: int,
    variation: Variation = DEFAULT_VARIATION,
    background: Background = "spectrum",
    posterior: Posterior | Sequence[Posterior] | None = None,
    specimens: Sequence[str | None] | None = None,
) -> WindowSet:
    """Synthetic windows of twins as they are, of the layout and the classes of `like`.

    Parameters
    ----------
    twin : a twin, or several of one class (one for each pump) that take turns.
    count : how many.
    like : measured training windows; they give layout, classes and noise, and must not be test windows.
    seed : addresses every draw.
    variation : what differs from window to window.
    background : what the windows are laid over. ``"spectrum"``: noise with the spectrum of the measured windows between
        the piston-pass lines. ``"residual"``: measured windows less their synchronous part. ``"healthy"``: measured
        healthy windows as they are, to which the twin adds only the fault's change (`fault_change`). ``"none"``:
        nothing, the bare model as the paper simulates it.
    posterior : what a calibration leaves open (`Calibration.posterior`), one for each twin: the values, scales and
        sensor path of each window are drawn from it, and `variation` spreads them further as pumps differ from one
        recording to the next. Without, every window has the twin's own.
    specimens : specimen that each twin stands for, whose windows alone it is laid over; without, or None, those of all.

    Raises
    ------
    InputError
        The twins' class is not among the windows' classes or differs between them, the channels differ, there is
        nothing to lay the windows over, or there are not as many posteriors or specimens as twins.
    """
    twins = [twin] if isinstance(twin, Twin) else list(twin)
    require_count(count)
    _require_agreement(twins, like)
    if specimens is not None and len(specimens) != len(twins):
        raise InputError(f"{len(specimens)} specimens for {len(twins)} twins; name one for each.")
    draw_values = _value_draws(twins, posterior, count, seed)
    if background == "healthy":
        return change_windows(
            twins,
            draw_values,
            label=_class_among(like.classes, twins[0]),
            count=count,
            like=like,
            seed=seed,
            variation=variation,
            specimens=[None] * len(twins) if specimens is None else specimens,
            chunk=_CHUNK,
        )
    sources = [twins[i % len(twins)] for i in range(count)]
    noises = _noises(twins, like, background, specimens)
    time = np.arange(like.length) / like.sample_rate
    signal = np.empty((count, len(like.channels), like.length), dtype=np.float32)
    for start in range(0, count, _CHUNK):
        chunk = range(start, min(start + _CHUNK, count))
        varied = [draw_twin(draw_values(sources[i], i), variation, seed, i) for i in chunk]
        with torch.no_grad():
            batch = accelerations(varied)
        for i, source, lines in zip(chunk, varied, batch.lines.numpy(), strict=True):
            rng = stream(seed, "window", twins[0].label, i)
            angle = rng.uniform(0, 2 * np.pi) + source.condition.speed * time
            window = synchronous_signal(lines[:, np.isin(batch.orders, source.orders)], source.orders, angle)
            window = window * np.exp(rng.normal(0, variation.sensor, (len(like.channels), 1)))
            signal[i] = window + noises[i % len(twins)].draw(rng) if noises else window
    pressure = np.array([source.condition.discharge_pressure for source in sources])
    return build_windows(
        signal,
        like=like,
        name="synthetic",
        label=_class_among(like.classes, twins[0]),
        pressure=pressure,
        speed=np.array([source.condition.speed for source in sources]),
        specimen=np.array([f"twin of {source.pump.name}" for source in sources]),
        seed=seed,
    )


def _noises(
    twins: Sequence[Twin], like: WindowSet, background: Background, specimens: Sequence[str | None] | None
) -> list[BackgroundNoise]:
    """The noise of each twin's windows; none where they are to be bare."""
    if background == "none":
        return []
    names = [None] * len(twins) if specimens is None else specimens
    keys = [
        (twin.condition, twin.pump.rotating_group.piston_count, name) for twin, name in zip(twins, names, strict=True)
    ]
    noises: dict[tuple[OperatingCondition, int, str | None], BackgroundNoise] = {}
    for twin, key in zip(twins, keys, strict=True):
        if key not in noises:
            noises[key] = background_noise(like, twin, background, key[-1])
    return [noises[key] for key in keys]


def _value_draws(
    twins: Sequence[Twin], posterior: Posterior | Sequence[Posterior] | None, count: int, seed: int
) -> Callable[[Twin, int], Twin]:
    """Function from a window's twin and number to the twin with values drawn for that window."""
    if posterior is None:
        return lambda twin, index: twin
    posteriors = [posterior] if isinstance(posterior, Posterior) else list(posterior)
    if len(posteriors) != len(twins):
        raise InputError(f"{len(posteriors)} posteriors for {len(twins)} twins; give one for each.")
    turns = -(-count // len(twins))
    points = [
        item.draws(turns, derive_seed(seed, "posterior", twins[0].label, number))
        for number, item in enumerate(posteriors)
    ]

    def draw_values(twin: Twin, index: int) -> Twin:
        turn, number = divmod(index, len(twins))
        return posteriors[number].twin_at(twin, points[number][turn])

    return draw_values


def specimen_among(like: WindowSet, recordings: Iterable[str]) -> str | None:
    """The one specimen that these recordings are of, as far as windows of them are in `like`; None where unknown."""
    names = set(like.specimen[np.isin(like.recording_id, list(recordings))].tolist()) - {""}
    return str(names.pop()) if len(names) == 1 else None


def _class_among(classes: Sequence[str], twin: Twin) -> str:
    """Name of the twin's class among `classes`, where a healthy pump may be called ``"healthy"``."""
    names = [name for name in classes if is_same_class(name, twin.label)]
    return names[0] if names and twin.label not in names else twin.label


def _require_agreement(twins: Sequence[Twin], like: WindowSet) -> None:
    for twin in twins:
        if _class_among(like.classes, twin) not in like.classes:
            raise InputError(f"class {twin.label!r} is not among the windows' classes ({', '.join(like.classes)}).")
        if twin.label != twins[0].label:
            raise InputError(f"one twin simulates {twins[0].label!r}, another {twin.label!r}; give twins of one class.")
        if twin.pump.channels != like.channels:
            raise InputError(
                f"the twin's sensors ({', '.join(twin.pump.channels)}) are not the windows' channels "
                f"({', '.join(like.channels)}); edit [[sensors]] in the pump file."
            )
        if like.sample_rate < 2 * twin.bandwidth:
            raise InputError(
                f"the windows' sample rate ({like.sample_rate:g} Hz) is below twice the twin's bandwidth; use "
                f"bandwidth={like.sample_rate / 2.56:g}."
            )
