"""Numbers, prefixes and folders that tell classes apart are kept in the proposed classes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from swashtwin.recordings import propose_index
from swashtwin.recordings.proposal import IndexProposal

CASES = Path(__file__).parent / "cases"


def propose_for(folder: Path, names: Sequence[str]) -> IndexProposal:
    """Return the proposal for files of these names, two of each class."""
    for number, name in enumerate(names):
        for part in (1, 2):
            path = folder / f"{name}_{part}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            samples = np.random.default_rng([number, part]).normal(size=60)
            path.write_text("acc\n" + "\n".join(f"{sample:.4f}" for sample in samples))
    return propose_index(folder, unit="g", sample_rate="1 kHz")


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (
            ["10 um/10 um_merged", "45 um/45 um_merged", "Healthy/Healthy_merged"],
            ["10 um", "45 um", "Healthy"],
        ),
        (["0.5X_B", "2.0X_B", "B", "normal"], ["0.5X_B", "2.0X_B", "B", "normal"]),
        (["0.5X_B/rec", "B/rec", "normal/rec"], ["0.5X_B", "B", "normal"]),
        (["normal", "wear_7mm", "wear_14mm"], ["normal", "wear_14mm", "wear_7mm"]),
        (["B007/run1", "IR014/run1", "normal/run1"], ["B007", "IR014", "normal"]),
        (["normal/x", "wear level 1/x", "wear level 2/x"], ["normal", "wear level 1"]),
    ],
)
def test_what_tells_classes_apart_is_kept_and_said(
    tmp_path: Path, names: list[str], labels: list[str]
) -> None:
    proposal = propose_for(tmp_path, names)

    assert set(labels) <= set(proposal.index["classes"])
    assert len(proposal.index["classes"]) == len(names)
    (note,) = [note for note in proposal.notes if note.kind == "numbered_classes"]
    assert "or else machines, operating points or measurements" in note.message
    assert "{label_pattern}" in note.remedy


@pytest.mark.parametrize(
    "names",
    [
        ["A/10kHz_wear", "A/10kHz_normal", "B/normal_25Hz"],
        ["run1/wear", "run2/normal", "15MPa/normal"],
        ["wear_1", "wear_2", "normal_3"],
        ["3d_wear", "3d_normal"],
        ["2026-01-03/wear", "2026-01-04/normal"],
    ],
)
def test_machines_operating_points_and_counts_are_no_classes(
    tmp_path: Path, names: list[str]
) -> None:
    proposal = propose_for(tmp_path, names)

    assert set(proposal.index["classes"]) == {"wear", "normal"}
    assert not [note for note in proposal.notes if note.kind == "numbered_classes"]


def test_classes_that_differ_in_case_only_are_said() -> None:
    proposal = propose_index(CASES / "K23-case", unit="g")

    messages = [note.message for note in proposal.notes if note.kind == "similar_classes"]
    assert len(messages) == 2
    assert "'Fault' and 'fault' differ in case" in messages[0]
