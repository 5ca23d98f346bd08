"""The tables of docs/explanation/physics.md, section 6b: where slippers would have to pull, a loose slipper, and what
oil does.

python benchmarks/contacts.py
"""

from dataclasses import replace

import numpy as np
import torch

from swashtwin.foundation import MPa, celsius, deg, mm, rpm, um
from swashtwin.physics import SlipperContact, Twin, carry_over, film_of, with_film
from swashtwin.physics.contacts.loose_slipper import loose_motion
from swashtwin.physics.contacts.riding import ride
from swashtwin.physics.excitation import impacts
from swashtwin.pump import Fault, LooseSlipper, OperatingCondition, SwashPlateDefect, load_pump

PUMP = load_pump("25scy14-1b")
AT_15 = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
CASES: dict[str, Fault | None] = {
    "healthy": None,
    "0.07 mm, shared": SwashPlateDefect(depth=mm(0.07), length=mm(30), width=mm(24)),
    "0.6 mm, shared": SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24)),
    "0.6 mm, literal": SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24), contact="literal"),
}


def level(twin: Twin) -> float:
    """Root mean square of the cover's axial acceleration [m/s^2]."""
    return float(np.sqrt((twin.acceleration().abs().numpy()[0] ** 2).sum() / 2))


def change(twin: Twin, other: Twin) -> float:
    """Change of the amplitudes of all sensors, over those of `twin`."""
    first, second = (model.acceleration().abs().numpy() for model in (twin, other))
    return float(np.linalg.norm(second - first) / np.linalg.norm(first))


def contact_table() -> None:
    """Contact forces of the linear twin, and levels with slippers that lift off."""
    print(f"{'linear twin, T1':18}{'lowest kN':>10}{'pulling':>9}{'hold-down kN':>14}{'rms':>8}{'one-sided':>11}")
    for name, fault in CASES.items():
        twin = Twin(PUMP, AT_15, fault)
        check, lifting = twin.contact_check(), replace(twin, contact=SlipperContact(one_sided=True))
        print(
            f"{name:18}{check.lowest / 1e3:10.2f}{check.pulling:9.0%}{check.hold_down / 1e3:14.2f}"
            f"{level(twin):8.3f}{level(lifting):11.3f}"
        )


def law_table() -> None:
    """A recess of 0.07 mm by the law of its contact: what films would have to do, and the line at 28 f_s."""
    recess = SwashPlateDefect(depth=mm(0.07), length=mm(30), width=mm(24))
    lifting = SlipperContact(one_sided=True)
    for pressure in (5, 10, 15):
        twin = Twin(PUMP, AT_15.replaced(discharge_pressure=MPa(pressure)))
        laws = {
            "healthy": twin,
            "shared": twin.with_fault(recess),
            "shared, --one-sided": replace(twin, fault=recess, contact=lifting),
            "physical": twin.with_fault(replace(recess, contact="physical")),
            "lift_off": twin.with_fault(replace(recess, contact="lift_off")),
        }
        for name, member in laws.items():
            check, line = member.contact_check(), np.flatnonzero(member.orders == 28)[0]
            lines = member.acceleration().abs().numpy()[0]
            print(
                f"{pressure:2} MPa {name:20} lowest {check.lowest / 1e3:6.2f} kN, pulling {check.pulling:4.0%}, "
                f"28 f_s {lines[line]:.3f}, rms {level(member):.3f} m/s^2"
            )
    for depth, degrees in ((0.07, 270), (0.07, 90), (0.6, 270), (0.6, 90)):
        rode = ride(PUMP, AT_15, replace(recess, depth=mm(depth), angle=deg(degrees)))
        print(
            f"{depth} mm at {degrees} deg: in flight {rode.in_flight:.2%} of a turn, "
            f"highest contact force {rode.force.max() / 1e3:.2f} kN"
        )


def loose_table() -> None:
    """Impacts of a loose slipper, marched and in closed form, and their share off the piston-pass lines."""
    for clearance in (0.05, 0.2, 0.5):
        fault = LooseSlipper(mm(clearance))
        marched = [f"{np.degrees(i.angle):.1f} deg {i.speed:.3f} m/s" for i in loose_motion(PUMP, AT_15, fault).impacts]
        closed = [f"{i.speed:.3f} m/s" for i in impacts(PUMP, AT_15, fault)]
        print(f"loose slipper, {clearance} mm: {', '.join(marched)}; closed form {', '.join(closed)}")
    for motion in ("simulated", "pulses"):
        twin = Twin(PUMP, AT_15, LooseSlipper(mm(0.2), motion=motion))  # type: ignore[arg-type]
        power = twin.acceleration().abs().numpy()[0] ** 2
        aside = power[twin.orders % 7 != 0].sum() / power.sum()
        print(f"  0.2 mm, {motion}: rms {level(twin):.3f}, off n f_s {aside:.2%}")


def film_table() -> None:
    """What temperature and pressure do to values and spectra, with films and without."""
    warm = AT_15.replaced(oil_temperature=celsius(45))
    for name, fault in (("healthy", None), ("0.6 mm, shared", CASES["0.6 mm, shared"])):
        twin = Twin(PUMP, warm, fault)
        cold, hot = (warm.replaced(oil_temperature=celsius(t)) for t in (30, 60))
        low = warm.replaced(discharge_pressure=MPa(5))
        moved = [carry_over(twin, condition) for condition in (cold, hot, low)]
        factors = [(there.values / twin.values).numpy()[:4].round(3).tolist() for there in moved]
        print(f"{name}: factors on C_sw K_sw C_v K_v at 30 degC {factors[0]}, 60 degC {factors[1]}, 5 MPa {factors[2]}")
        without, with_films = change(twin.at(cold), twin.at(hot)), change(moved[0], moved[1])
        pressure = change(twin.at(low), moved[2])
        print(
            f"  30 -> 60 degC moves the spectrum by {without:.1%} without films, {with_films:.1%} with; "
            f"5 MPa {pressure:.1%}"
        )
    for thickness in (7.5, 10, 15, 20, 22, 25):
        twin = with_film(Twin(PUMP, warm, CASES["0.6 mm, shared"]), um(thickness))
        film = film_of(twin)
        print(
            f"h = {thickness:4} um: C_sw {film.damping:.3g} N s/m, K_sw {film.stiffness:.3g} N/m, "
            f"std of ln K_sw {deviations(twin)[1]:.2g}"
        )


def deviations(twin: Twin) -> np.ndarray:
    """Standard deviations of the logarithms of the six values, as in docs/explanation/physics.md, section 6, without
    nuisances."""
    indices = torch.as_tensor(np.flatnonzero(twin.orders % 7 == 0))
    logs = twin.values.log()

    def amplitude(point: torch.Tensor) -> torch.Tensor:
        return twin.acceleration(point.exp())[:, indices].abs().flatten()

    slope = torch.autograd.functional.jacobian(amplitude, logs).numpy()
    sigma = np.hypot(0.05 * amplitude(logs).numpy(), 0.02)
    weighed = slope / sigma[:, None]
    return np.sqrt(np.diag(np.linalg.inv(weighed.T @ weighed)))


if __name__ == "__main__":
    torch.set_num_threads(1)
    contact_table()
    law_table()
    loose_table()
    film_table()
