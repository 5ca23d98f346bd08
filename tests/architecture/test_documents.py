"""The documents: no placeholder, no broken link, and lists that match the files."""

import json
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md"))]


def relative_name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("document", DOCUMENTS, ids=relative_name)
def test_no_placeholder_is_left(document: Path) -> None:
    assert not re.search(r"@@|TODO|TBD|NUMBERS", document.read_text(encoding="utf-8"))


@pytest.mark.parametrize("document", DOCUMENTS, ids=relative_name)
def test_every_relative_link_leads_to_a_file(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    targets = re.findall(r"\]\((?!https?://|#)([^)#]+)", text)

    assert [target for target in targets if not (document.parent / target).exists()] == []


@pytest.fixture(scope="module")
def version() -> str:
    """Version of the package."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return project["version"]


def test_the_citation_has_the_version_of_the_package(version: str) -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {version}\n" in citation


def test_a_version_is_released_in_the_citation_if_it_is_in_the_changelog(version: str) -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")

    dates = re.findall(r"^date-released: (.+)$", citation, flags=re.MULTILINE)
    heading = re.search(rf"^## \[{re.escape(version)}\] - (.+)$", changelog, flags=re.MULTILINE)

    assert heading is not None
    assert dates == ([] if heading[1] == "unreleased" else [heading[1]])


def test_both_packages_have_the_same_version_and_license(version: str) -> None:
    text = (ROOT / "bench" / "pyproject.toml").read_text(encoding="utf-8")
    bench = tomllib.loads(text)["project"]

    assert bench["version"] == version
    assert f"swashtwin[networks,twin]=={version}" in bench["dependencies"]
    assert (ROOT / "bench" / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()


def test_the_changelog_starts_with_the_version_of_the_package(version: str) -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    first_heading = re.search(r"^## \[(.*?)\]", changelog, flags=re.MULTILINE)

    assert first_heading is not None
    assert first_heading[1] == version


def test_the_list_for_language_models_has_every_page_of_the_site_and_no_other() -> None:
    sources = DOCS.rglob("*.md")
    pages = {path.relative_to(DOCS).with_suffix(".html").as_posix() for path in sources}
    # built from Python: the gallery and the page of commands
    examples = (DOCS / "gallery").glob("*.py")
    generated = {f"tutorials/examples/{path.stem}.html" for path in examples}
    generated.add("reference/command-line.html")

    listed = re.findall(r"\]\(([^)]+)\)", (DOCS / "llms.txt").read_text(encoding="utf-8"))

    # the list takes the place of the start page
    assert set(listed) == (pages - {"index.html"}) | generated


# a changelog names modules that no longer exist
@pytest.mark.parametrize(
    "document", [path for path in DOCUMENTS if path.name != "CHANGELOG.md"], ids=relative_name
)
def test_every_module_that_a_document_names_exists(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    paths = re.findall(r"`((?:\w+/)+[a-z_0-9]+\.py)`", text)
    paths += re.findall(r"python (benchmarks/[a-z_]+\.py)", text)

    folders = (ROOT, ROOT / "src", ROOT / "src" / "swashtwin")
    assert [path for path in paths if not any((folder / path).exists() for folder in folders)] == []


def test_every_file_of_the_first_changes_exists() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (.+?) \| (`.+`) \|$", text.split("## First changes")[1], re.MULTILINE)

    assert len(rows) == 5
    for change, files in rows:
        missing = [name for name in re.findall(r"`(.+?)`", files) if not (ROOT / name).exists()]
        assert missing == [], change


def test_a_commit_checks_scripts_with_the_version_that_every_change_must_pass() -> None:
    packages = json.loads((ROOT / ".ci/javascript/package.json").read_text(encoding="utf-8"))
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")

    version = packages["devDependencies"]["@biomejs/biome"]
    assert f"--package=@biomejs/biome@{version} " in hooks
