"""`run_demo`: a virtual rig, a trained model, the twin of a pump and a diagnosis, on a page that
begins with it.

The question is that of the paper's Case II: nobody recorded a fault at the pressure where it has to
be recognized. Twins are calibrated on the same fault at another pressure, and simulate it. The
recording shown is the first, by its name, of that fault at that pressure from a pump that had no
part in anything, whatever the models say of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from swashtwin.diagnosis import Diagnosis, diagnose, load_classifier, save_classifier
from swashtwin.foundation import plural
from swashtwin.learning import FittedClassifier, allowed_error_rate, cut_windows, learn_confidence
from swashtwin.plot import format_label
from swashtwin.recordings import Recording, load_recordings
from swashtwin.report import (
    Cell,
    Group,
    Part,
    Section,
    SectionOrder,
    Table,
    build_part,
    format_percent,
    write_report,
)
from swashtwin_bench.results.page import build_study_part
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.runs import Run, Work
from swashtwin_bench.rigs.writing import SIZES, build_rig
from swashtwin_bench.studies.plan import Plan
from swashtwin_bench.studies.plans import build_plan
from swashtwin_bench.studies.runner import model_file, require_rig, run_plan

QUESTION = "A fault nobody recorded at this pressure: can a twin replace the missing recordings?"
"""Title of the page."""

STUDY = "case2"
"""Case II of the paper."""

WITHOUT, WITH = "measured", "calibrated"
"""Training sets that are compared on the recordings of the fault."""

_FAMILIAR, _UNSEEN = "L2", "L4"
_ERROR_RATE = 0.1


@dataclass(frozen=True)
class Demo:
    """What the demo leaves in its folder."""

    study: StudyResult
    """Case II of the paper, small."""
    model: Path
    """Model trained on measured windows and on those of the calibrated twins."""
    twin: Path
    """Calibration of the first training pump."""
    pump: str
    """That pump."""
    with_twin: tuple[Diagnosis, ...]
    """Diagnosis of each recording of the fault at the pressure where nobody had recorded it, from
    unseen pumps; the first is the page's.
    """
    without_twin: tuple[Diagnosis, ...]
    """The same recordings, diagnosed by the network that was trained on measured windows alone."""
    label: str
    """The fault."""
    other: Path
    """File of a recording of an unseen pump with another fault, to diagnose next."""
    rig: Path
    """Folder of the recordings."""
    page: Path
    """The page."""


def run_demo(
    out: Path,
    *,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str, int, int], None],
    command: str = "",
) -> Demo:
    """Everything the demo makes, in `out`; what lies there from an interrupted run is used again.

    Parameters
    ----------
    progress : called with (activity, finished, in all).
    command : command line that repeats it.

    Raises
    ------
    DataError
        ``rig-SEED`` in `out` holds other recordings than those of the rig.
    """
    folder = out / f"rig-{seed}"
    if not (folder / "recordings.toml").is_file():
        build_rig(
            folder,
            seed=seed,
            jobs=jobs,
            progress=lambda count, total: progress("recording on the rig", count, total),
        )
    recordings = list(load_recordings(folder))
    require_rig(folder, recordings, SIZES["small"])
    plan = build_plan(STUDY, "quick")
    work = Work(
        (seed,),
        jobs,
        out / "runs",
        lambda activity, count, total: progress(f"Case II: {activity}", count, total),
        command=command,
    )
    study = run_plan(plan, recordings, work, keep_models=True)
    runs = {run["factors"]["training_set"]: run for run in study.runs if run["history"]}
    validation = _validation(recordings, runs[WITH], plan)
    models = {name: _with_confidence(load_classifier(model_file(out / "runs" / STUDY / runs[name]["key"])), validation)
              for name in (WITHOUT, WITH)}  # fmt: skip
    unseen = [
        recording
        for recording in recordings
        if recording.recording_id in runs[WITH]["roles"][_UNSEEN]
    ]
    faulty = [recording for recording in unseen if plan.scenario.is_scarce(recording)]
    other = next(
        recording
        for recording in unseen
        if recording.label not in (*plan.scenario.scarce, "normal")
    )
    calibration = study.calibrations[0]
    demo = Demo(
        study=study,
        model=save_classifier(models[WITH], out / "model.safetensors"),
        twin=calibration.save(out / "twin.json"),
        pump=str(
            next(r.specimen for r in recordings if r.recording_id == calibration.recording_ids[0])
        ),
        with_twin=_verdicts(models[WITH], faulty, plan),
        without_twin=_verdicts(models[WITHOUT], faulty, plan),
        label=str(faulty[0].label),
        other=folder / str(other.attributes["file"]),
        rig=folder,
        page=out / "report" / "report.html",
    )
    write_report(_part(demo), folder=demo.page.parent, about={"Model": demo.model.as_posix()})
    return demo


def _validation(recordings: Sequence[Recording], run: Run, plan: Plan) -> list[Recording]:
    """Recordings of the training pumps that no training, calibration or test used, none of the
    missing cell.
    """
    used = {name for ids in run["roles"].values() for name in ids}
    pumps = {
        recording.specimen
        for recording in recordings
        if recording.recording_id in run["roles"]["train"]
    }
    return [
        recording
        for recording in recordings
        if recording.specimen in pumps
        and recording.recording_id not in used
        and not plan.scenario.is_scarce(recording)
    ]


def _with_confidence(
    classifier: FittedClassifier, validation: Sequence[Recording]
) -> FittedClassifier:
    windows = cut_windows(validation, length=classifier.length, classes=classifier.classes)
    return learn_confidence(
        classifier, windows, error_rate=allowed_error_rate(len(validation), _ERROR_RATE)
    )


def _verdicts(
    classifier: FittedClassifier, recordings: Sequence[Recording], plan: Plan
) -> tuple[Diagnosis, ...]:
    """Diagnosis of each recording; the rig does not state how many pistons its pump has."""
    pistons = plan.scenario.pump.rotating_group.piston_count
    verdicts = [diagnose(classifier, recording) for recording in recordings]
    return tuple(
        replace(verdict, facts=replace(verdict.facts, pistons=pistons)) for verdict in verdicts
    )


def summarize_demo(demo: Demo) -> tuple[str, ...]:
    """The answer to the question in sentences."""
    right = [
        sum(verdict.label == demo.label for verdict in verdicts)
        for verdicts in (demo.with_twin, demo.without_twin)
    ]
    fault, shown = format_label(demo.label), demo.with_twin[0]
    verdict = "right" if shown.label == demo.label else "wrong"
    return (
        f"The pump has a {fault} fault, so this is {verdict}. No recording of a {fault} fault at this pressure, and no "
        "recording of this pump, had a part in the model: twins of other pumps, calibrated on the fault at another "
        "pressure, simulated it.",
        f"Of all {plural(len(demo.with_twin), 'recording')} of this fault at this pressure from unseen pumps, the "
        f"model names {right[0]} right. The same network without the twins' windows names {right[1]} right. Of single "
        f"windows of this fault at this pressure it names {_recalls(demo)}. This is one fleet of a virtual rig and one "
        "training: a demonstration, no proof.",
    )


def _recalls(demo: Demo) -> str:
    """Share of the fault's windows that is right, with the twins' windows and without, of both
    kinds of test.
    """
    recall = {
        (row["training_set"], row["split"]): float(row["scarce_recall"]["mean"])
        for row in demo.study.rows()
        if row["classifier"] == demo.study.main_classifier
    }
    return ", and ".join(
        f"{format_percent(recall[WITH, split])} right with them and "
        f"{format_percent(recall[WITHOUT, split])} without on {pumps}"
        for split, pumps in (
            (_UNSEEN, "unseen pumps"),
            (_FAMILIAR, "other recordings of the training pumps"),
        )
    )


def _part(demo: Demo) -> Part:
    """The page: the question and the diagnosis, then the recordings with and without the twin, then
    the paper's tables; what lies behind these is folded away.
    """
    verdict = build_part(demo.with_twin[0], "diagnosis")
    study = build_study_part(demo.study, "study")
    lead = Section(SectionOrder.VERDICT, "With the twin and without", (_comparison(demo),))
    paper = Section(SectionOrder.SCORES, "Case II of the paper", tuple(study.answer))
    behind = [
        replace(section, blocks=(Group("Details", section.blocks, is_open=False),))
        if section.position in (SectionOrder.CALIBRATION, SectionOrder.TRAINING)
        else section
        for section in study.sections
    ]
    return replace(
        verdict,
        title=QUESTION,
        answer=(*summarize_demo(demo), *verdict.answer),
        sections=(lead, *verdict.sections, paper, *behind),
        results={**verdict.results, **study.results},
    )


def _comparison(demo: Demo) -> Table:
    rows = tuple(
        (Cell(with_twin.recording_id), *map(_verdict_cell, (without, with_twin)))
        for without, with_twin in zip(demo.without_twin, demo.with_twin, strict=True)
    )
    caption = (
        f"Every recording of the fault ({format_label(demo.label)}) at this pressure from pumps that no "
        "model was trained on: "
        "class named by the network, and its probability, pooled over the windows."
    )
    return Table(caption, ("recording", "without the twin", "with the twin"), rows)


def _verdict_cell(verdict: Diagnosis) -> Cell:
    if verdict.label is None:
        return Cell("no verdict", verdict.no_verdict or "")
    return Cell(
        f"{format_label(verdict.label)}, {format_percent(verdict.probabilities[verdict.label])}"
    )
