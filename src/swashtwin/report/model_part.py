"""Parts of the page about a model: its training, and its scores or alarms on a test set."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from swashtwin.diagnosis import AlarmScores, AnomalyDetector, describe_single_machine_faults
from swashtwin.foundation import plural
from swashtwin.learning import SPLITS, Choice, FittedClassifier, Scores
from swashtwin.plot import confusion, figure_style, format_label
from swashtwin.report.drawing import Drawing, render_drawing, tabulate
from swashtwin.report.page import Bullets, Group, Part, Section, SectionOrder, Table
from swashtwin.report.wording import (
    add_bar_values,
    build_facts_table,
    format_number,
    format_number_cell,
    format_percent,
)

_NO_TEST = (
    "Shares of a training are no test: evaluate the model on recordings that had no part in it."
)


def build_training_part(classifier: FittedClassifier, key: str) -> Part:
    """Part of the page about one classifier."""
    choice, confidence = classifier.choice, classifier.confidence
    basis = "The model's confidence is not calibrated: its scores rank the classes and are no probabilities."
    if confidence is not None:
        rate = format_percent(confidence.error_rate)
        basis = f"Its confidence is calibrated by {confidence.basis}, at an error rate of {rate}."
    tried = (
        (Section(SectionOrder.SCORES, "What was tried", build_choice_blocks(choice)),)
        if choice and choice.trials
        else ()
    )
    summary = {
        "classes": list(classifier.classes),
        "network": classifier.network.name,
        "recordings": sorted(classifier.manifest),
        "seed": classifier.seed,
        "choice": None if choice is None else choice.to_dict(),
    }
    return Part(
        title="Training of a model",
        answer=(() if choice is None else (choice.sentence(),)),
        sections=(
            *tried,
            Section(
                SectionOrder.TRAINING, "What the model was trained on", _training_blocks(classifier)
            ),
        ),
        results={"trainings": [summary]},
        verdict=f"A model of {len(classifier.classes)} classes, from {plural(len(classifier.manifest), 'recording')}",
        certainty=(
            basis,
            *filter(None, (describe_single_machine_faults(classifier.training_reference),)),
            _NO_TEST,
        ),
        actions=(
            "Test it on recordings that had no part in it: swashtwin evaluate MODEL INDEX --report FOLDER.",
            "Then diagnose new recordings: swashtwin diagnose MODEL FILE --report page.html.",
        ),
        facts=(("Classes", ", ".join(map(format_label, classifier.classes))),),
    )


def build_detector_part(detector: AnomalyDetector) -> Part:
    """Part of the page about one detector of deviations; it has no figures."""
    healthy = detector.fitted_
    entries = [
        ("healthy recordings", healthy.n_recordings),
        ("machines and operating points", len(healthy.points)),
        ("levels compared", len(detector.layout.band_powers)),
        ("channels", list(detector.layout.channels)),
        ("sample rate", f"{detector.layout.sample_rate:g} Hz"),
    ]
    blocks = (
        Bullets("Notes", detector.notes_),
        build_facts_table("What the detector was made of.", entries),
    )
    return Part(
        title="Training of a detector of deviations",
        answer=(
            "It was made from healthy recordings alone: it raises an alarm, and names no fault.",
        ),
        sections=(Section(SectionOrder.TRAINING, "What it was made of", blocks),),
        results={
            "detectors": [
                {"error_rate": detector.error_rate_, "recordings": sorted(detector.manifest)}
            ]
        },
        verdict=f"A detector from {plural(healthy.n_recordings, 'healthy recording')}",
        certainty=(
            f"Its false-alarm rate is {format_percent(detector.error_rate_)} of the healthy recordings like these, at the "
            "machines and operating points that were recorded; elsewhere it gives no verdict.",
        ),
        actions=(
            "Judge new recordings: swashtwin diagnose MODEL FILE --report page.html.",
            "Add healthy recordings of other speeds, pressures and oil temperatures, and train again.",
        ),
    )


def _training_blocks(classifier: FittedClassifier) -> tuple[Table, ...]:
    layout, reference = classifier.layout, classifier.training_reference
    entries = [
        ("network", classifier.network.name),
        (
            "window",
            f"{layout.length} samples, {format_number(layout.length / layout.sample_rate)} s",
        ),
        ("sample rate", f"{layout.sample_rate:g} Hz"),
        ("channels", list(layout.channels)),
        ("pressures [MPa]", [format_number(pressure / 1e6) for pressure in classifier.pressures]),
        ("speeds [rev/min]", [format_number(speed * 30 / np.pi) for speed in classifier.speeds]),
        ("epochs", classifier.history[-1].number if classifier.history else None),
        ("seed", classifier.seed),
    ]
    facts = build_facts_table("The model.", entries)
    if reference is None:
        return (facts,)
    counts = Counter(zip(reference.label, reference.specimen, strict=True))
    machines = sorted(set(reference.specimen))
    rows = tuple(
        (format_label(label), *(counts[label, machine] or "–" for machine in machines))
        for label in dict.fromkeys(reference.label)
    )
    header = ("class", *(machine or "machine not stated" for machine in machines))
    return (
        Table("Measured recordings of the training, by class and machine.", header, rows),
        facts,
    )


def build_choice_blocks(choice: Choice | None) -> tuple[str | Table | Group, ...]:
    """How a model was chosen, where training chose it."""
    if choice is None:
        return ()
    rows = tuple(
        (
            f"{trial.candidate} (chosen)"
            if trial.candidate == choice.candidate
            else trial.candidate,
            *(format_percent(trial.clean), format_percent(trial.disturbed)),
            "yes" if trial.is_tied else "",
        )
        for trial in choice.trials
    ) + tuple(
        (f"whole recordings: {name}", format_percent(recall), "–", "")
        for name, recall in choice.head_recalls.items()
    )
    caption = (
        f"What training tried: share of the recordings of {choice.group}s that were left out told right, mean over the "
        f"classes, {plural(choice.n_folds, 'fold')}. One of those as good as the best within one standard error was "
        "taken."
    )
    header = ("candidate", "as measured", "with noise, gain, speed", "as good as the best")
    table = Table(caption, header, rows)
    return (choice.sentence(), *((table,) if rows else ()))


_METRICS = {
    "accuracy": "accuracy",
    "recording_accuracy": "accuracy by recording",
    "macro_recall": "macro recall (balanced accuracy)",
    "macro_f1": "macro F1",
    "g_mean": "G-mean (of all declared classes)",
    "g_mean_laplace": "G_ε (with Laplace recalls)",
    "false_alarm_rate": "false alarms: normal windows called faulty",
    "missed_fault_rate": "missed faults: faulty windows called normal",
    "macro_auroc": "macro AUROC",
    "calibration_error": "expected calibration error",
}


def build_scores_part(scores: Scores, key: str) -> Part:
    """Part of the page about one set of scores."""
    low, high = scores.accuracy_interval
    has_interval = format_number(low) != "—"
    interval = (
        f"95 % interval over the recordings {100 * low:.1f} to {100 * high:.1f} %"
        if has_interval
        else "no interval"
    )
    distance = (
        f"Split: {scores.split} ({SPLITS[scores.split]})."
        if scores.split
        else "How far the test lies from the training was not stated."
    )
    counted = (
        f"Of {plural(scores.n_windows, 'measured test window')} from {plural(scores.n_recordings, 'recording')}, "
        f"{100 * scores.accuracy:.1f} % were classified correctly ({interval}); of the recordings, "
        f"{100 * scores.recording_accuracy:.1f} %. {distance}",
    )
    reasons = tuple(
        f"{_METRICS.get(name, format_label(name))}: {format_label(why)}"
        for name, why in scores.reasons.items()
    )
    metrics = tuple(
        (
            label,
            format_number_cell(getattr(scores, name), format_label(scores.reasons.get(name, ""))),
        )
        for name, label in _METRICS.items()
    )
    caption = "Windows of each actual class in percent; rows add up to 100."
    matrices = {(scores.split or "", ""): scores.confusion}
    blocks = (
        Table(
            "Scores over the test windows.", ("", scores.split or "split not specified"), metrics
        ),
        Bullets("Why a number is missing (—) or rests on too few windows (*)", reasons),
        _class_table(scores),
        draw_confusion(f"{key}_confusion", matrices, scores.classes, caption=caption),
    )
    weakest, right = _weakest(scores), round(scores.recording_accuracy * scores.n_recordings)
    count = "All" if right == scores.n_recordings else f"{right} of"
    shares = (
        format_number(100 * share) for share in (scores.false_alarm_rate, scores.missed_fault_rate)
    )
    alarms, missed = (text if text == "—" else f"{text} %" for text in shares)
    mistakes = f"False alarms: {alarms} of the healthy windows. Missed faults: {missed} of the faulty ones."
    return Part(
        title="Test of a model",
        answer=(f"Weakest class: {weakest}.",) if weakest else (),
        sections=(Section(SectionOrder.SCORES, "Scores", blocks),),
        results={"scores": [scores.to_dict()]},
        verdict=f"{count} {plural(scores.n_recordings, 'recording')} classified correctly",
        tone="good" if scores.recording_accuracy >= _GOOD else "unsure",
        certainty=(*counted, mistakes),
        actions=_actions(scores),
    )


_GOOD, _FEW = 0.9, 20


def _weakest(scores: Scores) -> str:
    """The class least often found, and what it is taken for."""
    rows = [(value, name) for name, value in scores.recall.items() if math.isfinite(value)]
    if not rows or min(rows)[0] == 1:
        return ""
    value, name = min(rows)
    counts = scores.confusion[scores.classes.index(name)].copy()
    counts[scores.classes.index(name)] = 0
    other = (*scores.classes, "no verdict")[int(counts.argmax())]
    return f"{format_label(name)}, {100 * value:.0f} % of its windows found, most of the others called {format_label(other)}"


def _actions(scores: Scores) -> tuple[str, ...]:
    """What would make the result better, or surer."""
    actions = []
    if scores.n_recordings < _FEW:
        actions.append(f"Test on more recordings: {scores.n_recordings} leave a wide interval.")
    if weakest := _weakest(scores):
        name = weakest.split(",")[0]
        actions.append(
            f"Record more of the class {name}, or add synthetic windows of it (swashtwin synthesize)."
        )
    return (*actions, "Use it: swashtwin diagnose MODEL FILE --report page.html.")


def _class_table(scores: Scores) -> Table:
    rows = []
    for cell in scores.cells:
        pascals = cell.discharge_pressure
        pressure = "unknown" if pascals is None else add_bar_values(f"{pascals / 1e6:g} MPa")
        rows.append(
            (format_label(cell.label), pressure, cell.n_windows, format_number_cell(cell.recall))
        )
    for index, label in enumerate(scores.classes):
        if [cell.label for cell in scores.cells].count(label) != 1:
            value, count = scores.recall[label], int(scores.confusion[index].sum())
            recall = format_number_cell(
                value, f"no test window of {format_label(label)}" if value != value else ""
            )
            rows.append((format_label(label), "all", count, recall))
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
    """Grid of confusion matrices: windows by actual (row) and predicted class, by (row, column of
    the grid).

    A column beyond the classes counts the windows without a verdict.
    """
    n_columns = max(np.shape(matrix)[1] for matrix in matrices.values())
    predictions = [*classes, *["no verdict"] * (n_columns - len(classes))]
    rows = [
        {
            "row": row,
            "column": column,
            "actual": actual,
            "predicted": predicted,
            "windows": matrix[i][j],
        }
        for (row, column), matrix in matrices.items()
        for i, actual in enumerate(classes)
        for j, predicted in enumerate(predictions[: np.shape(matrix)[1]])
    ]
    title = "Confusion matrix" if len(matrices) == 1 else "Confusion matrices"
    figure = confusion(matrices, classes)
    description = ". ".join(
        filter(None, (_in_words(key, matrix, classes) for key, matrix in matrices.items()))
    )
    return render_drawing(
        name, figure, tabulate(rows), title=title, caption=caption, description=description
    )


def _in_words(key: tuple[str, str], counts: np.ndarray, classes: Sequence[str]) -> str:
    """Share of each class that was told right, as a screen reader says it."""
    total = np.asarray(counts).sum(axis=1)
    shares = [
        f"{format_label(label)} {100 * counts[index][index] / total[index]:.0f} %"
        for index, label in enumerate(classes)
        if total[index]
    ]
    where = ", ".join(part for part in key if part)
    return (
        f"Classified correctly{f' ({where})' if where else ''}: {', '.join(shares)}"
        if shares
        else ""
    )


def build_alarms_part(scores: AlarmScores) -> Part:
    """Part of the page about the alarms on one test set; it has no figures."""
    rate, healthy = scores.error_rate, [item for item in scores.classes if item.is_healthy]
    faulty = [item for item in scores.classes if not item.is_healthy]
    alarms, total = (
        sum(getattr(item, name) for item in faulty) for name in ("n_alarms", "n_recordings")
    )
    rows = tuple(
        (
            format_label(item.label),
            *(item.n_recordings, item.n_no_verdict, item.n_alarms),
            "–" if item.alarm_rate is None else format_percent(item.alarm_rate),
            f"{format_percent(item.interval[0])} to {format_percent(item.interval[1])}",
            "–" if item.auroc is None else format_number(item.auroc),
        )
        for item in scores.classes
    )
    header = ("class", "recordings", "no verdict", "alarms", "alarm rate", "95 % interval", "AUROC")
    table = Table(
        "Alarms by class. AUROC is of the class against the healthy recordings.", header, rows
    )
    return Part(
        title="Test of alarms",
        answer=tuple(
            f"Of {plural(item.n_recordings, 'healthy recording')}, {item.n_alarms} raised a false alarm."
            for item in healthy
        )
        or ("No healthy recording was tested, so this test says nothing about false alarms.",),
        sections=(Section(SectionOrder.SCORES, "Alarms", (table,)),),
        results={"alarms": [scores.to_dict()]},
        verdict=f"{alarms} of {plural(total, 'faulty recording')} raised an alarm"
        if faulty
        else "No fault tested",
        certainty=()
        if rate is None
        else (f"The detector states a false-alarm rate of {format_percent(rate)}.",),
        actions=(
            *(() if healthy else ("Test it on healthy recordings that had no part in it.",)),
            "Use it: swashtwin diagnose MODEL FILE --report page.html.",
        ),
    )
