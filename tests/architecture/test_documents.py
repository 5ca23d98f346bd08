"""The documents: nothing left to fill in, no link that leads nowhere."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_no_place_is_left_to_fill_in(document: Path) -> None:
    assert not re.search(r"@@|TODO|TBD|NUMBERS", document.read_text(encoding="utf-8"))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_relative_link_leads_somewhere(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    targets = re.findall(r"\]\((?!https?://|#)([^)#]+)", text)
    assert [target for target in targets if not (document.parent / target).exists()] == []


def test_citation_and_changelog_have_the_version_of_the_package() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "version"
    ]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    first = re.search(
        r"^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    assert first is not None
    assert first[1] == version


def test_the_list_for_language_models_has_every_page_of_the_site_and_no_other() -> None:
    docs = ROOT / "docs"
    pages = {
        path.relative_to(docs).with_suffix(".html").as_posix() for path in docs.rglob("*.md")
    } - {"index.html"}
    gallery = {f"tutorials/examples/{path.stem}.html" for path in (docs / "gallery").glob("*.py")}
    listed = re.findall(r"\]\(([^)]+)\)", (docs / "llms.txt").read_text(encoding="utf-8"))
    assert set(listed) == pages | gallery | {"reference/command-line.html"}


@pytest.mark.parametrize(
    "document", [path for path in DOCUMENTS if path.name != "CHANGELOG.md"], ids=lambda p: p.name
)
def test_every_module_that_a_document_names_exists(document: Path) -> None:
    names = re.findall(
        r"`((?:\w+/)+[a-z_0-9]+\.py)`|python (benchmarks/[a-z_]+\.py)",
        document.read_text(encoding="utf-8"),
    )
    paths = [next(filter(None, groups)) for groups in names]
    roots = (ROOT, ROOT / "src", ROOT / "src" / "swashtwin")
    assert [path for path in paths if not any((root / path).exists() for root in roots)] == []
