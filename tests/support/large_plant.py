"""A plant with any number of machines, whose history is written without judging a recording."""

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import update

from swashtwin.monitoring.history.database import Database, lock_machine
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.schema import Judgment, Machine, Tally

NOW = datetime.now(UTC).replace(microsecond=0)
INTERVAL = timedelta(hours=8)
LEARNING = 20
POINT = "1500 rpm, 15 MPa"
N_SITES = 4
_SUSPECT = {
    "certainty": "sure",
    "sentence": "Suspect: piston (93 %).",
    "label": "piston",
    "probabilities": {"piston": 0.93, "normal": 0.07},
}
_UNSURE = {
    "certainty": "unsure",
    "sentence": "Suspect, unsure: valve plate (47 %), or cylinder block (29 %). Virtual pumps "
    "separate valve plate and cylinder block in 73 % of recordings.",
    "label": "valve_plate",
    "probabilities": {"valve_plate": 0.47, "cylinder_block": 0.29, "normal": 0.24},
}
_SEVERITY = {
    "label": "piston",
    "sentence": "Severity, if piston wear: clearance 24 µm (18 ... 31 µm), detected; detection "
    "limit 9 µm.",
    "notes": [],
    "verdict": "detected",
    "dimension": "clearance",
    "unit": "µm",
    "value": 24.0,
    "interval": [18.0, 31.0],
    "certainty": "sure",
}
_FINDING = "channel y does not move in 100% of the recording."
_DELIVERY_REASONS = [
    "4 deliveries in a row have a problem; the last one is a.wav (broken).",
    "a.wav: no header.",
]
STORIES = ("worn", "unsure", "sensor", "delivery", "acknowledged", "unusual", "silent", "learning")
"""What happens to the first machines; all others stay healthy."""


def write_large_plant(folder: Path, n_machines: int, n_recordings: int = 36) -> Path:
    """Write the configuration and the history of machines at several sites, and return the
    configuration's path.

    Machine 3 is the first one with a story, so that the most urgent one is not the first by name.
    """
    folder.mkdir(parents=True)
    lines = ['folder = "data"', '[[source]]\nkind = "http"']
    stories = dict(zip(range(3, n_machines, 2), STORIES, strict=False))
    names = [f"P-{number + 101}" for number in range(n_machines)]
    for number, name in enumerate(names):
        site = f"hall {number * N_SITES // n_machines + 1}"
        lines.append(f'[[machine]]\nname = "{name}"\nsite = "{site}"\npump = "25scy14-1b"')
    config = folder / "watch.toml"
    config.write_text("\n".join(lines), encoding="utf-8")

    judgments = {
        name: list(_judgments(name, number, stories.get(number, ""), n_recordings))
        for number, name in enumerate(names)
    }
    _write_recordings(folder / "data", judgments)
    history = History.open("", folder / "data")
    for number, story in stories.items():
        _raise_alarm(history, names[number], story, judgments[names[number]])
    history.close()
    return config


def _write_recordings(folder: Path, judgments: Mapping[str, Sequence[Judgment]]) -> None:
    """Write the recordings of all machines in one transaction, which takes a second for 10,000."""
    database = Database("", folder)
    with database.writing() as session:
        for name, of_machine in judgments.items():
            lock_machine(session, name)
            for judgment in of_machine:
                judgment.machine = name
            session.add_all(of_machine)
            session.flush()
            newest = of_machine[-1].id
            session.execute(update(Machine).where(Machine.name == name).values(last=newest))
            for state, count in Counter(judgment.state for judgment in of_machine).items():
                session.add(Tally(machine=name, state=state, recordings=count))
    database.close()


def _raise_alarm(history: History, name: str, story: str, judgments: Sequence[Judgment]) -> None:
    newest = judgments[-1]
    raising = judgments[-min(6, len(judgments))]

    def source(judgment: Judgment) -> dict[str, Any]:
        return {"recording": judgment.id, "time": judgment.time.isoformat()}

    reasons = newest.reasons["sentences"]
    evidence: dict[str, Any] = {
        "reasons": raising.reasons["sentences"],
        "moved": raising.reasons["moved"],
        "newest": {"reasons": reasons} | source(newest),
    }
    with history.machine(name) as machine:
        if story in ("worn", "acknowledged"):
            evidence["suspect"] = _SUSPECT | source(newest)
            evidence["severity"] = _SEVERITY | source(raising)
        if story == "unsure":
            evidence["suspect"] = _UNSURE | source(newest)
        if story in ("worn", "unsure", "acknowledged"):
            alarm = machine.open_alarm("pump", POINT, raising.time, evidence, raising.id)
            if story == "acknowledged":
                machine.acknowledge(alarm.id, "Ada", "spare part ordered")
        elif story == "sensor":
            finding = {"kind": "flat", "channel": "y", "sentence": _FINDING}
            machine.open_alarm("sensor", POINT, newest.time, {"findings": [finding]}, newest.id)
        elif story == "delivery":
            machine.open_alarm("delivery", None, newest.time, {"reasons": _DELIVERY_REASONS}, None)


def _judgments(name: str, seed: int, story: str, count: int) -> Iterator[Judgment]:
    random = np.random.default_rng(seed)
    end = NOW - timedelta(minutes=5 * seed % 400)
    if story == "silent":
        end -= timedelta(days=4)
    for number in range(count):
        from_end = count - 1 - number
        score: float | None = float(random.gamma(2.0, 0.35))
        state = "normal"
        growth = max(0, 9 - from_end)
        is_worn = story in ("worn", "unsure", "acknowledged") and growth
        if number < LEARNING * count // 36 or story == "learning":
            score = None
            state = "learning"
        elif is_worn or (story == "unusual" and from_end < 2):
            score = 2.0 + 1.3 * growth
            state = "alarm" if from_end < 6 and is_worn else "unusual"
        elif story == "sensor" and from_end < 3:
            score = None
            state = "sensor"
        yield _judgment(name, number, end - INTERVAL * from_end, state, score)


def _judgment(name: str, number: int, time: datetime, state: str, score: float | None) -> Judgment:
    sentences = []
    moved: list[Mapping[str, Any]] = []
    if state in ("alarm", "unusual") and score is not None:
        for order in (9, 18, 27, 36, 1, 2, 3, 10):
            band = f"shaft order {order} ({25 * order} Hz)"
            moved.append({"channel": "x", "band": band, "change": score, "spreads": score})
            sentences.append(f"+{score:.1f} dB at {band}, channel x")
    findings = []
    if state == "sensor":
        findings.append({"kind": "flat", "channel": "y", "sentence": _FINDING})
        sentences.append(_FINDING)
    return Judgment(
        content=hashlib.sha256(f"{name} {number}".encode()).hexdigest(),
        time=time,
        received=time,
        source="http",
        file=f"{number}.wav",
        channels=["x", "y", "z"],
        unit="m/s^2",
        sample_rate=25600.0,
        duration=4.0,
        state=state,
        point=POINT,
        speed=157.08,
        pressure=15e6,
        capital=None if score is None else 0.2 + 20 * score * (state == "alarm"),
        alarm_p=None if score is None else 0.3,
        reasons={
            "sentences": sentences,
            "notes": [],
            "findings": findings,
            "delivery": [],
            "moved": moved,
            "score": score,
            "learned": min(number + 1, LEARNING),
            "learning": LEARNING,
            "verdict": {},
            "no_verdict": None,
            "suspect": None,
        },
    )
