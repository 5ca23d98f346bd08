"""The small virtual rig behind the golden values: four pumps, five classes, two recordings of each
at 15 MPa.
"""

import contextlib
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from swashtwin.foundation import MPa
from swashtwin.recordings import Recording, write_index, write_recording
from swashtwin_bench import build_rig, rig_recordings
from swashtwin_bench.rigs.writing import RigSize

SIZE = RigSize(specimens=4, repeats=2, duration=1.2)
LABELS = ("normal", "swash_plate")
"""Classes of the recordings that most golden values rest on."""
WEAR = ("A_normal_15MPa_1", "A_normal_15MPa_2", "A_swash_plate_15MPa_1")
"""Recordings of one pump, the last with a swash plate defect."""


@contextlib.contextmanager
def rig_at_15() -> Iterator[None]:
    """Within it the rig records at 15 MPa alone, and its small size is one pump for a moment."""
    module = sys.modules[build_rig.__module__]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "SIZES", {"small": RigSize(specimens=1, repeats=1, duration=0.2)})
        patch.setattr(module, "PRESSURES", (MPa(15),))
        yield


def plant_recordings() -> list[Recording]:
    """Every recording of the rig."""
    with rig_at_15():
        return [recording for recording, _ in rig_recordings(0, SIZE)]


def pair_recordings(plant: Sequence[Recording]) -> list[Recording]:
    """Healthy pumps and those with a swash plate defect, of two specimens."""
    return [
        recording for recording in plant if recording.specimen in "AB" and recording.label in LABELS
    ]


def write_workspace(plant: Sequence[Recording], folder: Path) -> None:
    """Files that the commands start from.

    ``recordings/`` with an HDF5 file each; the indexes ``plant.toml``, ``pair.toml``, ``wear.toml``
    (a pump before and after), ``worn.toml`` (after) and ``specimen.toml`` (A); and ``csv/`` with
    the first channel of a few recordings, without an index.
    """
    indexes = {
        "plant": list(plant),
        "pair": pair_recordings(plant),
        "wear": [recording for recording in plant if recording.recording_id in WEAR],
        "worn": [recording for recording in plant if recording.recording_id == WEAR[-1]],
        "specimen": [recording for recording in plant if recording.specimen == "A"],
    }
    files = {
        recording.recording_id: write_recording(
            recording, folder / "recordings" / f"{recording.recording_id}.h5"
        )
        for recording in plant
    }

    for name, recordings in indexes.items():
        paths = [files[recording.recording_id].relative_to(folder) for recording in recordings]
        write_index(recordings, paths, folder / f"{name}.toml")

    (folder / "csv").mkdir()
    for recording in indexes["pair"][:4]:
        rows = "\n".join(f"{value:.6f}" for value in recording.signal[0, :4000])
        (folder / "csv" / f"{recording.label}_{recording.recording_id[-1]}.csv").write_text(
            f"x\n{rows}\n"
        )
