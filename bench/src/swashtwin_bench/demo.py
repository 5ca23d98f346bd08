"""The demo: a virtual rig, a trained model, the twin of a pump, and a diagnosis as a page.

The question is that of the paper's Case II: a fault was never recorded at the pressure at which it
has to be recognized. Twins are calibrated on the same fault at another pressure, and simulate it.
The page shows the first recording, by name, of that fault at that pressure from a pump that
contributed nothing to the models, whether the diagnosis is right or wrong.
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

QUESTION = (
    "A fault that was never recorded at this pressure: can a twin replace the missing recordings?"
)
"""Title of the page."""

STUDY = "case2"
"""Case II of the paper."""

WITHOUT = "measured"
WITH = "calibrated"
"""Training sets compared on the recordings of the fault: without and with the twins' windows."""

# Splits of Case II: other recordings of the training pumps, and pumps that are never trained on.
_TRAINING_PUMPS = "L2"
_UNSEEN_PUMPS = "L4"

# Target miscoverage of the prediction sets, that of the default training.
_ERROR_RATE = 0.1


@dataclass(frozen=True)
class Demo:
    """Results of the demo, and the paths of its files."""

    study: StudyResult
    """Case II of the paper in its quick size."""
    model: Path
    """Model trained on measured windows and on those of the calibrated twins."""
    twin: Path
    """Calibration of the first training pump."""
    pump: str
    """Name of that pump."""
    with_twin: tuple[Diagnosis, ...]
    """Diagnosis of each recording of the fault at the missing pressure from unseen pumps; the page
    shows the first.
    """
    without_twin: tuple[Diagnosis, ...]
    """Diagnoses of the same recordings by the network trained on measured windows alone."""
    label: str
    """The fault."""
    next_recording: Path
    """Recording of an unseen pump with another fault, to diagnose next."""
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
    """Run the demo in the folder `out`; what an interrupted run left there is used again.

    Parameters
    ----------
    progress : called with (activity, finished, total).
    command : command line that repeats the demo.

    Raises
    ------
    DataError
        ``rig-SEED`` in `out` contains other recordings than those of the rig.
    """
    rig = out / f"rig-{seed}"
    recordings = _record_rig(rig, seed, jobs, progress)

    plan = build_plan(STUDY, "quick")
    work = Work(
        (seed,),
        jobs,
        out / "runs",
        lambda activity, count, total: progress(f"Case II: {activity}", count, total),
        command=command,
    )
    study = run_plan(plan, recordings, work, keep_models=True)

    # Only the network has a history; the trees beside it are not saved.
    network_runs = {run["factors"]["training_set"]: run for run in study.runs if run["history"]}
    validation = _select_validation(recordings, network_runs[WITH], plan)
    models = {}
    for training_set in (WITHOUT, WITH):
        folder = out / "runs" / STUDY / network_runs[training_set]["key"]
        classifier = load_classifier(model_file(folder))
        models[training_set] = _with_confidence(classifier, validation)

    unseen_ids = network_runs[WITH]["roles"][_UNSEEN_PUMPS]
    unseen = [recording for recording in recordings if recording.recording_id in unseen_ids]
    faulty = [recording for recording in unseen if plan.scenario.is_scarce(recording)]
    known_labels = (*plan.scenario.scarce, "normal")
    next_recording = next(r for r in unseen if r.label not in known_labels)

    calibration = study.calibrations[0]
    calibrated_id = calibration.recording_ids[0]
    pump = next(r.specimen for r in recordings if r.recording_id == calibrated_id)

    demo = Demo(
        study=study,
        model=save_classifier(models[WITH], out / "model.safetensors"),
        twin=calibration.save(out / "twin.json"),
        pump=str(pump),
        with_twin=_diagnose_all(models[WITH], faulty, plan),
        without_twin=_diagnose_all(models[WITHOUT], faulty, plan),
        label=str(faulty[0].label),
        next_recording=rig / str(next_recording.attributes["file"]),
        rig=rig,
        page=out / "report" / "report.html",
    )
    write_report(_build_page(demo), folder=demo.page.parent, about={"Model": demo.model.as_posix()})
    return demo


def _record_rig(
    folder: Path, seed: int, jobs: int, progress: Callable[[str, int, int], None]
) -> list[Recording]:
    """Return the recordings of the rig in `folder`, which is built if it does not exist."""
    if not (folder / "recordings.toml").is_file():
        build_rig(
            folder,
            seed=seed,
            jobs=jobs,
            progress=lambda count, total: progress("recording on the rig", count, total),
        )

    recordings = list(load_recordings(folder))
    require_rig(folder, recordings, SIZES["small"])
    return recordings


def _select_validation(recordings: Sequence[Recording], run: Run, plan: Plan) -> list[Recording]:
    """Return recordings of the training pumps that had no role in training, calibration or test.

    Recordings of the missing cell are excluded: by the question, nobody has one.
    """
    ids_with_role = set().union(*run["roles"].values())
    training_ids = set(run["roles"]["train"])
    training_pumps = {r.specimen for r in recordings if r.recording_id in training_ids}

    return [
        recording
        for recording in recordings
        if recording.specimen in training_pumps
        and recording.recording_id not in ids_with_role
        and not plan.scenario.is_scarce(recording)
    ]


def _with_confidence(
    classifier: FittedClassifier, validation: Sequence[Recording]
) -> FittedClassifier:
    windows = cut_windows(validation, length=classifier.layout.length, classes=classifier.classes)
    # Few validation recordings do not support every error rate.
    error_rate = allowed_error_rate(len(validation), _ERROR_RATE)
    return learn_confidence(classifier, windows, error_rate=error_rate)


def _diagnose_all(
    classifier: FittedClassifier, recordings: Sequence[Recording], plan: Plan
) -> tuple[Diagnosis, ...]:
    """Return the diagnosis of each recording, with the number of pistons.

    The recordings of the rig do not specify that number; the pump of the scenario does.
    """
    pistons = plan.scenario.pump.rotating_group.piston_count

    diagnoses = []
    for recording in recordings:
        diagnosis = diagnose(classifier, recording)
        facts = replace(diagnosis.facts, pistons=pistons)
        diagnoses.append(replace(diagnosis, facts=facts))

    return tuple(diagnoses)


def summarize_demo(demo: Demo) -> tuple[str, ...]:
    """Return the answer to the question of the demo in paragraphs."""
    fault = format_label(demo.label)
    correctness = "correct" if demo.with_twin[0].label == demo.label else "wrong"
    n_correct_with = sum(diagnosis.label == demo.label for diagnosis in demo.with_twin)
    n_correct_without = sum(diagnosis.label == demo.label for diagnosis in demo.without_twin)

    return (
        f"The pump has a {fault} fault, so this diagnosis is {correctness}. The model was trained "
        f"on no recording of this pump, and on no recording of a {fault} fault at this pressure. "
        "Twins of other pumps simulated the fault at this pressure; they were calibrated on "
        "recordings of it at another pressure.",
        f"There are {plural(len(demo.with_twin), 'recording')} of this fault at this pressure from "
        f"unseen pumps. The model classifies {n_correct_with} of them correctly. The same network "
        f"trained without the windows of the twins classifies {n_correct_without} correctly. "
        f"{_describe_recalls(demo)} This is one fleet of a virtual rig and one training: a "
        "demonstration, not a proof.",
    )


def _describe_recalls(demo: Demo) -> str:
    """Return sentences about the recall of the fault's windows, with and without the twin."""
    recalls = {
        (row["training_set"], row["split"]): float(row["scarce_recall"]["mean"])
        for row in demo.study.rows()
        if row["classifier"] == demo.study.main_classifier
    }

    sentences = []
    for split, source in (
        (_UNSEEN_PUMPS, "unseen pumps"),
        (_TRAINING_PUMPS, "other recordings of the training pumps"),
    ):
        recall_with = format_percent(recalls[WITH, split])
        recall_without = format_percent(recalls[WITHOUT, split])
        sentences.append(
            f"Recall of single windows of the fault from {source}: {recall_with} with the twins' "
            f"windows, {recall_without} without."
        )

    return " ".join(sentences)


def _build_page(demo: Demo) -> Part:
    """Return the page: question, diagnosis, comparison with and without the twin, Case II.

    Sections on calibration and training are folded: they explain, but do not answer.
    """
    diagnosis = build_part(demo.with_twin[0], "diagnosis")
    study = build_study_part(demo.study, "study")

    comparison = Section(
        SectionOrder.VERDICT, "With and without the twin", (_build_comparison(demo),)
    )
    paper = Section(SectionOrder.SCORES, "Case II of the paper", tuple(study.answer))

    study_sections = []
    for section in study.sections:
        if section.position in (SectionOrder.CALIBRATION, SectionOrder.TRAINING):
            details = Group("Details", section.blocks, is_open=False)
            section = replace(section, blocks=(details,))
        study_sections.append(section)

    return replace(
        diagnosis,
        title=QUESTION,
        answer=(*summarize_demo(demo), *diagnosis.answer),
        sections=(comparison, *diagnosis.sections, paper, *study_sections),
        results={**diagnosis.results, **study.results},
    )


def _build_comparison(demo: Demo) -> Table:
    rows = tuple(
        (Cell(with_twin.recording_id), _format_verdict(without_twin), _format_verdict(with_twin))
        for without_twin, with_twin in zip(demo.without_twin, demo.with_twin, strict=True)
    )
    caption = (
        f"All recordings of the fault ({format_label(demo.label)}) at this pressure from pumps "
        "that no model was trained on: predicted class and its probability, pooled over the "
        "windows of the recording."
    )
    return Table(caption, ("recording", "without the twin", "with the twin"), rows)


def _format_verdict(diagnosis: Diagnosis) -> Cell:
    if diagnosis.label is None:
        return Cell("no verdict", diagnosis.no_verdict or "")

    probability = diagnosis.probabilities[diagnosis.label]
    return Cell(f"{format_label(diagnosis.label)}, {format_percent(probability)}")
