"""What a stranger's file says never steers the terminal, and a console of any encoding shows it."""

import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from swashtwin.cli import app, console
from swashtwin.foundation import escape_controls, plain_text

HOSTILE = "a\x1b]0;owned\x07\x9b2J\u202eb"


def test_control_characters_are_written_as_codes() -> None:
    shown = escape_controls(HOSTILE)
    assert shown == r"a\x1b]0;owned\x07\u009b2J\u202eb"
    marks = "".join(map(chr, (*range(0x20), *range(0x7F, 0xA0), *range(0x2000, 0x2100), 0xFEFF)))
    hidden = {mark for mark in marks if escape_controls(mark) != mark}
    assert plain_text(f"a{marks}b") == "".join(
        mark for mark in plain_text(f"a{marks}b") if mark not in hidden
    )
    assert all(plain_text(f"a{mark}b") == "ab" for mark in hidden)
    assert escape_controls("Größe 中 \U0001f600 \u05d0") == "Größe 中 \U0001f600 \u05d0"


def test_no_way_out_lets_a_control_character_through(capsys: pytest.CaptureFixture[str]) -> None:
    console.print_text(HOSTILE)
    console.print_note(HOSTILE)
    console.print_table(HOSTILE, (HOSTILE,), [(f"{HOSTILE}\n",)])
    console.print_result({HOSTILE: HOSTILE}, True, lambda: None)
    console.print_merged_notes([(HOSTILE, HOSTILE)], "left out")
    captured = capsys.readouterr()
    assert not {"\x1b", "\x07", "\x9b", "\u202e"} & set(captured.out + captured.err)
    assert json.loads(captured.out.splitlines()[-1]) == {HOSTILE: HOSTILE}


def test_progress_shows_codes_and_no_markup(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with console.progress(HOSTILE) as bar:
        bar(1, 2, f"{HOSTILE}[bold]")
    shown = capsys.readouterr().err
    assert "[bold]" in shown
    assert not {"\x07", "\x9b", "\u202e"} & set(shown)


@pytest.mark.parametrize(
    "words", [("inspect", HOSTILE), ("inspect", f"--{HOSTILE}"), (f"--{HOSTILE}",), (HOSTILE,)]
)
def test_errors_show_the_codes_of_a_hostile_name(words: tuple[str, ...]) -> None:
    result = CliRunner().invoke(app, words)
    assert result.exit_code in (2, 3)
    assert r"\x1b" in result.stderr
    assert not {"\x1b", "\x07", "\x9b", "\u202e"} & set(result.output)


def test_logs_and_warnings_of_libraries_show_codes() -> None:
    record = logging.makeLogRecord({"msg": HOSTILE, "levelname": "WARNING"})
    assert "\x1b" not in console._EscapingFormatter("%(message)s").format(record)


def test_hostile_names_in_an_index_never_reach_the_terminal(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x\n" + "1\n2\n" * 200, encoding="utf-8")
    entry = '[[recording]]\nfile = "a.csv"\nsample_rate = "1 kHz"\nunit = "g"\n'
    entry += "".join(f"{key} = {json.dumps(HOSTILE)}\n" for key in ("id", "label", "specimen"))
    (tmp_path / "recordings.toml").write_text(f"format = 1\n{entry}", encoding="utf-8")
    for words in (
        ("inspect", tmp_path),
        ("inspect", tmp_path, "--json"),
        ("signal", "features", tmp_path / "a.csv"),
    ):
        shown = CliRunner().invoke(app, [str(word) for word in words]).output
        assert shown
        assert not {"\x1b", "\x07", "\x9b", "\u202e"} & set(shown)


@pytest.mark.parametrize("encoding", ["cp437", "cp1252"])
def test_a_console_without_unicode_shows_tables_and_json(encoding: str) -> None:
    code = (
        "from swashtwin.cli import console; console.safe_streams()\n"
        "console.print_table('µ 中', ('mm³',), [('中 ± 1',)])\n"
        "console.print_text('中 ≥')\n"
        "console.print_result({'a': '中ä'}, True, None)"
    )
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    process = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, check=False
    )
    assert process.returncode == 0, process.stderr
    lines = process.stdout.decode(encoding).splitlines()
    assert r"\u4e2d ± 1" in "".join(lines)
    assert json.loads(lines[-1]) == {"a": "中ä"}


@pytest.mark.parametrize("width", [40, 200])
def test_no_number_of_a_table_is_cut_on_a_narrow_terminal(
    width: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "_UNLIMITED_WIDTH", width)
    numbers = [[1001.0 + 10 * row + order for order in range(9)] for row in range(3)]
    header = ("recording", *(f"order {order}x" for order in range(9)))
    console.print_table(
        "levels",
        header,
        [(f"A01_normal_15MPa_{row}", *values) for row, values in enumerate(numbers)],
    )
    text = capsys.readouterr().out
    assert "…" not in text
    assert all(f" {value:.0f} " in text for values in numbers for value in values)


def test_a_label_of_megabytes_is_cut_in_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    console.print_table("classes", ("class", "recordings"), [("x" * 3_000_000, 1)])
    assert len(capsys.readouterr().out) < 20_000
