"""What shows only when recordings are compared: unequal rates, units and lengths, copies, thin classes."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from swashtwin.recordings.checks.findings import Finding
from swashtwin.recordings.recording import Recording


def unequal(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Rates, units and lengths that differ."""
    rates = _by_value((f"{recording.sample_rate:g} Hz", recording) for recording in recordings)
    if len(rates) > 1:
        listed = "; ".join(f"{rate}: {_labels(group)}" for rate, group in rates.items())
        between = any(_labels(a) != _labels(b) for a, b in pairwise(rates.values()))
        advice = 'a network would learn the rate; give resample = "..." in the index.'
        yield Finding("rate", "error" if between else "warning", None, f"sample rates differ ({listed}): {advice}")
    units = _by_value((recording.unit, recording) for recording in recordings)
    if len(units) > 1:
        listed = "; ".join(f"{unit}: {_labels(group)}" for unit, group in units.items())
        yield Finding("unit", "error", None, f"units differ ({listed}).")
    lengths = [recording.duration for recording in recordings]
    if lengths and max(lengths) > 3 * min(lengths):
        message = (
            f"lengths differ from {min(lengths):.4g} s to {max(lengths):.4g} s; long ones will outweigh the others."
        )
        yield Finding("length", "warning", None, message)


def duplicates(recordings: Sequence[Recording]) -> Iterator[Finding]:
    rows = (
        (hashlib.sha256(np.ascontiguousarray(row).tobytes()).hexdigest(), recording)
        for recording in recordings
        for row in recording.signal
        if np.ptp(row) > 0
    )
    reported = set()
    for group in _by_value(rows).values():
        ids = tuple(recording.recording_id for recording in group)
        if len(ids) > 1 and ids not in reported:
            reported.add(ids)
            message = (
                f"{', '.join(ids)} hold the same samples ({_labels(group)}); keep one, or a test will know its answer."
            )
            yield Finding("duplicate", "error", None, message)


def thin_classes(recordings: Sequence[Recording]) -> Iterator[Finding]:
    for label, group in _by_value((recording.label or "", recording) for recording in recordings).items():
        if not label:
            yield Finding("unlabeled", "note", None, f"{len(group)} recordings have no class.")
            continue
        specimens = {recording.specimen for recording in group if recording.specimen}
        if len(group) == 1:
            message = f"{label} has one recording only: it cannot stand in training and in a test."
            yield Finding("one_recording", "warning", None, message)
        elif len(specimens) == 1:
            message = (
                f"{label} was measured on one specimen only ({specimens.pop()}): no test can show transfer to another."
            )
            yield Finding("one_specimen", "note", None, message)


def _by_value(pairs: Iterable[tuple[str, Recording]]) -> dict[str, list[Recording]]:
    groups: dict[str, list[Recording]] = {}
    for value, recording in pairs:
        groups.setdefault(value, []).append(recording)
    return groups


def _labels(recordings: Iterable[Recording]) -> str:
    return ", ".join(sorted({recording.label or "no class" for recording in recordings}))
