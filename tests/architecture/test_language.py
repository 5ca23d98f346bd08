"""Habits of language that readers stumble over stay out of code, messages and documents."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = ("src/swashtwin", "bench/src")
ROOMS = sorted(path.name for path in (ROOT / "src/swashtwin").iterdir() if path.is_dir())

CONDITIONAL_WHERE = re.compile(
    r"\bwhere (?:there (?:is|are)|it (?:is|has|states|can|cannot)|none|no|not|nothing|neither)\b",
    re.IGNORECASE,
)
"""*Where* for *if*: "None where there is no alarm"."""

DIALECT = {
    "is none": r"(?<!there )\bis none\b",
    "is none of": r"\bis none of\b",
    "are none": r"(?<!there )\bare none\b",
    "of its own": r"\bof its own(?=[.,;:)\"]|$)",
    "so many": r"\bso many\b",
    "as far as": r"\bas far as (?:it|they|there|possible)\b",
    "as they are": r"\bas they are\b",
    "could be (for a prediction set)": r"\bcould be:",
}
"""Phrases with a plainer form (docs/explanation/architecture.md), and how they are detected."""

VAGUE_NAMES = {
    *("asked", "chosen", "found", "given", "heard", "kept", "lacking", "made", "odd"),
    *("shown", "stated", "told", "unlike", "usual", "wanted", "worded", "words"),
}
"""Participles and adjectives that do not state what a variable holds."""

OPTION = re.compile(r"^(?!.*\bswashtwin [a-z]).*?(?<![\w-])(--[a-z][a-z-]+)", re.DOTALL)
"""An option of the command line, in a text that quotes no whole command."""


def texts_of(path: Path) -> Iterator[tuple[int, str]]:
    """Return line number and text of each comment and string of a module."""
    source = path.read_text(encoding="utf-8")
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in (tokenize.COMMENT, tokenize.STRING):
            yield token.start[0], token.string


def messages_of(path: Path) -> Iterator[tuple[int, str]]:
    """Return line number and text of each string of a module but its docstrings.

    Strings that stand one after the other are one text.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [part.value for part in node.values if isinstance(part, ast.Constant)]
            yield node.lineno, "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and id(node) not in docstrings:
            yield node.lineno, str(node.value)


def python_files() -> list[Path]:
    return [path for source in SOURCES for path in sorted((ROOT / source).rglob("*.py"))]


def documents() -> list[Path]:
    pages = sorted((ROOT / "docs").rglob("*.md"))
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *pages]


def matches_in(pattern: re.Pattern[str]) -> list[str]:
    """Return places in code, messages and documents that match a pattern."""
    places = []
    for path in python_files():
        for line, text in texts_of(path):
            # a phrase may be broken over two lines of a docstring
            if match := pattern.search(re.sub(r"\s+", " ", text)):
                places.append(f"{path.relative_to(ROOT)}:{line}: {match[0]}")

    for path in documents():
        # the list of words names what is not to be written, and the evidence is generated from
        # records of earlier commits
        if path.name in ("nomenclature.md", "evidence.md"):
            continue
        text = re.sub(r"\s+", " ", path.read_text(encoding="utf-8"))
        places += [f"{path.relative_to(ROOT)}: {match[0]}" for match in pattern.finditer(text)]
    return places


def test_a_condition_is_introduced_by_if_or_when() -> None:
    assert matches_in(CONDITIONAL_WHERE) == []


@pytest.mark.parametrize("phrase", DIALECT)
def test_messages_and_documents_use_plain_phrases(phrase: str) -> None:
    assert matches_in(re.compile(DIALECT[phrase])) == []


@pytest.mark.parametrize("room", [room for room in ROOMS if room != "cli"])
def test_no_message_below_the_shell_names_an_option(room: str) -> None:
    """An error carries the setting and its remedy; only the shell spells options."""
    options = [
        f"{path.relative_to(ROOT)}:{line}: {match[1]}"
        for path in sorted((ROOT / "src/swashtwin" / room).rglob("*.py"))
        for line, text in messages_of(path)
        if (match := OPTION.search(text))
    ]
    assert options == []


def test_a_name_states_what_a_variable_holds() -> None:
    names = []
    for path in python_files():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                name = node.id
            elif isinstance(node, ast.arg):
                name = node.arg
            else:
                continue
            if name.strip("_").lower() in VAGUE_NAMES:
                names.append(f"{path.relative_to(ROOT)}:{node.lineno}: {name}")
    assert names == []


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        (CONDITIONAL_WHERE, "None where there is no alarm"),
        (re.compile(DIALECT["is none"]), "A key that is none is refused."),
        (OPTION, "set --sample-rate to the rate"),
    ],
)
def test_the_patterns_detect_what_they_are_for(pattern: re.Pattern[str], text: str) -> None:
    assert pattern.search(text)
