"""Parts of the page about a model: its training, and its scores or alarms on a test set."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from swashtwin.diagnosis import (
    AlarmScores,
    AnomalyDetector,
    describe_basis,
    describe_single_machine_faults,
)
from swashtwin.foundation import plural
from swashtwin.learning import SPLITS, CandidateChoice, FittedClassifier, Scores
from swashtwin.plot import confusion, figure_style, format_label
from swashtwin.report.drawing import Drawing, render_drawing, tabulate
from swashtwin.report.page import Bullets, Group, Part, Section, SectionOrder, Table, Tone
from swashtwin.report.wording import (
    add_bar_values,
    build_facts_table,
    format_number,
    format_number_cell,
    format_percent,
)

_NOT_A_TEST = (
    "Scores of a training are not a test: evaluate the model on recordings that were not part of "
    "it."
)
_DIAGNOSE_ACTION = "Use it: swashtwin diagnose MODEL FILE --report page.html."


def build_training_part(classifier: FittedClassifier, key: str) -> Part:
    """Return the part of the page about one classifier."""
    choice = classifier.choice
    confidence = classifier.confidence
    if confidence is None:
        basis = (
            "The model's confidence is not calibrated: its scores rank the classes and are not "
            "probabilities."
        )
    else:
        rate = format_percent(confidence.error_rate)
        recordings = describe_basis(classifier, confidence)
        basis = f"Its confidence is calibrated at an error rate of {rate} by {recordings}."

    certainty = [basis]
    few_machines = describe_single_machine_faults(classifier.training_reference)
    if few_machines:
        certainty.append(few_machines)
    certainty.append(_NOT_A_TEST)

    sections = [
        Section(SectionOrder.TRAINING, "Training data of the model", _training_blocks(classifier))
    ]
    if choice and choice.trials:
        trials = Section(
            SectionOrder.SCORES, "Candidates that were tried", build_choice_blocks(choice)
        )
        sections.insert(0, trials)

    summary = {
        "classes": list(classifier.classes),
        "network": classifier.network.name,
        "recordings": sorted(classifier.manifest),
        "seed": classifier.seed,
        "choice": None if choice is None else choice.to_dict(),
    }
    n_recordings = plural(len(classifier.manifest), "recording")
    return Part(
        title="Training of a model",
        answer=() if choice is None else (choice.sentence(),),
        sections=tuple(sections),
        results={"trainings": [summary]},
        verdict=f"A model of {len(classifier.classes)} classes, from {n_recordings}",
        certainty=tuple(certainty),
        actions=(
            "Test it on recordings that were not part of the training: swashtwin evaluate MODEL "
            "INDEX --report FOLDER.",
            "Then diagnose new recordings: swashtwin diagnose MODEL FILE --report page.html.",
        ),
        facts=(("Classes", ", ".join(map(format_label, classifier.classes))),),
    )


def build_detector_part(detector: AnomalyDetector) -> Part:
    """Return the part of the page about one detector of deviations; it has no figures."""
    baseline = detector.fitted_
    rate = format_percent(detector.error_rate_)
    entries = [
        ("healthy recordings", baseline.n_recordings),
        ("machines and operating points", len(baseline.points)),
        ("band powers compared", len(detector.layout.band_powers)),
        ("channels", list(detector.layout.channels)),
        ("sample rate", f"{detector.layout.sample_rate:g} Hz"),
    ]

    blocks = (
        Bullets("Notes", detector.notes_),
        build_facts_table("Training data and settings of the detector.", entries),
    )

    results = {"error_rate": detector.error_rate_, "recordings": sorted(detector.manifest)}
    return Part(
        title="Training of a detector of deviations",
        answer=(
            "It was trained on healthy recordings alone: it raises an alarm, but names no fault.",
        ),
        sections=(Section(SectionOrder.TRAINING, "Training of the detector", blocks),),
        results={"detectors": [results]},
        verdict=f"A detector from {plural(baseline.n_recordings, 'healthy recording')}",
        certainty=(
            f"Its false-alarm rate is {rate} for healthy recordings like these, of the machines "
            "and operating points that were recorded; for others it gives no verdict.",
        ),
        actions=(
            "Judge new recordings: swashtwin diagnose MODEL FILE --report page.html.",
            "Add healthy recordings of other speeds, pressures and oil temperatures, and train "
            "again.",
        ),
    )


def _training_blocks(classifier: FittedClassifier) -> tuple[Table, ...]:
    """Return the tables of a training: its recordings and the model."""
    layout = classifier.layout
    duration = format_number(layout.length / layout.sample_rate)
    entries = [
        ("network", classifier.network.name),
        ("window", f"{layout.length} samples, {duration} s"),
        ("sample rate", f"{layout.sample_rate:g} Hz"),
        ("channels", list(layout.channels)),
        ("pressures [MPa]", [format_number(value / 1e6) for value in classifier.pressures]),
        ("speeds [rev/min]", [format_number(value * 30 / np.pi) for value in classifier.speeds]),
        ("epochs", classifier.history[-1].number if classifier.history else None),
        ("seed", classifier.seed),
    ]
    facts = build_facts_table("The model.", entries)

    reference = classifier.training_reference
    if reference is None:
        return (facts,)

    counts = Counter(zip(reference.label, reference.specimen, strict=True))
    machines = sorted(set(reference.specimen))
    rows = tuple(
        (format_label(label), *(counts[label, machine] or "–" for machine in machines))
        for label in dict.fromkeys(reference.label)
    )
    header = ("class", *(machine or "machine not specified" for machine in machines))
    recordings = Table("Measured recordings of the training, by class and machine.", header, rows)
    return (recordings, facts)


def build_choice_blocks(choice: CandidateChoice | None) -> tuple[str | Table | Group, ...]:
    """Return how a model was chosen, if training chose it."""
    if choice is None:
        return ()

    rows = []
    for trial in choice.trials:
        name = trial.candidate
        if trial.candidate == choice.candidate:
            name += " (selected)"
        recalls = format_percent(trial.clean), format_percent(trial.disturbed)
        rows.append((name, *recalls, "yes" if trial.is_tied else ""))
    for head, recall in choice.head_recalls.items():
        rows.append((f"whole recordings: {head}", format_percent(recall), "–", ""))
    if not rows:
        return (choice.sentence(),)

    caption = (
        f"Candidates of the training: macro recall on recordings of held-out {choice.group}s, "
        f"{plural(choice.n_folds, 'fold')}. The selected one is as good as the best within one "
        "standard error."
    )
    header = ("candidate", "as measured", "with noise, gain, speed", "as good as the best")
    return (choice.sentence(), Table(caption, header, tuple(rows)))


_METRIC_LABELS = {
    "accuracy": "accuracy",
    "recording_accuracy": "accuracy by recording",
    "macro_recall": "macro recall (balanced accuracy)",
    "macro_f1": "macro F1",
    "g_mean": "G-mean (of all declared classes)",
    "g_mean_laplace": "G_ε (with Laplace recalls)",
    "false_alarm_rate": "false alarms: normal windows classified as faulty",
    "missed_fault_rate": "missed faults: faulty windows classified as normal",
    "macro_auroc": "macro AUROC",
    "calibration_error": "expected calibration error",
}

# Accuracy by recording from which a test is shown as good news.
_GOOD_ACCURACY = 0.9

# Test recordings below which more are recommended.
_MIN_TEST_RECORDINGS = 20


def build_scores_part(scores: Scores, key: str) -> Part:
    """Return the part of the page about one set of scores."""
    n_right = round(scores.recording_accuracy * scores.n_recordings)
    count = f"{n_right} of"
    if n_right == scores.n_recordings:
        count = "All"

    tone: Tone = "unsure"
    if scores.recording_accuracy >= _GOOD_ACCURACY:
        tone = "good"
    return Part(
        title="Test of a model",
        answer=_describe_weakest_class(scores),
        sections=(Section(SectionOrder.SCORES, "Scores", _score_blocks(scores, key)),),
        results={"scores": [scores.to_dict()]},
        verdict=f"{count} {plural(scores.n_recordings, 'recording')} classified correctly",
        tone=tone,
        certainty=(_describe_accuracy(scores), _describe_mistakes(scores)),
        actions=_recommend_actions(scores),
    )


def _score_blocks(scores: Scores, key: str) -> tuple[Any, ...]:
    """Return the tables and the figure of the scores."""
    metrics = tuple(
        (
            label,
            format_number_cell(getattr(scores, name), format_label(scores.reasons.get(name, ""))),
        )
        for name, label in _METRIC_LABELS.items()
    )

    # the same reasons as the tooltips, which a printed page does not show
    reasons = tuple(
        f"{_METRIC_LABELS.get(name, format_label(name))}: {format_label(reason)}"
        for name, reason in scores.reasons.items()
    )

    return (
        Table(
            "Scores over the test windows.", ("", scores.split or "split not specified"), metrics
        ),
        Bullets("Why a number is missing (—) or rests on too few windows (*)", reasons),
        _class_table(scores),
        draw_confusion(
            f"{key}_confusion",
            {(scores.split or "", ""): scores.confusion},
            scores.classes,
            caption="Windows of each actual class in percent; rows add up to 100.",
        ),
    )


def _describe_accuracy(scores: Scores) -> str:
    """Return the accuracy with its interval and the split."""
    low, high = scores.accuracy_interval
    interval = "no interval"
    if math.isfinite(low):
        interval = f"95 % interval over the recordings {100 * low:.1f} to {100 * high:.1f} %"
    split = "The split between training and test was not specified."
    if scores.split:
        split = f"Split: {scores.split} ({SPLITS[scores.split]})."
    return (
        f"Of {plural(scores.n_windows, 'measured test window')} from "
        f"{plural(scores.n_recordings, 'recording')}, {100 * scores.accuracy:.1f} % were "
        f"classified correctly ({interval}); of the recordings, "
        f"{100 * scores.recording_accuracy:.1f} %. {split}"
    )


def _describe_mistakes(scores: Scores) -> str:
    """Return the rates of false alarms and missed faults."""

    def rate(share: float) -> str:
        if not math.isfinite(share):
            return "—"
        return f"{format_number(100 * share)} %"

    return (
        f"False alarms: {rate(scores.false_alarm_rate)} of the healthy windows. Missed faults: "
        f"{rate(scores.missed_fault_rate)} of the faulty ones."
    )


def _find_weakest_class(scores: Scores) -> str | None:
    """Return the class with the lowest recall; `None` if all have a recall of 1, or none has
    one.
    """
    recalls = [(recall, name) for name, recall in scores.recall.items() if math.isfinite(recall)]
    if not recalls or min(recalls)[0] == 1:
        return None
    return min(recalls)[1]


def _describe_weakest_class(scores: Scores) -> tuple[str, ...]:
    """Return a sentence on the class with the lowest recall, and the class it is mistaken for;
    nothing if there is none.
    """
    name = _find_weakest_class(scores)
    if name is None:
        return ()

    index = scores.classes.index(name)
    mistakes = scores.confusion[index].copy()
    mistakes[index] = 0
    mistaken_for = (*scores.classes, "no verdict")[int(mistakes.argmax())]
    return (
        f"Weakest class: {format_label(name)}, {100 * scores.recall[name]:.0f} % of its windows "
        f"classified correctly, most of the others as {format_label(mistaken_for)}.",
    )


def _recommend_actions(scores: Scores) -> tuple[str, ...]:
    """Return what would improve the result, or make it more certain."""
    actions = []
    if scores.n_recordings < _MIN_TEST_RECORDINGS:
        actions.append(f"Test on more recordings: {scores.n_recordings} leave a wide interval.")
    weakest = _find_weakest_class(scores)
    if weakest is not None:
        actions.append(
            f"Record more of the class {format_label(weakest)}, or add synthetic windows of it "
            "(swashtwin synthesize)."
        )
    return (*actions, _DIAGNOSE_ACTION)


def _class_table(scores: Scores) -> Table:
    """Return the recall by class and discharge pressure, and by class if it has several."""
    rows = []
    for cell in scores.cells:
        pressure = "unknown"
        if cell.discharge_pressure is not None:
            pressure = add_bar_values(f"{cell.discharge_pressure / 1e6:g} MPa")
        recall_cell = format_number_cell(cell.recall)
        rows.append((format_label(cell.label), pressure, cell.n_windows, recall_cell))

    # a class with one cell needs no row for all of its pressures
    cell_counts = Counter(cell.label for cell in scores.cells)
    for index, label in enumerate(scores.classes):
        if cell_counts[label] != 1:
            recall = scores.recall[label]
            reason = f"no test window of {format_label(label)}" if math.isnan(recall) else ""
            n_windows = int(scores.confusion[index].sum())
            rows.append((format_label(label), "all", n_windows, format_number_cell(recall, reason)))

    header = ("class", "absolute pressure", "windows", "recall")
    return Table("Recall by class and discharge pressure.", header, tuple(rows))


@figure_style()
def draw_confusion(
    name: str,
    matrices: Mapping[tuple[str, str], np.ndarray],
    classes: Sequence[str],
    *,
    caption: str,
) -> Drawing:
    """Draw a grid of confusion matrices: windows by actual (row) and predicted class, by (row,
    column of the grid).

    A column beyond the classes counts the windows without a verdict.
    """
    n_columns = max(np.shape(matrix)[1] for matrix in matrices.values())
    predictions = [*classes, *["no verdict"] * (n_columns - len(classes))]

    rows = []
    for (grid_row, grid_column), matrix in matrices.items():
        for actual, counts in zip(classes, matrix, strict=True):
            rows += [
                {
                    "row": grid_row,
                    "column": grid_column,
                    "actual": actual,
                    "predicted": predicted,
                    "windows": count,
                }
                for predicted, count in zip(predictions, counts, strict=False)
            ]

    descriptions = [_describe_matrix(key, matrix, classes) for key, matrix in matrices.items()]
    return render_drawing(
        name,
        confusion(matrices, classes),
        tabulate(rows),
        title="Confusion matrix" if len(matrices) == 1 else "Confusion matrices",
        caption=caption,
        description=". ".join(filter(None, descriptions)),
    )


def _describe_matrix(key: tuple[str, str], counts: np.ndarray, classes: Sequence[str]) -> str:
    """Return the share of each class that was classified correctly, for a screen reader."""
    total = np.asarray(counts).sum(axis=1)
    shares = [
        f"{format_label(label)} {100 * counts[index][index] / total[index]:.0f} %"
        for index, label in enumerate(classes)
        if total[index]
    ]
    if not shares:
        return ""
    position = ", ".join(filter(None, key))
    if position:
        position = f" ({position})"
    return f"Classified correctly{position}: {', '.join(shares)}"


def build_alarms_part(scores: AlarmScores) -> Part:
    """Return the part of the page about the alarms on one test set; it has no figures."""
    healthy = [alarms for alarms in scores.classes if alarms.is_healthy]
    faulty = [alarms for alarms in scores.classes if not alarms.is_healthy]

    answer = [
        f"Of {plural(alarms.n_recordings, 'healthy recording')}, {alarms.n_alarms} raised a false "
        "alarm."
        for alarms in healthy
    ]
    if not healthy:
        answer = ["No healthy recording was tested, so this test does not measure false alarms."]

    verdict = "No fault tested"
    if faulty:
        n_alarms = sum(alarms.n_alarms for alarms in faulty)
        n_recordings = sum(alarms.n_recordings for alarms in faulty)
        verdict = f"{n_alarms} of {plural(n_recordings, 'faulty recording')} raised an alarm"

    certainty: tuple[str, ...] = ()
    if scores.error_rate is not None:
        rate = format_percent(scores.error_rate)
        certainty = (f"The detector specifies a false-alarm rate of {rate}.",)

    actions = [_DIAGNOSE_ACTION]
    if not healthy:
        actions.insert(0, "Test it on healthy recordings that were not part of its training.")

    return Part(
        title="Test of alarms",
        answer=tuple(answer),
        sections=(Section(SectionOrder.SCORES, "Alarms", (_alarms_table(scores),)),),
        results={"alarms": [scores.to_dict()]},
        verdict=verdict,
        certainty=certainty,
        actions=tuple(actions),
    )


def _alarms_table(scores: AlarmScores) -> Table:
    """Return the alarms by class."""
    rows = []
    for alarms in scores.classes:
        low, high = alarms.interval
        rows.append(
            (
                format_label(alarms.label),
                alarms.n_recordings,
                alarms.n_no_verdict,
                alarms.n_alarms,
                _format_if_defined(alarms.alarm_rate, format_percent),
                f"{format_percent(low)} to {format_percent(high)}",
                _format_if_defined(alarms.auroc, format_number),
            )
        )
    return Table(
        "Alarms by class. AUROC is of the class against the healthy recordings.",
        ("class", "recordings", "no verdict", "alarms", "alarm rate", "95 % interval", "AUROC"),
        tuple(rows),
    )


def _format_if_defined(value: float | None, formatted: Callable[[float], str]) -> str:
    if value is None:
        return "–"
    return formatted(value)
