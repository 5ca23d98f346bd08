"""`write_report` writes results as one page with its data."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import singledispatch
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

from swashtwin.diagnosis import AlarmScores, AnomalyDetector, Diagnosis, Evidence, FaultClassifier
from swashtwin.foundation import (
    TEXT,
    VERSION,
    InputError,
    atomic_write,
    escape_controls,
    json_text,
    plural,
)
from swashtwin.learning import FittedClassifier, Scores
from swashtwin.recordings import Recording, summarize_recordings
from swashtwin.report.diagnosis_part import build_anomaly_part, build_diagnosis_part
from swashtwin.report.drawing import Drawing, load_template
from swashtwin.report.evidence_part import build_evidence_part
from swashtwin.report.living_pump import LivingPump, load_pump_source
from swashtwin.report.model_part import (
    build_alarms_part,
    build_detector_part,
    build_scores_part,
    build_training_part,
)
from swashtwin.report.page import (
    Group,
    Part,
    Section,
    Table,
    build_cards,
    build_overview,
    find_shared_facts,
    iterate_drawings,
)
from swashtwin.report.wording import Glossary, list_facts, rig_notice

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration

FORMAT = "swashtwin report 1"

# Titles of parts that the title of a page joins.
_MAX_TITLES = 3

Item: TypeAlias = (
    "Calibration | FaultClassifier | FittedClassifier | AnomalyDetector | AlarmScores | Scores | "
    "Diagnosis | Evidence | Part"
)
"""What a report can be made of."""


@dataclass(frozen=True, eq=False)
class _Content:
    """What a page shows."""

    parts: tuple[Part, ...]
    facts: tuple[tuple[str, str], ...]
    """Facts below the title, by name."""
    notices: tuple[str, ...]
    cards: tuple[Part, ...]
    overview: Table | None
    sections: tuple[Section, ...]


def render_page(
    *items: Item,
    recordings: Sequence[Recording] = (),
    about: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return the page of `write_report` as text; errors are the same."""
    return _render(_collect_content(items, recordings, about), has_folder=False)


def write_report(
    *items: Item,
    folder: Path | str,
    recordings: Sequence[Recording] = (),
    about: Mapping[str, str] = MappingProxyType({}),
) -> Path:
    """Write ``report.html``, a page that needs no other file and no network; return its path.

    The folder also gets ``results.json`` and each figure as ``figures/NAME.svg`` with its data as
    ``figures/NAME.csv``. All are written, or none is; figures of an earlier report in the same
    folder are replaced if they have the same name, and kept otherwise. ``results.json`` names those
    of this report.

    Parameters
    ----------
    items : in the order of the page; each adds its answer at the top and its sections below.
    folder : created if it does not exist.
    recordings : recordings of the results. Machine, date, operating point and file that they
        specify are shown below the title, with a notice if they are of no real pump. A diagnosis
        shows those of its recording without this argument.
    about : further facts below the title, by name, such as the file of the model.

    Raises
    ------
    InputError
        There is no item, an item is of an unknown type, or `folder` is a file.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; name a folder for the report.")

    content = _collect_content(items, recordings, about)
    figures = _list_figures(content.cards)
    results: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "figures": [figure.name for figure in figures],
    }
    for part in content.parts:
        for kind, entries in part.results.items():
            results.setdefault(kind, []).extend(entries)

    # the page is opened first, so that it replaces an earlier one last
    texts = {folder / "report.html": _render(content, has_folder=True)}
    texts[folder / "results.json"] = json_text(results, indent=1) + "\n"
    for figure in figures:
        texts[folder / "figures" / f"{figure.name}.svg"] = figure.svg
        texts[folder / "figures" / f"{figure.name}.csv"] = figure.csv
    with ExitStack() as stack:
        for path, text in texts.items():
            stack.enter_context(atomic_write(path)).write_text(text, **TEXT)
    return folder / "report.html"


def _list_figures(cards: Sequence[Part]) -> list[Drawing]:
    """Return every figure of the page."""
    figures: list[Drawing] = []
    for card in cards:
        figures += iterate_drawings(card.glance)
        for section in card.sections:
            figures += iterate_drawings(section.blocks)
    return figures


@singledispatch
def build_part(item: Any, key: str) -> Part:
    """Return the part of the page about an item; `key` is the start of the name of each figure.

    Raises
    ------
    InputError
        No part is registered for the item's type.
    """
    kind = type(item)
    # compared by name, since importing the class would import torch
    if f"{kind.__module__}.{kind.__name__}" == "swashtwin.calibration.result.Calibration":
        from swashtwin.report.calibration_part import build_calibration_part

        return build_calibration_part(item, key)
    raise InputError(
        f"No report can be made of a {kind.__name__}: give a study's result, a calibration, scores "
        "or a diagnosis."
    )


build_part.register(Scores)(build_scores_part)
build_part.register(Evidence)(build_evidence_part)
build_part.register(FittedClassifier)(build_training_part)


@build_part.register
def _(part: Part, key: str) -> Part:
    return part


@build_part.register
def _(diagnosis: Diagnosis, key: str) -> Part:
    if diagnosis.kind == "detector":
        return build_anomaly_part(diagnosis, key)
    return build_diagnosis_part(diagnosis, key)


@build_part.register
def _(classifier: FaultClassifier, key: str) -> Part:
    return build_training_part(classifier.fitted_, key)


@build_part.register
def _(detector: AnomalyDetector, key: str) -> Part:
    return build_detector_part(detector)


@build_part.register
def _(scores: AlarmScores, key: str) -> Part:
    return build_alarms_part(scores)


def _collect_content(
    items: Sequence[Item], recordings: Sequence[Recording], about: Mapping[str, str]
) -> _Content:
    """Return what the page of `items` shows."""
    if not items:
        raise InputError(
            "A report needs at least one study, calibration, set of scores or diagnosis."
        )
    parts = [build_part(item, key) for item, key in zip(items, _build_keys(items), strict=True)]
    cards = build_cards(parts)
    overview = build_overview(parts, cards)

    facts: dict[str, str] = {}
    if len({part.subject for part in parts}) == 1:
        facts = find_shared_facts(parts)
    if sum(bool(part.facts) for part in parts) > 1:
        facts.pop("Recordings", None)  # a count that holds for one part alone
    summary = summarize_recordings(recordings)
    facts = facts | dict(list_facts(summary)) | dict(about)

    notices = [*(part.notice for part in parts), rig_notice(summary)]
    return _Content(
        parts=tuple(parts),
        facts=tuple(facts.items()),
        notices=tuple(dict.fromkeys(filter(None, notices))),
        cards=tuple(cards),
        overview=overview,
        sections=() if overview else tuple(_order_sections(parts)),
    )


def _build_keys(items: Sequence[Item]) -> list[str]:
    """Return the start of the name of each item's figures: its kind, numbered if there are
    several.
    """
    kinds = [type(item).__name__.lower() for item in items]
    totals = Counter(kinds)
    counts: Counter[str] = Counter()
    keys = []
    for kind in kinds:
        counts[kind] += 1
        keys.append(f"{kind}_{counts[kind]}" if totals[kind] > 1 else kind)
    return keys


def _order_sections(parts: Sequence[Part]) -> list[Section]:
    """Return every section by its position.

    Sections of one title, such as those of two calibrations, get the title of their part and are
    folded.
    """
    totals = Counter(section.title for part in parts for section in part.sections)
    sections = []
    for part in parts:
        sections += [section for section in part.sections if totals[section.title] == 1]
        repeated = [section for section in part.sections if totals[section.title] > 1]
        if repeated:
            groups = tuple(
                Group(section.title, section.blocks, is_open=False) for section in repeated
            )
            sections.append(replace(repeated[0], title=part.title, blocks=groups))
    return sorted(sections, key=lambda section: section.position)


def _render(content: _Content, *, has_folder: bool) -> str:
    """Return the page as HTML."""
    # Of many recordings each pump would add its numbers to the page.
    turns = not content.overview and any(
        isinstance(block, LivingPump) for card in content.cards for block in card.glance
    )
    page = load_template("report.html.jinja").render(
        pump_style=load_pump_source("css") if turns else "",
        pump_script=load_pump_source("js") if turns else "",
        facts=content.facts,
        notices=content.notices,
        cards=content.cards,
        overview=content.overview,
        sections=content.sections,
        title=_build_title(content.parts),
        glossary=Glossary(),
        version=VERSION,
        has_folder=has_folder,
    )
    return escape_controls(page, keep="\n")


def _build_title(parts: Sequence[Part]) -> str:
    """Return the title of a page: that of its part, or what its parts have in common.

    An answer before the diagnosis of one recording is what the page is about.
    """
    titles = {part.title for part in parts if part.verdict or part.answer}
    subjects = {part.subject for part in parts}
    leads = not parts[0].subject and parts[0].verdict and len(subjects) == 2
    if len(titles) == 1 or len(subjects) == 1 or leads:
        return parts[0].title
    if "" not in subjects:
        return f"{parts[0].title.split(' of ')[0]} of {plural(len(subjects), 'recording')}"
    short_titles = dict.fromkeys(re.split("[,:]", part.title)[0] for part in parts)
    return " and ".join(list(short_titles)[:_MAX_TITLES])
