"""The rival that learns nothing: levels at known orders, thresholds from healthy windows, a rule from physics."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import FeatureTable, WindowLayout, WindowSet

CERTAIN = 0.96
"""Probability that the rule gives to the class it names; the others share the rest evenly."""


@dataclass(frozen=True, eq=False)
class OrderThreshold:
    """Which class's levels rise above those of healthy windows: a table of signs, and one threshold.

    A window's score for a class is the mean rise over that class's columns, in standard deviations of healthy windows.
    Below the threshold it is normal; above, it is of the class with the highest score.
    """

    classes: tuple[str, ...]
    """Class names, in the order of the probabilities."""
    layout: WindowLayout
    """Sample rate, channels, unit and length that windows must have."""
    manifest: tuple[str, ...]
    """Recordings that gave the thresholds; none may be tested on."""
    features: Callable[[WindowSet], FeatureTable]
    """Levels against the machine's own healthy ones."""
    rule: Mapping[str, tuple[str, ...]]
    """Names of the columns that rise, by class of fault."""
    center: Float[np.ndarray, " fault"]
    """Mean rise of healthy windows over each rule's columns."""
    deviation: Float[np.ndarray, " fault"]
    """Its standard deviation."""
    threshold: float
    """Score above which a window is faulty [standard deviations]."""

    def scores(self, windows: WindowSet) -> Float[np.ndarray, "window fault"]:
        """Score of each window for each class of the rule."""
        if difference := self.layout.difference(windows.layout):
            raise InputError(f"the thresholds were taken from other windows: {difference}.")
        return (_rises(self.features(windows), self.rule) - self.center) / self.deviation

    def predict_proba(self, windows: WindowSet) -> Float[np.ndarray, "window class"]:
        """`CERTAIN` for the class that the rule names, so that several windows of a recording vote."""
        scores = self.scores(windows)
        faults = np.array([self.classes.index(name) for name in self.rule])
        named = np.where(
            scores.max(axis=1) > self.threshold, faults[scores.argmax(axis=1)], self.classes.index("normal")
        )
        probability = np.full((len(windows), len(self.classes)), (1 - CERTAIN) / (len(self.classes) - 1))
        probability[np.arange(len(windows)), named] = CERTAIN
        return probability


def threshold_orders(
    healthy: WindowSet,
    features: Callable[[WindowSet], FeatureTable],
    rule: Mapping[str, tuple[str, ...]],
    *,
    quantile: float = 0.99,
    manifest: tuple[str, ...] = (),
) -> OrderThreshold:
    """Rule whose threshold this share of measured healthy windows stays below.

    Parameters
    ----------
    healthy : measured windows of machines without a fault.
    features : levels, such as `order_levels.AgainstHealthy`.
    rule : columns that rise, by class of fault, such as `rising_orders` gives.
    quantile : share of the healthy windows that are not to raise an alarm.
    manifest : further recordings that had a part in it.

    Raises
    ------
    DataError
        There are fewer than two healthy windows.
    """
    healthy = healthy.subset((healthy.label == "normal") & ~healthy.synthetic)
    if len(healthy) < 2:
        raise DataError("thresholds need two or more measured healthy windows; there are fewer.")
    rises = _rises(features(healthy), rule)
    center, deviation = rises.mean(axis=0), np.maximum(rises.std(axis=0), 1e-9)
    highest = ((rises - center) / deviation).max(axis=1)
    used = sorted({*healthy.recording_id.tolist(), *manifest})
    threshold = float(np.quantile(highest, quantile))
    return OrderThreshold(healthy.classes, healthy.layout, tuple(used), features, rule, center, deviation, threshold)


def rising_orders(table: FeatureTable, windows: WindowSet, *, columns: int = 6) -> dict[str, tuple[str, ...]]:
    """For each class of fault the columns whose median rises most over those of the normal windows.

    Meant for windows of a twin, whose lines are known without a measurement.

    Parameters
    ----------
    table : features of `windows`.
    windows : windows of every class, normal ones among them.
    columns : how many columns of each class.
    """
    normal = np.median(table.values[windows.label == "normal"], axis=0)
    rule = {}
    for name in windows.classes:
        if name == "normal" or not np.any(windows.label == name):
            continue
        rise = np.median(table.values[windows.label == name], axis=0) - normal
        rule[name] = tuple(table.names[column] for column in np.argsort(-rise)[:columns])
    return rule


def _rises(table: FeatureTable, rule: Mapping[str, tuple[str, ...]]) -> Float[np.ndarray, "window fault"]:
    columns_by_name = {name: column for column, name in enumerate(table.names)}
    return np.stack(
        [table.values[:, [columns_by_name[name] for name in columns]].mean(axis=1) for columns in rule.values()], axis=1
    )
