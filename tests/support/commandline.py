"""The command line, run within the tests."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from typer.testing import CliRunner, Result

from swashtwin.cli import app

INTERRUPTED = 130
"""Exit code after Ctrl-C."""
AT_15 = ("--speed", "860 rpm", "--pressure", "15 MPa")
TINY = (
    "--network",
    "bitcn",
    "--set",
    "epochs=1",
    "--set",
    "stride=32",
    "--set",
    "channels=8,8",
)
DEFECT = ("--fault", "swash_plate:depth=0.08mm")
FACTS = ("--sample-rate", "2 kHz", "--unit", "g")
"""What the text tables of `write_tone` do not say."""
QUICK = ("--set", "starts=1", "--set", "nuisances=none", "--set", "phases=false")

PYTHON_WORDS = re.compile(
    r"\b(?!(?:MPa|rpm|celsius|mm)\()[A-Za-z_][\w.]*\((?!s\)|es\))"
    r"|(?<!--read )(?<!--read \")\b[a-z_]{2,}=(?=[\w\"'(\[{.,])"
)
"""What looks like a call or an argument of Python, which no error in the shell holds; ``MPa(15)``
may, and --read.
"""


def write_tone(path: Path, frequency: float, count: int = 600, rate: float = 2000.0) -> Path:
    """Path of a text table with a tone in noise, of which each file has its own."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draw = np.random.default_rng(sum(path.name.encode()))
    samples = np.sin(2 * np.pi * frequency / rate * np.arange(count)) + 0.1 * draw.standard_normal(
        count
    )
    np.savetxt(path, samples, header="x", comments="", fmt="%.6f")

    return path


def write_tones(folder: Path, count: int) -> Path:
    """Folder with so many text tables of each of two classes."""
    for label, frequency in (("normal", 100), ("piston", 300)):
        for number in range(1, count + 1):
            write_tone(folder / f"{label}_{number}.csv", frequency)

    return folder


def run(*arguments: object, code: int = 0) -> Result:
    """What a command printed, after it ended with `code`."""
    # A wide terminal: in a narrow one, the length of a test's folder decides where a message breaks.
    result = CliRunner().invoke(app, [str(word) for word in arguments], env={"COLUMNS": "200"})
    if result.exit_code == INTERRUPTED != code:
        raise KeyboardInterrupt  # Ctrl-C ends the tests, not the command alone

    assert result.exit_code == code, result.output

    if code == 3:
        assert not PYTHON_WORDS.search(result.stderr), result.stderr
    return result


def run_json(*arguments: object, code: int = 0) -> dict[str, Any]:
    """The one JSON object that a command printed."""
    answer = json.loads(run(*arguments, "--json", code=code).stdout)
    assert isinstance(answer, dict)
    return answer


def one_line(result: Result) -> str:
    """The one line in which a command said why it ended."""
    lines = [line for line in result.stderr.splitlines() if line.startswith("swashtwin: ")]
    assert len(lines) == 1
    assert "Traceback" not in result.stderr

    return lines[0]
