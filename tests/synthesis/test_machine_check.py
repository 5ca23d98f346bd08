"""A twin and recordings of different pumps or operating points are refused with both values, or it
cannot be known.
"""

from dataclasses import replace

import numpy as np
import pytest
from twin_recordings import recording_of

from swashtwin.foundation import InputError, MPa, rpm
from swashtwin.learning import cut_windows, require_shared_speed
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
    nine = Twin(scaled_pump(pump, Nameplate(45e-6, 9, rpm(1500), MPa(28)), "nine"),
                OperatingCondition(rpm(1500), MPa(28)), bandwidth=2600)  # fmt: skip
    return replace(recording_of(nine), synthetic=False)


def without_condition(recording: Recording, **attributes: str) -> Recording:
    return replace(recording, condition=None, attributes={**recording.attributes, **attributes})


def test_the_twins_pump_at_its_operating_point_passes_in_silence(
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


def test_another_speed_or_pressure_is_refused_unless_it_is_named_on_purpose(
    twin: Twin, same_machine: Recording
) -> None:
    faster = twin.condition.replace(speed=rpm(1500))
    with pytest.raises(
        InputError,
        match=r"The twin runs at 1500 rev/min, but the recordings specify 860 rev/min",
    ):
        require_same_machine(twin, [faster], [same_machine])

    assert require_same_machine(twin, [faster], [same_machine], speed=False) == ()

    higher = twin.condition.replace(discharge_pressure=MPa(28))
    with pytest.raises(
        InputError,
        match=r"The twin runs at 28 MPa, but the recordings specify 15 MPa\. Calibrate",
    ):
        require_same_machine(
            twin,
            [higher],
            cut_windows([same_machine], length=1024, allow_partial_revolution=True),
        )

    assert require_same_machine(twin, [twin.condition, higher], [same_machine]) == ()


def test_a_specified_number_of_pistons_is_compared_without_the_lines(
    twin: Twin, same_machine: Recording
) -> None:
    nine = same_machine.replace(
        attributes={"pistons": "9"}, signal=np.zeros_like(same_machine.signal)
    )
    with pytest.raises(
        InputError,
        match=r"rec-0 is of a pump with 9 pistons, the twin \(25scy14-1b\) has 7. Cal",
    ):
        require_same_machine(twin, [twin.condition], [nine])

    seven = nine.replace(attributes={"pistons": "7"})
    assert require_same_machine(twin, [twin.condition], [seven]) == ()


def test_lines_alone_show_another_pump_if_nothing_is_specified(
    twin: Twin, same_machine: Recording, other_machine: Recording
) -> None:
    notes = require_same_machine(twin, [twin.condition], [without_condition(same_machine)])
    assert [note.split(",")[0] for note in notes] == [
        "The recordings specify no speed", "The recordings specify no pressure",
    ]  # fmt: skip
    with pytest.raises(
        InputError,
        match=r"lines at multiples of 22[45].* Hz, and the twin \(25scy14-1b\) with its 7",
    ):
        require_same_machine(twin, [twin.condition], [without_condition(other_machine)])


def test_a_note_states_that_noise_cannot_be_checked(twin: Twin, same_machine: Recording) -> None:
    noise = same_machine.replace(
        signal=np.random.default_rng(0).normal(size=same_machine.signal.shape)
    )
    (note,) = require_same_machine(twin, [twin.condition], [noise])

    assert "do not show the number of pistons" in note
    assert "that of the twin (7) cannot be checked" in note


def test_training_refuses_synthetic_windows_of_another_speed(
    twin: Twin, same_machine: Recording
) -> None:
    measured = cut_windows([same_machine], length=1024, allow_partial_revolution=True)
    synthetic = simulate_windows(
        twin.at(twin.condition.replace(speed=rpm(1500))),
        count=2,
        like=measured,
        seed=0,
        background="none",
    )

    with pytest.raises(
        InputError,
        match=r"synthetic windows run at 1500 rev/min, .* recordings specify 860",
    ):
        require_shared_speed(measured, synthetic)

    require_shared_speed(replace(measured, speed=np.full(len(measured), np.nan)), synthetic)
    require_shared_speed(measured, replace(synthetic, speed=np.full(2, twin.condition.speed)))
