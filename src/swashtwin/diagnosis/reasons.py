"""Sentences on what of a recording lies outside the range of the training.

They cover the operating point, the gain, noise floor, lines, offset and similarity of channels, and
the machine.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float64

from swashtwin.learning import (
    MIN_STRETCH_SAMPLES,
    Confidence,
    DeviatingStatistic,
    FittedClassifier,
    TrainingReference,
    deviating_statistics,
    swapped_channels,
)
from swashtwin.pump import PRESSURE_TOLERANCE, is_healthy, values_match

# Relative difference up to which a speed counts as trained. Wider than elsewhere, since it only
# decides whether a reason is given.
_SPEED_TOLERANCE = 0.05

# Level below the training's from which a channel is called nearly silent [dB].
_SILENT_DB = 40.0

# Difference between the changes of level and noise floor up to which a gain explains both [dB].
_GAIN_TOLERANCE_DB = 3.0

# Level of a signal in m/s^2 above that of the same signal in g [dB].
_G_IN_SI_DB = 20 * math.log10(9.80665)

# Distance from `_G_IN_SI_DB` up to which a wrong unit is the likelier cause of a change [dB].
_UNIT_TOLERANCE_DB = 0.7

# Share of a channel that no other channel explains, as -10 log10, from which one signal may be
# recorded twice [dB]: a correlation of 0.99. This rule compares with the training, in which sensors
# beside each other may well correlate by more; `find_doubled_channels` needs no training.
_DUPLICATE_SIMILARITY_DB = 17.0

UNNAMED_MACHINE = "this machine"
"""Machine of healthy recordings that do not specify theirs, and of what is compared with them."""

_MAX_REASONS = 6
_MAX_LISTED_VALUES = 6
_MAX_LISTED_MACHINES = 3


def describe_deviations(
    classifier: FittedClassifier,
    condition: Float64[np.ndarray, " quantity"],
    statistics: Float64[np.ndarray, "channel statistic"],
) -> tuple[str, ...]:
    """Return sentences on what lies outside the training's range, the operating point first.

    Parameters
    ----------
    condition : speed [rad/s] and discharge pressure [Pa]; NaN if not specified.
    statistics : mean `signal_statistics` of the recording.
    """
    reasons = list(_describe_condition(classifier, condition))
    reference = classifier.training_reference
    if reference is None or not np.isfinite(statistics).all():
        return tuple(reasons)

    channels = classifier.layout.channels
    swapped_pair = swapped_channels(reference.statistics, statistics)
    if swapped_pair is not None:
        first, second = (channels[index] for index in swapped_pair)
        reasons.append(
            f"Channels {first} and {second} look swapped: the spectrum of each resembles that of "
            "the other in the training."
        )

    # Nearly all statistics of swapped channels deviate, which adds nothing to that sentence.
    deviations = [
        statistic
        for statistic in deviating_statistics(reference.statistics, reference.specimen, statistics)
        if statistic.channel not in (swapped_pair or ())
    ]
    changes = statistics - np.median(reference.statistics, axis=0)
    for channel in dict.fromkeys(deviation.channel for deviation in deviations):
        of_channel = {
            deviation.statistic: deviation
            for deviation in deviations
            if deviation.channel == channel
        }
        reasons += _describe_channel(
            channels[channel], classifier.layout.unit, of_channel, changes[channel]
        )
    return tuple(reasons[:_MAX_REASONS])


def _describe_condition(
    classifier: FittedClassifier, condition: Float64[np.ndarray, " quantity"]
) -> Iterator[str]:
    speed, pressure = condition.tolist()
    if _is_untrained(pressure, classifier.pressures, PRESSURE_TOLERANCE):
        trained = _list_values([value / 1e6 for value in classifier.pressures])
        yield (
            f"Discharge pressure {pressure / 1e6:.3g} MPa was not trained (trained: {trained} MPa)."
        )
    if _is_untrained(speed, classifier.speeds, _SPEED_TOLERANCE):
        trained = _list_values([value * 30 / math.pi for value in classifier.speeds])
        yield (
            f"Speed {speed * 30 / math.pi:.4g} rev/min was not trained (trained: {trained} "
            "rev/min)."
        )


def _is_untrained(value: float, trained: tuple[float, ...], tolerance: float) -> bool:
    if not trained or math.isnan(value):
        return False
    return not values_match(value, np.array(trained), tolerance).any()


def _list_values(values: list[float]) -> str:
    texts = [f"{value:.4g}" for value in values]
    if len(texts) <= _MAX_LISTED_VALUES:
        return ", ".join(texts)
    return f"{len(texts)} values from {texts[0]} to {texts[-1]}"


def single_machine_classes(reference: TrainingReference) -> tuple[str, ...]:
    """Return the faults that were trained on one machine only.

    Recordings that do not specify their machine count as one machine.
    """
    machines = {label: set[str]() for label in reference.label if not is_healthy(label)}
    for label, specimen in zip(reference.label, reference.specimen, strict=True):
        if label in machines:
            machines[label].add(specimen)
    return tuple(sorted(label for label, names in machines.items() if len(names) < 2))


def describe_basis(
    classifier: FittedClassifier, confidence: Confidence, error_rate: float | None = None
) -> str:
    """Return which recordings calibrated a confidence, and what their machines cannot promise."""
    rate = confidence.error_rate if error_rate is None else error_rate
    limit = "" if classifier.choice is None else classifier.choice.describe_machine_limit(rate)
    return f"{confidence.basis}; {limit}" if limit else confidence.basis


def describe_single_machine_faults(reference: TrainingReference | None) -> str:
    """Describe which faults were trained on one machine only; empty if there are none."""
    faults = () if reference is None else single_machine_classes(reference)
    if not faults:
        return ""
    return (
        f"{', '.join(faults)}: measured on one machine only, so the same faults of another machine "
        "cannot be expected to be recognized. Record each fault on at least two machines, and "
        "specify the machine of each recording (specimen, in the index)."
    )


def describe_untrained_machine(
    reference: TrainingReference | None, specimen: str, *, always: bool
) -> str:
    """Describe that a recording's machine is not in the training; empty if it is.

    Parameters
    ----------
    specimen : the machine; empty if not specified.
    always : whether to do so even if each fault was trained on several machines.
    """
    if reference is None:
        return ""
    trained = sorted(set(reference.specimen) - {""})
    if specimen in trained or not trained:
        return ""
    if not always and not (specimen and single_machine_classes(reference)):
        return ""

    machines = _list_machines(trained)
    if not specimen:
        return (
            f"The recording does not specify its machine, and the training covers {machines}. If "
            "it is of another machine, the difference may be due to the machine."
        )
    subject = "This machine" if specimen == UNNAMED_MACHINE else f"Machine {specimen}"
    return (
        f"{subject} is not in the training, which covers {machines}. Machines differ as "
        f"much as faults do, so the difference need not be a fault. To find out, use healthy "
        f"recordings of {specimen}: in the training, for an anomaly detector, or to adapt a pump "
        "prior (swashtwin model adapt)."
    )


def _list_machines(names: Sequence[str]) -> str:
    """Return the number and the names of machines in order, the first and last of many."""
    if len(names) == 1:
        return f"one machine, {names[0]}"
    if len(names) <= _MAX_LISTED_MACHINES:
        return f"{len(names)} machines: {', '.join(names)}"
    return f"{len(names)} machines, {names[0]} to {names[-1]}"


def describe_missing_comparison(classifier: FittedClassifier) -> str:
    """Describe why a model cannot compare with healthy recordings; empty if it can."""
    reason = _comparison_obstacle(classifier)
    if not reason:
        return ""
    return f"The model does not compare with healthy recordings of a machine: {reason}."


def _comparison_obstacle(classifier: FittedClassifier) -> str:
    """Return what in the training prevents heads on changes from healthy recordings."""
    choice = classifier.choice
    model = classifier.recordings
    reference = classifier.training_reference
    if choice is None:
        return "its network was named, so that no model of whole recordings was trained"
    if model is not None and model.on_changes is not None:
        return ""
    if choice.reason:
        return choice.reason
    if choice.group != "specimen":
        return "it requires recordings of each class on at least two specified machines"
    if model is None or reference is None:
        return f"a recording is shorter than {MIN_STRETCH_SAMPLES} samples. Record longer ones"

    machines = sorted(set(reference.specimen) - set(model.healthy.machines()))
    if machines:
        names = [name or "not specified" for name in machines]
        return (
            "it requires two healthy recordings of each machine, but has fewer of "
            f"{_list_machines(names)}"
        )
    return "a class has synthetic recordings only"


def describe_absent_baseline(classifier: FittedClassifier, specimen: str) -> str:
    """Describe that a model has no healthy recordings of a machine; empty if it has some.

    If they improved the recall in the training's folds, the description has these figures.
    """
    model = classifier.recordings
    choice = classifier.choice
    if model is None or model.on_changes is None or choice is None or model.knows(specimen):
        return ""
    names = sorted(
        "an unnamed machine" if name == UNNAMED_MACHINE else name
        for name in model.healthy.machines()
    )
    machines = _list_machines(names)
    if not specimen:
        return (
            "The recording does not specify its machine (specimen), so that it was not compared "
            f"with healthy recordings of it. The model has some of {machines}."
        )
    absence = (
        f"No healthy recording is of the machine {specimen}, only of {machines}, so that the "
        "recording was not compared with healthy ones."
    )

    without_baseline = choice.head_recalls["without baseline"]
    with_baseline = choice.head_recalls["with baseline"]
    if choice.group != "specimen" or with_baseline <= without_baseline:
        return (
            f"{absence} Correct its machine (specimen), or pass healthy recordings of {specimen}."
        )

    counts = Counter(model.healthy.specimen).values()
    fewest = min(counts)
    most = max(counts)
    n_healthy = f"{fewest}" if fewest == most else f"{fewest} to {most}"
    return (
        f"{absence} Recall on held-out machines: {100 * without_baseline:.0f} % without healthy "
        f"recordings of the machine, {100 * with_baseline:.0f} % with {n_healthy} of them. Pass "
        "some as healthy."
    )


def _describe_channel(
    name: str,
    unit: str,
    deviations: dict[str, DeviatingStatistic],
    change: Float64[np.ndarray, " statistic"],
) -> Iterator[str]:
    """Yield a sentence for each statistic of a channel that lies outside the training's range.

    A changed gain moves level and noise floor alike, and gets one sentence for both.

    Parameters
    ----------
    deviations : statistics outside the range, by name.
    change : change of each statistic from the training's median [dB]: level, noise floor, ...
    """
    level = deviations.get("level")
    floor = deviations.get("noise_floor")
    if level is not None and level.excess < -_SILENT_DB:
        position = _describe_position(level, f"dB re 1 {unit}")
        yield f"Channel {name} is nearly silent: its level is {position}."
        return

    if level is not None and floor is not None:
        has_line_change = "line_share" in deviations
        if _is_gain_change(level, floor, change, has_line_change):
            yield _describe_gain(name, float(change[1]))
            level = None
            floor = None
    if floor is not None:
        position = _describe_position(floor, f"dB re 1 ({unit})²/Hz")
        yield f"The noise floor of channel {name} is {position}."
    if level is not None:
        yield f"The level of channel {name} is {_describe_position(level, f'dB re 1 {unit}')}."

    offset = deviations.get("offset")
    if offset is not None and offset.excess > 0:
        ratio = 10 ** (offset.value / 20)
        max_ratio = 10 ** (offset.high / 20)
        yield (
            f"Channel {name} has an offset of {ratio:.2g} times its fluctuation; in the training "
            f"it was at most {max_ratio:.2g}. Check the sensor's coupling and the amplifier."
        )

    similarity = deviations.get("similarity")
    if (
        similarity is not None
        and similarity.excess > 0
        and similarity.value > _DUPLICATE_SIMILARITY_DB
    ):
        correlation = _correlation(similarity.value)
        max_correlation = _correlation(similarity.high)
        yield (
            f"Channel {name} follows another channel (correlation {correlation:.3f}; at most "
            f"{max_correlation:.3f} in the training). Is one signal recorded twice?"
        )

    lines = deviations.get("line_share")
    if lines is not None:
        yield (
            f"The strongest lines of channel {name} hold {_percent(lines.value):.0f} % of its "
            f"power; in the training they held {_percent(lines.low):.0f} to "
            f"{_percent(lines.high):.0f} %."
        )


def _is_gain_change(
    level: DeviatingStatistic,
    floor: DeviatingStatistic,
    change: Float64[np.ndarray, " statistic"],
    has_line_change: bool,
) -> bool:
    """Whether a gain explains the changes of level and noise floor.

    Both then changed by the same amount, from the training's medians or from its ranges.
    """
    level_change, floor_change = change[:2]
    differences = [level_change - floor_change, level.excess - floor.excess]
    if not has_line_change:
        # Added noise would have changed the share of the lines. Without that, it suffices if the
        # level lies within the training's range once the gain is taken out.
        level_without_gain = level.value - floor_change
        differences.append(max(level.low - level_without_gain, level_without_gain - level.high))
    return any(abs(difference) <= _GAIN_TOLERANCE_DB for difference in differences)


def _describe_gain(name: str, gain_db: float) -> str:
    direction = "higher" if gain_db > 0 else "lower"
    sentence = (
        f"The gain of channel {name} looks {abs(gain_db):.0f} dB {direction} than in the training: "
        "its level and its noise floor both changed."
    )
    if abs(abs(gain_db) - _G_IN_SI_DB) <= _UNIT_TOLERANCE_DB:
        sentence += " That is the factor of 9.81 between g and m/s^2: check the unit of the file."
    return sentence


def _describe_position(statistic: DeviatingStatistic, unit: str) -> str:
    """Describe a statistic against the training's range.

    Such as "14 dB above the training's range (-32 dB re 1 m/s^2; training: -50 to -46)".
    """
    side = "above" if statistic.excess > 0 else "below"
    return (
        f"{abs(statistic.excess):.0f} dB {side} the training's range "
        f"({statistic.value:.0f} {unit}; training: {statistic.low:.0f} to {statistic.high:.0f})"
    )


def _correlation(similarity_db: float) -> float:
    return math.sqrt(1 - 10 ** (-similarity_db / 10))


def _percent(share_db: float) -> float:
    return 100 * 10 ** (share_db / 10)
