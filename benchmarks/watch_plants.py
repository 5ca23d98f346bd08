"""Plants that deliver nothing usable, or with a wrong clock: does the watch say so?

Each plant learns from healthy recordings, then delivers others one by one. `watch.py blind` counts
the deliveries until the watch reports a problem of the machine or raises an alarm of the pump.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

RATE = 5120.0
BASELINE = 20
N_DISTURBED = 3
"""Deliveries within which a finding must be reported."""
CADENCE = timedelta(minutes=10)
START = datetime(2025, 11, 24, 16, tzinfo=UTC)
WORN = 6.0
CONSTANT_POINT = 'speed = "1500 rpm"\ndischarge_pressure = "15 MPa"'
LOGGER_RESET = datetime(2000, 1, 1, 0, 5, tzinfo=UTC)
ARCHIVE_START = START - timedelta(days=200)


@dataclass(frozen=True)
class Delivery:
    """A recording as a file."""

    time: datetime
    """Date of the file."""
    loudness: float = 1.0
    rate: float = RATE
    channels: Sequence[str] = ("x [m/s^2]", "y [m/s^2]")


@dataclass(frozen=True)
class Plant:
    """What a plant delivers, and what must become of it."""

    disturbed: Callable[[int], Delivery] | None = None
    """The later deliveries by number; None for a plant that delivers only the first ones."""
    first: Sequence[Delivery] = field(
        default_factory=lambda: [Delivery(START + number * CADENCE) for number in range(24)]
    )
    machine: str = CONSTANT_POINT
    tags: str = ""
    must_report: bool = True
    """Whether a problem or an alarm must follow; otherwise all must be judged, and none may."""
    points: Sequence[str] = ()
    """Operating points at which something may be learned; empty for any."""


def later(number: int) -> datetime:
    """Return the date of a delivery after the first ones."""
    return START + (24 + number) * CADENCE


def tags(line: Callable[[datetime], str], head: str = "time,speed,pressure") -> str:
    """Return a tags file with a line for each delivery."""
    lines = [line(START + number * CADENCE - timedelta(minutes=1)) for number in range(30)]
    return "".join(f"{text}\n" for text in (head, *lines))


def tagged(text: str, *, must_report: bool = False) -> Plant:
    """Return a plant whose operating point is in a tags file."""
    six = [Delivery(START + number * CADENCE) for number in range(6)]
    return Plant(
        None,
        six,
        'tags = "tags.csv"\ntags_zone = "UTC"',
        text,
        must_report,
        ("1498 rpm, 15.1 MPa",),
    )


SEMICOLON = "time;speed;pressure"
PLANTS: Mapping[str, Plant] = {
    "clock at 2000": Plant(lambda n: Delivery(LOGGER_RESET + n * CADENCE, WORN)),
    "times set back an hour": Plant(lambda n: Delivery(later(n) - timedelta(hours=1), WORN)),
    "times ahead": Plant(lambda n: Delivery(datetime(2040, 1, 1, tzinfo=UTC) + n * CADENCE, WORN)),
    "channel vanished": Plant(lambda n: Delivery(later(n), channels=("x [m/s^2]",))),
    "rate changed": Plant(lambda n: Delivery(later(n), rate=2560.0)),
    "unit lost": Plant(lambda n: Delivery(later(n), channels=("x", "y"))),
    "file of 1980 in a backlog": Plant(
        None,
        [
            Delivery(datetime(1980, 1, 1, tzinfo=UTC)),
            *(Delivery(START + number * CADENCE) for number in range(30)),
        ],
        must_report=False,
    ),
    "archive": Plant(
        None,
        [Delivery(ARCHIVE_START + number * timedelta(days=2)) for number in range(30)],
        must_report=False,
    ),
    "tags with semicolons": tagged(tags(lambda t: f"{t:%Y-%m-%dT%H:%M:%SZ};1498;15.1", SEMICOLON)),
    "tags with a BOM": tagged("\ufeff" + tags(lambda t: f"{t:%Y-%m-%dT%H:%M:%SZ},1498,15.1")),
    "tags in milliseconds": tagged(tags(lambda t: f"{t.timestamp() * 1000:.0f},1498,15.1")),
    "German tags": tagged(tags(lambda t: f"{t:%d.%m.%Y %H:%M:%S};1498,0;15,1", SEMICOLON)),
    "one bad tag": tagged(
        tags(
            lambda t: (
                f"{t:%Y-%m-%dT%H:%M:%SZ},1498,15.1"
                if t.minute != 19 or t.hour != 16
                else f"{t:%Y-%m-%dT%H:%M:%SZ},Bad Input,15.1"
            )
        )
    ),
    "ambiguous tags": tagged(
        tags(lambda t: f"{t:%Y-%m-%dT%H:%M:%SZ};1,498;15,100", SEMICOLON), must_report=True
    ),
    "impossible tags": tagged(
        tags(lambda t: f"{t:%Y-%m-%dT%H:%M:%SZ},-1498,2190"), must_report=True
    ),
}


def write(folder: Path, name: str, delivery: Delivery, seed: int) -> None:
    """Write a delivery into the folder that is watched."""
    random = np.random.default_rng(seed)
    moments = np.arange(int(2 * delivery.rate)) / delivery.rate
    tone = sum(
        np.sin(2 * np.pi * 225 * order * moments + random.uniform(0, 6)) / order
        for order in (1, 2, 3)
    )
    noise = random.normal(size=(moments.size, len(delivery.channels)))
    signal = delivery.loudness * np.asarray(tone)[:, None] + noise
    path = folder / "incoming" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    heading = ",".join(("time [s]", *delivery.channels))
    rows = np.column_stack([moments, signal])
    np.savetxt(path, rows, "%.6f", ",", header=heading, comments="")
    os.utime(path, (delivery.time.timestamp(),) * 2)


def run_once(config: Path) -> dict[str, Any]:
    """Judge what is there, and return the result of the command."""
    command = [sys.executable, "-m", "swashtwin", "watch", "run", str(config), "--once", "--json"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    answer = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    result: dict[str, Any] = json.loads(answer.stdout)
    return result


def has_pump_alarm(folder: Path) -> bool:
    """Return whether a message about an alarm of the pump was sent."""
    log = folder / "data" / "alarms.log"
    return log.exists() and "pump alarm opened" in log.read_text(encoding="utf-8")


def watch_plant(folder: Path, plant: Plant, learned_points: Callable[[Path], set[str]]) -> str:
    """Return what the watch made of a plant; it begins with ``ok`` if that is right."""
    folder.mkdir(parents=True)
    config = folder / "watch.toml"
    config.write_text(
        f'folder = "data"\n[[machine]]\nname = "pump-1"\n{plant.machine}\n'
        '[[source]]\nkind = "folder"\npath = "incoming"\nsettle_time = "0.1 s"\n'
        '[[channel]]\nkind = "log"\n',
        encoding="utf-8",
    )
    if plant.tags:
        (folder / "tags.csv").write_text(plant.tags, encoding="utf-8")
    for number, delivery in enumerate(plant.first):
        write(folder, f"a{number:03}.csv", delivery, number)
    result = run_once(config)

    points = learned_points(config)
    if plant.points and not points <= set(plant.points):
        return f"learned at {sorted(points)}"
    if plant.disturbed is None:
        is_reported = bool(result["problems"])
        counts = f"{result['judged']:.0f} judged, {result['rejected']:.0f} rejected, "
        counts += f"{result['waiting']} wait"
        if is_reported != plant.must_report:
            return f"{counts}, problems {result['problems']}"
        return f"ok: {counts}"

    for number in range(N_DISTURBED):
        write(folder, f"b{number:03}.csv", plant.disturbed(number), 900 + number)
        result = run_once(config)
        if result["problems"]:
            alarm = ", pump alarm" if has_pump_alarm(folder) else ""
            return f"ok: reported at delivery {number + 1}{alarm}"
    return "nothing is reported"
