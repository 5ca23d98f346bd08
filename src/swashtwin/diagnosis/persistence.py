"""When the alarms of recordings that follow each other stand: what lasts and is large, not what happens once."""

from collections.abc import Sequence

import numpy as np

from swashtwin.diagnosis.anomaly_detector import AnomalyVerdict

RISE = 6.0
"""Rise of a level [dB] that counts: twice the amplitude."""
SPREADS = 5.0
"""The same in standard deviations, as in `signals.trend_of`."""


def persistent_alarms(
    verdicts: Sequence[AnomalyVerdict], *, rise: float = RISE, spreads: float = SPREADS
) -> tuple[bool, ...]:
    """Whether the alarm stands at each recording of a sequence: it does where the one before was an alarm as well, and
    at least one and the same level has risen far in both.

    A single blow against the housing has no second recording, and levels that fall, as when a machine runs in, are no
    damage. A false-alarm rate of 0.05 by recording means dozens of alarms in a thousand recordings; the rise is what
    keeps a sequence quiet. Recordings without a verdict are passed over.

    Parameters
    ----------
    verdicts : of one detector, in order of time.
    rise : least rise of the level [dB].
    spreads : least rise over the standard deviation of differences between healthy recordings.
    """
    standing = []
    before = None
    for verdict in verdicts:
        if verdict.deviation is None:
            standing.append(False)
            continue
        risen = (verdict.deviation.change >= rise) & (verdict.deviation.spreads >= spreads) & bool(verdict.alarm)
        standing.append(before is not None and bool(np.any(risen & before)))
        before = risen
    return tuple(standing)
