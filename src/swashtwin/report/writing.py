"""`write_report` writes results as one page with its data."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
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
from swashtwin.report.drawing import load_template
from swashtwin.report.evidence_part import build_evidence_part
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
    build_cards,
    build_overview,
    find_shared_facts,
    iterate_drawings,
)
from swashtwin.report.wording import Glossary, list_facts, rig_notice

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration

FORMAT = "swashtwin report 1"

Item: TypeAlias = (
    "Calibration | FaultClassifier | FittedClassifier | AnomalyDetector | AlarmScores | Scores | "
    "Diagnosis | Evidence | Part"
)
"""What a report can be made of."""


def render_page(
    *items: Item,
    recordings: Sequence[Recording] = (),
    about: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """The page of `write_report` as text; errors are the same."""
    return _page(*_contents(items, recordings, about), has_folder=False)


def write_report(
    *items: Item,
    folder: Path | str,
    recordings: Sequence[Recording] = (),
    about: Mapping[str, str] = MappingProxyType({}),
) -> Path:
    """Path of ``report.html``, a page that needs no other file and no network.

    Beside it stand ``results.json`` and each figure as ``figures/NAME.svg`` with its data as
    ``figures/NAME.csv``. All are written, or none is; figures of an earlier report in the same
    folder are replaced where they have the same name, and kept otherwise. ``results.json`` names
    those of this report.

    Parameters
    ----------
    items : in the order of the page; each adds its answer at the top and its sections below.
    folder : created if it does not exist.
    recordings : those that the results are of. Machine, date, condition and file that they state
        stand below the title, and a notice if they are of no real pump. A diagnosis states those of
        its recording by itself.
    about : further facts to stand below the title, by name, such as the file of the model.

    Raises
    ------
    InputError
        No item, an item of an unknown type, or `folder` is a file.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; name a folder for the report.")
    parts, shown = _contents(items, recordings, about)
    cards: list[Part] = shown["cards"]
    blocks = [
        (*card.glance, *(block for section in card.sections for block in section.blocks))
        for card in cards
    ]
    figures = [drawing for each in blocks for drawing in iterate_drawings(each)]
    texts = {
        folder / "report.html": _page(parts, shown, has_folder=True)
    }  # opens first, so is replaced last
    table: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "figures": [drawing.name for drawing in figures],
    }
    for part in parts:
        for kind, entries in part.results.items():
            table.setdefault(kind, []).extend(entries)
    texts[folder / "results.json"] = json_text(table, indent=1) + "\n"
    for drawing in figures:
        texts[folder / "figures" / f"{drawing.name}.svg"] = drawing.svg
        texts[folder / "figures" / f"{drawing.name}.csv"] = drawing.csv
    with ExitStack() as stack:
        for path, text in texts.items():
            stack.enter_context(atomic_write(path)).write_text(text, **TEXT)
    return folder / "report.html"


@singledispatch
def build_part(item: Any, key: str) -> Part:
    """Part of the page about an item; `key` is the start of the name of each figure. An
    `InputError` where none is registered for its type.
    """
    kind = type(item)
    if (
        f"{kind.__module__}.{kind.__name__}" == "swashtwin.calibration.result.Calibration"
    ):  # which needs torch
        from swashtwin.report.calibration_part import build_calibration_part

        return build_calibration_part(item, key)
    raise InputError(
        f"no report can be made of a {kind.__name__}; give a study's result, a calibration, scores or a diagnosis."
    )


build_part.register(Part)(lambda part, key: part)
build_part.register(Scores)(build_scores_part)
build_part.register(Diagnosis)(
    lambda verdict, key: (
        build_anomaly_part if verdict.kind == "detector" else build_diagnosis_part
    )(verdict, key)
)
build_part.register(Evidence)(build_evidence_part)
build_part.register(FittedClassifier)(build_training_part)
build_part.register(FaultClassifier)(
    lambda classifier, key: build_training_part(classifier.fitted_, key)
)
build_part.register(AnomalyDetector)(lambda detector, key: build_detector_part(detector))
build_part.register(AlarmScores)(lambda scores, key: build_alarms_part(scores))


def _contents(
    items: Sequence[Item], recordings: Sequence[Recording], about: Mapping[str, str]
) -> tuple[list[Part], dict[str, Any]]:
    """The parts, and what the page shows of them by its name in the template."""
    if not items:
        raise InputError(
            "a report needs at least one study, calibration, set of scores or diagnosis."
        )
    kinds = [type(item).__name__.lower() for item in items]
    numbers = [kinds[: index + 1].count(kind) for index, kind in enumerate(kinds)]
    keys = [
        f"{kind}_{number}" if kinds.count(kind) > 1 else kind
        for kind, number in zip(kinds, numbers, strict=True)
    ]
    parts = [build_part(item, key) for item, key in zip(items, keys, strict=True)]
    cards = build_cards(parts)
    overview = build_overview(parts, cards)
    stated = summarize_recordings(recordings)
    agreed = find_shared_facts(parts) if len({part.subject for part in parts}) == 1 else {}
    if sum(bool(part.facts) for part in parts) > 1:
        agreed.pop("Recordings", None)  # a count of one part alone
    facts = agreed | dict(list_facts(stated)) | dict(about)
    shown = {
        "facts": list(facts.items()),
        "notices": list(
            dict.fromkeys(filter(None, [*(part.notice for part in parts), rig_notice(stated)]))
        ),
        "cards": cards,
        "overview": overview,
        "sections": [] if overview else _sections(parts),
    }
    return parts, shown


def _sections(parts: Sequence[Part]) -> list[Section]:
    """Every section by its position.

    Sections of one title, such as those of two calibrations, are told apart by what they are of,
    and folded away.
    """
    total = Counter(section.title for part in parts for section in part.sections)
    sections = []
    for part in parts:
        alike = [section for section in part.sections if total[section.title] > 1]
        sections += [section for section in part.sections if total[section.title] == 1]
        if alike:
            groups = tuple(Group(section.title, section.blocks, is_open=False) for section in alike)
            sections.append(replace(alike[0], title=part.title, blocks=groups))
    return sorted(sections, key=lambda section: section.position)


def _page(parts: Sequence[Part], shown: Mapping[str, Any], *, has_folder: bool) -> str:
    titles = list(dict.fromkeys(part.title for part in parts if part.verdict or part.answer))
    subjects = {part.subject for part in parts}
    is_one = len(titles) == 1 or len(subjects) == 1
    title = parts[0].title
    if not is_one and "" not in subjects:
        title = f"{title.split(' of ')[0]} of {plural(len(subjects), 'recording')}"
    elif not is_one:
        title = " and ".join(
            list(dict.fromkeys(re.split("[,:]", part.title)[0] for part in parts))[:3]
        )
    page = load_template("report.html.jinja").render(
        shown, title=title, glossary=Glossary(), version=VERSION, has_folder=has_folder
    )
    return escape_controls(page, keep="\n")
