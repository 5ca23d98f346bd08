"""What the zero-shot study tells: names of its rows, their numbers, and what they mean."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from swashtwin.learning import Scores
from swashtwin_bench.questions.zero_shot_data import (
    CALIBRATED,
    HEALTHY_ONLY,
    NOMINAL,
    ORACLE,
    POSTERIOR,
    SAME,
    UNSEEN,
    ZeroShotSettings,
)
from swashtwin_bench.questions.zero_shot_prior import (
    FOREST,
    OTHER_PRESSURES,
    PRIOR,
    SHOTS,
    at_unseen_pressure,
    few_shot,
)
from swashtwin_bench.results.table import StudyTable, Trial

TREES, TREES_ORDERS, TREES_HEALTHY = "extra trees", "extra trees on orders", "extra trees on orders against healthy"
NET, NET_HEALTHY = "BiTCN", "BiTCN on orders against healthy"
RULE, ENVELOPE_RULE = "order threshold", "envelope threshold"

DRAWN = (*((name, TREES_HEALTHY) for name in (NOMINAL, CALIBRATED, POSTERIOR, ORACLE)), (HEALTHY_ONLY, RULE))
"""Whose confusion matrices the report shows."""

METRICS = {
    "accuracy": "accuracy",
    "balanced_accuracy": "balanced accuracy",
    "g_mean": "G-mean",
    "recording_accuracy": "recordings right",
    "recording_balanced_accuracy": "balanced accuracy by recording",
    "false_alarm_rate": "false alarms",
    "missed_fault_rate": "missed faults",
    "strangers": "balanced accuracy on strangers",
    "discriminator": "AUROC measured/synthetic",
}
"""Headings; the recall of each class follows. ``strangers`` and ``discriminator`` are of the training set, not of a
test."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one classifier scored on one test."""

    training_set: str
    classifier: str
    test: str
    scores: Scores
    recording_recall: float
    strangers: float
    discriminator: float


@dataclass(frozen=True, eq=False)
class Fleet:
    """Everything that came out under one seed."""

    seed: int
    outcomes: tuple[Outcome, ...]
    by_recording: tuple[Trial, ...]
    rules: Mapping[str, Mapping[str, Sequence[str]]]
    roles: Mapping[str, Any]
    origin: str


LEVELS = {
    "no measured fault": "L5",
    f"measured faults, {SAME}": "L2",
    f"measured faults, {UNSEEN}": "L4",
    f"{OTHER_PRESSURES}, {at_unseen_pressure(SAME)}": "L3",
    f"{OTHER_PRESSURES}, {at_unseen_pressure(UNSEEN)}": "L4",
}
"""Level of generalization of the rows, by what teaches and what tests them."""

NOTES = (
    "Severities are log-uniform over a decade around what the literature calls plausible; only the row that says so "
    "knows the rig's. Rows that no measured fault teaches are level L5. Rows that measured faults teach (the oracle, a "
    "few of each fault) are L2 on the same pumps and L4 on others; at the highest pressure, where faults of other "
    "pressures teach, L3 and L4. The pump prior and rows with measured normals have learned from healthy recordings of "
    "the same pumps, so that their normals are L2 there.",
    "Against healthy: less the median of the same machine's own healthy recordings at the same pressure, which every "
    "machine has from its first days; also the pumps without a twin.",
    "Strangers are synthetic windows of twins drawn from the priors: what a choice can rest on before a fault was "
    "measured. The row of prior draws has seen such twins and stays out of the choice.",
    "AUROC measured/synthetic: how well trees on the same features tell measured healthy windows from synthetic "
    "healthy ones, pumps held out; 0.5 is not at all. Where it is near 1 and only the faults are synthetic, a "
    "classifier can learn 'synthetic' for 'faulty'.",
)


def trial_of(outcome: Outcome, seed: int) -> Trial:
    """Its row's numbers."""
    scores = outcome.scores
    values = {
        "accuracy": scores.accuracy,
        "balanced_accuracy": scores.macro_recall,
        "g_mean": scores.g_mean,
        "recording_accuracy": scores.recording_accuracy,
        "recording_balanced_accuracy": outcome.recording_recall,
        "false_alarm_rate": scores.false_alarm_rate,
        "missed_fault_rate": scores.missed_fault_rate,
        "strangers": outcome.strangers,
        "discriminator": outcome.discriminator,
        **{f"recall_{name}": recall for name, recall in scores.recall.items()},
    }
    return Trial(
        {"training_set": outcome.training_set, "classifier": outcome.classifier, "test": outcome.test}, seed, values
    )


def confusions_of(fleets: Sequence[Fleet]) -> list[dict[str, Any]]:
    """Windows by actual and predicted class, all seeds together."""
    summed: dict[tuple[str, str, str], np.ndarray] = {}
    for outcome in (outcome for fleet in fleets for outcome in fleet.outcomes):
        key = (outcome.training_set, outcome.classifier, outcome.test)
        summed[key] = summed.get(key, 0) + outcome.scores.confusion
    return [
        {
            "training_set": key[0],
            "classifier": key[1],
            "test": key[2],
            "drawn": key[:2] in DRAWN,
            "windows": matrix.tolist(),
        }
        for key, matrix in summed.items()
    ]


def choose_zero_shot(study: StudyTable) -> tuple[str, str]:
    """Training set and classifier with the best balanced accuracy on strangers, the only thing known beforehand."""
    rows = {
        (row["training_set"], row["classifier"]): row["strangers"]["mean"] or 0.0
        for row in study.rows()
        if row["training_set"] in (NOMINAL, CALIBRATED, POSTERIOR)
    }
    return max(rows, key=lambda key: rows[key])


def answer_of(study: StudyTable) -> tuple[str, ...]:
    """What came out, in sentences."""
    rows = {(row["training_set"], row["classifier"], row["test"]): row for row in study.rows()}

    def score(training_set: str, classifier: str, test: str = SAME, metric: str = "balanced_accuracy") -> str:
        mean = rows.get((training_set, classifier, test), {}).get(metric, {}).get("mean")
        return "no number" if mean is None else f"{mean:.3f}"

    def pair(training_set: str, classifier: str = FOREST, tests: tuple[str, str] = (SAME, UNSEEN)) -> str:
        return " / ".join(score(training_set, classifier, test, "recording_balanced_accuracy") for test in tests)

    best = choose_zero_shot(study)
    shots = ", ".join(f"{count} of each {pair(few_shot(count))}" for count in SHOTS)
    highest = {
        name: pair(name, tests=(at_unseen_pressure(SAME), at_unseen_pressure(UNSEEN)))
        for name in (PRIOR, f"{PRIOR} and {OTHER_PRESSURES}", OTHER_PRESSURES)
    }
    answer = (
        f"A pump prior and the machine's healthy recordings, no measured fault: balanced accuracy by recording "
        f"{pair(PRIOR)} (same pumps / pumps held out); twins of the pump itself ({best[1]}, {best[0]}) {pair(*best)}; "
        f"taught by measured faults {pair(ORACLE)}. With measured recordings of each fault: {shots}.",
        "At the highest pressure, of which no measured fault teaches (L3 / L4): "
        + "; ".join(f"{name} {scores}" for name, scores in highest.items())
        + ".",
    )
    if not study.settings["calibrated"]:
        return answer
    return (
        *answer,
        f"Chosen on synthetic strangers alone: {best[1]}, trained on {best[0]}; on measured faults it scores a "
        f"balanced accuracy of {score(*best)} on the same pumps and {score(*best, UNSEEN)} on pumps without a twin.",
        f"On the same pumps, trees on orders against healthy: nominal twin {score(NOMINAL, TREES_HEALTHY)}, calibrated "
        f"{score(CALIBRATED, TREES_HEALTHY)}, draws from the posterior {score(POSTERIOR, TREES_HEALTHY)}, measured "
        f"faults (an oracle) {score(ORACLE, TREES_HEALTHY)}; the rule that learns nothing {score(HEALTHY_ONLY, RULE)}, "
        f"on the envelope {score(HEALTHY_ONLY, ENVELOPE_RULE)}.",
        f"Without a comparison with the machine's own healthy recordings the same windows give "
        f"{score(POSTERIOR, TREES_ORDERS)} (orders) and {score(POSTERIOR, TREES)} (the usual features).",
    )


def describe_settings(settings: ZeroShotSettings) -> dict[str, Any]:
    """Settings as JSON can hold them."""
    return {
        "pump": settings.pump.name,
        "window_length": settings.length,
        "windows_per_recording": settings.windows,
        "calibrated": settings.calibrated,
        "specimens_without_twin": settings.held_out,
        "twins_per_pump": settings.draws,
        "windows_per_twin_pressure_class": settings.synthetic,
        "method": type(settings.method).__name__,
        "nuisances": asdict(settings.nuisances),
        "trees": settings.trees,
        "orders": settings.orders,
        "training": asdict(settings.training),
        "network": {"name": "bitcn", **settings.network},
        "order_network": {"name": "bitcn", **settings.order_network},
    }
