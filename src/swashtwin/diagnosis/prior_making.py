"""A prior from the changes of virtual pumps."""

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from swashtwin.diagnosis.prior_classifier import PriorClassifier
from swashtwin.diagnosis.prior_head import VirtualChanges
from swashtwin.foundation import InputError
from swashtwin.pump import Pump, is_healthy
from swashtwin.signals import OrderBands


def make_prior(
    change: Float[np.ndarray, "recording channel level"],
    label: Shaped[np.ndarray, " recording"],
    number: Int[np.ndarray, " recording"],
    scatter: Float[np.ndarray, "pump channel level"],
    drawn: Bool[np.ndarray, " pump"],
    *,
    pump: Pump,
    speed: tuple[float, float],
    pressure: tuple[float, float],
) -> PriorClassifier:
    """Prior of the changes of virtual pumps (`synthesis.simulate_changes`).

    Parameters
    ----------
    change, label, number, scatter, drawn : as of `synthesis.OrderChanges`, the healthy class first
        and the one of what is none of the faults last; an `InputError` where there are fewer than
        three.
    speed, pressure : ranges of the design's operating points [rad/s, Pa].
    """
    classes = tuple(dict.fromkeys(label.tolist()))
    if len(classes) < 3 or not is_healthy(classes[0]):
        raise InputError(
            "a prior needs three classes at least, the healthy one first and that of unknown faults last; the virtual "
            f"pumps show {', '.join(classes) or 'none'}."
        )
    target = np.array([classes.index(name) for name in label.tolist()], dtype=np.int8)
    change, scatter = change.astype(np.float16), scatter.astype(np.float16)
    return PriorClassifier(
        pump=pump.name,
        bands=OrderBands(pump.rotating_group.piston_count),
        channels=pump.channels,
        classes=classes,
        speed=speed,
        pressure=pressure,
        n_pumps=len(drawn),
        virtual=VirtualChanges(change, target, number.astype(np.int32), scatter, drawn),
    )
