"""Change the logic of the modules that must not err, and list the changes that no test notices.

    pip install mutmut
    python .ci/mutants.py --per-module 20

mutmut makes the mutants, and runs the tests that reach each of them; pyproject.toml names modules
and tests. Of its mutants those of the logic are sampled (the same seed draws the same ones): other
comparisons, numbers, operators, conditions, arguments that are left out. Other texts and a `None`
in place of a value are not. mutmut leaves constants outside of functions alone. The last lines
count the killed mutants of each module; `mutants/survivors.diff` shows the others. A survivor is a
missing test, dead code, or a change without effect: read it before you believe the figure.
"""

import argparse
import ast
import difflib
import io
import json
import random
import re
import subprocess
import sys
import textwrap
import tokenize
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

MUTANTS = Path("mutants")
LOG = MUTANTS / "log.txt"
ORIGINAL = "__mutmut_orig"
UNTESTED = 33
"""mutmut's exit code for a mutant that no test reaches."""
NO_LOGIC = (tokenize.STRING, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)


@dataclass(frozen=True)
class Mutant:
    """A changed function."""

    name: str
    module: str
    original: str
    changed: str

    def diff(self) -> str:
        """Return what is changed."""
        lines = (text.splitlines(keepends=True) for text in (self.original, self.changed))
        return "".join(difflib.unified_diff(*lines, self.name, self.name, n=3))


def read_mutants(meta: Path) -> Iterator[Mutant]:
    """Yield the mutants of one module."""
    names = json.loads(meta.read_text(encoding="utf-8"))["exit_code_by_key"]
    path = meta.with_suffix("")
    module = path.relative_to(MUTANTS / "src" / "swashtwin").as_posix()
    source = path.read_text(encoding="utf-8")

    lines = source.splitlines(keepends=True)
    functions = {}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and "__mutmut_" in node.name:
            functions[node.name] = textwrap.dedent(
                "".join(lines[node.lineno - 1 : node.end_lineno])
            )

    for name in names:
        function = name.rpartition(".")[2]
        stem = function.rpartition("__mutmut_")[0]
        original = functions[stem + ORIGINAL].replace(stem + ORIGINAL, stem, 1)
        yield Mutant(name, module, original, functions[function].replace(function, stem, 1))


def is_logic(mutant: Mutant) -> bool:
    """Return whether a mutant changes more than texts, types and the checks of `zip`, and puts no
    `None` in place of a value.
    """
    return logic_tokens(mutant.original) != logic_tokens(mutant.changed) and (
        count_nones(mutant.original) == count_nones(mutant.changed)
    )


def logic_tokens(source: str) -> list[str]:
    """Return the tokens of a function without texts, `dtype=` and `strict=`."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    code = " ".join(token.string for token in tokens if token.type not in NO_LOGIC)
    return re.sub(r", (dtype|strict) = [\w. ]+", "", code).replace(", )", ")").split()


def count_nones(source: str) -> int:
    """Return how often a function names `None`."""
    return len(re.findall(r"\bNone\b", source))


def run_mutmut(names: list[str]) -> int:
    """Run the tests for these mutants, one at a time, and return mutmut's exit code."""
    command = [sys.executable, "-m", "mutmut", "run", "--max-children", "1", *names]
    MUTANTS.mkdir(exist_ok=True)
    with LOG.open("ab") as log:
        return subprocess.run(command, check=False, stdout=log, stderr=log).returncode


def require_all_tests() -> None:
    """Stop if the tests of a file did not run: each of their mutants would survive."""
    settings = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["tool"]["mutmut"]
    stats = json.loads((MUTANTS / "mutmut-stats.json").read_text(encoding="utf-8"))
    for selected in settings["pytest_add_cli_args_test_selection"]:
        for path in sorted(Path(selected).rglob("test_*.py")) or [Path(selected)]:
            is_test = path.name.startswith("test_")
            if is_test and not any(
                test.startswith(f"{path}::") for test in stats["duration_by_test"]
            ):
                raise SystemExit(f"No test of {path} ran: see {LOG}.")


def main() -> None:
    """Sample, run and count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--per-module", type=int, default=20, help="mutants of each module")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="part of the path of the modules")
    options = parser.parse_args()

    # It makes the mutants and times the tests before it finds that no mutant has this name.
    run_mutmut(["none"])
    require_all_tests()

    samples: dict[Path, list[Mutant]] = {}
    for meta in sorted(MUTANTS.glob("src/swashtwin/**/*.py.meta")):
        mutants = [mutant for mutant in read_mutants(meta) if is_logic(mutant)]
        if mutants and options.only in mutants[0].module:
            draw = random.Random(options.seed)
            samples[meta] = draw.sample(mutants, min(options.per_module, len(mutants)))
    if run_mutmut([mutant.name for sample in samples.values() for mutant in sample]):
        raise SystemExit(f"mutmut failed: see {LOG}.")

    survivors = []
    for meta, sample in samples.items():
        exit_codes = json.loads(meta.read_text(encoding="utf-8"))["exit_code_by_key"]
        alive = [mutant for mutant in sample if exit_codes[mutant.name] in (0, UNTESTED)]
        survivors += alive
        print(f"{sample[0].module}: {len(sample) - len(alive)} of {len(sample)} killed")
    text = "\n".join(mutant.diff() for mutant in survivors)
    (MUTANTS / "survivors.diff").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
