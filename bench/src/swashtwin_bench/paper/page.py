"""`write_paper_page`: the paper's tables and figures beside ours, on one page with the studies they come from."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from swashtwin.foundation import InputError, plural
from swashtwin.report import (
    Bullets,
    Cell,
    Group,
    Paragraph,
    Part,
    Picture,
    Section,
    SectionOrder,
    Table,
    drawings,
    write_report,
)
from swashtwin_bench.paper.beside import beside_table, level_sentence
from swashtwin_bench.paper.convergence import convergence_drawing, convergence_sentence, convergence_table
from swashtwin_bench.paper.differences import Comparability, common, comparability
from swashtwin_bench.paper.identification import STUDY as IDENTIFICATION
from swashtwin_bench.paper.identified import identification_blocks, identification_sentence
from swashtwin_bench.paper.running import EXPERIMENTS, REPEATED
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.study_part import study_part, with_origin
from swashtwin_bench.results.table import StudyTable
from swashtwin_bench.results.table_part import table_part

TITLES = {
    "case1": "Case I, few samples",
    "case2": "Case II, missing condition",
    "recess": "Case I with the paper's recess of 0.6 mm",
    "algorithms": "Algorithms, repeated trainings",
    "ablation": "Ablation A, B, C with convergence",
    "noise": "Noise",
    "related": "Related work",
    "identification": "Identification by the IPINN",
}
"""Heading of each experiment."""

PICTURES: Mapping[str, tuple[str, ...]] = {
    "excitation of each slipper, and total": ("_excitation",),
    "waveforms before and after identification": ("_waveforms",),
    "spectra before and after identification": ("_spectra",),
    "loss curves of the identification": ("_losses", "_rates"),
    "confusion matrix of each training set": ("_confusion",),
    "t-SNE of each training set": ("_tsne",),
    "bars of the algorithms": ("algorithms_classifiers",),
    "bars of the ablation": ("ablation_classifiers",),
    "convergence of the ablation": ("_convergence",),
    "accuracy against noise": ("_perturbation",),
    "loss curves of the training": ("_training",),
}
"""Pictures that the paper shows, and how the names of ours end."""


def write_paper_page(results: Mapping[str, StudyTable], size: str, folder: Path) -> Path:
    """Path of ``report.html``: a section for each experiment, the paper's rows beside ours and its studies folded.

    Parameters
    ----------
    results : by study, as `run_paper` gives them.
    size : name in `plans.SIZES`.
    folder : made if it does not exist.

    Raises
    ------
    InputError
        No result, or `folder` is a file.
    """
    if not results:
        raise InputError("there is no result of any experiment to write a page of.")
    parts = {study.study: _part(study) for study in _with_each_twin_once(results.values())}
    sections = []
    for name in _experiments(results):
        studies = [parts[study] for study in EXPERIMENTS[name] if study in parts]
        groups = (group for part in studies for group in _folded(part))
        sections.append(Section(SectionOrder.VERDICT, TITLES[name], (*_blocks(name, size, results), *groups)))
    shown = [drawing.name for section in sections for drawing in drawings(section.blocks)]
    kinds = dict.fromkeys(kind for part in parts.values() for kind in part.results)
    page = Part(
        title="The paper, row by row",
        answer=(),
        notice=next(iter(results.values())).origin,
        certainty=_certainty(size, results),
        glance=(_overview(results),),
        sections=(_introduction(size, results, shown), *sections),
        results={kind: [entry for part in parts.values() for entry in part.results.get(kind, [])] for kind in kinds},
    )
    return write_report(page, folder=folder)


def paper_answer(results: Mapping[str, StudyTable]) -> tuple[str, ...]:
    """What came out of each experiment, in a sentence."""
    return tuple(f"{TITLES[name]}: {_result(name, results)}" for name in _experiments(results))


def _overview(results: Mapping[str, StudyTable]) -> Table:
    texts = ((name, _result(name, results)) for name in _experiments(results))
    rows = tuple((Cell(TITLES[name]), Cell(text[0].upper() + text[1:])) for name, text in texts)
    return Table("What came out of each experiment.", ("experiment", "result"), rows)


def _experiments(results: Mapping[str, StudyTable]) -> list[str]:
    return [name for name, studies in EXPERIMENTS.items() if studies[0] in results]


def _with_each_twin_once(studies: Iterable[StudyTable]) -> Iterator[StudyTable]:
    """Studies without the calibrations that one before has shown."""
    shown: set[tuple[str, str, tuple[str, ...]]] = set()
    for study in studies:
        if not isinstance(study, StudyResult):
            yield study
            continue
        named = {(study.origin, each.twin.pump.name, each.recording_ids): each for each in study.calibrations}
        new = tuple(each for name, each in named.items() if name not in shown)
        notes = study.notes if len(new) == len(named) else (*study.notes, "Further twins: see an earlier experiment.")
        yield replace(study, calibrations=new, notes=notes)
        shown |= named.keys()


def _folded(part: Part) -> Iterator[Group]:
    """The sections of a study, folded away."""
    study = part.title.split(",")[0].split(":")[0]
    for section in part.sections:
        yield Group(f"{study}: {section.title.removeprefix(f'{study}: ')}", section.blocks, is_open=False)


def _certainty(size: str, results: Mapping[str, StudyTable]) -> tuple[str, ...]:
    """What the size, and the numbers of fleets, trainings and pumps, let one say."""
    fleets = {study.seeds for name, study in results.items() if name not in (REPEATED, IDENTIFICATION)}
    remarks = ["Size small shows that every experiment runs, not how good it is."] if size == "small" else []
    if fleets:
        seeds = ", ".join(str(seed) for seed in sorted(set().union(*fleets)))
        least, most = min(map(len, fleets)), max(map(len, fleets))
        count = plural(most, "fleet") if least == most else f"{least} to {most} fleets"
        remarks.append(
            f"{count} of pumps (seeds {seeds}). "
            + ("Differences have no interval." if most == 1 else "Differences are paired by fleet.")
            + (" An accuracy of one fleet has its interval over the test's recordings." if least == 1 else "")
        )
    if REPEATED in results:
        trainings = plural(len(results[REPEATED].seeds), "training")
        remarks.append(f"Algorithms: {trainings} of each on one fleet. Differences between fleets are not in them.")
    if IDENTIFICATION in results:
        remarks.append("Identification: intervals are over pumps.")
    return tuple(remarks)


def _part(study: StudyTable) -> Part:
    key = study.study.replace("-", "_")
    return study_part(study, key) if isinstance(study, StudyResult) else table_part(study, key)


def _introduction(size: str, results: Mapping[str, StudyTable], shown: Sequence[str]) -> Section:
    study = next(iter(results.values()))
    rows = tuple(
        (
            Cell(picture),
            Cell(", ".join(name for name in shown if name.endswith(endings)) or "none on this page"),
        )
        for picture, endings in PICTURES.items()
    )
    source = (
        "The paper: IPINN-BiTCN fault diagnosis of axial piston pump friction pairs under imbalanced samples, "
        "Measurement and Control, DOI 10.1177/00202940261419020. Its figures are as printed there; ours come from the "
        "runs of this folder."
    )
    return Section(
        SectionOrder.VERDICT,
        "What is compared",
        (
            Paragraph(source),
            Paragraph(f"Command: {study.command or 'not recorded'}"),
            *_remarks(common(size, _precisions(results))),
            Table("Pictures of the paper, and ours: files in figures/.", ("picture", "figures"), rows),
        ),
    )


def _precisions(results: Mapping[str, StudyTable]) -> tuple[str, ...]:
    """Number formats that networks were trained in."""
    runs = (run for study in results.values() if isinstance(study, StudyResult) for run in study.runs)
    return tuple(sorted({run.task.settings["model"].get("training", {}).get("precision", "float32") for run in runs}))


def _blocks(name: str, size: str, results: Mapping[str, StudyTable]) -> Iterator[Any]:
    study = results[EXPERIMENTS[name][0]]
    if study.origin != next(iter(results.values())).origin:
        yield Paragraph(study.origin)
    if isinstance(study, StudyResult):
        random = _random_of(name, results)
        metrics = ("accuracy",) if random is None else ("accuracy", "recall", "f1", "g_mean")
        yield beside_table(study, random, metrics)
        if name == "ablation":
            yield convergence_table(study)
            yield Picture(with_origin(convergence_drawing(study, study.study.replace("-", "_")), study))
        yield Bullets("Result of the study", study.answer)
    else:
        yield from identification_blocks(study)
    yield from _remarks(comparability(name, size))


def _remarks(remarks: Comparability) -> Iterator[Bullets]:
    yield Bullets("The same as in the paper", remarks.same)
    yield Bullets("Different, and why", remarks.different)


def _random_of(name: str, results: Mapping[str, StudyTable]) -> StudyResult | None:
    """The study of an experiment on random windows."""
    random = results.get(EXPERIMENTS[name][-1]) if len(EXPERIMENTS[name]) > 1 else None
    return random if isinstance(random, StudyResult) else None


def _result(name: str, results: Mapping[str, StudyTable]) -> str:
    study = results[EXPERIMENTS[name][0]]
    if not isinstance(study, StudyResult):
        return identification_sentence(study)
    sentence = level_sentence(study, _random_of(name, results)) or "the paper prints no figure of what was run."
    return f"{sentence} Convergence {convergence_sentence(study)}" if name == "ablation" else sentence
