"""What a calibration takes from recordings, and what it refuses."""

from dataclasses import replace
from typing import Literal

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
    lines = twin.acceleration().abs().numpy()[:, np.isin(twin.orders, measurement.orders)]
    assert measurement.orders.tolist() == list(range(7, 175, 7))
    np.testing.assert_allclose(measurement.amplitude, lines, rtol=5e-3, atol=2e-3 * lines.max())


def test_the_deviation_of_two_recordings_holds_the_difference_between_them(
    twin: Twin, recording: Recording
) -> None:
    louder = replace(recording, signal=1.2 * recording.signal, recording_id="rec-2")
    both = measure(twin, [recording, louder])
    single = measure(twin, [recording])
    np.testing.assert_allclose(both.amplitude, 1.1 * single.amplitude)
    assert np.all(both.deviation >= 0.0999 * single.amplitude)


def test_only_recordings_of_the_twins_label_speed_and_pressure_are_used(
    twin: Twin, recording: Recording
) -> None:
    at_15 = twin.condition
    others = [
        replace(
            recording, recording_id="10 MPa", condition=at_15.replace(discharge_pressure=MPa(10))
        ),
        replace(recording, recording_id="fast", condition=at_15.replace(speed=1.02 * at_15.speed)),
        replace(recording, recording_id="normal", label="normal"),
        replace(recording, recording_id="unknown", condition=None),
    ]
    near = replace(
        recording, recording_id="near", condition=at_15.replace(discharge_pressure=MPa(15.8))
    )
    measurement = measure(twin, [*others, near, recording])
    assert measurement.recording_ids == ("near", "rec-1")
    assert [name for name, _ in measurement.excluded_recordings] == [
        "10 MPa",
        "fast",
        "normal",
        "unknown",
    ]


def test_one_channel_is_enough_but_must_be_the_same_in_all(
    twin: Twin, recording: Recording
) -> None:
    single = recording.select_channels(["body_y"])
    assert measure(twin, [single]).amplitude.shape[0] == 1
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
