"""Recordings of a pump that hums, and a configuration that watches it."""

import os
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from swashtwin.monitoring.config.config_file import load_watch_config
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.recordings import Recording, write_recording

RATE = 5120.0
LEARNING = 20
START = datetime(2026, 11, 1, tzinfo=UTC)


def hum(
    seed: int,
    *,
    gain: float = 1.0,
    rate: float = RATE,
    channels: Sequence[str] = ("x", "y"),
) -> Recording:
    """Two seconds of a pump with nine pistons at 1500 rpm; `gain` is how much louder it is than
    when healthy.
    """
    random = np.random.default_rng(seed)
    time = np.arange(int(2 * rate)) / rate
    tone = sum(
        np.sin(2 * np.pi * 225 * order * time + random.uniform(0, 6)) / order for order in (1, 2, 3)
    )
    signal = np.stack([gain * tone + random.normal(size=time.size) for _ in channels])

    return Recording(
        signal.astype(np.float32).astype(float),
        rate,
        f"hum-{seed}",
        channels=tuple(channels),
    )


def write_hum(path: Path, seed: int, minute: float | None = None, **settings: object) -> Path:
    """Path of a file with such a recording, `minute` minutes after `START`; now by default."""
    path.parent.mkdir(parents=True, exist_ok=True)
    hidden = write_recording(hum(seed, **settings), path.with_name(f".{path.name}"))  # type: ignore[arg-type]
    if minute is not None:
        os.utime(hidden, (START.timestamp() + 60 * minute,) * 2)
    return hidden.rename(path)


def watch_config(
    folder: Path,
    text: str = "",
    *,
    history: str = "",
    machines: Sequence[str] = ("pump-1",),
    machine: str = "",
) -> WatchConfig:
    """Configuration of a watch of the folder ``incoming``, with more in `text`, and of each machine
    in `machine`.
    """
    lines = ['folder = "data"', f'history = "{history}"' if history else ""]
    facts = f'speed = "1500 rpm"\ndischarge_pressure = "15 MPa"\n{machine}'
    lines += [f'[[machine]]\nname = "{name}"\n{facts}' for name in machines]
    lines += [
        '[[source]]\nkind = "folder"\npath = "incoming"\nsettle_time = "0.05 s"',
        f"[alarms]\nbaseline_recordings = {LEARNING}",
    ]
    (folder / "incoming").mkdir(parents=True, exist_ok=True)
    (folder / "watch.toml").write_text("\n".join([*lines, text]), encoding="utf-8")

    return load_watch_config(folder / "watch.toml")
