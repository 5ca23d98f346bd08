"""One set of options says how to read a file, and a message advises no option that its command
lacks.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import soundfile
from commandline import one_line, run
from typer.main import get_command

from swashtwin.cli import app
from swashtwin.cli.options import READING

SIGNAL = ("signal spectrum", "signal features")
READERS = ("index", "inspect", "diagnose", "calibrate", "data convert", *SIGNAL)
RATE = ["--sample-rate", "1 kHz"]
ROWS = [f"{number / 1000},{number % 7}.5,{number % 5}.25" for number in range(64)]


def options_of(path: str) -> set[str]:
    command = get_command(app)
    for name in path.split():
        command = command.commands[name]  # type: ignore[attr-defined]
    return {name for parameter in command.params for name in parameter.opts}


@pytest.mark.parametrize("command", READERS)
def test_every_command_that_reads_a_file_takes_the_same_options(command: str) -> None:
    assert {f"--{name.replace('_', '-')}" for name in READING} <= options_of(command)


FILES = {
    "plain": ["a,b", *(row.partition(",")[2] for row in ROWS)],
    "volts": ["a [V]", *(f"{number % 7}.25" for number in range(64))],
    "counts": ["a [1]", *(f"{number % 7}.25" for number in range(64))],
    "doubtful": ["a", *(f"{number % 7},125" for number in range(64))],
}


@pytest.mark.parametrize(
    ("file", "given", "advised", "mended"),
    [
        ("plain", ["--unit", "g"], "--sample-rate", ["--sample-rate", "1 kHz"]),
        ("plain", ["--sample-rate", "1 kHz"], "--unit", ["--unit", "g"]),
        (
            "plain",
            ["--sample-rate", "1 kHz", "--sensitivity", "100 mV/g"],
            "--unit",
            ["--unit", "V"],
        ),
        (
            "doubtful",
            ["--unit", "g", "--sample-rate", "1 kHz"],
            '--read "decimal=,"',
            ["--read", "decimal=,"],
        ),
        ("wav", [], "--sensitivity", ["--sensitivity", "50 m/s^2"]),
        ("wav", ["--sensitivity", "100 mV/g"], "50 m/s^2", ["--sensitivity", "50 m/s^2"]),
        (
            "volts",
            ["--sample-rate", "1 kHz", "--unit", "g"],
            "--sensitivity",
            ["--sensitivity", "100 mV/g"],
        ),
        (
            "counts",
            ["--sample-rate", "1 kHz", "--unit", "g"],
            '--sensitivity "1 g"',
            ["--sensitivity", "1 g"],
        ),
    ],
)
def test_the_option_that_a_message_advises_reads_the_file(
    file: str, given: list[str], advised: str, mended: list[str], tmp_path: Path
) -> None:
    path = tmp_path / ("a.wav" if file == "wav" else "a.csv")
    if file == "wav":
        soundfile.write(path, np.random.default_rng(0).normal(0, 0.1, 64), 8000, subtype="PCM_16")
    else:
        path.write_text("\n".join(FILES[file]) + "\n")
    arguments = ["data", "convert", str(path), "--out", str(tmp_path / "a.h5"), *given]
    message = one_line(run(*arguments, code=3))
    assert advised in message
    for option in re.findall(r"--[a-z][a-z-]*", message):
        assert all(option in options_of(command) for command in READERS), option
    replaced = mended[0] in given or "Remove --unit" in message
    run(
        *arguments[: -len(given) or None],
        *(RATE if replaced and file != "wav" else given * (not replaced)),
        *mended,
    )
