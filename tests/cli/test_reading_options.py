"""Every command that reads a file takes the same options, and a message advises only those."""

import re
from pathlib import Path

import numpy as np
import pytest
import soundfile
from commandline import one_line, run
from typer.main import get_command

from swashtwin.cli import app
from swashtwin.cli.options import READING_OPTIONS

READERS = (
    "index",
    "inspect",
    "diagnose",
    "calibrate",
    "data convert",
    "signal spectrum",
    "signal features",
)

RATE = ("--sample-rate", "1 kHz")


def options_of(path: str) -> set[str]:
    command = get_command(app)
    for name in path.split():
        command = command.commands[name]  # type: ignore[attr-defined]
    return {option for parameter in command.params for option in parameter.opts}


@pytest.mark.parametrize("command", READERS)
def test_every_command_that_reads_a_file_takes_the_same_options(command: str) -> None:
    reading_options = {f"--{name.replace('_', '-')}" for name in READING_OPTIONS}
    assert reading_options <= options_of(command)


TABLES = {
    "plain": ["a,b", *(f"{row % 7}.5,{row % 5}.25" for row in range(64))],
    "volts": ["a [V]", *(f"{row % 7}.25" for row in range(64))],
    "counts": ["a [1]", *(f"{row % 7}.25" for row in range(64))],
    # a comma that separates either two columns or the decimals of one
    "doubtful": ["a", *(f"{row % 7},125" for row in range(64))],
}
"""Lines of text tables whose rate or unit is not specified, or contradicts an option."""


def write_file(kind: str, folder: Path) -> Path:
    """Write a text table of `TABLES`, or a sound file, whose samples have no unit."""
    if kind == "wav":
        path = folder / "a.wav"
        samples = np.random.default_rng(0).normal(0, 0.1, 64)
        soundfile.write(path, samples, 8000, subtype="PCM_16")
        return path

    path = folder / "a.csv"
    path.write_text("\n".join(TABLES[kind]) + "\n")
    return path


@pytest.mark.parametrize(
    ("kind", "options", "advice", "corrected_options"),
    [
        pytest.param(
            "plain",
            ("--unit", "g"),
            "--sample-rate",
            ("--unit", "g", *RATE),
            id="sample rate missing",
        ),
        pytest.param("plain", RATE, "--unit", (*RATE, "--unit", "g"), id="unit missing"),
        pytest.param(
            "plain",
            (*RATE, "--sensitivity", "100 mV/g"),
            "--unit",
            (*RATE, "--sensitivity", "100 mV/g", "--unit", "V"),
            id="unit missing beside a sensitivity",
        ),
        pytest.param(
            "doubtful",
            ("--unit", "g", *RATE),
            '--read "decimal=,"',
            ("--unit", "g", *RATE, "--read", "decimal=,"),
            id="decimal comma",
        ),
        pytest.param("wav", (), "--sensitivity", ("--sensitivity", "50 m/s^2"), id="sound file"),
        pytest.param(
            "wav",
            ("--sensitivity", "100 mV/g"),
            "50 m/s^2",
            ("--sensitivity", "50 m/s^2"),
            id="sensitivity in volts for a sound file",
        ),
        # volts are not g: the sensitivity states the unit in place of --unit
        pytest.param(
            "volts",
            (*RATE, "--unit", "g"),
            "Remove --unit, or set its scale: --sensitivity",
            (*RATE, "--sensitivity", "100 mV/g"),
            id="unit contradicts volts",
        ),
        pytest.param(
            "counts",
            (*RATE, "--unit", "g"),
            'Remove --unit, or set its scale: --sensitivity "1 g"',
            (*RATE, "--sensitivity", "1 g"),
            id="unit contradicts counts",
        ),
    ],
)
def test_the_option_that_a_message_advises_reads_the_file(
    kind: str,
    options: tuple[str, ...],
    advice: str,
    corrected_options: tuple[str, ...],
    tmp_path: Path,
) -> None:
    command = ("data", "convert", write_file(kind, tmp_path), "--out", tmp_path / "a.h5")

    message = one_line(run(*command, *options, code=3))
    assert advice in message

    # the message is the same for all commands, so each must know the options that it names
    for option in re.findall(r"--[a-z][a-z-]*", message):
        for reader in READERS:
            assert option in options_of(reader)

    run(*command, *corrected_options)
