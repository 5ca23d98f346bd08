"""Habits of language that readers stumble over stay out of code, messages and documents."""

import ast
import io
import re
import tokenize
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = ("src/swashtwin", "bench/src")
ROOMS = sorted(path.parent.name for path in (ROOT / "src/swashtwin").glob("*/__init__.py"))

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


@dataclass(frozen=True)
class Module:
    """What is written in a module, each with its line number."""

    messages: list[tuple[int, str]]
    docstrings: list[tuple[int, str]]
    names: list[tuple[int, str]]
    """Variables that are assigned, and parameters."""


@cache
def read_module(path: Path) -> Module:
    """Return the strings and names of a module, which is parsed once for all tests.

    What is formatted in a string is `{}`. Strings that stand one after the other are one text.
    """
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    statements = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    module = Module([], [], [])
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            parts = [
                str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values
            ]
            module.messages.append((node.lineno, "".join(parts)))
        elif isinstance(node, ast.Constant):
            texts = module.docstrings if id(node) in statements else module.messages
            texts.append((node.lineno, str(node.value)))
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            module.names.append((node.lineno, node.id))
        elif isinstance(node, ast.arg):
            module.names.append((node.lineno, node.arg))
    return module


def comments_of(path: Path) -> Iterator[tuple[int, str]]:
    """Return line number and text of each comment of a module; lines that follow are one text."""
    source = path.read_text(encoding="utf-8")
    first_line = 0
    last_line = 0
    text = ""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT:
            continue
        if text and token.start[0] == last_line + 1:
            text += f" {token.string.lstrip('# ')}"
        else:
            yield first_line, text
            first_line = token.start[0]
            text = token.string
        last_line = token.start[0]
    yield first_line, text


def python_files() -> list[Path]:
    return [path for source in SOURCES for path in sorted((ROOT / source).rglob("*.py"))]


def texts() -> list[Path]:
    """Documents and templates of pages, but those that quote what is not to be written.

    The list of words names it, and the evidence is generated from records of earlier commits.
    """
    pages = sorted((ROOT / "docs").rglob("*.md"))
    pages += sorted((ROOT / "src/swashtwin").rglob("*.jinja"))
    selected = [page for page in pages if page.name not in ("nomenclature.md", "evidence.md")]
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *selected]


def _name(path: Path) -> str:
    return "/".join(path.parts[-3:])


@cache
def passages_of(path: Path) -> list[tuple[int, str]]:
    """Return line number and text of what is written in a module or document, on one line each.

    Each file is read once for all phrases.
    """
    if path.suffix == ".py":
        module = read_module(path)
        passages = [*comments_of(path), *module.docstrings, *module.messages]
    else:
        # The code of a template has other words, such as the test "is none".
        passages = [(0, re.sub(r"\{[%{].*?[%}]\}", "", path.read_text(encoding="utf-8")))]
    return [(line, re.sub(r"\s+", " ", text)) for line, text in passages]


def places_of(pattern: re.Pattern[str], files: Iterable[Path]) -> list[str]:
    """Return the places in modules and texts that match a pattern; it may stand on two lines."""
    places = []
    for path in files:
        for line, text in passages_of(path):
            places += [f"{_name(path)}:{line}: {match[0]}" for match in pattern.finditer(text)]
    return places


def options_in(files: Iterable[Path]) -> list[str]:
    """Return the options of the command line that messages of modules name."""
    return [
        f"{_name(path)}:{line}: {match[1]}"
        for path in files
        for line, text in read_module(path).messages
        if (match := OPTION.search(text))
    ]


def vague_names_in(files: Iterable[Path]) -> list[str]:
    """Return the variables and parameters of modules that have a vague name."""
    return [
        f"{_name(path)}:{line}: {name}"
        for path in files
        for line, name in read_module(path).names
        if name.strip("_").lower() in VAGUE_NAMES
    ]


def test_a_condition_is_introduced_by_if_or_when() -> None:
    assert places_of(CONDITIONAL_WHERE, [*python_files(), *texts()]) == []


@pytest.mark.parametrize("phrase", DIALECT)
def test_messages_and_documents_use_plain_phrases(phrase: str) -> None:
    assert places_of(re.compile(DIALECT[phrase]), [*python_files(), *texts()]) == []


@pytest.mark.parametrize("room", [room for room in ROOMS if room != "cli"])
def test_no_message_below_the_shell_names_an_option(room: str) -> None:
    """An error carries the setting and its remedy; only the shell spells options."""
    assert options_in(sorted((ROOT / "src/swashtwin" / room).rglob("*.py"))) == []


def test_a_name_states_what_a_variable_holds() -> None:
    assert vague_names_in(python_files()) == []


FORMS = {
    "comment.py": "# Return {}{} anything.\n",
    "comments.py": "# Return {}\n# {} anything.\n",
    "docstring.py": 'def function():\n    """Return {}\n    {} anything.\n    """\n',
    "message.py": 'raise ValueError("Return {} {}")\n',
    "joined.py": 'raise ValueError(\n    "Return {} "\n    "{} anything"\n)\n',
    "formatted.py": 'raise ValueError(f"{{name}}: {} {}")\n',
    "document.md": "Return {}\n{} anything.\n",
}
"""Ways of writing a phrase, broken in two where that is possible."""

BREACHES = {
    **dict.fromkeys(
        (
            *("where there is", "where it has", "where it cannot", "where none", "where nothing"),
            *("Where there are", "where it states", "where neither"),
        ),
        CONDITIONAL_WHERE,
    ),
    "it is none": re.compile(DIALECT["is none"]),
    "it is none of": re.compile(DIALECT["is none of"]),
    "they are none": re.compile(DIALECT["are none"]),
    "a file of its own.": re.compile(DIALECT["of its own"]),
    "so many": re.compile(DIALECT["so many"]),
    "as far as possible": re.compile(DIALECT["as far as"]),
    "as they are": re.compile(DIALECT["as they are"]),
    "could be: piston": re.compile(DIALECT["could be (for a prediction set)"]),
}
"""Phrases, and the pattern that must detect each."""


def test_every_phrase_of_the_dialect_is_tried() -> None:
    assert {pattern.pattern for pattern in BREACHES.values()} == {
        CONDITIONAL_WHERE.pattern,
        *DIALECT.values(),
    }


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("phrase", BREACHES)
def test_a_phrase_is_detected_in_code_and_documents(phrase: str, form: str, tmp_path: Path) -> None:
    first, _, rest = phrase.partition(" ")
    if form == "comment.py":
        rest = f" {rest}"
    path = tmp_path / form
    path.write_text(FORMS[form].format(first, rest), encoding="utf-8")
    assert places_of(BREACHES[phrase], [path])


@pytest.mark.parametrize(
    ("text", "detected"),
    [
        ('raise ValueError("set --sample-rate to the rate")', True),
        ('raise ValueError(f"{name}: set --rate")', True),
        ('raise ValueError(\n    "set "\n    "--rate"\n)', True),
        ('raise ValueError("read it with swashtwin inspect --rate 1")', False),
        ('"""Set --rate."""', False),
        ('raise ValueError("a well-known--rate")', False),
    ],
)
def test_an_option_is_detected_in_messages(text: str, detected: bool, tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(f"{text}\n", encoding="utf-8")
    assert bool(options_in([path])) is detected


@pytest.mark.parametrize("name", sorted(VAGUE_NAMES))
@pytest.mark.parametrize(
    "text",
    [
        "{} = 1",
        "{}: int = 1",
        "for {} in (): pass",
        "with open('a') as _{}: pass",
        "def function(*, {}): pass",
        "function = lambda {}: 1",
        "class A:\n    {}: int",
        "_{} = 1",
    ],
)
def test_a_vague_name_is_detected(text: str, name: str, tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(text.format(name), encoding="utf-8")
    assert vague_names_in([path])


def test_the_files_that_are_searched_exist() -> None:
    assert len(python_files()) > 100
    assert all(path.is_file() for path in texts())
    assert {"foundation", "cli", "recordings"} <= set(ROOMS)
