"""Two odd recordings among twenty healthy ones: false alarms and faults caught, with and without the rule.

    python benchmarks/odd_healthy.py 100 101 102 103

Each fleet of rig versions 1 and 2 has three pumps, with 54 healthy recordings and 48 of faults each. Of the first 42
healthy ones 20 train and 22 test; odd ones are made of the others.
"""

import sys

import numpy as np
from scipy.signal import butter, sosfilt

from swashtwin.learning import MOST_ODD, level_layout, usual_recordings
from swashtwin.learning.healthy.healthy_levels import nonconformity_scores
from swashtwin_bench.rigs.writing import RigSize, rig_recordings

FAULTS = ("swash_plate", "cylinder_block", "piston", "valve_plate")


def burst(x, rate, rng):
    """Three to eight knocks of 10 to 60 ms, 8 to 25 times the rms at their peak, on all channels."""
    x = x.copy()
    for _ in range(rng.integers(3, 9)):
        time = np.arange(int(rate * 0.3)) / rate
        start = rng.integers(0, x.shape[1] - len(time))
        shape = np.exp(-time / rng.uniform(0.01, 0.06)) * np.sin(2 * np.pi * rng.uniform(400, 5000) * time)
        peak = rng.uniform(8, 25) * x.std(axis=1, keepdims=True) * rng.uniform(0.5, 1, (len(x), 1))
        x[:, start : start + len(time)] += peak * shape
    return x


def sensor(x, rate, rng):
    """One channel with another gain (3 to 9 dB), hum, a loose mounting (low pass at 0.8 to 2 kHz) or noise."""
    x = x.copy()
    channel, kind = rng.integers(len(x)), rng.integers(4)
    scale = x[channel].std()
    if kind == 0:
        x[channel] *= 10 ** (rng.choice([-1, 1]) * rng.uniform(3, 9) / 20)
    if kind == 1:
        angle = 2 * np.pi * 50 * np.arange(x.shape[1]) / rate
        x[channel] += scale * rng.uniform(0.5, 2) * np.sign(np.sin(angle + rng.uniform(0, 6)))
    if kind == 2:
        x[channel] = sosfilt(butter(2, rng.uniform(800, 2000), fs=rate, output="sos"), x[channel])
    if kind == 3:
        x[channel] += scale * rng.uniform(0.3, 1.5) * rng.standard_normal(x.shape[1])
    return x


def levels_of(version, seed):
    """Levels of a fleet, with pump, label, point, repeat and kind of oddness of each row."""
    rows, layout = [], None
    for labels, size in ((("normal",), RigSize(3, 18)), (FAULTS, RigSize(3, 4))):
        for recording, _ in rig_recordings(seed, size, labels=labels, version=version):
            layout = layout or level_layout([recording])[0]
            repeat, condition = int(recording.recording_id.rsplit("_", 1)[1]), recording.condition
            point = (condition.speed, condition.discharge_pressure)
            facts = (recording.specimen, recording.label, point, repeat)
            rows.append((*facts, "", layout.measure(recording)))
            if recording.label == "normal" and repeat > 14:
                rng = np.random.default_rng([seed, int(version), repeat, int(point[1] / 1e6), ord(recording.specimen)])
                for make in (burst, sensor):
                    changed = recording.replace(signal=make(recording.signal, recording.sample_rate, rng))
                    rows.append((*facts, make.__name__, layout.measure(changed)))
    points = sorted({row[2] for row in rows})
    named = [(row[0], row[1], points.index(row[2]), row[3], row[4]) for row in rows]
    return *map(np.array, zip(*named, strict=True)), np.stack([row[5] for row in rows])


def alarms(levels, point, train, rows):
    """Whether each row is the furthest of all."""
    hits = []
    for row in rows:
        both = np.append(train, row)
        scores = nonconformity_scores(levels[both], np.unique(point[both], return_inverse=True)[1])
        hits.append(scores[-1] * (1 - 1e-9) > scores[:-1].max())
    return np.array(hits)


def kept(levels, point, rows):
    """The rows that the detector keeps."""
    usual = usual_recordings(levels[rows], np.unique(point[rows], return_inverse=True)[1])
    return rows[usual] if (~usual).sum() <= MOST_ODD * len(rows) else rows


def trials(version, seed):
    """(kind, false alarms and recordings, caught without the odd ones, with them, and by the rule) of each pump."""
    specimen, label, point, repeat, odd, levels = levels_of(version, seed)
    rng = np.random.default_rng([seed, int(version)])
    for pump in np.unique(specimen):
        healthy = (specimen == pump) & (label == "normal") & (odd == "")
        first = rng.permutation(np.flatnonzero(healthy & (repeat <= 14)))
        first = first[
            np.argsort([np.sum(point[first[:i]] == point[row]) for i, row in enumerate(first)], kind="stable")
        ]
        faults = np.flatnonzero((specimen == pump) & (label != "normal"))
        train, test, spare = first[:20], first[20:], np.flatnonzero(healthy & (repeat > 14))
        rule = kept(levels, point, train)
        before, after = alarms(levels, point, train, faults).mean(), alarms(levels, point, rule, faults).mean()
        yield "none", alarms(levels, point, rule, test), before, before, after
        for kind in ("burst", "sensor", "another point", "mixed"):
            moved, chosen = point.copy(), []
            for _ in range(2):
                one = rng.choice(["burst", "sensor", "another point"]) if kind == "mixed" else kind
                made = np.flatnonzero((specimen == pump) & (odd == one))
                row = rng.choice(np.setdiff1d(spare if one == "another point" else made, chosen))
                if one == "another point":
                    moved[row] = rng.choice(np.setdiff1d(point[train[2:]], point[row]))
                chosen.append(row)
            sets = (train[2:], np.append(train[2:], chosen), kept(levels, moved, np.append(train[2:], chosen)))
            yield kind, alarms(levels, moved, sets[2], test), *(alarms(levels, moved, s, faults).mean() for s in sets)


found = {}
for seed in map(int, sys.argv[1:]):
    for version in ("1", "2"):
        for kind, *trial in trials(version, seed):
            found.setdefault(kind, []).append(((version, seed), *trial))
for kind, rows in found.items():
    fleets, false = np.array([hash(row[0]) for row in rows]), np.concatenate([row[1] for row in rows])
    without, with_them, rule = (np.array([row[n] for row in rows]) for n in (2, 3, 4))
    rng, names = np.random.default_rng(0), np.unique(fleets)
    draws = [np.concatenate([np.flatnonzero(fleets == f) for f in rng.choice(names, len(names))]) for _ in range(2000)]
    ratios = [np.quantile([x[d].sum() / without[d].sum() for d in draws], [0.025, 0.975]) for x in (with_them, rule)]
    print(kind, false.sum(), "of", false.size, "; without", without.mean(), "; with", with_them.mean() / without.mean(),
          ratios[0], "; rule", rule.mean() / without.mean(), ratios[1], flush=True)  # fmt: skip
