"""Commands whose ``--json`` answers are golden, and what of an answer is compared."""

import contextlib
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from commandline import run_json
from golden_rig import write_workspace

from swashtwin.recordings import Recording

AT_15 = "--speed '860 rpm' --pressure '15 MPa'"
RECESS = "--fault swash_plate:length=30mm,width=24mm,depth=0.07mm"
GAUSS_NEWTON = "--method gauss-newton --set starts=1 --set nuisances=none --set phases=false"
NETWORK = (
    "--network spectral_bitcn --set epochs=12 --set batch_size=16 "
    "--set channels=8,8 --set dilations=1,2 --set hidden=16"
)
FAULTY_RECORDING = "recordings/A_swash_plate_15MPa_1.h5"


@dataclass(frozen=True)
class Command:
    """A command of the command line."""

    line: str
    """Arguments after ``swashtwin``, quoted as in a shell, without ``--json``; paths are those in
    the workspace.
    """
    requires: tuple[str, ...] = ()
    """Commands whose files it reads, by name in `COMMANDS`."""
    rtol: float = 1e-6
    """Relative tolerance of its numbers."""
    atol: float = 0.0
    """Absolute tolerance of its numbers."""


SEARCHED: dict[str, float] = {"rtol": 1e-4, "atol": 1e-9}
"""Tolerances of the result of a search."""
LEARNED: dict[str, float] = {"rtol": 1e-3, "atol": 5e-4}
"""Tolerances of probabilities and losses of a trained network."""

COMMANDS: dict[str, Command] = {
    "inspect": Command("inspect pair.toml"),
    "split": Command("data split pair.toml --out split --test-fraction 0.5"),
    "features": Command("signal features worn.toml --pistons 7 --out features.csv", atol=1e-12),
    "spectrum_order": Command(
        f"signal spectrum {FAULTY_RECORDING} --kind order --pistons 7 --out order.svg"
    ),
    "trend": Command("signal trend specimen.toml --baseline 'A_[npv]*' --out trend.svg"),
    "calibrate": Command(
        f"calibrate split/train.toml --specimen A {AT_15} {RECESS} {GAUSS_NEWTON} --out worn.json",
        requires=("split",),
        **SEARCHED,
    ),
    "calibrate_healthy": Command(
        # in doubt without the default nuisances: which mistakes explain it differs between machines
        f"calibrate pair.toml {AT_15} --method gauss-newton --set starts=1 --specimen A "
        "--band '0-1 kHz' --out healthy.json",
        **SEARCHED,
    ),
    "severity": Command(
        f"twin severity healthy.json wear.toml {RECESS}",
        requires=("calibrate_healthy",),
        **SEARCHED,
    ),
    "synthesize": Command(
        "synthesize worn.json --like split/train.toml --window 2048 --count 3 "
        "--out synthetic.safetensors",
        requires=("calibrate",),
        **SEARCHED,
    ),
    "synthesize_fill": Command(
        "synthesize --fill all worn.json --like split/train.toml --window 2048 --count 1 "
        "--out filled.safetensors",
        requires=("calibrate",),
        **SEARCHED,
    ),
    "train": Command(
        "train split/train.toml --add synthetic.safetensors --test-fraction 0 "
        f"--out model.safetensors {NETWORK}",
        requires=("synthesize",),
        **LEARNED,
    ),
    "evaluate": Command("evaluate model.safetensors pair.toml", requires=("train",), **LEARNED),
    "diagnose": Command(
        f"diagnose model.safetensors {FAULTY_RECORDING} --report diagnosis",
        requires=("train",),
        **LEARNED,
    ),
}
"""Commands by the name of their golden file, which stays if a command is renamed."""

VOLATILE = frozenset(
    {
        "wall_s",
        "cpu_s",
        "simulations",
        "device",
        "version",
        "rig_version",
        "command",
        "bytes",
        "key",
    }
    | {"sha256", "recording_hashes", "fingerprints", "estimator", "settings"}
)
"""Keys of what differs from machine to machine or from version to version, and of settings that are
only shown.
"""

PROSE = frozenset(
    {
        "notes",
        "answer",
        "message",
        "sentences",
        "fact_sources",
        "skipped",
        "meaning",
        "split_meaning",
        "origin",
    }
    | {"source", "title", "compared_with", "what", "why", "doubt"}
)
"""Keys of sentences, whose number is compared and not their wording."""


class Workspace:
    """A folder in which commands run, each once."""

    def __init__(self, plant: Sequence[Recording], folder: Path) -> None:
        self.folder = folder
        self._answers: dict[str, Any] = {}
        write_workspace(plant, folder)

    def answer(self, name: str) -> Any:
        """Return what is compared of the answer of the command `name` of `COMMANDS`."""
        if name not in self._answers:
            command = COMMANDS[name]
            for earlier in command.requires:
                self.answer(earlier)

            with contextlib.chdir(self.folder):
                self._answers[name] = self._compared(run_json(*shlex.split(command.line)))

        return self._answers[name]

    def _compared(self, value: Any) -> Any:
        if isinstance(value, dict):
            return {
                key: count_of(entry) if key in PROSE else self._compared(entry)
                for key, entry in value.items()
                if key not in VOLATILE
            }
        if isinstance(value, list):
            return [self._compared(entry) for entry in value]
        is_path = isinstance(value, str) and "/" in value and Path(value).exists()

        return Path(value).name if is_path else value


def count_of(sentences: Any) -> Any:
    """Return the number of sentences in a list, or if there is a text at all."""
    return len(sentences) if isinstance(sentences, list) else bool(sentences)
