"""`write_report` writes results as one page with its data."""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cache, singledispatch
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined, Template

from swashtwin.calibration import Calibration, Difference, IdentifiabilityReport
from swashtwin.diagnosis import AnomalyVerdict, Diagnosis, Evidence
from swashtwin.foundation import TEXT, VERSION, InputError, escape_controls, replacing
from swashtwin.learning import DataCheck, Scores
from swashtwin.report.anomaly_part import anomaly_part
from swashtwin.report.calibration_part import calibration_part
from swashtwin.report.check_part import check_part
from swashtwin.report.diagnosis_part import diagnosis_part
from swashtwin.report.difference_part import difference_part
from swashtwin.report.evidence_part import evidence_part
from swashtwin.report.identifiability_part import identifiability_part
from swashtwin.report.page import Part, Section, drawings
from swashtwin.report.scores_part import scores_part

FORMAT = "swashtwin report 1"

_UNKNOWN_ORIGIN = "The recordings do not state their source. What holds for them need not hold for another pump."


Item = (
    Calibration | Difference | IdentifiabilityReport | Scores | DataCheck | Diagnosis | AnomalyVerdict | Evidence | Part
)
"""What a report can be made of."""


def page_text(*items: Item) -> str:
    """The page of `write_report` as text.

    Raises
    ------
    InputError
        No item, or an item of an unknown type.
    """
    parts, sections = _contents(items)
    return _page(parts, sections)


def write_report(*items: Item, folder: Path | str) -> Path:
    """Path of ``report.html``, a page that needs no other file and no network.

    Beside it stand ``results.json`` and each figure as ``figures/NAME.svg`` with its data as ``figures/NAME.csv``. All
    are written, or none is; figures of an earlier report in the same folder are replaced where they have the same name,
    and kept otherwise. ``results.json`` names those of this report.

    Parameters
    ----------
    items : in the order of the page; each adds its answer at the top and its sections below.
    folder : created if it does not exist.

    Raises
    ------
    InputError
        No item, an item of an unknown type, or `folder` is a file.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; name a folder for the report.")
    parts, sections = _contents(items)
    figures = [drawing for section in sections for drawing in drawings(section.blocks)]
    texts = {folder / "report.html": _page(parts, sections)}  # the first to be opened, so the last to be replaced
    texts[folder / "results.json"] = _results(parts, [drawing.name for drawing in figures])
    for drawing in figures:
        texts[folder / "figures" / f"{drawing.name}.svg"] = drawing.svg
        texts[folder / "figures" / f"{drawing.name}.csv"] = drawing.csv
    with ExitStack() as stack:
        for path, text in texts.items():
            stack.enter_context(replacing(path)).write_text(text, **TEXT)
    return folder / "report.html"


@singledispatch
def part_of(item: object, key: str) -> Part:
    """Part of the page about an item.

    Parameters
    ----------
    key : start of the name of each figure.

    Raises
    ------
    InputError
        No part is registered for its type.
    """
    raise InputError(
        f"no report can be made of a {type(item).__name__}; give a study's result, a calibration, scores or a "
        "diagnosis."
    )


part_of.register(Part)(lambda part, key: part)
part_of.register(Calibration)(calibration_part)
part_of.register(Difference)(difference_part)
part_of.register(IdentifiabilityReport)(identifiability_part)
part_of.register(Scores)(scores_part)
part_of.register(DataCheck)(check_part)
part_of.register(Diagnosis)(diagnosis_part)
part_of.register(AnomalyVerdict)(anomaly_part)
part_of.register(Evidence)(evidence_part)


def _contents(items: Sequence[Item]) -> tuple[list[Part], list[Section]]:
    """The part of each item, and all sections in the order of the page."""
    if not items:
        raise InputError("a report needs at least one study, calibration, set of scores or diagnosis.")
    parts = [part_of(item, key) for item, key in zip(items, _keys(items), strict=True)]
    return parts, _sections(items, parts)


def _sections(items: Sequence[object], parts: Sequence[Part]) -> list[Section]:
    """Every section by its position; several studies each keep their sections together, under their titles."""
    if len(items) > 1 and all(isinstance(item, Part) for item in items):
        return [
            replace(section, title=f"{_short(part.title)}: {section.title}")
            for part in parts
            for section in part.sections
        ]
    return sorted((section for part in parts for section in part.sections), key=lambda section: section.position)


def _short(title: str) -> str:
    return title.split(",")[0].split(":")[0]


def _answers(parts: Sequence[Part]) -> list[str]:
    """Every sentence; with several parts, the first of each begins with its title."""
    if len({part.title for part in parts}) == 1:
        return [sentence for part in parts for sentence in part.answer]
    return [f"{_short(part.title)}. {text}" if i == 0 else text for part in parts for i, text in enumerate(part.answer)]


def _keys(items: Sequence[object]) -> list[str]:
    """Name of each item, numbered if there are several of its kind; several studies go by their own names."""
    kinds = [type(item).__name__.lower() for item in items]
    total, seen, keys = Counter(kinds), Counter[str](), []
    for kind in kinds:
        seen[kind] += 1
        keys.append(f"{kind}_{seen[kind]}" if total[kind] > 1 else kind)
    return keys


def _page(parts: Sequence[Part], sections: Sequence[Any]) -> str:
    page = _template().render(
        title=parts[0].title if len(parts) == 1 else "Report",
        answer=_answers(parts),
        notices=list(dict.fromkeys(part.notice for part in parts if part.notice)) or [_UNKNOWN_ORIGIN],
        sections=sections,
        version=VERSION,
    )
    return escape_controls(page, keep="\n")


@cache
def _template() -> Template:
    text = files("swashtwin.report").joinpath("report.html.jinja").read_text(encoding="utf-8")
    return Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True).from_string(
        text
    )


def _results(parts: Sequence[Part], figures: list[str]) -> str:
    table: dict[str, Any] = {"format": FORMAT, "version": VERSION, "figures": figures}
    for part in parts:
        for kind, entries in part.results.items():
            table.setdefault(kind, []).extend(entries)
    return json.dumps(_finite(table), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    """The same with null in place of NaN and infinity, which JSON does not have."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(name): _finite(entry) for name, entry in value.items()}
    return [_finite(entry) for entry in value] if isinstance(value, list | tuple) else value
