"""What of a recording is outside the training's range, in words: condition, gain, noise floor,
lines, machine.
"""

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float64

from swashtwin.learning import (
    FittedClassifier,
    OutsideFact,
    TrainingReference,
    outside_facts,
    swapped_channels,
)
from swashtwin.pump import PRESSURE_TOLERANCE, is_healthy, values_match

_SPEED_TOLERANCE = 0.05
"""Relative difference up to which a speed was trained at: more than elsewhere, since it only
decides over a note.
"""
_SILENT = 40.0
"""Level below the training's from which a channel is called nearly silent [dB]."""
_SAME_GAIN = 3.0
"""Difference between the changes of level and noise floor, from the training's medians or from its
ranges, up to which a gain explains both [dB].
"""
_UNITS_APART = 20 * math.log10(9.80665)
"""Level of a signal in m/s^2 above that in g [dB]."""
_SAME_FACTOR = 0.7
"""Distance from that level up to which a wrong unit is the likelier cause of a change [dB]."""
_TWICE = 17.0
"""Share of a channel that no other one explains, as -10 log10, beyond which one signal may be
recorded twice [dB]: a correlation of 0.99.
"""
_MOST = 6


def reasons_of(
    classifier: FittedClassifier,
    condition: Float64[np.ndarray, " quantity"],
    facts: Float64[np.ndarray, "channel fact"],
) -> tuple[str, ...]:
    """What is outside the training's range, the operating condition first, then the most unusual.

    Parameters
    ----------
    condition : speed [rad/s] and discharge pressure [Pa]; NaN where not stated.
    facts : mean `signal_facts` of the recording.
    """
    reasons: list[str] = []
    speed, pressure = condition.tolist()
    if _is_new(pressure, classifier.pressures, PRESSURE_TOLERANCE):
        trained = _listed([value / 1e6 for value in classifier.pressures])
        reasons.append(
            f"Discharge pressure {pressure / 1e6:.3g} MPa was never trained ({trained} MPa were)."
        )
    if _is_new(speed, classifier.speeds, _SPEED_TOLERANCE):
        trained = _listed([value * 30 / math.pi for value in classifier.speeds])
        reasons.append(
            f"Speed {speed * 30 / math.pi:.4g} rev/min was never trained ({trained} rev/min were)."
        )
    reference = classifier.training_reference
    if reference is None or not np.isfinite(facts).all():
        return tuple(reasons)
    channels, unit = classifier.layout.channels, classifier.layout.unit
    pair = swapped_channels(reference.facts, facts)
    if pair is not None:
        first, second = (channels[index] for index in pair)
        reasons.append(
            f"Channels {first} and {second} look swapped: the spectrum of each is like the other's in the training."
        )
    outside = [
        fact
        for fact in outside_facts(reference.facts, reference.specimen, facts)
        if fact.channel not in (pair or ())
    ]
    usual = np.median(reference.facts, axis=0)
    for channel in dict.fromkeys(fact.channel for fact in outside):
        changes = {fact.fact: fact for fact in outside if fact.channel == channel}
        reasons += _of_channel(channels[channel], unit, changes, (facts - usual)[channel])
    return tuple(reasons[:_MOST])


def single_machine_classes(reference: TrainingReference) -> tuple[str, ...]:
    """Faults that the training has of one machine only; recordings that state no machine count as
    one.
    """
    machines = {label: set[str]() for label in reference.label if not is_healthy(label)}
    for label, specimen in zip(reference.label, reference.specimen, strict=True):
        if label in machines:
            machines[label].add(specimen)
    return tuple(sorted(label for label, names in machines.items() if len(names) < 2))


def describe_single_machine_faults(reference: TrainingReference | None) -> str:
    """That another machine's faults cannot be expected to be named, in words; empty where they
    can.
    """
    if reference is None or not (few := single_machine_classes(reference)):
        return ""
    return (
        f"{', '.join(few)}: measured on one machine only, so that another machine's faults cannot be expected to be "
        "named. Record each fault on two machines at least, and state which is which (specimen, in the index)."
    )


def another_machine(reference: TrainingReference | None, specimen: str, *, always: bool) -> str:
    """That a recording's machine had no part in the training, in words, and what would help; empty
    where it had.

    Parameters
    ----------
    specimen : the machine; empty where not stated.
    always : also where the training has each fault of several machines.
    """
    trained = sorted({*(() if reference is None else reference.specimen)} - {""})
    if reference is None or specimen in trained or not trained:
        return ""
    if not (always or (specimen and single_machine_classes(reference))):
        return ""
    named = ", ".join(trained) if len(trained) <= 3 else f"{trained[0]} to {trained[-1]}"
    known = f"one, {trained[0]}" if len(trained) == 1 else f"{len(trained)}, {named}"
    if not specimen:
        return f"It states no machine. The training knows {known}: of another one, any difference may be the machine's."
    return (
        f"Its machine, {specimen}, had no part in the training, which knows {known}. Machines differ as much as faults "
        f"do, so this difference need not be a fault. Healthy recordings of {specimen} in the training, a detector of "
        "these alone, or a pump prior adapted to them (swashtwin model adapt) would tell."
    )


def own_healthy_would_help(classifier: FittedClassifier, specimen: str) -> str:
    """What healthy recordings of a machine that the model has none of would buy, in words, by the
    training's folds.
    """
    model, choice = classifier.recordings, classifier.choice
    if model is None or model.on_changes is None or choice is None or model.knows(specimen):
        return ""
    without, with_own = (choice.head_recalls[f"{kind} baseline"] for kind in ("without", "with"))
    if choice.group != "specimen" or with_own <= without:
        return ""
    counts = Counter(model.healthy.specimen)
    few, many = min(counts.values()), max(counts.values())
    return (
        f"No healthy recordings of {specimen or 'its machine'} are known. Of machines left out of the training "
        f"{100 * without:.0f} % of the recordings were named right so, and {100 * with_own:.0f} % compared with "
        f"{few if few == many else f'{few} to {many}'} healthy recordings of their own: give some (--healthy)."
    )


def _of_channel(
    name: str, unit: str, changes: dict[str, OutsideFact], change: Float64[np.ndarray, " fact"]
) -> Iterator[str]:
    """One sentence for each fact of a channel that is outside; one for both where a gain explains
    level and floor.
    """
    level, floor, lines = (changes.get(fact) for fact in ("level", "noise_floor", "line_share"))
    if level is not None and level.excess < -_SILENT:
        yield f"Channel {name} is nearly silent: its level is {_moved(level, f'dB re 1 {unit}')}."
        return
    differences: list[float] = []
    if level is not None and floor is not None:
        differences = [change[0] - change[1], level.excess - floor.excess]
        if lines is None:  # noise would have moved the share of the lines
            without = level.value - change[1]
            differences.append(max(level.low - without, without - level.high))
    if any(difference <= _SAME_GAIN for difference in map(abs, differences)):
        is_unit = abs(abs(change[1]) - _UNITS_APART) <= _SAME_FACTOR
        hint = (
            " That is the factor of 9.81 between g and m/s^2: check the unit of the file."
            if is_unit
            else ""
        )
        yield (
            f"The gain of channel {name} looks {abs(change[1]):.0f} dB {'higher' if change[1] > 0 else 'lower'} than "
            f"in the training: its level and its noise floor both moved.{hint}"
        )
        level = floor = None
    if floor is not None:
        yield f"The noise floor of channel {name} is {_moved(floor, f'dB re 1 ({unit})²/Hz')}."
    if level is not None:
        yield f"The level of channel {name} is {_moved(level, f'dB re 1 {unit}')}."
    offset, likeness = changes.get("offset"), changes.get("likeness")
    if offset is not None and offset.excess > 0:
        times, most = (10 ** (value / 20) for value in (offset.value, offset.high))
        yield (
            f"Channel {name} has an offset of {times:.2g} times its fluctuation; in the training it was {most:.2g} at "
            "most. Check the sensor's coupling and the amplifier."
        )
    if likeness is not None and likeness.excess > 0 and likeness.value > _TWICE:
        now, most = (
            math.sqrt(1 - 10 ** (-value / 10)) for value in (likeness.value, likeness.high)
        )
        yield (
            f"Channel {name} follows another one (correlation {now:.3f}; {most:.3f} at most in the training): is one "
            "signal recorded twice?"
        )
    if lines is not None:
        low, high, share = (
            100 * 10 ** (value / 10) for value in (lines.low, lines.high, lines.value)
        )
        yield (
            f"The strongest lines of channel {name} hold {share:.0f} % of its power; in the training they held "
            f"{low:.0f} to {high:.0f} %."
        )


def _moved(fact: OutsideFact, unit: str) -> str:
    """Such as "14 dB above the training's (-32 dB re 1 m/s^2; the training had -50 to -46)"."""
    return (
        f"{abs(fact.excess):.0f} dB {'above' if fact.excess > 0 else 'below'} the training's ({fact.value:.0f} {unit}; "
        f"the training had {fact.low:.0f} to {fact.high:.0f})"
    )


def _is_new(value: float, trained: tuple[float, ...], tolerance: float) -> bool:
    return (
        bool(trained)
        and not math.isnan(value)
        and not values_match(value, np.array(trained), tolerance).any()
    )


def _listed(values: list[float]) -> str:
    words = [f"{value:.4g}" for value in values]
    return (
        ", ".join(words)
        if len(words) <= 6
        else f"{len(words)} values from {words[0]} to {words[-1]}"
    )
