"""The page of a data check says everything that must be mended."""

import numpy as np

from swashtwin.learning import check_recordings
from swashtwin.recordings import Recording
from swashtwin.report.check_part import check_part


def test_a_copy_at_another_gain_stands_among_what_must_be_mended() -> None:
    signal = np.random.default_rng(0).normal(size=(1, 4096))
    recordings = [Recording(signal, 1000.0, "first"), Recording(2 * signal, 1000.0, "again")]
    check = check_recordings(recordings)
    assert not check.is_sound
    text = repr(check_part(check, ""))
    assert "is a copy of first at another gain" in text
    assert "Nothing suspicious" not in text
