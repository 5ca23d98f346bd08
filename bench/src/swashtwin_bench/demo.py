"""The demo: a virtual rig, trained models, the twin of a pump, and a diagnosis as a page.

Every class was recorded at low pressures, but at the highest one only the healthy pump was: the
state of a plant whose faults occurred elsewhere. Twins simulate every class at that pressure. The
page compares three trainings on all recordings of unseen pumps at that pressure: on measured
windows alone, with nominal twins, and with twins calibrated on the training pumps. It shows the
diagnosis of the first faulty recording, by name, whether it is right or wrong.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from swashtwin.diagnosis import Diagnosis, diagnose, load_classifier, save_classifier
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
from swashtwin_bench.results.naming import format_factor
from swashtwin_bench.results.page import build_study_part
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.runs import Run, Work
from swashtwin_bench.rigs.writing import SIZES, build_rig
from swashtwin_bench.studies.plan import Plan
from swashtwin_bench.studies.plans import build_plan
from swashtwin_bench.studies.runner import model_file, require_rig, run_plan
from swashtwin_bench.studies.training_sets import DEMO_TRAINING_SETS

QUESTION = "No fault was recorded at this pressure: can twins replace the missing recordings?"
"""Title of the page."""

STUDY = "demo"
"""Name of the study whose runs the demo keeps."""

WITHOUT = "measured"
"""Training set without simulated windows."""

WITH = "calibrated"
"""Training set whose model is kept, and whose diagnosis the page shows."""

HEALTHY = "normal"
"""Class of the rig's healthy pumps."""

# Split of the pumps that are never trained on.
_UNSEEN_PUMPS = "L4"

# Target miscoverage of the prediction sets, that of the default training.
_ERROR_RATE = 0.1


@dataclass(frozen=True)
class Demo:
    """Results of the demo, and the paths of its files."""

    study: StudyResult
    """Scores of all training sets and classifiers."""
    model: Path
    """Model trained on measured windows and on those of the calibrated twins."""
    twin: Path
    """Calibration of the first training pump."""
    pump: str
    """Name of that pump."""
    diagnoses: Mapping[str, tuple[Diagnosis, ...]]
    """Diagnosis of each recording of unseen pumps at the missing pressure, by training set."""
    labels: tuple[str, ...]
    """True class of each of these recordings."""
    next_recording: Path
    """Recording of an unseen pump with another fault, to diagnose next."""
    shown_index: int
    """Index of the recording whose diagnosis the page shows: the first faulty one."""
    rig: Path
    """Folder of the recordings."""
    page: Path
    """The page."""

    def count_correct(self, training_set: str) -> int:
        """Return how many recordings a training set classifies correctly."""
        return sum(
            diagnosis.label == label
            for diagnosis, label in zip(self.diagnoses[training_set], self.labels, strict=True)
        )

    def count_false_alarms(self, training_set: str) -> int:
        """Return how many healthy recordings a training set takes for faulty ones."""
        return sum(
            label == HEALTHY and diagnosis.label not in (HEALTHY, None)
            for diagnosis, label in zip(self.diagnoses[training_set], self.labels, strict=True)
        )


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
    plan = build_plan(STUDY)
    recordings = _record_rig(rig, plan, seed, jobs, progress)

    work = Work(
        (seed,),
        jobs,
        out / "runs",
        progress,
        command=command,
    )
    study = run_plan(plan, recordings, work, keep_models=True)

    # Only the network has a history; the trees beside it are not saved.
    network_runs = {run["factors"]["training_set"]: run for run in study.runs if run["history"]}
    validation = _select_validation(recordings, network_runs[WITH], plan)
    models = {}
    for training_set in plan.training_sets:
        folder = out / "runs" / STUDY / network_runs[training_set]["key"]
        classifier = load_classifier(model_file(folder))
        models[training_set] = _with_confidence(classifier, validation)

    unseen_ids = network_runs[WITH]["roles"][_UNSEEN_PUMPS]
    unseen = [recording for recording in recordings if recording.recording_id in unseen_ids]
    labels = tuple(str(recording.label) for recording in unseen)
    faulty = [index for index, label in enumerate(labels) if label != HEALTHY]
    next_recording = next(unseen[index] for index in faulty if labels[index] != labels[faulty[0]])

    calibration = study.calibrations[0]
    calibrated_id = calibration.recording_ids[0]
    pump = next(r.specimen for r in recordings if r.recording_id == calibrated_id)

    demo = Demo(
        study=study,
        model=save_classifier(models[WITH], out / "model.safetensors"),
        twin=calibration.save(out / "twin.json"),
        pump=str(pump),
        diagnoses={name: _diagnose_all(model, unseen, plan) for name, model in models.items()},
        labels=labels,
        next_recording=rig / str(next_recording.attributes["file"]),
        shown_index=faulty[0],
        rig=rig,
        page=out / "report" / "report.html",
    )
    write_report(
        *_build_page(demo), folder=demo.page.parent, about={"Model": demo.model.as_posix()}
    )
    return demo


def _record_rig(
    folder: Path, plan: Plan, seed: int, jobs: int, progress: Callable[[str, int, int], None]
) -> list[Recording]:
    """Return the recordings of the rig in `folder`, which is built if it does not exist."""
    if not (folder / "recordings.toml").is_file():
        build_rig(
            folder,
            seed=seed,
            size=plan.fleet,
            jobs=jobs,
            progress=lambda count, total: progress("recording on the rig", count, total),
        )

    recordings = list(load_recordings(folder))
    require_rig(folder, recordings, SIZES[plan.fleet])
    return recordings


def _select_validation(recordings: Sequence[Recording], run: Run, plan: Plan) -> list[Recording]:
    """Return recordings of the training pumps that had no role in training, calibration or test.

    Recordings of the missing cells are excluded: by the question, nobody has one.
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
    fault = format_label(demo.labels[demo.shown_index])
    is_correct = demo.diagnoses[WITH][demo.shown_index].label == demo.labels[demo.shown_index]
    n_recordings = len(demo.labels)
    n_healthy = demo.labels.count(HEALTHY)

    trainings = {name: format_factor("training_set", name) for name in DEMO_TRAINING_SETS}
    correct = ", ".join(
        f"{demo.count_correct(name)} ({training})" for name, training in trainings.items()
    )
    false_alarms = ", ".join(
        f"{demo.count_false_alarms(name)} ({training})" for name, training in trainings.items()
    )
    return (
        f"Classified correctly: {correct}, of {n_recordings} recordings at 15 MPa of pumps that no "
        f"model was trained on. Healthy ones taken for faulty: {false_alarms}, of {n_healthy}. The "
        "three trainings share the network and the recordings: every class at 5 and 10 MPa, and "
        "the healthy pump at 15 MPa. Twins added every class at 15 MPa.",
        "This is one fleet of a virtual rig and one training: a demonstration, not a proof. "
        "swashtwin bench study demo repeats it on other fleets.",
        f"The page shows the diagnosis of the first faulty recording with the {WITH} twins. The "
        f"pump has a {fault} fault, so this diagnosis is {'correct' if is_correct else 'wrong'}.",
    )


def _build_page(demo: Demo) -> tuple[Part, Part]:
    """Return the parts of the page: the answer to the question, and a diagnosis.

    Sections on calibration and training are folded: they explain, but do not answer.
    """
    diagnosis = build_part(demo.diagnoses[WITH][demo.shown_index], "diagnosis")
    study = build_study_part(demo.study, "study")
    counts, caveat, correctness = summarize_demo(demo)

    comparison = Section(
        SectionOrder.VERDICT, "With and without twins", (counts, _build_comparison(demo))
    )
    scores = Section(SectionOrder.SCORES, "Both classifiers on unseen pumps", study.glance)

    study_sections = []
    for section in study.sections:
        if section.position in (SectionOrder.CALIBRATION, SectionOrder.TRAINING):
            details = Group("Details", section.blocks, is_open=False)
            section = replace(section, blocks=(details,))
        study_sections.append(section)

    answer = Part(
        title=QUESTION,
        verdict=(
            f"{demo.count_correct(WITH)} of {len(demo.labels)} recordings correct with twins, "
            f"{demo.count_correct(WITHOUT)} without"
        ),
        answer=(caveat,),
        notice=diagnosis.notice,
        glance=(_build_counts(demo),),
        sections=(comparison, scores, *study_sections),
        results=study.results,
    )
    return answer, replace(diagnosis, answer=(correctness, *diagnosis.answer))


def _build_counts(demo: Demo) -> Table:
    """Return the table of recordings that each training classifies correctly, by class."""
    rows = []
    for label in dict.fromkeys(demo.labels):
        cells = [Cell(format_label(label)), Cell(str(demo.labels.count(label)))]
        for training_set in DEMO_TRAINING_SETS:
            named = [
                diagnosis.label == label
                for diagnosis, true_label in zip(
                    demo.diagnoses[training_set], demo.labels, strict=True
                )
                if true_label == label
            ]
            cells.append(Cell(str(sum(named))))
        rows.append(tuple(cells))

    totals = [Cell(str(demo.count_correct(name))) for name in DEMO_TRAINING_SETS]
    rows.append((Cell("all"), Cell(str(len(demo.labels))), *totals))
    header = ("class", "recordings", *_training_set_labels())
    caption = (
        "Recordings at 15 MPa from pumps that no model was trained on, and how many of each class "
        "each training classifies correctly."
    )
    return Table(caption, header, tuple(rows))


def _training_set_labels() -> list[str]:
    return [format_factor("training_set", name) for name in DEMO_TRAINING_SETS]


def _build_comparison(demo: Demo) -> Group:
    """Return the table of all recordings with their verdicts, folded."""
    rows = []
    for index, label in enumerate(demo.labels):
        diagnoses = [demo.diagnoses[name][index] for name in DEMO_TRAINING_SETS]
        name_cell = Cell(diagnoses[0].recording_id)
        rows.append((name_cell, Cell(format_label(label)), *map(_format_verdict, diagnoses)))

    table = Table(
        "The same recordings one by one: predicted class and its probability, pooled over the "
        "windows of the recording.",
        ("recording", "true class", *_training_set_labels()),
        tuple(rows),
    )
    return Group("Recording by recording", (table,), is_open=False)


def _format_verdict(diagnosis: Diagnosis) -> Cell:
    if diagnosis.label is None:
        return Cell("no verdict", diagnosis.no_verdict or "")

    probability = diagnosis.probabilities[diagnosis.label]
    return Cell(f"{format_label(diagnosis.label)}, {format_percent(probability)}")
