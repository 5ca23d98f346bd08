"""Files that are whole or not there, and seeds that never share a stream."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import swashtwin
from swashtwin.foundation import InputError, atomic_write, derive_seed, random_stream, write_text

NAMES = st.text(st.characters(exclude_characters="\x1f", exclude_categories=["Cs"]), max_size=8)


def test_an_old_file_stays_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.txt", "old")
    with atomic_write(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
        assert temporary.parent == path.parent
        assert temporary.suffix == path.suffix

    assert path.read_text() == "new"


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt(), ValueError()]
)
def test_whatever_goes_wrong_leaves_the_old_file_and_no_debris(
    tmp_path: Path, error: BaseException
) -> None:
    path = write_text(tmp_path / "a.txt", "old")

    def fill_the_disk() -> None:
        with atomic_write(path) as temporary:
            temporary.write_text("ne")
            raise error

    with pytest.raises(type(error)):
        fill_the_disk()
    assert os.listdir(tmp_path) == ["a.txt"]
    assert path.read_text() == "old"


def test_a_folder_in_the_way_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "a.txt" / "inside").mkdir(parents=True)
    with pytest.raises(OSError, match=r"a\.txt"):
        write_text(tmp_path / "a.txt", "new")
    assert os.listdir(tmp_path) == ["a.txt"]
    assert os.listdir(tmp_path / "a.txt") == ["inside"]


@given(
    seed=st.integers(0, 2**63),
    purpose=st.lists(NAMES, max_size=3),
    second=st.lists(NAMES, max_size=3),
)
def test_seeds_are_equal_only_for_the_same_purpose(
    seed: int, purpose: list[str], second: list[str]
) -> None:
    derived = derive_seed(seed, *purpose)
    assert 0 <= derived < 2**63
    assert derived == derive_seed(seed, *purpose)
    assert (derived == derive_seed(seed, *second)) == (purpose == second)
    assert derived != derive_seed(seed + 1, *purpose)


def test_seeds_are_the_same_on_every_machine() -> None:
    assert derive_seed(0, "noise", "rec-1") == 7897652416301739758


def test_streams_of_different_purposes_are_uncorrelated() -> None:
    random_text = np.stack(
        [random_stream(0, "part", number).standard_normal(4000) for number in range(20)]
    )
    correlation = np.corrcoef(random_text) - np.eye(20)

    assert np.abs(correlation).max() < 5 / np.sqrt(4000)


@pytest.mark.wrong_types
@pytest.mark.parametrize("load", ["load_model", "load_calibration", "load_pump", "load_recordings"])
def test_what_is_no_path_is_refused_in_one_sentence(load: str) -> None:
    with pytest.raises(
        InputError, match=r"^3 is not a path; give the file as text or as a pathlib.Path\.$"
    ):
        getattr(swashtwin, load)(3)
