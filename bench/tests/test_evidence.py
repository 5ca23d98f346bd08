"""The page of evidence is generated from its files, and a study's rows can be added to them."""

import re
import subprocess

import pytest

from swashtwin_bench import evidence


def run_git(*arguments: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(["git", "-C", evidence.ROOT.parent, *arguments], capture_output=True)


def test_the_page_is_up_to_date() -> None:
    page = evidence.PAGE.read_text(encoding="utf-8")
    expected = evidence.build_page(evidence.load_evidence())
    assert page == expected, "run python -m swashtwin_bench.evidence page"


@pytest.mark.parametrize("entry", evidence.load_evidence(), ids=lambda entry: entry.question)
def test_each_entry_has_its_count_interval_command_and_a_full_table(
    entry: evidence.Evidence,
) -> None:
    assert entry.n
    assert entry.interval
    assert entry.command
    assert {len(row) for row in entry.rows} == {len(entry.columns)}


def test_rows_of_a_study_become_a_table() -> None:
    accuracy = {"mean": 0.95, "std": 0.01, "values": []}
    rows = [{"split": "L2", "accuracy": accuracy, "matrix": [[1]]}]

    # a matrix does not fit in a cell of the page
    columns, cells = evidence.tabulate_rows(rows)
    assert columns == ["split", "accuracy"]
    assert cells == [["L2", "0.950 ± 0.010"]]


def command_is_in(commit: str, command: str) -> bool:
    """Whether a commit has the script of a command, or registers its study."""
    script = re.search(r"python (?:\./)?(benchmarks/\w+\.py)", command)
    if script:
        return run_git("cat-file", "-e", f"{commit}:{script[1]}").returncode == 0

    study = re.search(r"swashtwin bench (?:study )?([\w-]+)", command)
    assert study, f"{command} is neither a script nor a study"
    return (
        run_git("grep", "-q", "-F", f'"{study[1]}"', commit, "--", "src", "bench").returncode == 0
    )


@pytest.fixture(scope="module")
def history() -> None:
    """Skip tests of earlier commits if the checkout does not hold them."""
    if run_git("rev-parse", "--is-shallow-repository").stdout.strip() != b"false":
        pytest.skip("This is no checkout with the whole history (git fetch --unshallow).")


@pytest.mark.usefixtures("history")
@pytest.mark.parametrize("entry", evidence.load_evidence(), ids=lambda entry: entry.question)
def test_each_command_is_in_the_commit_that_is_named(entry: evidence.Evidence) -> None:
    # Tags do not travel with a clone, so that only hashes are names.
    assert re.fullmatch("[0-9a-f]{8,40}", entry.commit)
    assert run_git("cat-file", "-e", f"{entry.commit}^{{commit}}").returncode == 0
    if entry.command != "as above":
        assert command_is_in(entry.commit, entry.command)


@pytest.mark.usefixtures("history")
def test_a_command_that_a_commit_lacks_is_noticed() -> None:
    assert not command_is_in(evidence.DEFAULT_COMMIT, "python benchmarks/no_such_script.py")
    assert not command_is_in(evidence.DEFAULT_COMMIT, "swashtwin bench study no-such-study")
