"""Which measurement separates two faults, on virtual pumps that the shipped prior does not hold.

    python benchmarks/fault_separation.py --pumps 120

A network is trained on the shipped virtual pumps and names the faults of further ones. Each fault
is recorded twice at the pump's operating point, once at another pressure and once at another speed,
with four healthy recordings to compare with at each. Two recordings are judged by the product of
their probabilities. Each pair of faults and each set of sensors prints one line of JSON.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy
import torch

from swashtwin.diagnosis import PriorClassifier, prior_head
from swashtwin.foundation import SwashTwinError, random_stream
from swashtwin.pump import OperatingCondition, load_pump
from swashtwin.signals import OrderBands
from swashtwin.synthesis import PumpPrior
from swashtwin.synthesis.pump_prior import Trouble, TroubleSource, draw_drawing
from swashtwin.synthesis.virtual_pump import CELLS, VirtualPump

DESIGN = "25scy14-1b"
FAULTS = ("swash_plate", "cylinder_block", "piston", "valve_plate")
REFERENCES = 4
POINTS = ("one", "repeated", "other_pressure", "other_speed")
SENSORS = ((0,), (1,), (2,), (0, 1, 2))


@dataclass(eq=False)
class MovedPump(VirtualPump):
    """Virtual pump whose recordings are taken at each of `POINTS` in turn."""

    def _draw_conditions(self, count: int) -> list[OperatingCondition]:
        rated = self.drawing.rated
        assert rated is not None
        # The other half of the range of the prior.
        is_slow = self.speed < 0.9 * rated.speed
        is_unloaded = self.pressure < 0.6 * rated.discharge_pressure
        speed = (1.2 if is_slow else 0.6) * rated.speed / self.speed
        pressure = (0.9 if is_unloaded else 0.35) * rated.discharge_pressure / self.pressure

        factors = ((1.0, 1.0), (1.0, 1.0), (1.0, pressure), (speed, 1.0))
        conditions = []
        for number, condition in enumerate(super()._draw_conditions(count)):
            speed_factor, pressure_factor = factors[number // (REFERENCES + len(FAULTS))]
            conditions.append(
                replace(
                    condition,
                    speed=condition.speed * speed_factor,
                    discharge_pressure=condition.discharge_pressure * pressure_factor,
                )
            )
        return conditions


def keep_troubles() -> None:
    """Make a pump show the same fault in each of its recordings."""
    draw = TroubleSource.draw
    drawn: dict[tuple[int, str], Trouble] = {}

    def draw_once(source: TroubleSource, label: str) -> Trouble:
        key = (id(source.rng), label)
        if key not in drawn:
            drawn[key] = draw(source, label)
        return drawn[key]

    TroubleSource.draw = draw_once  # type: ignore[method-assign]


def simulate(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return changes (pump, point, fault, channel, band) and scatters, without the fault's axis."""
    keep_troubles()
    torch.set_num_threads(1)
    prior = PumpPrior(pump=load_pump(DESIGN))
    generators = []  # kept, so that no two have one id
    changes = []
    scatters = []
    for number in range(count):
        rng = random_stream(77, "part", number)
        generators.append(rng)
        drawing = draw_drawing(rng) if number % 2 else prior.pump
        bands = OrderBands(drawing.rotating_group.piston_count)
        highest = int(bands.highest * bands.piston_count) + 1
        labels = (("normal",) * REFERENCES + FAULTS) * len(POINTS)
        try:
            spectra = MovedPump(prior, rng, drawing, highest).spectra(labels)
        except SwashTwinError:
            continue
        powers = bands.log_powers(spectra, 1 / CELLS)
        powers = powers.reshape(len(POINTS), -1, *powers.shape[1:])
        healthy = powers[:, :REFERENCES]
        changes.append(powers[:, REFERENCES:] - healthy.mean(axis=1, keepdims=True))
        scatters.append(healthy.std(axis=1, ddof=1))
    return np.array(changes), np.array(scatters)


def answer(
    prior: PriorClassifier, changes: np.ndarray, scatters: np.ndarray, channels: Sequence[int]
) -> np.ndarray:
    """Return log-probabilities (pump, point, fault, class) with some sensors."""
    assert prior.virtual is not None
    every_pump = np.ones(prior.n_pumps, dtype=bool)
    virtual = prior.virtual.subset(every_pump, list(channels))
    scatter = prior_head._virtual_scatter(virtual)
    values = prior_head._flatten(virtual.change)
    inputs = np.arcsinh(prior_head._divide_by_scatter(values, scatter[virtual.number]))
    is_background = np.isin(virtual.target, (0, len(prior.classes) - 1))
    weight = np.where(is_background, prior_head.BACKGROUND_WEIGHT, 1.0)
    inner, inner_bias, outer, outer_bias = prior_head._train_network(
        inputs, virtual.target, weight, 0
    )

    healthy = prior_head._flatten(virtual.change[virtual.target == 0])
    typical = prior_head._N_PRIOR_SCATTER * np.mean(healthy**2, axis=0)
    own = REFERENCES * scatters[..., channels, :].reshape(*scatters.shape[:2], -1) ** 2
    scale = np.sqrt((typical + own) / (prior_head._N_PRIOR_SCATTER + REFERENCES))
    flat = changes[..., channels, :].reshape(*changes.shape[:3], -1)
    hidden = np.maximum(np.arcsinh(flat / scale[:, :, None]) @ inner + inner_bias, 0)
    logits = (hidden @ outer + outer_bias) / prior_head.TEMPERATURE
    return np.asarray(scipy.special.log_softmax(logits, axis=-1))


def main() -> None:
    """Print the accuracies."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pumps", type=int, default=120, help="virtual pumps")
    changes, scatters = simulate(parser.parse_args().pumps)
    prior = PriorClassifier.load(DESIGN)
    for channels in SENSORS:
        answers = answer(prior, changes, scatters, channels)
        for first, second in combinations(range(len(FAULTS)), 2):
            columns = [prior.classes.index(FAULTS[index]) for index in (first, second)]
            by_point = answers[:, :, [first, second]][..., columns]
            row: dict[str, object] = {
                "sensors": [prior.channels[index] for index in channels],
                "faults": [FAULTS[first], FAULTS[second]],
                "n": 2 * len(changes),
            }
            for point, name in enumerate(POINTS):
                joint = by_point[:, 0] + (by_point[:, point] if point else 0.0)
                is_right = joint.argmax(axis=-1) == np.arange(2)
                row[name] = round(float(is_right.mean()), 3)
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
