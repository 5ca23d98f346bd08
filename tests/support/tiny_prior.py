"""A pump prior of a few invented pumps, for recordings of any channels."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from swashtwin.diagnosis import make_prior, order_band_powers
from swashtwin.pump import load_pump
from swashtwin.recordings import Recording
from swashtwin.signals import OrderBands

PISTONS = 7
PUMPS = 40


def write_prior(path: Path, healthy: Recording, worn: Recording) -> Path:
    """Write a prior whose piston wear changes band powers as from `healthy` to `worn`.

    Its cylinder block fault changes the bands in reverse order.
    """
    rng = np.random.default_rng(0)
    pump = load_pump("25scy14-1b")
    bands = OrderBands(PISTONS)
    step = np.nan_to_num(order_band_powers(worn, bands) - order_band_powers(healthy, bands))
    classes = {
        "normal": 0 * step,
        "piston": step,
        "cylinder_block": step[:, ::-1],
        "other": -step,
    }
    sizes = np.exp(rng.normal(0, 0.3, (PUMPS, 1, 1)))
    change = np.concatenate([sizes * course for course in classes.values()])
    change = change + rng.normal(0, 0.03, change.shape)
    prior = make_prior(
        change,
        np.repeat(list(classes), PUMPS),
        np.tile(np.arange(PUMPS), len(classes)),
        np.full((PUMPS, *step.shape), 0.05),
        np.ones(PUMPS, dtype=bool),
        pump=replace(pump, sensors=pump.sensors[: len(step)]),
        speed=(10.0, 500.0),
        pressure=(1e6, 5e7),
    )

    return replace(prior, channels=healthy.channels).save(path)
