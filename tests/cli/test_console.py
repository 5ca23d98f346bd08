"""What a stranger's file says never steers the terminal, and a console of any encoding shows it."""

import json
import logging
import os
import subprocess
import sys
from pathlib import Path
from queue import Queue

import pytest
from typer.testing import CliRunner

from swashtwin.cli import app, console
from swashtwin.foundation import escape_controls, plain_text

# ESC sets the window title and BEL ends it, CSI in one byte clears the screen, and the override
# U+202E reverses the text that follows.
HOSTILE = "a\x1b]0;owned\x07\x9b2J\u202eb"
CONTROLS = {"\x1b", "\x07", "\x9b", "\u202e"}


def test_control_characters_are_written_as_codes() -> None:
    assert escape_controls(HOSTILE) == r"a\x1b]0;owned\x07\u009b2J\u202eb"


def test_letters_and_symbols_of_any_language_are_not_escaped() -> None:
    text = "Größe 中 \U0001f600 \u05d0"
    assert escape_controls(text) == text


def test_plain_text_drops_exactly_the_characters_that_are_written_as_codes() -> None:
    # C0 and C1 controls, the Unicode block of invisible and direction marks, and the byte order mark
    code_points = (*range(0x20), *range(0x7F, 0xA0), *range(0x2000, 0x2100), 0xFEFF)
    characters = [chr(code_point) for code_point in code_points]
    escaped = {character for character in characters if escape_controls(character) != character}

    assert not escaped & set(plain_text(f"a{''.join(characters)}b"))
    for character in escaped:
        assert plain_text(f"a{character}b") == "ab"


def test_no_kind_of_output_contains_a_control_character(
    capsys: pytest.CaptureFixture[str],
) -> None:
    console.print_text(HOSTILE)
    console.print_note(HOSTILE)
    console.print_table(HOSTILE, (HOSTILE,), [(f"{HOSTILE}\n",)])
    console.print_result({HOSTILE: HOSTILE}, True, lambda: None)
    console.print_merged_notes([(HOSTILE, HOSTILE)], "left out")

    printed = capsys.readouterr()
    assert not CONTROLS & set(printed.out + printed.err)
    # JSON escapes them without loss
    assert json.loads(printed.out.splitlines()[-1]) == {HOSTILE: HOSTILE}


def test_a_progress_bar_shows_codes_and_takes_no_markup(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)

    with console.progress(HOSTILE) as bar:
        bar(1, 2, f"{HOSTILE}[bold]")

    printed = capsys.readouterr().err
    assert "[bold]" in printed
    # the bar itself moves the cursor with ESC
    assert not (CONTROLS - {"\x1b"}) & set(printed)


class Clock:
    """Time that passes only when a test says so."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def quiet_lines(monkeypatch: pytest.MonkeyPatch) -> Queue[str]:
    """Lines that a command prints, also because nothing was finished for a hundredth of a second.

    Reading captured output while another thread prints may lose a line.
    """
    lines: Queue[str] = Queue()
    monkeypatch.setattr(console, "SILENCE_S", 0.01)
    monkeypatch.setattr(console, "print_note", lines.put)
    return lines


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(console, "time", clock)
    return clock


def test_a_log_states_how_long_it_takes_after_the_first_unit_of_work(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.progress("training") as bar:
        bar(0, 10)
        clock.now = 30.0
        bar(1, 10)
        clock.now = 60.0
        bar(2, 10, "training, loss 0.1")

    assert capsys.readouterr().err.splitlines() == [
        "training: 1 of 10, about 4 min of 5 min left",
        "training, loss 0.1: 2 of 10, about 4 min of 5 min left",
    ]


def test_a_unit_that_takes_long_raises_the_estimate_of_all_that_is_left(
    clock: Clock, quiet_lines: Queue[str]
) -> None:
    with console.progress("study") as bar:
        clock.now = 30.0
        bar(1, 10)
        clock.now = 600.0
        earlier_lines = {"study: 30 s so far", "study: 1 of 10, about 4 min of 5 min left"}
        line = quiet_lines.get(timeout=60)
        while line in earlier_lines:
            line = quiet_lines.get(timeout=60)

    # 300 s for each of nine units, of which one has run for at least as long
    assert line == "study: 1 of 10, about 40 min of 50 min left"


def test_units_of_an_earlier_run_and_of_another_activity_do_not_shorten_the_estimate(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.progress("study") as bar:
        clock.now = 10.0
        bar(5, 6, "recording")
        clock.now = 20.0
        bar(6, 6, "recording")
        bar(0, 3, "training")
        clock.now = 120.0
        bar(1, 3, "training")

    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "recording: 5 of 6, about 10 s of 20 s left"
    assert lines[-1] == "training: 1 of 3, about 3 min of 5 min left"


def test_the_start_of_processes_does_not_count_for_many_units(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.progress("recording") as bar:
        clock.now = 50.0
        bar(1, 270)
        for count in range(2, 5):
            clock.now += 0.5
            bar(count, 270)

    # nothing is known after the first unit, and little after the next ones
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "recording: 4 of 270, about 2 min of 3 min left"


def test_the_first_of_many_long_units_counts(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.progress("courses") as bar:
        # two processes, which finish at about the same time
        clock.now = 500.0
        bar(1, 25)
        clock.now = 520.0
        bar(2, 25)

    lines = capsys.readouterr().err.splitlines()
    assert lines[-1] == "courses: 2 of 25, about 1 h 40 min of 1 h 48 min left"


def test_a_process_that_joblib_replaces_is_not_reported() -> None:
    code = (
        "import warnings; from swashtwin.cli import console; console.safe_streams(); "
        "warnings.warn('A worker stopped while some jobs were given to the executor.'); "
        "warnings.warn('another warning')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert "A worker stopped" not in done.stderr
    assert "another warning" in done.stderr


def test_a_short_command_prints_no_progress(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.progress("reading") as bar:
        for count in range(5):
            clock.now += 0.5
            bar(count, 5)

    assert capsys.readouterr().err == ""


def test_a_log_states_that_a_long_unit_of_work_goes_on(
    clock: Clock, quiet_lines: Queue[str]
) -> None:
    with console.progress("evaluating"):
        clock.now = 200.0
        line = quiet_lines.get(timeout=60)

    assert line == "evaluating: 3 min so far"


def test_a_progress_bar_states_how_long_is_left(
    clock: Clock, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "200")

    with console.progress("training") as bar:
        clock.now = 30.0
        bar(1, 10)

    assert "about 4 min of 5 min left" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(("inspect", HOSTILE), id="file"),
        pytest.param(("inspect", f"--{HOSTILE}"), id="option of a command"),
        pytest.param((f"--{HOSTILE}",), id="option"),
        pytest.param((HOSTILE,), id="command"),
    ],
)
def test_errors_show_the_codes_of_a_hostile_name(arguments: tuple[str, ...]) -> None:
    result = CliRunner().invoke(app, arguments)

    assert result.exit_code in (2, 3)
    assert r"\x1b" in result.stderr
    assert not CONTROLS & set(result.output)


def test_logs_and_warnings_of_libraries_show_codes() -> None:
    record = logging.makeLogRecord({"msg": HOSTILE, "levelname": "WARNING"})
    assert "\x1b" not in console._EscapingFormatter("%(message)s").format(record)


@pytest.mark.parametrize(
    ("command", "options"),
    [
        pytest.param("inspect .", (), id="table"),
        pytest.param("inspect .", ("--json",), id="json"),
        pytest.param("signal features a.csv", (), id="single file"),
    ],
)
def test_hostile_names_in_an_index_never_reach_the_terminal(
    command: str, options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("x\n" + "1\n2\n" * 200, encoding="utf-8")
    name = json.dumps(HOSTILE)
    entry = '[[recording]]\nfile = "a.csv"\nsample_rate = "1 kHz"\nunit = "g"\n'
    entry += f"id = {name}\nlabel = {name}\nspecimen = {name}\n"
    Path("recordings.toml").write_text(f"format = 1\n{entry}", encoding="utf-8")

    output = CliRunner().invoke(app, [*command.split(), *options]).output

    assert output
    assert not CONTROLS & set(output)


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
    # ± exists in both code pages, the Chinese character in neither
    assert r"\u4e2d ± 1" in "".join(lines)
    assert json.loads(lines[-1]) == {"a": "中ä"}


@pytest.mark.parametrize("width", [40, 200])
def test_no_number_of_a_table_is_cut_on_a_narrow_terminal(
    width: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "_UNLIMITED_WIDTH", width)
    header = ("recording", *(f"order {order}x" for order in range(9)))
    # every number is another one: 1001 to 1029
    numbers = [[1001.0 + 10 * row + order for order in range(9)] for row in range(3)]
    rows = [(f"A01_normal_15MPa_{row}", *values) for row, values in enumerate(numbers)]

    console.print_table("levels", header, rows)

    text = capsys.readouterr().out
    assert "…" not in text
    for values in numbers:
        for value in values:
            assert f" {value:.0f} " in text


def test_a_label_of_megabytes_is_cut_in_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    console.print_table("classes", ("class", "recordings"), [("x" * 3_000_000, 1)])
    assert len(capsys.readouterr().out) < 20_000


def printed_notes(capsys: pytest.CaptureFixture[str], notes: list[tuple[str, str]]) -> list[str]:
    console.print_merged_notes(notes)
    return capsys.readouterr().err.splitlines()


def test_notes_of_one_kind_become_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    equal = [(f"r{number}", "It has no speed.") for number in range(78)]
    differing = [(f"r{number}", f"Level of r{number} is -{number}.5 dB.") for number in range(78)]

    (equal_line,) = printed_notes(capsys, equal)
    (differing_line,) = printed_notes(capsys, differing)

    assert equal_line == "note: in 78 recordings (r0, r1, r2 and 75 more): It has no speed."
    assert differing_line == (
        "note: in 78 recordings (r0, r1, r2 and 75 more), such as r0: Level of r0 is -0.5 dB."
    )


def test_equal_notes_stay_equal_if_a_name_is_a_word_of_them(
    capsys: pytest.CaptureFixture[str],
) -> None:
    notes = [("dead", "A dead sensor?"), ("other", "A dead sensor?")]

    assert printed_notes(capsys, notes) == ["note: in 2 recordings (dead, other): A dead sensor?"]


def test_few_notes_that_differ_in_a_number_and_notes_of_other_kinds_stay(
    capsys: pytest.CaptureFixture[str],
) -> None:
    notes = [("a", "Gain 3 dB."), ("b", "Gain 4 dB."), ("a", "Offset 3 g.")]

    assert printed_notes(capsys, notes) == [
        "note: a: Gain 3 dB.",
        "note: b: Gain 4 dB.",
        "note: a: Offset 3 g.",
    ]
