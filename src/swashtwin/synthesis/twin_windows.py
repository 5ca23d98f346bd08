"""Windows that nobody measured, made with a twin.

The first floor where physics and learning meet. A synthetic window is the twin's steady acceleration with what varies
from one moment to the next drawn anew, laid over noise as the machine makes it. It carries ``synthetic=True``, which
`evaluate` refuses.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch

from swashtwin.calibration import Posterior
from swashtwin.foundation import InputError, derive_seed, stream
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin, accelerations
from swashtwin.pump import OperatingCondition
from swashtwin.signals import synchronous_signal
from swashtwin.synthesis.background import Background, BackgroundNoise, background_noise
from swashtwin.synthesis.filler import made_windows, require_count
from swashtwin.synthesis.variation import DEFAULT_VARIATION, Variation, drawn

_CHUNK = 64
"""Windows that are made together; memory does not grow beyond them, and an interruption is heard between them."""


def synthesize(
    twin: Twin | Sequence[Twin],
    *,
    label: str,
    count: int,
    like: WindowSet,
    seed: int,
    variation: Variation = DEFAULT_VARIATION,
    background: bool | Background = True,
    posterior: Posterior | Sequence[Posterior] | None = None,
    machines: Sequence[str] | None = None,
) -> WindowSet:
    """Synthetic windows of one class, of the layout and the classes of `like`.

    Parameters
    ----------
    twin : calibrated twin, or several (one for each pump) that take turns.
    label : class of the windows, which must be the twin's.
    count : how many.
    like : measured training windows; they give layout, classes and noise, and must not be test windows.
    seed : addresses every draw.
    variation : what differs from window to window.
    background : what the windows are laid over. ``"spectrum"``, or True: noise with the spectrum of the measured
        windows between the piston-pass lines. ``"residual"``: measured windows less their synchronous part. ``"none"``,
        or False: nothing, the bare model as the paper simulates it.
    posterior : what a calibration leaves open (`Calibration.posterior`), one for each twin: the values, scales and
        sensor path of each window are drawn from it, and `variation` spreads them further as pumps differ from one
        recording to the next. Without, every window has the twin's own.
    machines : specimen that each twin stands for, whose windows alone lend it noise; without, those of all.

    Raises
    ------
    InputError
        The label is not the twin's, the channels differ, there is nothing to take noise from, or there are not as many
        posteriors or machines as twins.
    """
    twins = [twin] if isinstance(twin, Twin) else list(twin)
    _require_agreement(twins, label, count, like)
    known = _known(twins, posterior, count, seed)
    sources = [twins[i % len(twins)] for i in range(count)]
    noises = _noises(twins, like, background, machines)
    time = np.arange(like.length) / like.sample_rate
    signal = np.empty((count, len(like.channels), like.length), dtype=np.float32)
    for start in range(0, count, _CHUNK):
        chunk = range(start, min(start + _CHUNK, count))
        varied = [drawn(known(sources[i], i), variation, seed, i) for i in chunk]
        with torch.no_grad():
            batch = accelerations(varied)
        for i, one, lines in zip(chunk, varied, batch.lines.numpy(), strict=True):
            rng = stream(seed, "window", label, i)
            angle = rng.uniform(0, 2 * np.pi) + one.condition.speed * time
            window = synchronous_signal(lines[:, np.isin(batch.orders, one.orders)], one.orders, angle)
            window = window * np.exp(rng.normal(0, variation.sensor, (len(like.channels), 1)))
            signal[i] = window + noises[i % len(twins)].drawn(rng) if noises else window
    pressure = np.array([one.condition.discharge_pressure for one in sources])
    return made_windows(
        signal,
        like=like,
        name="synthetic",
        label=label,
        pressure=pressure,
        speed=np.array([one.condition.speed for one in sources]),
        specimen=np.array([f"twin of {one.pump.name}" for one in sources]),
        seed=seed,
    )


def _noises(
    twins: Sequence[Twin], like: WindowSet, background: bool | Background, machines: Sequence[str] | None
) -> list[BackgroundNoise]:
    """The noise of each twin's windows; none where they are to be bare."""
    if background in (False, "none"):
        return []
    if machines is not None and len(machines) != len(twins):
        raise InputError(f"{len(machines)} machines for {len(twins)} twins; name one for each.")
    kind: Background = "residual" if background == "residual" else "spectrum"
    own = [None] * len(twins) if machines is None else machines
    keys = [
        (one.condition, one.pump.rotating_group.piston_count, machine) for one, machine in zip(twins, own, strict=True)
    ]
    found: dict[tuple[OperatingCondition, int, str | None], BackgroundNoise] = {}
    for one, key in zip(twins, keys, strict=True):
        if key not in found:
            found[key] = background_noise(like, one, kind, key[-1])
    return [found[key] for key in keys]


def _known(
    twins: Sequence[Twin], posterior: Posterior | Sequence[Posterior] | None, count: int, seed: int
) -> Callable[[Twin, int], Twin]:
    """What makes of a window's twin and number the twin as far as it is known."""
    if posterior is None:
        return lambda twin, index: twin
    posteriors = [posterior] if isinstance(posterior, Posterior) else list(posterior)
    if len(posteriors) != len(twins):
        raise InputError(f"{len(posteriors)} posteriors for {len(twins)} twins; give one for each.")
    turns = -(-count // len(twins))
    points = [
        one.draws(turns, derive_seed(seed, "posterior", twins[0].label, number))
        for number, one in enumerate(posteriors)
    ]

    def known(twin: Twin, index: int) -> Twin:
        turn, number = divmod(index, len(twins))
        return posteriors[number].twin_at(twin, points[number][turn])

    return known


def _require_agreement(twins: Sequence[Twin], label: str, count: int, like: WindowSet) -> None:
    require_count(count)
    if label not in like.classes:
        raise InputError(f"class {label!r} is not among the windows' classes ({', '.join(like.classes)}).")
    for one in twins:
        if one.label != label:
            raise InputError(f"the twin simulates {one.label!r}, not {label!r}; give it a fault of that class.")
        if one.pump.channels != like.channels:
            raise InputError(
                f"the twin's sensors ({', '.join(one.pump.channels)}) are not the windows' channels "
                f"({', '.join(like.channels)}); edit [[sensors]] in the pump file."
            )
        if like.sample_rate < 2 * one.bandwidth:
            raise InputError(
                f"the windows' sample rate ({like.sample_rate:g} Hz) is below twice the twin's bandwidth; use "
                f"bandwidth={like.sample_rate / 2.56:g}."
            )
