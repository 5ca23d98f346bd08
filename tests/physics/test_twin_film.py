"""Twins whose slippers ride on a film, and twins that go to another condition with their films."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from swashtwin.foundation import InputError, MPa, celsius, mm, rpm, um
from swashtwin.physics import Scales, Twin, carry_over, film_of, film_values, with_film
from swashtwin.pump import Interfaces, OperatingCondition, Pump, SwashPlateDefect

AT_15 = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))


def with_damping(twin: Twin, damping: float) -> Twin:
    return twin.with_interfaces(Interfaces.from_values([damping, *twin.values[1:]]))


@pytest.mark.parametrize(("damping", "film", "stiffness"), [(1.86e6, 7.5, 8.9e6), (7.78e5, 10.1, 1.6e7)])
def test_the_papers_values_of_c_sw_are_films_of_7_5_and_10_um(
    pump: Pump, at_15: OperatingCondition, damping: float, film: float, stiffness: float
) -> None:
    estimate = film_of(with_damping(Twin(pump, at_15), damping))
    assert estimate.thickness == pytest.approx(um(film), rel=5e-3)
    assert estimate.damping == damping
    assert estimate.stiffness == pytest.approx(stiffness, rel=0.02)
    assert estimate.lift_ratio == pytest.approx(1.05, abs=0.01)


@given(film=st.floats(5, 50), temperature=st.floats(20, 80), pressure=st.floats(1, 35))
def test_the_film_of_a_twin_is_the_one_it_was_given(
    pump: Pump, film: float, temperature: float, pressure: float
) -> None:
    condition = AT_15.replaced(discharge_pressure=MPa(pressure), oil_temperature=celsius(temperature))
    twin = with_film(Twin(pump, condition), um(film))
    estimate = film_of(twin)
    assert estimate.thickness == pytest.approx(um(film), rel=1e-9)
    assert (estimate.damping, estimate.stiffness) == pytest.approx(twin.values[:2].tolist(), rel=1e-8)
    assert twin.values[2:].tolist() == list(pump.interfaces.values())[2:]


@pytest.mark.parametrize("film", [5e-6, 50e-6])
def test_the_thinnest_and_the_thickest_film_are_found_again(pump: Pump, at_15: OperatingCondition, film: float) -> None:
    twin = with_film(Twin(pump, at_15), film)
    assert with_film(twin, film_of(twin).thickness).values.tolist() == pytest.approx(twin.values.tolist())


def test_a_twin_with_a_film_keeps_its_fault_scales_and_pressures(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, SwashPlateDefect(mm(0.6), mm(30), mm(24)), scales=Scales(mount=1.2), bandwidth=300)
    drive = twin.drive
    riding = with_film(twin, um(10))
    assert riding.drive is drive
    assert (riding.fault, riding.scales, riding.bandwidth) == (twin.fault, twin.scales, 300)


def test_a_film_floats_where_its_lift_is_the_force_of_a_piston(pump: Pump, at_15: OperatingCondition) -> None:
    ratios = [film_of(with_film(Twin(pump, at_15), um(film))).lift_ratio for film in (7.5, 24.0, 40)]
    assert ratios[0] > 1 > ratios[2]
    assert ratios[1] == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize("damping", [3.6e4, 6.2e6])
def test_a_damping_that_no_film_gives_is_refused_with_those_there_are(
    pump: Pump, at_15: OperatingCondition, damping: float
) -> None:
    range_given = r"of 5...50 um, which damp with 3.65e\+04...6.15e\+06 N s/m at 45 degC; .* with_film"
    with pytest.raises(InputError, match=range_given) as caught:
        film_of(with_damping(Twin(pump, at_15), damping))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("thickness", [10.0, um(4.9), um(51), 0.0, -um(10), math.nan])
def test_a_thickness_outside_the_range_is_refused(pump: Pump, at_15: OperatingCondition, thickness: float) -> None:
    with pytest.raises(InputError, match=r"outside 5...50 um, .* in meters: 10 um is um\(10\)"):
        with_film(Twin(pump, at_15), thickness)


def test_a_pump_with_more_pressure_in_its_case_than_at_its_outlet_has_no_film(
    pump: Pump, at_15: OperatingCondition
) -> None:
    flooded = at_15.replaced(case_pressure=MPa(16))
    with pytest.raises(InputError, match=r"discharge_pressure \(1.5e\+07 Pa\) must exceed case_pressure"):
        with_film(Twin(pump, flooded), um(10))
    with pytest.raises(InputError, match="must exceed case_pressure"):
        carry_over(Twin(pump, at_15), flooded)


@given(
    temperature=st.floats(0, 90),
    pressure=st.floats(1, 35),
    factors=st.lists(st.floats(0.1, 10), min_size=6, max_size=6),
)
def test_values_carried_over_and_back_are_what_they_were(
    pump: Pump, temperature: float, pressure: float, factors: list[float]
) -> None:
    interfaces = Interfaces.from_values(np.array(pump.interfaces.values()) * factors)
    away = AT_15.replaced(oil_temperature=celsius(temperature), discharge_pressure=MPa(pressure), speed=rpm(1500))
    there = carry_over(Twin(pump, AT_15, interfaces=interfaces), away, bore_exponent=0.5)
    assert there.condition == away
    back = carry_over(there, AT_15, bore_exponent=0.5)
    assert back.values.tolist() == pytest.approx(list(interfaces.values()), rel=1e-12)


def test_a_film_that_is_carried_over_keeps_its_thickness_and_its_law(pump: Pump, at_15: OperatingCondition) -> None:
    away = at_15.replaced(oil_temperature=celsius(60), discharge_pressure=MPa(5))
    there = carry_over(with_film(Twin(pump, at_15), um(12)), away)
    assert there.values[:2].tolist() == pytest.approx(with_film(Twin(pump, away), um(12)).values[:2].tolist())
    assert film_of(there).thickness == pytest.approx(um(12))


def test_warm_oil_takes_two_thirds_of_the_films_damping_and_no_stiffness(pump: Pump, at_15: OperatingCondition) -> None:
    cold = Twin(pump, at_15.replaced(oil_temperature=celsius(30)))
    warm = carry_over(cold, at_15.replaced(oil_temperature=celsius(60)))
    thinner = math.exp(-0.0366 * 30)
    assert thinner == pytest.approx(1 / 3, rel=1e-3)
    assert (warm.values / cold.values).tolist() == pytest.approx([thinner, 1, thinner, 1, 1, 1])
    filmed = carry_over(cold, warm.condition, bore_exponent=1)
    assert float(filmed.values[4] / cold.values[4]) == pytest.approx(thinner)


def test_a_healthy_cover_shakes_more_with_warm_films_than_the_leakage_alone_would_make_it(
    pump: Pump, at_15: OperatingCondition
) -> None:
    def level(twin: Twin) -> float:
        return float(twin.acceleration()[0].abs().square().sum().div(2).sqrt())

    twin = Twin(pump, at_15)
    conditions = [at_15.replaced(oil_temperature=celsius(warmth)) for warmth in (30, 60)]
    assert [level(carry_over(twin, condition)) for condition in conditions] == pytest.approx([1.18, 1.70], rel=0.01)
    assert [level(twin.at(condition)) for condition in conditions] == pytest.approx([1.42, 1.39], rel=0.01)


def test_pressure_stiffens_the_films_and_leaves_their_damping(pump: Pump, at_15: OperatingCondition) -> None:
    high = Twin(pump, at_15)
    low = carry_over(high, at_15.replaced(discharge_pressure=MPa(5)))
    piston_force = 0.08 * 3.5 * math.pi / 4 * mm(17) ** 2
    load = (piston_force * MPa(4.9) + 350) / (piston_force * MPa(14.9) + 350)
    assert (low.values / high.values).tolist() == pytest.approx([1, 4.9 / 14.9, 1, load, 1, 1])


def test_the_values_of_a_film_are_those_of_the_twin_on_it(pump: Pump, at_15: OperatingCondition) -> None:
    thickness = torch.tensor([[5e-6, 1e-5], [2e-5, 5e-5]], dtype=torch.float64)
    batch = torch.stack(film_values(pump, at_15, thickness), dim=-1)
    for values, film in zip(batch.reshape(-1, 2), thickness.reshape(-1), strict=True):
        torch.testing.assert_close(values, with_film(Twin(pump, at_15), float(film)).values[:2])


def test_a_thickness_has_exact_gradients(pump: Pump, at_15: OperatingCondition) -> None:
    logarithm = torch.log(torch.tensor([6e-6, 1e-5, 3e-5], dtype=torch.float64)).requires_grad_()

    def logarithms(films: torch.Tensor) -> torch.Tensor:
        return torch.stack(film_values(pump, at_15, films.exp())).log()

    assert torch.autograd.gradcheck(logarithms, (logarithm,))


def test_a_spectrum_has_exact_gradients_with_respect_to_a_thickness(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, SwashPlateDefect(mm(0.6), mm(30), mm(24)), bandwidth=450)

    def read(film: torch.Tensor) -> torch.Tensor:
        slipper = torch.stack(film_values(pump, at_15, film.exp()))
        return torch.view_as_real(twin.acceleration(torch.cat([slipper, twin.values[2:]])))

    logarithm = torch.tensor(um(15), dtype=torch.float64).log().requires_grad_()
    assert torch.autograd.gradcheck(read, (logarithm,))


def test_film_values_stay_on_the_device_and_in_the_precision_of_the_thickness(
    pump: Pump, at_15: OperatingCondition
) -> None:
    for value in film_values(pump, at_15, torch.empty(3, device="meta", dtype=torch.float32)):
        assert (value.device.type, value.dtype, value.shape) == ("meta", torch.float32, (3,))
    thickness = torch.linspace(um(5), um(50), 20, dtype=torch.float64)
    exact, single = (torch.stack(film_values(pump, at_15, films)) for films in (thickness, thickness.float()))
    torch.testing.assert_close(single.double(), exact, rtol=1e-5, atol=0.0)


def test_thicker_films_damp_less_and_are_stiffer(pump: Pump, at_15: OperatingCondition) -> None:
    damping, stiffness = film_values(pump, at_15, torch.linspace(um(5), um(49), 100, dtype=torch.float64))
    assert bool((damping.diff() < 0).all())
    assert bool((stiffness.diff() > 0).all())
