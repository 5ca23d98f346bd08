"""`run_paper` and `write_paper_page`: every experiment of the paper by its own recipe, and one page
of them.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from swashtwin.foundation import InputError, plural
from swashtwin.recordings import Recording, load_recordings
from swashtwin.report import (
    Bullets,
    Cell,
    Part,
    Section,
    SectionOrder,
    Table,
    format_number,
    iterate_drawings,
    write_report,
)
from swashtwin_bench.paper.identification import STUDY as IDENTIFICATION
from swashtwin_bench.paper.identification import rates_drawing, run_identification, values_table
from swashtwin_bench.results.naming import format_factor
from swashtwin_bench.results.page import build_study_part
from swashtwin_bench.results.reported import PAPER_STUDY, format_reported
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.runs import Run, Work
from swashtwin_bench.results.table import StudyTable
from swashtwin_bench.rigs.writing import RIG_VERSION
from swashtwin_bench.studies import plans
from swashtwin_bench.studies.plan import PlanSettings
from swashtwin_bench.studies.plans import PAPER, PAPER_NETWORK, build_plan
from swashtwin_bench.studies.registry import read_settings
from swashtwin_bench.studies.runner import find_fleets, run_plan

EXPERIMENTS: Mapping[str, str] = MappingProxyType(
    {
        "case1": "Case I, few samples",
        "case2": "Case II, missing condition",
        "recess": "Case I with the paper's recess of 0.6 mm",
        "algorithms": "Algorithms, repeated trainings",
        "ablation": "Ablation A, B, C with convergence",
        "noise": "Noise",
        "related": "Related work",
        "identification": "Identification by the IPINN",
    }
)
"""Experiments of the paper, in the order of the page, and their headings."""

PICTURES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "excitation of each slipper, and total": ("_excitation",),
        "waveforms before and after identification": ("_waveforms",),
        "spectra before and after identification": ("_spectra",),
        "loss curves of the identification": ("_losses", "_rates"),
        "confusion matrix of each training set": ("_confusion",),
        "t-SNE of each training set": ("_tsne",),
        "bars of the algorithms": ("algorithms_rows",),
        "bars of the ablation": ("ablation_rows",),
        "accuracy against noise": ("_perturbation",),
        "loss curves of the training": ("_training",),
    }
)
"""Pictures that the paper shows, and how the names of ours end."""

SAME = (
    "Pump 25SCY14-1B at 860 rev/min and 5, 10 and 15 MPa; five classes; the swash plate fault at "
    "15 MPa is scarce, and twins fill it with three windows for each measured one; training sets "
    "are measured windows only, with a nominal twin, or with calibrated twins; test windows are "
    "measured. The paper's network, by Adam with a rate of 0.001.",
    "Ablation: A ordinary in place of dilated causal convolution, B no squeeze-and-excitation, C "
    "the forward branch only. IPINN with four convolutions, base values times magnitudes, boundary "
    "and spectrum loss, Adam, 500 epochs; the best epoch is the result.",
)
"""Settings that are the same as in the paper."""

DIFFERENT = (
    "Recordings are of the virtual rig, which is no machine; the paper's are of one real rig. The "
    "paper's figures are no target that these could meet or miss. Three accelerometers in place of "
    "thirteen, whose places are not public.",
    "The recess is 0.07 mm deep in place of 0.6 mm, but in the experiment recess, where films pull "
    "the slippers through it as in the paper's model (version 1-deep of the rig).",
    "The paper prints no size of its networks, no length of a window and no scaling: these are our "
    "reading. A window is 80 ms and scaled by itself. The last epoch counts, never the one best on "
    "the test.",
    "The paper does not say whether training and test share recordings: both cases stand by "
    "recording (L2) and on random windows (L0). It does not define its noise ratio; nor its "
    "G-mean, which is another than ours.",
    "Recurrent networks read patches of 16 samples and TCN steps of 8. The trainings of the "
    "algorithms are repeated on one fleet, as the paper's ten: the spread is that of weights and "
    "order alone.",
    "The paper prints no figure for related work. The autoencoder is that of Sohaib and Kim, DOI "
    "10.1155/2018/2919637; which graph networks the paper cites is not public in text: a graph of "
    "three sensors is our reading.",
    "The steady vibration is solved by harmonic balance inside the IPINN's loss, which gives the "
    "lines of RK4.",
)
"""Differences from the paper, with their reasons."""


def run_paper(
    work: Work,
    *,
    size: str = "quick",
    experiments: Sequence[str] = tuple(EXPERIMENTS),
    settings: Mapping[str, Any] | None = None,
    source: Path | None = None,
) -> dict[str, StudyTable]:
    """Return the results of some experiments by name of the study.

    Runs that are finished in the folder of `work` are read.

    Parameters
    ----------
    work : its seeds are fleets of the virtual rig; the algorithms are repeated on the first one. It
        needs a folder.
    size : name of a size of the plans.
    experiments : names in `EXPERIMENTS`.
    settings : values of `PlanSettings` by name; training sets apply to the experiments that compare
        them.
    source : index, store or folder of recordings that replace the virtual rig.

    Raises
    ------
    InputError
        A size, experiment or setting is unknown, or there is no folder.
    """
    unknown = [name for name in experiments if name not in EXPERIMENTS]
    if unknown or not experiments:
        raise InputError(
            f"no experiment {', '.join(unknown) or 'is named'}; there are {', '.join(EXPERIMENTS)}."
        )
    if size not in plans.SIZES[PAPER]:
        raise InputError(f"no size {size!r}; there are {', '.join(plans.SIZES[PAPER])}.")
    if (folder := work.out) is None:
        raise InputError("the paper needs a folder (--out), which the fleets are built into.")
    plan_settings: PlanSettings = read_settings(PlanSettings, settings or {}, "the paper")
    rig_size = "small" if size == "quick" else "paper"
    recordings = None if source is None else load_recordings(source)

    def fleet(version: str) -> Callable[[int], Sequence[Recording]]:
        """Return the function that gives the recordings of a seed."""
        if recordings is None:
            return find_fleets(folder, rig_size, version, work)
        return lambda _: recordings

    results: dict[str, StudyTable] = {}
    selected = [name for name in EXPERIMENTS if name in experiments]
    for number, name in enumerate(selected, 1):
        part = work.part(f"{name} ({number} of {len(selected)})")
        if name == "identification":
            results[IDENTIFICATION] = run_identification(part, size, fleet(RIG_VERSION))
            continue

        plan = build_plan(f"{PAPER_STUDY}{name}", size)
        sets = tuple(name for name in plan_settings.training_sets if name in plan.training_sets)
        # An experiment with a single training set compares none, so the setting does not apply.
        if not sets and plan_settings.training_sets and len(plan.training_sets) > 1:
            raise InputError(
                f"no training set {plan_settings.training_sets[0]!r}; there are "
                f"{', '.join(plan.training_sets)}."
            )
        plan = plan.with_settings(replace(plan_settings, training_sets=sets))
        results[plan.study] = run_plan(plan, fleet(plan.rig), part)

    return results


def paper_answer(results: Mapping[str, StudyTable]) -> tuple[str, ...]:
    """Return the result of each experiment in a sentence."""
    return tuple(f"{heading}: {_result(study)}" for heading, study in _experiments(results))


def _experiments(results: Mapping[str, StudyTable]) -> Iterator[tuple[str, StudyTable]]:
    """Yield heading and study of the experiments that have a result."""
    for name, heading in EXPERIMENTS.items():
        study = results.get(f"{PAPER_STUDY}{name}")
        if study is not None:
            yield heading, study


def _result(study: StudyTable) -> str:
    """Return the result of a study in a few sentences.

    They give the last row of the paper's network for which the paper prints a figure, at each
    split, and the differences of the other networks.
    """
    if not isinstance(study, StudyResult):
        return study.answer[0]

    rows = [row for row in study.rows() if row["classifier"] == PAPER_NETWORK]
    printed = [row for row in rows if row["split"] == "L2" and format_reported(study.study, row)]
    if not printed:
        return "the paper prints no figure of what was run."

    row = printed[-1]
    test = _describe_test(row, study)
    splits = ", ".join(
        f"{candidate['accuracy']['mean']:.3f} at {candidate['split']}"
        for candidate in rows
        if _describe_test(candidate, study) == test
    )
    count = len(row["accuracy"]["values"])
    sentence = (
        f"{test}: accuracy {splits}; n = {count}; the paper: {format_reported(study.study, row)}."
    )

    perturbation = row.get("perturbation", "")
    differences = [
        difference
        for difference in study.differences()
        if difference.factor == "classifier"
        and difference.first["split"] == "L2"
        and difference.first.get("perturbation", "") == perturbation
    ]
    sentences = [sentence, *(difference.sentence for difference in differences)]
    if study.study == f"{PAPER_STUDY}ablation":
        sentences.append(convergence_sentence(study))
    return " ".join(sentences)


def _describe_test(row: Mapping[str, Any], study: StudyResult) -> str:
    """Return training set and test of a row in words, without its split and its windows."""
    return ", ".join(
        format_factor(name, row[name])
        for name in study.factors
        if name not in ("classifier", "split", "windows")
    )


def convergence(study: StudyResult) -> dict[str, tuple[float, float]]:
    """Return mean epochs and CPU time [s] to a training loss that all networks reach, by network.

    That loss is the highest of the networks' minimum losses. Seeds without a training of every
    network are skipped, because their common loss would be another one.
    """
    names = list(dict.fromkeys(run["factors"]["classifier"] for run in study.runs))
    costs: dict[str, list[tuple[int, float]]] = {name: [] for name in names}

    for seed in study.seeds:
        runs = [run for run in study.runs if run["seed"] == seed]
        if len(runs) != len(names):
            continue

        common_loss = max(min(_losses(run)) for run in runs)
        for run in runs:
            epoch = 1 + next(
                index for index, loss in enumerate(_losses(run)) if loss <= common_loss
            )
            cpu_s = epoch * run["values"].get("epoch_cpu_s", np.nan)
            costs[run["factors"]["classifier"]].append((epoch, cpu_s))

    means: dict[str, tuple[float, float]] = {}
    for name, pairs in costs.items():
        if pairs:
            epochs, seconds = np.mean(pairs, axis=0)
            means[name] = (float(epochs), float(seconds))

    return means


def _losses(run: Run) -> list[float]:
    return [epoch["loss"] for epoch in run["history"]]


def convergence_sentence(study: StudyResult) -> str:
    """Return epochs and seconds of each network to the common loss.

    The sentence also states whether the full network is the fastest by both.
    """
    means = convergence(study)
    if PAPER_NETWORK not in means:
        return "Convergence: no fleet has a training of every network yet."

    listed = "; ".join(
        f"{format_factor('classifier', name)} {format_number(epochs)} epochs and "
        f"{format_number(seconds)} s"
        for name, (epochs, seconds) in means.items()
    )
    paper_epochs, paper_seconds = means[PAPER_NETWORK]
    is_first = all(
        paper_epochs < epochs and paper_seconds < seconds
        for name, (epochs, seconds) in means.items()
        if name != PAPER_NETWORK
    )

    return (
        f"Convergence to a training loss that all reach: {listed}. The full network is "
        f"{'' if is_first else 'not '}the "
        "fastest by both."
    )


def write_paper_page(results: Mapping[str, StudyTable], size: str, folder: Path) -> Path:
    """Write a page that compares each experiment with the paper, and return its path.

    ``report.html`` begins with the results of all experiments and has a part for each study.

    Parameters
    ----------
    results : by study, as `run_paper` returns them.
    size : name of a size of the plans.
    folder : made if it does not exist.

    Raises
    ------
    InputError
        There is no result, or `folder` is a file.
    """
    if not results:
        raise InputError("No experiment has a result to write a page of.")

    parts = [_part(study) for study in _without_repeated_twins(results)]
    drawings: list[str] = []
    for part in parts:
        for section in part.sections:
            drawings += [drawing.name for drawing in iterate_drawings(section.blocks)]

    pictures = []
    for picture, endings in PICTURES.items():
        matching = [name for name in drawings if name.endswith(endings)]
        pictures.append((Cell(picture), Cell(", ".join(matching) or "none on this page")))

    overview = tuple(
        (Cell(heading), Cell(_result(study))) for heading, study in _experiments(results)
    )
    first = next(iter(results.values()))
    lead = Part(
        title="The paper, row by row",
        answer=(),
        notice=first.origin,
        certainty=_certainty(size, results),
        glance=(Table("What came out of each experiment.", ("experiment", "result"), overview),),
        sections=(
            Section(
                SectionOrder.VERDICT,
                "What is compared",
                (
                    "The paper: IPINN-BiTCN fault diagnosis of axial piston pump friction pairs "
                    "under imbalanced samples, Measurement and Control, DOI "
                    "10.1177/00202940261419020. Its figures are as printed there; ours come from "
                    "the runs of this folder.",
                    Bullets("The same as in the paper", SAME),
                    Bullets("Different, and why", (*_smaller(size), *DIFFERENT)),
                    Table(
                        "Pictures of the paper, and ours: files in figures/.",
                        ("picture", "figures"),
                        tuple(pictures),
                    ),
                ),
            ),
        ),
        results={},
    )
    return write_report(lead, *parts, folder=folder)


def _part(study: StudyTable) -> Part:
    # The lead states the results of all experiments; each chart stands with its scores.
    part = replace(build_study_part(study, study.study.replace("-", "_")), notice="", glance=())
    if study.study != IDENTIFICATION:
        return part
    blocks = (values_table(study), rates_drawing(study))
    return replace(
        part, sections=(*part.sections, Section(SectionOrder.CALIBRATION, "The six values", blocks))
    )


def _without_repeated_twins(results: Mapping[str, StudyTable]) -> Iterator[StudyTable]:
    """Yield the studies without the calibrations that a previous one has reported."""
    reported_keys: set[tuple[str, str, tuple[str, ...]]] = set()
    for study in results.values():
        if isinstance(study, StudyResult):
            calibrations = {}
            for calibration in study.calibrations:
                key = (study.origin, calibration.twin.pump.name, calibration.recording_ids)
                calibrations[key] = calibration

            new_calibrations = [
                calibration for key, calibration in calibrations.items() if key not in reported_keys
            ]
            reported_keys |= calibrations.keys()
            study = replace(study, calibrations=tuple(new_calibrations))

        yield study


def _smaller(size: str) -> tuple[str, ...]:
    """What is smaller than in the paper."""
    training, paper = plans.TRAINING[size], plans.TRAINING["paper"]
    if size == "paper":
        return ()
    text = f"Size {size}: {training.epochs} epochs in place of {paper.epochs}"
    if size == "medium":
        return (
            f"{text}, and the paper's network reads patches of {plans.PATCH} samples in place of "
            "every sample.",
        )
    counts, full = plans.SCENARIOS[PAPER, size], plans.SCENARIOS[PAPER, "paper"]
    return (
        f"{text}, batches of {training.batch_size} in place of {paper.batch_size}; "
        f"{counts.windows} windows of each recording in place of {full.windows}, "
        f"{counts.scarce_windows} measured windows in the scarce cell in place of "
        f"{full.scarce_windows}, {counts.synthetic} synthetic ones in place of {full.synthetic}. "
        "It shows that every experiment runs, not how good it is.",
    )


def _certainty(size: str, results: Mapping[str, StudyTable]) -> tuple[str, ...]:
    """Return the limits of the results: size, and numbers of fleets, trainings and pumps."""
    remarks = []
    if size == "quick":
        remarks.append("Size quick shows that every experiment runs, not how good it is.")

    # The algorithms are repeated on one fleet, so their seeds are not fleets.
    repeated = f"{PAPER_STUDY}algorithms"
    fleet_studies = [study for name, study in results.items() if name != repeated]
    seeds = sorted(set().union(*(study.seeds for study in fleet_studies)))
    if seeds:
        intervals = "Differences have no interval."
        if len(seeds) > 1:
            intervals = "Differences are paired by fleet."
        fleet_count = plural(len(seeds), "fleet")
        remarks.append(f"{fleet_count} of pumps (seeds {', '.join(map(str, seeds))}). {intervals}")

    if repeated in results:
        remarks.append(
            f"Algorithms: {plural(len(results[repeated].seeds), 'training')} of each on one fleet."
        )
    return tuple(remarks)
