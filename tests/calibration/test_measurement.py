"""The lines that a calibration measures, and the recordings that it uses, excludes or refuses."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from swashtwin.calibration import measure
from swashtwin.foundation import DataError, InputError, MPa
from swashtwin.physics import Twin
from swashtwin.recordings import Recording

RATE = 6400.0


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    return twin.simulate(1.2, RATE, recording_id="rec-1")


def test_the_measured_lines_of_a_clean_recording_are_the_twins(
    twin: Twin, recording: Recording
) -> None:
    measurement = measure(twin, [recording])
    # 24 multiples of the piston frequency lie within the band
    assert measurement.orders.tolist() == list(range(7, 175, 7))

    lines = twin.acceleration().abs().numpy()[:, np.isin(twin.orders, measurement.orders)]
    np.testing.assert_allclose(measurement.amplitude, lines, rtol=5e-3, atol=2e-3 * lines.max())


def test_the_deviation_of_two_recordings_covers_the_difference_between_them(
    twin: Twin, recording: Recording
) -> None:
    louder = replace(recording, signal=1.2 * recording.signal, recording_id="rec-2")
    pair = measure(twin, [recording, louder])
    single = measure(twin, [recording])

    np.testing.assert_allclose(pair.amplitude, 1.1 * single.amplitude)
    # each lies 10 % from the mean, less a rounding error
    assert np.all(pair.deviation >= 0.0999 * single.amplitude)


def test_only_recordings_of_the_twins_label_speed_and_pressure_are_used(
    twin: Twin, recording: Recording
) -> None:
    condition = twin.condition

    def variant(name: str, **changes: Any) -> Recording:
        return replace(recording, recording_id=name, **changes)

    unlike = [
        variant("10 MPa", condition=condition.replace(discharge_pressure=MPa(10))),
        variant("fast", condition=condition.replace(speed=1.02 * condition.speed)),
        variant("normal", label="normal"),
        variant("unknown", condition=None),
    ]
    similar = variant("similar", condition=condition.replace(discharge_pressure=MPa(15.8)))

    measurement = measure(twin, [*unlike, similar, recording])

    assert measurement.recording_ids == ("similar", "rec-1")
    excluded_ids = [name for name, _ in measurement.excluded_recordings]
    assert excluded_ids == ["10 MPa", "fast", "normal", "unknown"]


def test_one_channel_is_enough(twin: Twin, recording: Recording) -> None:
    single = recording.select_channels(["body_y"])
    assert measure(twin, [single]).amplitude.shape[0] == 1


def test_recordings_of_different_channels_are_refused(twin: Twin, recording: Recording) -> None:
    single = recording.select_channels(["body_y"])
    with pytest.raises(DataError, match="Select the same"):
        measure(twin, [recording, replace(single, recording_id="rec-2")])


@pytest.mark.parametrize(
    ("band", "lines", "message"),
    [
        ((0.0, 5000.0), "piston", r"end it at 3136 Hz"),
        ((500.0, 200.0), "piston", "the lower first"),
        ((0.0, 50.0), "piston", r"no multiple of the piston-pass frequency \(100.3 Hz\)"),
        (
            (0.0, 2500.0),
            "shaft",
            "a twin of swash_plate has lines at multiples of 7 only. Use the piston-pass lines",
        ),
    ],
    ids=["beyond the samples", "upper limit first", "below the first line", "lines of a recess"],
)
def test_a_band_without_lines_is_refused(
    twin: Twin,
    recording: Recording,
    band: tuple[float, float],
    lines: Literal["piston", "shaft"],
    message: str,
) -> None:
    with pytest.raises(InputError, match=message):
        measure(twin, [recording], band, lines)
