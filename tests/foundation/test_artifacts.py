"""An artifact is read back as it was saved, or is refused in one line."""

import json
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from swashtwin.foundation import (
    ArtifactError,
    MissingFileError,
    parse_json,
    read_artifact,
    write_artifact,
)

CARD = {"names": ["a", "b"], "rate": 0.1, "none": None}
TENSORS = {
    "weight": np.arange(12.0).reshape(3, 4),
    "count": np.array([3, 5]),
    "flag": np.array([True]),
}


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    return write_artifact(tmp_path / "deep" / "x.safetensors", "thing", 3, CARD, TENSORS)


def read(path: Path, kind: str = "thing", version: int = 3) -> tuple[dict, dict]:
    return read_artifact(path, kind, version, advice="make it again")


def test_card_and_tensors_are_read_back_and_give_the_same_bytes(saved):
    card, tensors = read(saved)
    assert card == CARD
    assert all(np.array_equal(tensors[name], tensor) for name, tensor in TENSORS.items())

    second_file = write_artifact(saved.with_name("again.safetensors"), "thing", 3, card, tensors)
    assert second_file.read_bytes() == saved.read_bytes()
    assert sorted(path.name for path in saved.parent.iterdir()) == [
        "again.safetensors",
        "x.safetensors",
    ]


def test_every_flipped_byte_and_every_cut_is_refused_in_one_line(saved):
    content = saved.read_bytes()
    for index in range(len(content)):
        changed = bytearray(content)
        changed[index] ^= 0x04
        saved.write_bytes(changed)

        with pytest.raises(ArtifactError) as caught:
            read(saved)
        assert "\n" not in str(caught.value)

    for length in (0, 5, 100, len(content) // 2, len(content) - 1):
        saved.write_bytes(content[:length])
        with pytest.raises(ArtifactError, match="damaged"):
            read(saved)


def rewrite(path: Path, **changes: object) -> None:
    with safe_open(path, framework="np") as file:
        note = json.loads(file.metadata()["swashtwin"])
    save_file(load_file(path), path, metadata={"swashtwin": json.dumps({**note, **changes})})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"card": {**CARD, "rate": 0.2}}, "changed after it was saved"),
        ({"version": 2}, "has version 2 of a thing, this swashtwin reads version 3; make it again"),
        ({"version": [2] * 999}, "has version"),
        ({"kind": "other"}, "holds a 'other', not a thing"),
        ({"sha256": None}, "changed after it was saved"),
    ],
)
def test_an_edited_note_is_refused(saved, changes, message):
    rewrite(saved, **changes)
    with pytest.raises(ArtifactError, match=message) as caught:
        read(saved)
    assert len(str(caught.value)) < 300 + len(str(saved))


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        (
            None,
            "was not written by swashtwin; this swashtwin reads version 3 of a thing: make it again",
        ),
        ({"format": "pt"}, "was not written by swashtwin"),
        (
            {"swashtwin-classifier": "{}"},
            "has the former format swashtwin-classifier; this swashtwin reads version 3",
        ),
        (
            {"card": '{"format": "swashtwin-windows-1"}'},
            "has the former format swashtwin-windows-1",
        ),
        ({"format": "swashtwin-checkpoint-2"}, "has the former format swashtwin-checkpoint-2"),
        ({"swashtwin": "{"}, "its card cannot be read"),
        ({"swashtwin": "[1]"}, "its card cannot be read"),
        ({"swashtwin": "[" * 100_000}, "its card cannot be read"),
        ({"swashtwin": '{"kind": "thing"}'}, "its card cannot be read"),
    ],
)
def test_foreign_and_former_files_are_refused_by_format(saved, metadata, message):
    save_file(TENSORS, saved, metadata=metadata)
    with pytest.raises(ArtifactError, match=message):
        read(saved)


def test_text_and_missing_files_are_refused(tmp_path):
    (tmp_path / "text.safetensors").write_text("pump")
    with pytest.raises(ArtifactError, match="damaged or not a saved thing"):
        read(tmp_path / "text.safetensors")

    (tmp_path / "long.safetensors").write_bytes(b"\xff" * 64)
    with pytest.raises(ArtifactError, match="damaged"):
        read(tmp_path / "long.safetensors")
    with pytest.raises(MissingFileError, match=r"gone.safetensors does not exist; make it again"):
        read(tmp_path / "gone.safetensors")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_neither_saved_nor_loaded(tmp_path, value):
    tensors = {"weight": np.array([1.0, value])}
    with pytest.raises(ArtifactError, match="weight holds NaN or infinity"):
        write_artifact(tmp_path / "x.safetensors", "thing", 3, CARD, tensors)
    assert not list(tmp_path.iterdir())

    path = write_artifact(
        tmp_path / "x.safetensors", "thing", 3, CARD, tensors, may_be_nan=["weight"]
    )

    with pytest.raises(ArtifactError, match="weight holds NaN or infinity"):
        read(path)

    _, loaded = read_artifact(path, "thing", 3, advice="make it again", may_be_nan=["weight"])
    np.testing.assert_array_equal(loaded["weight"], tensors["weight"])


@pytest.mark.parametrize(
    "text",
    [
        "NaN",
        "[Infinity]",
        '{"a": -Infinity}',
        "1e999",
        "9" * 5_000_000,
        "[" * 100_000,
        "",
        '{"a": 1,}',
    ],
)
def test_invalid_json_and_numbers_that_are_not_finite_are_refused(text):
    with pytest.raises((ValueError, RecursionError)):
        parse_json(text)
