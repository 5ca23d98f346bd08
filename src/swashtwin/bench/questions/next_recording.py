"""Whether the plan of the next recording is better than random choice: interval widths against recordings added.

Each pump starts from one recording. One recording after the other is then added, by `plan_recording` after each
calibration, or drawn from the same candidates. Two kinds of pumps: on the twin's *own* recordings everything is right,
and sensors can be moved; a pump of the *virtual rig*, of which the twin lacks much, is assembled once and has its three
sensors.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from joblib import delayed

from swashtwin.bench.questions.wrong_twin_study import SPREAD, study_twin
from swashtwin.bench.results.contrasts import paired_interval
from swashtwin.bench.results.finished import finished_values
from swashtwin.bench.results.runs import Task
from swashtwin.bench.results.table import StudyTable, Trial
from swashtwin.bench.rigs.fleet import Specimen, draw_specimen
from swashtwin.bench.rigs.measuring import Run, measure, true_values
from swashtwin.bench.rigs.writing import RIG_VERSION, SAMPLE_RATE, recording_of, run_of
from swashtwin.calibration import Calibration, GaussNewton, calibrate, plan_recording, total_width
from swashtwin.foundation import VERSION, InputError, MPa, parallel, rpm, stream
from swashtwin.pump import Interfaces, OperatingCondition, Pump, Sensor, load_pump
from swashtwin.recordings import Recording
from swashtwin.signals import add_noise

STUDY = "next-recording"
METRICS = {
    "width": "total ln width",
    "fall": "fall since the first",
    "covered": "intervals that hold, of 6",
}
SPEEDS = tuple(map(rpm, (600, 860, 1200, 1500)))
PRESSURES = tuple(map(MPa, (5, 10, 15)))
DURATIONS = (2.0, 4.0)
"""Lengths of candidates [s]."""
DRAWN = ("cover_z", "body_y", "body_x")
SETS = (DRAWN, ("cover_z", "body_y", "cover_y"), ("cover_z", "body_y", "body_z"))
"""Sets of three sensors: as in the pump file, and the third one elsewhere."""
PUMPS = ("own", "rig")
RATIO = 2.0
"""How much faster than by random choice the widths shall fall."""


@dataclass(frozen=True)
class Choice:
    """A recording that can be taken."""

    speed: float
    pressure: float
    duration: float
    channels: tuple[str, ...] = DRAWN

    @property
    def name(self) -> str:
        """What to record, in words."""
        return (
            f"{self.speed * 30 / math.pi:.0f} rpm, {self.pressure / 1e6:g} MPa, {self.duration:g} s, "
            f"{' '.join(self.channels)}"
        )


FIRST = Choice(rpm(860), MPa(10), 4.0)
"""What every pump starts from."""


def choices_of(pumps: str) -> tuple[Choice, ...]:
    """Every candidate recording of a kind of pumps."""
    return tuple(Choice(*each) for each in product(SPEEDS, PRESSURES, DURATIONS, SETS if pumps == "own" else [DRAWN]))


def run_next_recording(
    *,
    seeds: Sequence[int] = (100, 101, 102, 103, 104, 105),
    pumps: Sequence[str] = PUMPS,
    added: int = 3,
    draws: int = 2,
    jobs: int = 1,
    out: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Total interval width by number of recordings, planned and drawn, a trial for each pump.

    Parameters
    ----------
    seeds : a pump of each kind for each.
    pumps : kinds of pumps, of `PUMPS`.
    added : recordings that are added to the first.
    draws : random sequences for each pump, whose mean counts.
    jobs : processes that work side by side.
    out : folder that keeps finished sequences; a study that was interrupted goes on there.
    progress : called with sequences done and in all.
    command : command line that repeats the study, kept with the result.

    Raises
    ------
    InputError
        Unknown pumps, or nothing to add or to draw.
    """
    started, ways = time.perf_counter(), ("plan", *(f"random {number}" for number in range(1, draws + 1)))
    if set(pumps) - set(PUMPS) or not pumps or added < 1 or draws < 1:
        raise InputError(f"pumps ({', '.join(pumps)}) must be of {', '.join(PUMPS)}; add and draw at least 1.")
    work = [(kind, seed, way) for seed in seeds for kind in pumps for way in ways]
    values = []
    for result in parallel(jobs, return_as="generator")(delayed(_finished)(*each, added, out) for each in work):
        values.append(result)
        if progress is not None:
            progress(len(values), len(work))
    sequences = dict(zip(work, values, strict=True))
    trials = [
        Trial({"pumps": kind, "choice": way, "recordings": str(count + 1)}, seed, row)
        for kind, way in product(pumps, ("plan", "random"))
        for count in range(added + 1)
        for seed in seeds
        for row in [_mean([values for key, values in sequences.items() if _is_of(key, kind, seed, way)], count)]
    ]
    table = StudyTable(
        study=STUDY,
        title="Do intervals narrow faster if the next recording is planned?",
        metrics=METRICS,
        trials=tuple(trials),
        answer=(),
        settings={"added": added, "draws": draws, "candidates": {kind: len(choices_of(kind)) for kind in pumps}},
        origin="Own: simulations of the twin with noise 30 dB below, in which everything is right. Rig: the virtual "
        "rig, a stand-in for a machine, which shares the model's equations with the twin.",
        wall_s=time.perf_counter() - started,
        version=VERSION,
        command=command,
        notes=_NOTES,
        details={"sequences": [{"pumps": k, "seed": s, "choice": w, **row} for (k, s, w), row in sequences.items()]},
    )
    return replace(table, answer=tuple(text for kind in pumps for text in _answer(table, kind, added)))


_NOTES = (
    "Total ln width: sum over the six values of ln(greatest / least) of the 90 % interval. The fall of random choice "
    "is the mean over its draws.",
    "Candidates: 600, 860, 1200 and 1500 rev/min at 5, 10 and 15 MPa, of 2 or 4 s; own pumps with each of three sets "
    "of three sensors. A draw takes no candidate twice.",
)


def _is_of(key: tuple[str, int, str], kind: str, seed: int, way: str) -> bool:
    return key[:2] == (kind, seed) and key[2].startswith(way)


def _mean(sequences: Sequence[dict[str, Any]], count: int) -> dict[str, float]:
    """Means over sequences after `count` added recordings."""
    width = float(np.mean([row["widths"][count] for row in sequences]))
    fall = float(np.mean([row["widths"][0] - row["widths"][count] for row in sequences]))
    return {"width": width, "fall": fall, "covered": float(np.mean([row["covered"][count] for row in sequences]))}


def _finished(kind: str, seed: int, way: str, added: int, out: Path | None) -> dict[str, Any]:
    torch.set_num_threads(1)
    settings = {"added": added, "version": VERSION}
    task = Task(STUDY, "sequences", seed, {"pumps": kind, "choice": way}, settings, f"virtual rig {RIG_VERSION}")
    return finished_values(out, task, lambda: _sequence(kind, seed, way, added))


def _sequence(kind: str, seed: int, way: str, added: int) -> dict[str, Any]:
    """Widths after each recording, how many of the six intervals hold the truth, and what was recorded."""
    machine = _OwnPump(seed) if kind == "own" else _RigPump(seed)
    candidates = choices_of(kind)
    order = stream(seed, STUDY, kind, way).permutation(len(candidates))
    chosen, recordings, truths = [FIRST], [], []
    widths, covered = [], []
    for count in range(added + 1):
        recording, truth = machine.record(chosen[-1], chosen.count(chosen[-1]))
        recordings.append(recording)
        truths.append(np.log(truth))
        calibration = calibrate(machine.pump, recordings, method=GaussNewton(starts=1), explain_misfit=False, seed=seed)
        widths.append(total_width(calibration.estimates))
        covered.append(_covered(calibration, np.exp(np.mean(truths, axis=0))))
        if count < added:
            chosen.append(_planned(calibration, kind) if way == "plan" else candidates[order[count]])
    return {"widths": widths, "covered": covered, "recorded": [choice.name for choice in chosen]}


def _covered(calibration: Calibration, truth: np.ndarray) -> int:
    pairs = zip(calibration.estimates, truth, strict=True)
    return sum(bool(each.interval[0] <= value <= each.interval[1]) for each, value in pairs)


def _planned(calibration: Calibration, kind: str) -> Choice:
    plan = plan_recording(
        calibration,
        speeds=SPEEDS,
        pressures=PRESSURES,
        durations=DURATIONS,
        sensors=SETS if kind == "own" else [DRAWN],
    )
    best = plan.candidates[0]
    return Choice(best.speed, best.discharge_pressure, best.duration, best.channels)


class _OwnPump:
    """A twin's own recordings, with noise, of true values about the nominal ones."""

    def __init__(self, seed: int) -> None:
        rng = stream(seed, STUDY, "own")
        twin = study_twin()
        self.seed, self.pump = seed, _with_more_sensors(twin.pump)
        self.truth = twin.values.numpy() * np.exp(SPREAD * rng.standard_normal(6))
        self._twin = replace(twin, pump=self.pump).with_interfaces(Interfaces.from_values(self.truth))

    def record(self, choice: Choice, number: int) -> tuple[Recording, np.ndarray]:
        """Recording of a choice, the `number`-th of its kind, and the true values."""
        name = f"{choice.name}, {number}"
        rng = stream(self.seed, STUDY, name)
        condition = OperatingCondition(speed=choice.speed, discharge_pressure=choice.pressure)
        recording = self._twin.at(condition).simulate(
            choice.duration, 6400.0, phase=rng.uniform(0, 2 * math.pi), recording_id=name
        )
        picked = recording.picked(list(choice.channels))
        return picked.replace(signal=add_noise(picked.signal, 30.0, int(rng.integers(2**31)))), self.truth


def _with_more_sensors(pump: Pump) -> Pump:
    """With the two further sensors of `SETS`, where others sit."""
    position_of = {sensor.name: sensor.position for sensor in pump.sensors}
    more = (
        Sensor("cover_y", position_of["cover_z"], (0.0, 1.0, 0.0)),
        Sensor("body_z", position_of["body_x"], (0.0, 0.0, 1.0)),
    )
    return replace(pump, sensors=(*pump.sensors, *more))


class _RigPump:
    """The first healthy pump of a fleet of the virtual rig, assembled once, at the oil temperature of one day."""

    def __init__(self, seed: int) -> None:
        self.seed, self.pump = seed, load_pump("25scy14-1b")
        self._first = self._run(FIRST, "assembly", draw_specimen(self.pump, "A", seed))

    def record(self, choice: Choice, number: int) -> tuple[Recording, np.ndarray]:
        """As of `_OwnPump`; the true values move with the pressure."""
        name = f"{choice.name}, {number}"
        drawn = self._run(choice, name, self._first.specimen)
        condition = drawn.condition.replaced(oil_temperature=self._first.condition.oil_temperature)
        run = replace(self._first, condition=condition)
        (signal,) = measure([run], choice.duration, SAMPLE_RATE, [(self.seed, name)])
        recording = recording_of(name, "normal", choice.pressure, run, signal, speed=choice.speed)
        return recording.picked(list(choice.channels)), true_values(run)

    def _run(self, choice: Choice, name: str, specimen: Specimen) -> Run:
        return run_of(name, specimen, choice.pressure, self.seed, None, choice.speed)


def _answer(table: StudyTable, kind: str, added: int) -> list[str]:
    """Twice as fast, in its two meanings: twice the fall after as many recordings, or the fall of twice as many."""
    planned, drawn = (
        [
            np.array(table.values("fall", pumps=kind, choice=way, recordings=str(count + 1)))
            for count in range(added + 1)
        ]
        for way in ("plan", "random")
    )
    sentences = []
    for count in range(1, added + 1):
        plan, chance = planned[count], drawn[count]
        ratio = f" ({plan.mean() / chance.mean():.2f} times as much)" if min(plan.mean(), chance.mean()) > 0 else ""
        sentences.append(
            f"{kind}, {count} added: the width falls by {plan.mean():.2f} as planned and by {chance.mean():.2f} at "
            f"random{ratio}. Plan less random: {_range(plan - chance)}; less {RATIO:g} times random: "
            f"{_range(plan - RATIO * chance)} (95 %, {len(plan)} pumps)."
        )
    for count in range(1, int(added / RATIO) + 1):
        more = round(RATIO * count)
        sentences.append(
            f"{kind}: {count} planned less {more} drawn recordings: the width falls by "
            f"{np.mean(planned[count] - drawn[more]):.2f} more, {_range(planned[count] - drawn[more])}."
        )
    return sentences


def _range(differences: np.ndarray) -> str:
    low, high = paired_interval(differences.tolist())
    return f"{low:.2f} to {high:.2f}"
