"""The report of a study: one page, and its data beside it."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from swashtwin.learning import SPLITS
from swashtwin.plot import format_label
from swashtwin.pump import PRESSURE_TOLERANCE, values_match
from swashtwin.report import (
    Bullets,
    Cell,
    Drawing,
    Group,
    Part,
    Section,
    SectionOrder,
    Table,
    build_calibration_blocks,
    build_facts_table,
    describe_verdicts,
    flatten_settings,
    format_number,
    write_report,
)
from swashtwin_bench.results.figures import (
    draw_confusions,
    draw_curves,
    draw_embedding,
    draw_excitation,
    draw_rows,
    draw_summary,
    draw_training,
    select_embedded_runs,
)
from swashtwin_bench.results.naming import format_factor
from swashtwin_bench.results.reported import format_reported, is_reported
from swashtwin_bench.results.result import METRICS, Difference, StudyResult
from swashtwin_bench.results.runs import Run
from swashtwin_bench.results.table import USER_FILES, StudyTable

# Trials in the tooltip of a cell: more would fill the screen.
MAX_TRIALS_IN_TOOLTIP = 20

MAX_SUMMARY_PAIRS = 6
"""Differences at the top of the page; the scores have all."""

# Names of metrics in the reasons of a score, if they differ.
_REASON_NAMES = {"recall": "macro_recall", "f1": "macro_f1"}


def write_study_report(study: StudyTable, folder: Path | str) -> Path:
    """Write the report of a study, and return the path of ``report.html`` (`write_report`).

    Parameters
    ----------
    folder : is created if it does not exist.

    Raises
    ------
    InputError
        `folder` is a file.
    """
    return write_report(build_study_part(study, "study"), folder=folder)


def build_study_part(study: StudyTable, key: str) -> Part:
    """Return the part of a report for one study.

    Parameters
    ----------
    key : prefix of the names of its figures.
    """
    notes = Bullets("Notes on the numbers", study.notes)
    sentences = Bullets("In words", study.answer)
    score_blocks: list[Any] = [sentences, _build_rows_table(study), notes]
    drawings = [draw_rows(study, key)]
    sections: list[Section] = []
    results: dict[str, Any] = {"studies": [study.to_dict()]}

    if isinstance(study, StudyResult):
        score_blocks = [sentences, *_build_score_blocks(study, notes)]
        drawings += [*draw_curves(study, key), draw_confusions(study, key)]
        if study.calibrations:
            blocks = _build_calibration_blocks(study, key)
            sections.append(Section(SectionOrder.CALIBRATION, "Calibration of the twins", blocks))
            results["calibrations"] = [calibration.to_dict() for calibration in study.calibrations]
        blocks = _build_training_blocks(study, key)
        sections.append(Section(SectionOrder.TRAINING, "Training and features", blocks))

    score_blocks += [_with_origin(drawing, study) for drawing in drawings]
    scores = Section(SectionOrder.SCORES, "Scores", tuple(score_blocks))
    provenance = Section(
        SectionOrder.PROVENANCE, "Provenance and command", _build_provenance_blocks(study)
    )

    name = study.study
    if isinstance(study, StudyResult) and study.size:
        name += f", {study.size}"
    return Part(
        title=study.title,
        verdict=study.headline,
        # A study without rows has no headline, but may have an answer.
        answer=() if study.headline else study.answer[:1],
        glance=_build_summary(study, key),
        facts=(
            ("Study", name),
            ("Seeds", ", ".join(map(str, study.seeds))),
            ("Device", study.device),
            ("Version", study.version),
        ),
        notice="" if study.origin == USER_FILES else study.origin,
        sections=(scores, *sections, provenance),
        results=results,
    )


def _build_summary(study: StudyTable, key: str) -> tuple[Any, ...]:
    """Return what is seen at a glance: a chart, and the differences of the hardest split."""
    blocks: list[Any] = []
    if isinstance(study, StudyResult):
        split = study.hardest_split
        blocks.append(f"{split}: {SPLITS.get(split, 'not described')}.")
    if study.summary_rows():
        blocks.append(_with_origin(draw_summary(study, key), study))
    if isinstance(study, StudyResult):
        split_pairs = [
            pair for pair in study.differences() if pair.first["split"] == study.hardest_split
        ]
        if split_pairs:
            blocks.append(_build_pairs_table(study, split_pairs[:MAX_SUMMARY_PAIRS]))
    return tuple(blocks)


def _build_rows_table(study: StudyTable) -> Table:
    """Return the table of mean and standard deviation of each metric for each row."""
    rows = []
    for row in study.rows():
        factors = [Cell(format_label(row[name])) for name in study.factors]
        scores = [_format_spread(row[metric]) for metric in study.metrics]
        rows.append((*factors, *scores))

    header = (*map(format_label, study.factors), *study.metrics.values())
    return Table("Mean ± standard deviation over the trials.", header, tuple(rows))


def _format_spread(spread: dict[str, Any]) -> Cell:
    values = [value for value in spread["values"] if value is not None]
    if not values:
        return Cell("—", "not defined for this row")

    text = format_number(spread["mean"])
    if spread["std"] is not None:
        text += f" ± {format_number(spread['std'])}"

    trials = ", ".join(map(format_number, values[:MAX_TRIALS_IN_TOOLTIP]))
    return Cell(text, f"single trials: {trials}")


def _build_score_blocks(study: StudyResult, notes: Bullets) -> list[Any]:
    """Return the tables of scores and of differences, with what is to be read with them."""
    reasons: dict[str, None] = {}
    for run, row in study.tests():
        for metric in METRICS:
            reason = _find_reason([(run, row)], metric)
            if reason:
                reasons[f"{row['split']}, {METRICS[metric]}: {reason}"] = None

    blocks: list[Any] = [
        _build_splits_table(sorted({trial.factors["split"] for trial in study.trials})),
        build_scores_table(study),
        notes,
        Bullets("Missing numbers (—) and numbers with a limited basis (*)", tuple(reasons)),
    ]
    if is_reported(study.study):
        blocks.append(
            "The figures of the paper (DOI 10.1177/00202940261419020) were measured on another "
            "rig. They are shown with the split nearest to what the paper tested, L2, and are no "
            "target for these scores. Its G-means have another definition: 0.9748 at an accuracy "
            "of 0.98 and 0.9029 at 0.9240 are below 0.9791 and 0.9088, the minimum of the "
            "geometric mean of five recalls on its 5 × 50 test windows."
        )
    # A study without a reference value compares nothing.
    if study.differences():
        blocks.append(build_differences_table(study))

    return blocks


def build_scores_table(study: StudyResult) -> Table:
    """Return the table of scores over the seeds, with the figures of the paper."""
    with_paper = is_reported(study.study)

    rows = []
    for row in sorted(study.rows(), key=lambda row: str(row["split"])):
        factors = {name: row[name] for name in study.factors}
        labels = [format_factor(name, value) for name, value in factors.items() if name != "split"]
        n_seeds = len(row["accuracy"]["values"])

        tests = study.tests(**factors)
        scores = [_format_score(row[metric], _find_reason(tests, metric)) for metric in METRICS]
        if len(tests) == 1:
            low, high = tests[0][1]["accuracy_interval"]
            scores[0] = replace(scores[0], text=f"{scores[0].text} ({low:.2f} to {high:.2f})")

        cells = [Cell(", ".join([row["split"], *labels])), Cell(str(n_seeds)), *scores]
        if with_paper:
            cells.append(Cell(format_reported(study.study, factors)))
        rows.append(tuple(cells))

    header = ["split, classifier, training set", "seeds", *METRICS.values()]
    if with_paper:
        header.append("the paper, its rig")
    return Table(
        f"Mean ± standard deviation over the seeds of a row, of {len(study.seeds)} in total; for a "
        "single test the accuracy has its 95 % interval over the recordings of the test. All test "
        "windows are measured. Accuracy by recording: each recording counts once, by the mean "
        "log-probability of its windows.",
        tuple(header),
        tuple(rows),
    )


def _format_score(spread: dict[str, Any], reason: str) -> Cell:
    finite = [value for value in spread["values"] if value is not None]
    if not finite:
        return Cell("—", reason or "not defined for this test set")

    text = f"{spread['mean']:.3f}"
    if spread["std"] is not None:
        text += f" ±\u00a0{spread['std']:.3f}"
    if len(finite) < len(spread["values"]):
        text += f" ({len(finite)} of {len(spread['values'])} seeds)"

    if reason:
        return Cell(f"{text} *", reason)
    return Cell(text, "single seeds: " + ", ".join(f"{value:.3f}" for value in finite))


def _find_reason(tests: Sequence[tuple[Run, dict[str, Any]]], metric: str) -> str:
    """Return why a score of some tests is missing or has a limited basis; empty if it has not."""
    if metric == "scarce_recall":
        is_missing = any(math.isnan(row[metric]) for _, row in tests)
        return "no test window in the scarce cell" if is_missing else ""

    name = _REASON_NAMES.get(metric, metric)
    reasons = [row["reasons"][name] for _, row in tests if name in row["reasons"]]
    return "; ".join(dict.fromkeys(reasons))


def build_differences_table(study: StudyResult) -> Table:
    """Return the table of all differences of the study's metric, paired by seed."""
    return _build_pairs_table(study, study.differences())


def _build_pairs_table(study: StudyResult, pairs: Sequence[Difference]) -> Table:
    """Return the table of differences of the study's metric, paired by seed."""
    rows = []
    for pair in pairs:
        first = format_factor(pair.factor, pair.first[pair.factor])
        second = format_factor(pair.factor, pair.second[pair.factor])
        fixed = [
            format_factor(name, value) for name, value in pair.first.items() if name != pair.factor
        ]

        interval = Cell("—", "one seed")
        is_clear = Cell("—")
        if pair.pairs > 1:
            low, high = (100 * limit for limit in pair.interval)
            interval = Cell(f"{low:+.1f} to {high:+.1f}")
            is_clear = Cell("yes" if pair.is_clear else "no")

        rows.append(
            (
                Cell(f"{first} minus {second}"),
                Cell(", ".join(fixed)),
                Cell(f"{100 * pair.mean:+.1f}"),
                interval,
                Cell(str(pair.pairs)),
                is_clear,
            )
        )

    # Fleets of the rig differ in their fingerprints; splits of the same recordings do not.
    has_fleets = len({run["data"] for run in study.runs}) > 1
    if has_fleets:
        method = "Student's t over fleets"
    else:
        method = "the corrected resampled t, because the seeds split the same recordings"
    return Table(
        f"Differences of {METRICS[study.metric]} in points, paired by seed; 95 % intervals by "
        f"{method}.",
        ("difference", "for", "points", "95 % interval", "seeds", "excludes zero"),
        tuple(rows),
    )


def _with_origin(drawing: Drawing, study: StudyTable) -> Drawing:
    """Return the figure with its origin in the caption: a figure is often passed on alone."""
    if "virtual rig" in study.origin:
        recordings = "virtual rig, no real pump"
    else:
        recordings = "recordings: see the page"

    seeds = ", ".join(map(str, study.seeds))
    command = study.command or "command not recorded"
    origin = f"{command}; seeds {seeds}; {study.device}; {recordings}"
    return replace(drawing, caption=f"{drawing.caption} [{origin}]")


def _build_calibration_blocks(study: StudyResult, key: str) -> tuple[Any, ...]:
    target_pressure = study.settings.get("pressure_Pa")
    is_only_one = len(study.calibrations) == 1

    extrapolations = []
    groups = []
    for number, calibration in enumerate(study.calibrations, start=1):
        pump_name = calibration.twin.pump.name
        pressure = calibration.twin.condition.discharge_pressure
        if isinstance(target_pressure, float) and not values_match(
            pressure, target_pressure, PRESSURE_TOLERANCE
        ):
            extrapolations.append(
                f"{pump_name} was calibrated at {pressure / 1e6:.3g} MPa and simulated at "
                f"{target_pressure / 1e6:.3g} MPa."
            )

        calibration_key = f"{key}_calibration" + ("" if is_only_one else f"_{number}")
        blocks = build_calibration_blocks(calibration, calibration_key)
        if number == 1:
            blocks = (*blocks, *draw_excitation(calibration.nominal, calibration_key))
        title = f"{pump_name}: {describe_verdicts(calibration)}"
        groups.append(Group(title, blocks, is_open=is_only_one))

    return (
        Bullets("Twins used at another pressure than calibrated", tuple(extrapolations)),
        *groups,
    )


def _build_training_blocks(study: StudyResult, key: str) -> tuple[Any, ...]:
    blocks: list[Any] = [_build_cells_table(study)]
    if any(run["history"] for run in study.runs):
        blocks.append(_with_origin(draw_training(study, key), study))
    if select_embedded_runs(study):
        blocks.append(_with_origin(draw_embedding(study, key), study))
    else:
        blocks.append("No t-SNE: no network was trained, or there are fewer than 10 test windows.")

    return tuple(blocks)


def _build_splits_table(splits: Sequence[str]) -> Table:
    """Return the table of the meaning of the splits."""
    return Table(
        "Distance of the test data from the training data.",
        ("split", "test data"),
        tuple((split, SPLITS.get(split, "not described")) for split in splits),
    )


def _build_cells_table(study: StudyResult) -> Table:
    """Return the table of windows by class and pressure in each set of the first seed."""
    sets = study.cells
    names: list[str] = []
    for counts in sets.values():
        names += [name for name in counts if name not in names]
    # Cells first; then counts that are not of a cell, such as that of synthetic windows.
    names.sort(key=lambda name: not _is_cell(name))

    rows = []
    for name in names:
        counts_of_name = [str(counts.get(name, 0) or "–") for counts in sets.values()]
        rows.append((Cell(format_label(name)), *map(Cell, counts_of_name)))

    totals = [
        sum(count for name, count in counts.items() if _is_cell(name)) for counts in sets.values()
    ]
    rows.append((Cell("all"), *(Cell(str(total)) for total in totals)))

    header = ["class @ pressure"]
    for name in sets:
        is_test = name.split(", ")[0] in SPLITS
        header.append(f"test {name}" if is_test else format_factor("training_set", name))

    caption = (
        f"Windows by class and pressure in each training and test set, under seed {study.seeds[0]}."
    )
    return Table(caption, tuple(header), tuple(rows))


def _is_cell(name: str) -> bool:
    """Return whether a count is that of a class at a pressure (`count_cells`)."""
    return " @ " in name


def _build_provenance_blocks(study: StudyTable) -> tuple[Any, ...]:
    facts = [
        ("command", study.command or "not recorded"),
        ("study", study.study),
        ("seeds", list(study.seeds)),
        ("swashtwin version", study.version),
        ("device", study.device),
        ("duration", f"{format_number(study.wall_s)} s"),
        ("recordings", study.origin),
    ]
    calibrations = study.calibrations if isinstance(study, StudyResult) else ()
    calibrated_on = tuple(
        f"{calibration.twin.pump.name}, {calibration.method} {calibration.version}: "
        f"{', '.join(calibration.recording_ids)}"
        for calibration in calibrations
    )
    settings = build_facts_table("Settings of the study.", flatten_settings(study.settings))

    return (
        build_facts_table("The run.", facts),
        Bullets(
            "Recordings used to calibrate twins (training data, in no test set)", calibrated_on
        ),
        Group("Settings", (settings,), is_open=False),
    )
