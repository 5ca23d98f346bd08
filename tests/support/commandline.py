"""The command line, run within the tests."""

import json
import re
from typing import Any

from typer.testing import CliRunner, Result

from swashtwin.cli import app

INTERRUPTED = 130
"""Exit code after Ctrl-C."""
AT_15 = ("--speed", "860 rpm", "--pressure", "15 MPa")
TINY = ("--network", "bitcn", "--set", "epochs=1", "--set", "stride=32", "--set", "channels=8,8")
DEFECT = ("--fault", "swash_plate:depth=0.08mm")
QUICK = ("--set", "starts=1", "--set", "nuisances=none", "--set", "phases=false")


PYTHON_WORDS = re.compile(r"\b(?!(?:MPa|rpm|celsius|mm)\()[A-Za-z_][\w.]*\((?!s\)|es\))|\b[a-z_]{2,}=(?=[\w\"'(\[{.,])")
"""What looks like a call or an argument of Python, which no error in the shell holds; ``MPa(15)`` may."""


def run(*words: object, code: int = 0) -> Result:
    """What a command printed, after it ended with `code`."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exit_code == INTERRUPTED != code:
        raise KeyboardInterrupt  # Ctrl-C ends the tests, not the command alone
    assert result.exit_code == code, result.output
    if code == 3:
        assert not PYTHON_WORDS.search(result.stderr), result.stderr
    return result


def run_json(*words: object, code: int = 0) -> dict[str, Any]:
    """The one JSON object that a command printed."""
    answer = json.loads(run(*words, "--json", code=code).stdout)
    assert isinstance(answer, dict)
    return answer


def one_line(result: Result) -> str:
    """The one line in which a command said why it ended."""
    lines = [line for line in result.stderr.splitlines() if line.startswith("swashtwin: ")]
    assert len(lines) == 1
    assert "Traceback" not in result.stderr
    return lines[0]
