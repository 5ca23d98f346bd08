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
    """Return line number and text of each string of a module except its docstrings.

    Adjacent strings are one text.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            # of an f-string the parts that are constant
            parts = [str(part.value) for part in node.values if isinstance(part, ast.Constant)]
            yield node.lineno, "".join(parts)
        elif isinstance(node, ast.Constant) and id(node) not in docstrings:
            yield node.lineno, str(node.value)


def python_files() -> list[Path]:
    paths: list[Path] = []
    for source in SOURCES:
        paths += sorted((ROOT / source).rglob("*.py"))
    return paths


def documents() -> list[Path]:
    pages = sorted((ROOT / "docs").rglob("*.md"))
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *pages]


def matches_in(pattern: re.Pattern[str]) -> list[str]:
    """Return where code, messages and documents match a pattern."""
    matches = []
    for path in python_files():
        for line, text in texts_of(path):
            # a phrase may be broken over two lines of a docstring
            match = pattern.search(re.sub(r"\s+", " ", text))
            if match:
                matches.append(f"{path.relative_to(ROOT)}:{line}: {match[0]}")

    for path in documents():
        # the list of words names what is not to be written, and the evidence is generated from
        # records of earlier commits
        if path.name in ("nomenclature.md", "evidence.md"):
            continue
        text = re.sub(r"\s+", " ", path.read_text(encoding="utf-8"))
        matches += [f"{path.relative_to(ROOT)}: {match[0]}" for match in pattern.finditer(text)]
    return matches


def test_a_condition_is_introduced_by_if_or_when() -> None:
    assert matches_in(CONDITIONAL_WHERE) == []


@pytest.mark.parametrize("phrase", DIALECT)
def test_messages_and_documents_use_plain_phrases(phrase: str) -> None:
    assert matches_in(re.compile(DIALECT[phrase])) == []


@pytest.mark.parametrize("room", [room for room in ROOMS if room != "cli"])
def test_no_message_below_the_shell_names_an_option(room: str) -> None:
    """An error carries the setting and its remedy; only the shell spells options."""
    options = []
    for path in sorted((ROOT / "src/swashtwin" / room).rglob("*.py")):
        for line, text in messages_of(path):
            match = OPTION.search(text)
            if match:
                options.append(f"{path.relative_to(ROOT)}:{line}: {match[1]}")

    assert options == []


def bound_names(path: Path) -> Iterator[tuple[int, str]]:
    """Return line number and name of each variable and parameter of a module."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg


def test_a_name_states_what_a_variable_holds() -> None:
    vague_names = []
    for path in python_files():
        for line, name in bound_names(path):
            # `_found` and `FOUND` say as little as `found`
            if name.strip("_").lower() in VAGUE_NAMES:
                vague_names.append(f"{path.relative_to(ROOT)}:{line}: {name}")

    assert vague_names == []


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        pytest.param(CONDITIONAL_WHERE, "None where there is no alarm", id="where"),
        pytest.param(
            re.compile(DIALECT["is none"]), "A key that is none is refused.", id="is none"
        ),
        pytest.param(OPTION, "set --sample-rate to the rate", id="option"),
    ],
)
# an expression that matches nothing would pass every test above
def test_the_patterns_detect_an_example_of_what_they_forbid(
    pattern: re.Pattern[str], text: str
) -> None:
    assert pattern.search(text)
