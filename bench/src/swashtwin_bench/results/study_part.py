"""What a study adds to the page."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from swashtwin.learning import LEVELS
from swashtwin.plot import words
from swashtwin.pump import PRESSURE_TOLERANCE, values_match
from swashtwin.report import (
    Bullets,
    Cell,
    Drawing,
    Group,
    Paragraph,
    Part,
    Picture,
    Section,
    SectionOrder,
    Table,
    calibration_blocks,
    comparison_table,
    facts_table,
    flatten_settings,
    levels_table,
    number,
    score,
    verdict_counts,
)
from swashtwin_bench.results.answers import case_answer, case_verdict
from swashtwin_bench.results.comparison_figures import classifier_drawing, curve_drawings, curve_factor, time_drawing
from swashtwin_bench.results.naming import classifier_words, training_set_words
from swashtwin_bench.results.reported import PAPER_STUDY, is_reported, paper_words
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.runs import Outcome
from swashtwin_bench.results.study_figures import (
    accuracy_drawing,
    can_embed,
    confusion_of,
    embedding_drawing,
    scarce_drawing,
    training_drawing,
)

_METRICS = {
    "accuracy": ("accuracy", "accuracy"),
    "recall": ("macro recall", "macro_recall"),
    "f1": ("macro F1", "macro_f1"),
    "g_mean": ("G-mean", "g_mean"),
    "g_mean_laplace": ("G_ε", "g_mean_laplace"),
    "recording_accuracy": ("accuracy by recording", "recording_accuracy"),
    "scarce_recall": ("recall in the scarce cell", "scarce_recall"),
}
"""Heading and name in `Scores.reasons` of each number in a study's rows."""


def study_part(study: StudyResult, key: str) -> Part:
    """Part of one study."""
    is_case = study.study.removeprefix(PAPER_STUDY) in ("case1", "case2")
    sections = [Section(SectionOrder.SCORES, "Scores", _score_blocks(study, key))]
    if study.calibrations:
        sections.append(
            Section(SectionOrder.CALIBRATION, "Calibration of the twins", _calibration_sections(study, key))
        )
    sections.append(Section(SectionOrder.TRAINING, "Training and features", _training_blocks(study, key)))
    sections.append(Section(SectionOrder.PROVENANCE, "Where this comes from, and how to repeat it", _provenance(study)))
    return Part(
        title=study.title,
        answer=case_answer(study) if is_case else study.answer,
        verdict=case_verdict(study) if is_case else "",
        facts=(
            ("Study", f"{study.study}, {study.size}"),
            ("Seeds", ", ".join(map(str, study.seeds))),
            ("Device", study.device),
            ("Version", study.version),
        ),
        notice=study.origin if "virtual rig" in study.origin else "",
        sections=tuple(sections),
        results={
            "studies": [study.to_dict()],
            "calibrations": [calibration.to_dict() for calibration in study.calibrations],
        },
    )


def _score_blocks(study: StudyResult, key: str) -> tuple:
    reasons = _reasons([*study.outcomes, *study.rivals])
    return (
        levels_table(sorted({outcome.level for outcome in study.outcomes})),
        metrics_table(study),
        Bullets("To be read with it", study.notes),
        Bullets("Where a number is missing (—) or rests on less than it should (*)", reasons),
        *_about_the_paper(study),
        *([contrast_table(study)] if study.contrasts else []),
        *(Picture(with_origin(drawing, study)) for drawing in _score_drawings(study, key)),
    )


def _score_drawings(study: StudyResult, key: str) -> list[Drawing]:
    several = len({outcome.classifier for outcome in study.outcomes}) > 1
    if curve_factor(study) is not None:
        first = curve_drawings(study, key)
    elif several and len({outcome.training_set for outcome in study.outcomes}) == 1:
        first = [classifier_drawing(study, key), time_drawing(study, key)]
    else:
        first = [accuracy_drawing(study, key), scarce_drawing(study, key)]
    return [*first, confusion_of(study, key)]


def with_origin(drawing: Drawing, study: StudyResult) -> Drawing:
    """The figure with what it takes to repeat it under it: command, seeds, device, and whose recordings."""
    seeds = ", ".join(map(str, study.seeds))
    rig = "virtual rig, no real pump" if "virtual rig" in study.origin else "the user's recordings"
    commands = study.commands or ("command not recorded",)
    command = commands[0] if len(commands) == 1 else f"{len(commands)} commands, at the end of the study"
    source = f"{command}; {'seed' if len(study.seeds) == 1 else 'seeds'} {seeds}"
    return replace(drawing, caption=f"{drawing.caption} [{source}; {study.device}; {rig}]")


def contrast_table(study: StudyResult) -> Table:
    """Differences of accuracy, paired by seed."""
    corrected = any(contrast.is_corrected for contrast in study.contrasts)
    no_test = "splits of the same recordings are no independent pairs" if corrected else "fewer than six seeds"
    rows = []
    for contrast in study.contrasts:
        factor = next(name for name in contrast.first if contrast.first[name] != contrast.second[name])
        named = training_set_words if factor == "training_set" else classifier_words
        fixed = [
            classifier_words(value) if name == "classifier" else words(value)
            for name, value in contrast.first.items()
            if name != factor
        ]
        low, high = contrast.interval
        interval = f"{100 * low:+.1f} to {100 * high:+.1f}" if low == low else "—"
        why = "" if low == low else "one seed"
        rows.append(
            (
                Cell(f"{named(contrast.first[factor])} less {named(contrast.second[factor])}"),
                Cell(", ".join(fixed)),
                Cell(f"{100 * contrast.mean:+.1f}"),
                Cell(interval, why),
                Cell(str(contrast.pairs)),
                Cell(number(contrast.p_value), "" if contrast.p_value == contrast.p_value else no_test),
                Cell("—" if low != low else "yes" if contrast.is_clear else "no", why),
            )
        )
    kind = "corrected resampled t, for the seeds split the same recordings" if corrected else "Student's t over fleets"
    if all(contrast.pairs < 2 for contrast in study.contrasts):
        kind = "none, for there is one seed"
    return Table(
        f"Differences of accuracy in points, paired by seed; 95 % intervals by {kind}; p by Wilcoxon's signed ranks, "
        "corrected by Holm.",
        ("difference", "of", "points", "95 % interval", "seeds", "p", "clear of zero"),
        tuple(rows),
    )


def metrics_table(study: StudyResult) -> Table:
    """Mean and standard deviation over the seeds, rivals and the paper's figures in the same table."""
    table = sorted(
        [*study.rows(), *study.rows(rivals=True)],
        key=lambda row: (row["level"], row["classifier"] in study.rival_names),
    )
    with_paper = is_reported(study)
    rows = []
    for row in table:
        key = {name: row[name] for name in study.factors}
        same = [outcome for outcome in (*study.outcomes, *study.rivals) if outcome.factors == key]
        cells = [_spread_cell(row[metric], _why(same, reason)) for metric, (_, reason) in _METRICS.items()]
        if with_paper:
            cells.append(Cell(paper_words(study, key)))
        rows.append((Cell(_row_words(key)), Cell(str(len(row["accuracy"]["values"]))), *cells))
    header = ("level, classifier, training set", "seeds", *(heading for heading, _ in _METRICS.values()))
    return Table(
        f"Mean ± standard deviation over a row's seeds, of {len(study.seeds)} in all; test windows measured only. "
        "Accuracy by recording: each recording counts once, by the mean log-probability of its windows.",
        (*header, "the paper, its rig") if with_paper else header,
        tuple(rows),
    )


def _row_words(key: dict[str, str]) -> str:
    further = [words(value) for name, value in key.items() if name not in ("level", "classifier", "training_set")]
    named = (key["level"], classifier_words(key["classifier"]), training_set_words(key["training_set"]), *further)
    return ", ".join(named)


def _spread_cell(spread: dict[str, Any], reason: str) -> Cell:
    finite = [value for value in spread["values"] if value is not None]
    if not finite:
        return Cell("—", reason or "not defined for this test set")
    text = score(spread["mean"]) + (f" ±\u00a0{score(spread['std'])}" if spread["std"] is not None else "")
    if len(finite) < len(spread["values"]):
        text += f" ({len(finite)} of {len(spread['values'])} seeds)"
    return Cell(f"{text} *" if reason else text, reason or "single seeds: " + ", ".join(map(score, finite)))


def _why(outcomes: Sequence[Outcome], name: str) -> str:
    if name == "scarce_recall":
        is_missing = any(math.isnan(outcome.scarce_recall) for outcome in outcomes)
        return "no test window in the scarce cell" if is_missing else ""
    return "; ".join(
        dict.fromkeys(outcome.scores.reasons[name] for outcome in outcomes if name in outcome.scores.reasons)
    )


def _reasons(outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    reasons: dict[str, None] = {}
    for outcome in outcomes:
        for heading, name in _METRICS.values():
            if reason := _why([outcome], name):
                reasons[f"{outcome.level}, {heading}: {reason}"] = None
    return tuple(reasons)


def _about_the_paper(study: StudyResult) -> list[Paragraph]:
    if not is_reported(study):
        return []
    return [
        Paragraph(
            "The paper's figures (DOI 10.1177/00202940261419020) were measured on another rig and stand beside the "
            "level nearest to what the paper tested, L2; they are no target that these scores could meet or miss. Its "
            "G-means are of another definition: 0.9748 at an accuracy of 0.98 and 0.9029 at 0.9240 are below 0.9791 "
            "and 0.9088, the least that the geometric mean of five recalls can be on its 5 × 50 test windows."
        )
    ]


def _calibration_sections(study: StudyResult, key: str) -> tuple:
    several = len(study.calibrations) > 1
    blocks: list[Any] = [comparison_table(study.calibrations)] if several else []
    blocks.append(Bullets("Used away from where they were calibrated", _extrapolation_notes(study)))
    for index, calibration in enumerate(study.calibrations):
        own_key = f"{key}_calibration_{index + 1}" if several else f"{key}_calibration"
        inner = calibration_blocks(calibration, own_key, with_excitation=index == 0)
        title = f"{calibration.twin.pump.name}: {verdict_counts(calibration)}"
        blocks.append(Group(title, inner, is_open=not several))
    return tuple(blocks)


def _extrapolation_notes(study: StudyResult) -> tuple[str, ...]:
    """Twins whose windows were simulated at another pressure than that of their recordings."""
    target = study.settings.get("pressure_Pa")
    pressures = [
        (calibration.twin.pump.name, calibration.twin.condition.discharge_pressure)
        for calibration in study.calibrations
    ]
    return tuple(
        f"{name} was calibrated at {pressure / 1e6:.3g} MPa and simulated at {target / 1e6:.3g} MPa."
        for name, pressure in pressures
        if isinstance(target, float) and not values_match(pressure, target, PRESSURE_TOLERANCE)
    )


def _training_blocks(study: StudyResult, key: str) -> tuple:
    blocks: list[Any] = [_cells_table(study)]
    if study.curves:
        blocks.append(Picture(with_origin(training_drawing(study, key), study)))
    if any(can_embed(run.embedding) for run in study.embedded_runs):
        blocks.append(Picture(with_origin(embedding_drawing(study, key), study)))
    elif study.embedded_runs:
        reason = "no features were kept, there are fewer than 10 test windows, or all of them have the same features"
        blocks.append(Paragraph(f"No t-SNE: {reason}."))
    return tuple(blocks)


def _cells_table(study: StudyResult) -> Table:
    names = list(dict.fromkeys(name for cells in study.cells.values() for name in cells))
    names.sort(key=lambda name: " @ " not in name)
    rows = [
        (Cell(words(name)), *(Cell(str(cells.get(name, 0) or "–")) for cells in study.cells.values())) for name in names
    ]
    total = [sum(count for name, count in cells.items() if " @ " in name) for cells in study.cells.values()]
    rows.append((Cell("all"), *(Cell(str(count)) for count in total)))
    header = [f"test {name}" if name.split(", ")[0] in LEVELS else training_set_words(name) for name in study.cells]
    return Table(
        f"Windows by class and pressure in each training and test set, under seed {study.seeds[0]}. Training sets with "
        "a twin hold the measured ones and the synthetic ones.",
        ("class @ pressure", *header),
        tuple(rows),
    )


def _provenance(study: StudyResult) -> tuple:
    used = tuple(
        f"{calibration.twin.pump.name}, {calibration.method} {calibration.version}: "
        f"{', '.join(calibration.recording_ids)}"
        for calibration in study.calibrations
    )
    entries = [
        ("command" if len(study.commands) < 2 else "commands", list(study.commands) or "not recorded"),
        ("study and size", f"{study.study}, {study.size}"),
        ("seeds", list(study.seeds)),
        ("swashtwin version", study.version),
        ("device", study.device),
        ("time taken", f"{number(study.wall_s)} s"),
        ("recordings", study.origin),
    ]
    return (
        facts_table("The run.", entries),
        Bullets("Recordings that twins were calibrated on (training data, in no test set)", used),
        Group("Settings", (facts_table("Settings of the study.", flatten_settings(study.settings)),), is_open=False),
    )
