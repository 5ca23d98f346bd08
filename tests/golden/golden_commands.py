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
    "--network spectral_bitcn --set epochs=12 --set batch_size=16 --set channels=8,8 --set dilations=1,2 "
    "--set hidden=16"
)
WORN = "recordings/A_swash_plate_15MPa_1.h5"


@dataclass(frozen=True)
class Command:
    """A command of the command line."""

    words: str
    """What is typed after ``swashtwin``, quoted as in a shell, without ``--json``; paths are those
    in the workspace.
    """
    after: tuple[str, ...] = ()
    """Commands whose files it reads, by name in `COMMANDS`."""
    rtol: float = 1e-6
    """Relative tolerance of its numbers."""
    atol: float = 0.0
    """Absolute tolerance of its numbers."""


SEARCHED: dict[str, float] = {"rtol": 1e-4, "atol": 1e-9}
"""Tolerances of what a search ends at."""
LEARNED: dict[str, float] = {"rtol": 1e-3, "atol": 5e-4}
"""Tolerances of what a network learned: they are probabilities and losses."""

COMMANDS: dict[str, Command] = {
    "inspect": Command("inspect pair.toml"),
    "split": Command("data split pair.toml --out split --test-fraction 0.5"),
    "features": Command("signal features worn.toml --pistons 7 --out features.csv", atol=1e-12),
    "spectrum_order": Command(f"signal spectrum {WORN} --kind order --pistons 7 --out order.svg"),
    "trend": Command("signal trend specimen.toml --baseline 'A_[npv]*' --out trend.svg"),
    "calibrate": Command(
        f"calibrate split/train.toml --specimen A {AT_15} {RECESS} {GAUSS_NEWTON} --out worn.json",
        after=("split",),
        **SEARCHED,
    ),
    "calibrate_healthy": Command(
        f"calibrate pair.toml {AT_15} {GAUSS_NEWTON} --specimen A --band '0-1 kHz' --out healthy.json",
        **SEARCHED,
    ),
    "severity": Command(
        f"twin severity healthy.json wear.toml {RECESS}", after=("calibrate_healthy",), **SEARCHED
    ),
    "synthesize": Command(
        "synthesize worn.json --like split/train.toml --window 2048 --count 3 --out synthetic.safetensors",
        after=("calibrate",),
    ),
    "train": Command(
        f"train split/train.toml --add synthetic.safetensors --test-fraction 0 --out model.safetensors {NETWORK}",
        after=("synthesize",),
        **LEARNED,
    ),
    "evaluate": Command("evaluate model.safetensors pair.toml", after=("train",), **LEARNED),
    "diagnose": Command(
        f"diagnose model.safetensors {WORN} --report diagnosis", after=("train",), **LEARNED
    ),
}
"""Commands by a name that stays, whatever they are called: that of their golden file."""

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
    | {"source", "title", "compared_with", "what", "why"}
)
"""Keys of sentences, whose number is compared and not their wording."""


class Workspace:
    """A folder in which commands run, each once."""

    def __init__(self, plant: Sequence[Recording], folder: Path) -> None:
        self.folder = folder
        self._answers: dict[str, Any] = {}
        write_workspace(plant, folder)

    def answer(self, name: str) -> Any:
        """What the command `name` of `COMMANDS` answers, as far as it is compared."""
        if name not in self._answers:
            command = COMMANDS[name]
            for earlier in command.after:
                self.answer(earlier)

            with contextlib.chdir(self.folder):
                self._answers[name] = self._compared(run_json(*shlex.split(command.words)))

        return self._answers[name]

    def _compared(self, value: Any) -> Any:
        if isinstance(value, dict):
            return {
                key: count_of(item) if key in PROSE else self._compared(item)
                for key, item in value.items()
                if key not in VOLATILE
            }
        if isinstance(value, list):
            return [self._compared(item) for item in value]
        is_path = isinstance(value, str) and "/" in value and Path(value).exists()

        return Path(value).name if is_path else value


def count_of(sentences: Any) -> Any:
    """How many sentences there are: of a list its length, of a text whether there is one."""
    return len(sentences) if isinstance(sentences, list) else bool(sentences)
