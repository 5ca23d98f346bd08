"""A twin and recordings of different pumps or operating points are refused with both values."""

from dataclasses import replace

import numpy as np
import pytest
from twin_recordings import recording_of

from swashtwin.foundation import InputError, MPa, rpm
from swashtwin.learning import WindowSet, cut_windows, require_shared_speed
from swashtwin.physics import Twin
from swashtwin.pump import Nameplate, OperatingCondition, Pump, scaled_pump
from swashtwin.recordings import Recording
from swashtwin.synthesis import require_same_machine, simulate_windows, synthesize


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15, bandwidth=2600)


@pytest.fixture(scope="module")
def same_machine(twin: Twin) -> Recording:
    """Recording of the twin's pump at its operating point."""
    return replace(recording_of(twin), synthetic=False)


@pytest.fixture(scope="module")
def other_machine(pump: Pump) -> Recording:
    """Recording of a pump with nine pistons at 1500 rev/min and 28 MPa."""
    nine_pistons = scaled_pump(pump, Nameplate(45e-6, 9, rpm(1500), MPa(28)), "nine")
    twin = Twin(nine_pistons, OperatingCondition(rpm(1500), MPa(28)), bandwidth=2600)
    return replace(recording_of(twin), synthetic=False)


def without_condition(recording: Recording, **attributes: str) -> Recording:
    return replace(recording, condition=None, attributes={**recording.attributes, **attributes})


def test_the_twins_pump_at_its_operating_point_passes_without_a_note(
    twin: Twin, same_machine: Recording
) -> None:
    assert require_same_machine(twin, [twin.condition], [same_machine]) == ()


def test_a_pump_with_other_pistons_and_speed_is_refused_with_both_values(
    twin: Twin, other_machine: Recording
) -> None:
    message = (
        r"lines at multiples of 22[45].* Hz, those of 9 pistons at 1500 rev/min, "
        r"and the twin .* its 7 at multiples of"
    )
    with pytest.raises(InputError, match=message):
        synthesize(twin, None, count=1, like=[other_machine], window=1024)


def test_another_speed_is_refused(twin: Twin, same_machine: Recording) -> None:
    faster = twin.condition.replace(speed=rpm(1500))
    message = "The twin runs at 1500 rev/min, but the recordings specify 860 rev/min"
    with pytest.raises(InputError, match=message):
        require_same_machine(twin, [faster], [same_machine])

    # unless the caller named it on purpose
    assert require_same_machine(twin, [faster], [same_machine], speed=False) == ()


def test_another_pressure_is_refused(twin: Twin, same_machine: Recording) -> None:
    higher = twin.condition.replace(discharge_pressure=MPa(28))
    windows = cut_windows([same_machine], length=1024, allow_partial_revolution=True)
    message = r"The twin runs at 28 MPa, but the recordings specify 15 MPa\. Calibrate"
    with pytest.raises(InputError, match=message):
        require_same_machine(twin, [higher], windows)


def test_a_further_pressure_passes(twin: Twin, same_machine: Recording) -> None:
    higher = twin.condition.replace(discharge_pressure=MPa(28))
    assert require_same_machine(twin, [twin.condition, higher], [same_machine]) == ()


def test_a_specified_number_of_pistons_is_compared_without_the_lines(
    twin: Twin, same_machine: Recording
) -> None:
    def silent_recording(pistons: str) -> Recording:
        silence = np.zeros_like(same_machine.signal)
        return same_machine.replace(attributes={"pistons": pistons}, signal=silence)

    message = r"rec-0 is of a pump with 9 pistons, the twin \(25scy14-1b\) has 7. Cal"
    with pytest.raises(InputError, match=message):
        require_same_machine(twin, [twin.condition], [silent_recording("9")])

    assert require_same_machine(twin, [twin.condition], [silent_recording("7")]) == ()


def test_without_an_operating_point_the_same_pump_passes_with_notes(
    twin: Twin, same_machine: Recording
) -> None:
    notes = require_same_machine(twin, [twin.condition], [without_condition(same_machine)])
    assert [note.split(",")[0] for note in notes] == [
        "The recordings specify no speed",
        "The recordings specify no pressure",
    ]


def test_without_an_operating_point_the_lines_reveal_another_pump(
    twin: Twin, other_machine: Recording
) -> None:
    message = r"lines at multiples of 22[45].* Hz, and the twin \(25scy14-1b\) with its 7"
    with pytest.raises(InputError, match=message):
        require_same_machine(twin, [twin.condition], [without_condition(other_machine)])


def test_a_note_states_that_noise_cannot_be_checked(twin: Twin, same_machine: Recording) -> None:
    noise = np.random.default_rng(0).normal(size=same_machine.signal.shape)
    (note,) = require_same_machine(twin, [twin.condition], [same_machine.replace(signal=noise)])

    assert "do not show the number of pistons" in note
    assert "that of the twin (7) cannot be checked" in note


@pytest.fixture(scope="module")
def measured(same_machine: Recording) -> WindowSet:
    return cut_windows([same_machine], length=1024, allow_partial_revolution=True)


@pytest.fixture(scope="module")
def faster_windows(twin: Twin, measured: WindowSet) -> WindowSet:
    """Synthetic windows at 1500 rev/min."""
    faster = twin.at(twin.condition.replace(speed=rpm(1500)))
    return simulate_windows(faster, count=2, like=measured, seed=0, background="none")


def test_training_refuses_synthetic_windows_of_another_speed(
    measured: WindowSet, faster_windows: WindowSet
) -> None:
    message = "synthetic windows run at 1500 rev/min, .* recordings specify 860"
    with pytest.raises(InputError, match=message):
        require_shared_speed(measured, faster_windows)


def test_training_accepts_synthetic_windows_if_speeds_agree_or_are_unknown(
    twin: Twin, measured: WindowSet, faster_windows: WindowSet
) -> None:
    unknown_speed = replace(measured, speed=np.full(len(measured), np.nan))
    require_shared_speed(unknown_speed, faster_windows)

    same_speed = replace(faster_windows, speed=np.full(2, twin.condition.speed))
    require_shared_speed(measured, same_speed)
