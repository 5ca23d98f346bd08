"""More channels of the rig: 13 accelerometers, and what a test stand records beside vibration."""

import numpy as np
import pytest

from swashtwin.foundation import InputError
from swashtwin.pump import SwashPlateDefect, load_pump
from swashtwin_bench import rig_recordings
from swashtwin_bench.rigs.writing import DEEP_VERSION, RigSize

TINY = RigSize(specimens=1, repeats=1, duration=1.2)


def test_thirteen_accelerometers_sit_where_the_pump_file_says() -> None:
    pairs = list(rig_recordings(3, TINY, labels=("normal",), sensors=13))
    usual = list(rig_recordings(3, TINY, labels=("normal",)))
    pump = load_pump("25scy14-1b-13")
    for (recording, run), (_, usual_run) in zip(pairs, usual, strict=True):
        assert recording.channels == pump.channels
        assert recording.n_channels == 13
        assert (run.condition, run.specimen.mount) == (usual_run.condition, usual_run.specimen.mount)
        levels = recording.signal.std(axis=1)
        assert (levels > 0.05).all()
        assert np.unique(levels.round(3)).size == 13
    talk = pairs[0][1].specimen.housing.gain - np.diag(np.diag(pairs[0][1].specimen.housing.gain))
    few = usual[0][1].specimen.housing.gain - np.diag(np.diag(usual[0][1].specimen.housing.gain))
    assert np.sqrt((talk**2).sum(axis=1).mean()) < 2 * np.sqrt((few**2).sum(axis=1).mean())


@pytest.mark.parametrize(("version", "sensors"), [("2", 13), ("1", 5)])
def test_a_number_of_sensors_that_a_version_has_not_is_refused(version: str, sensors: int) -> None:
    with pytest.raises(InputError, match=rf"{sensors} sensors cannot be recorded by version {version} of the rig"):
        next(iter(rig_recordings(0, TINY, version=version, sensors=sensors)))


def test_the_papers_recess_is_the_only_difference_of_the_deep_version() -> None:
    labels = ("normal", "swash_plate")
    deep = {r.recording_id: (r, run) for r, run in rig_recordings(3, TINY, labels=labels, version=DEEP_VERSION)}
    for usual, run in rig_recordings(3, TINY, labels=labels):
        recording, deep_run = deep[usual.recording_id]
        if usual.label == "normal":
            np.testing.assert_array_equal(recording.signal, usual.signal)
            continue
        fault = deep_run.fault
        assert isinstance(fault, SwashPlateDefect)
        assert isinstance(run.fault, SwashPlateDefect)
        assert (fault.depth, fault.length, fault.width) == pytest.approx((0.6e-3, 30e-3, 24e-3))
        assert (fault.angle, fault.contact) == (run.fault.angle, "shared")
        assert recording.signal.std() > 1.5 * usual.signal.std()
