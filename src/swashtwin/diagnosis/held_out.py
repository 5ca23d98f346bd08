"""Recordings that are held out of a training, and those that must not be."""

from collections.abc import Mapping

import numpy as np

import swashtwin.learning as learning
from swashtwin.foundation import DataError, LeakError
from swashtwin.learning import WindowSet
from swashtwin.recordings import Manifest, repeated_recordings, say_seen, seen_recordings

_ERROR_RATE = 0.1


def hold_out_validation(
    training: WindowSet,
    group: str | Mapping[str, str],
    manifest: Manifest,
    *,
    fraction: float,
    error_rate: float | None,
    seed: int,
) -> tuple[WindowSet, WindowSet | None, float, tuple[str, ...]]:
    """(training windows, validation windows or None, error rate that these allow, notes).

    Parameters
    ----------
    group : what a split keeps whole.
    manifest : recordings that stay in training.
    fraction : share of the recordings that is held out; 0 for none.
    error_rate : that which the validation recordings should allow; 0.1 if None, and then as far as they go.
    """
    asked = _ERROR_RATE if error_rate is None else error_rate
    if not fraction:
        return training, None, asked, ()
    n_left = len(training.recordings.keys() - seen_recordings(manifest, training.recordings).keys())
    plan = learning.plan_validation(n_left, asked, fraction)
    try:
        training, validation = learning.split_by_recording(
            training, test_fraction=plan.fraction, seed=seed, group=group, keep_in_training=manifest
        )
    except DataError as cause:
        raise DataError(
            f"no validation set can be held out with every class on both sides: {cause} Otherwise "
            "a validation or a test fraction of 0 trains without this split."
        ) from cause
    count = np.unique(validation.recording_id).size
    if error_rate is not None:
        learning.require_enough(count, error_rate)
    allowed, notes = learning.allowed_error_rate(count, asked), tuple[str, ...]()
    if allowed != asked or plan.fraction != fraction:
        rate = f"; they allow an error rate of {allowed:g}" if allowed != asked else ""
        notes = (
            f"An error rate of {asked:g} needs {plan.needed} validation recordings, and a share of "
            f"{fraction:g} is about {round(fraction * plan.n_recordings)}; {count} "
            f"of {plan.n_recordings} recordings are held out for it{rate}.",
        )
    return training, learning.without_overlap(validation), allowed, notes


def refuse_seen(held_out: WindowSet, manifest: Manifest) -> None:
    if seen := seen_recordings(manifest, held_out.recordings):
        raise LeakError(
            f"{say_seen(seen)} had a part in the synthetic windows and would be tested on; split first (swashtwin data "
            "split), then calibrate, synthesize and train on the training side with a test fraction of 0.",
            field="test_fraction",
        )


def copy_notes(windows: WindowSet) -> list[str]:
    copies = repeated_recordings(windows.recordings)
    return [
        f"{name} holds the same samples as {first}; keep one of them, or it counts twice."
        for name, first in copies.items()
    ]
