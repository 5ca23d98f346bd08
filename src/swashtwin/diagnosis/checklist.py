"""What to check on the machine before acting on a diagnosis, and why that would show it.

The reasons are the physics of the parts (docs/explanation/physics.md), not a statistic: none of these checks was
measured together with our recordings. Oil is sampled from the running line (ISO 4021) and counted as ISO 4406 codes.
"""

from dataclasses import dataclass
from types import MappingProxyType

from swashtwin.pump import is_healthy, propose_class


@dataclass(frozen=True)
class Check:
    """One thing to look at."""

    what: str
    """What to do."""
    why: str
    """What it would show, and by which physics."""


_DRAIN = (
    "Measure the case drain flow at rated pressure and known oil temperature, and compare it with this pump's earlier "
    "value."
)
_OIL = "Take an oil sample from the running line: particle count, and which metals."
_BEFORE = Check(
    "Check pressure, speed, oil level, suction pressure, air in the oil, and the sensor's mounting.",
    "A starved or aerated pump and a loose sensor change vibration more than early wear does; rule them out first.",
)
_PLAUSIBLE = (
    Check(
        "Look at the trend of levels and orders against this machine's healthy recordings (swashtwin signal trend).",
        "A learned class is a comparison with other pumps; a change of this pump at one operating point is not.",
    ),
)

CHECKS = MappingProxyType(
    {
        "normal": _PLAUSIBLE,
        "swash_plate": (
            Check(_OIL, "A worn or pitted swash plate and its slippers shed steel and bronze or brass."),
            Check(
                _DRAIN,
                "Slippers that ride over a recess lose their film: leakage through the slipper pockets drains into the "
                "case, in bursts once per piston and turn.",
            ),
            Check(
                "Look at the swash plate face and the slipper soles at the next opening.",
                "The recess itself is to be seen there.",
            ),
        ),
        "cylinder_block": (
            Check(
                _DRAIN,
                "A bore or block face that lost its shape widens the gap by its cube in the leakage (laminar slot).",
            ),
            Check(
                "Compare the case drain temperature with the tank's.",
                "Throttled oil carries the lost power as heat: some 0.05 K for each 0.1 MPa that leaks through.",
            ),
            Check(
                "Look at the spline, the shaft bearing and the block's running face at the next opening.",
                "A block that tilts wears its face on one side, and vibrates once per turn.",
            ),
        ),
        "piston": (
            Check(
                _DRAIN,
                "Radial clearance leaks with its cube; one worn piston of seven drains more, once per turn.",
            ),
            Check(
                "Measure the pressure ripple at the outlet, by order.",
                "One piston that delivers less leaves lines at all multiples of the shaft, not only at the piston-pass "
                "line.",
            ),
            Check(_OIL, "Wear of pistons and bores sheds steel and bronze, and dirt in the gap caused it."),
        ),
        "valve_plate": (
            Check(
                "Measure the pressure ripple at the outlet, at the piston-pass line and its multiples.",
                "A scratched dam or an eroded groove changes how the pressure in each chamber rises at the dead "
                "centers, for every piston alike.",
            ),
            Check(
                _DRAIN + " Measure the delivered flow too.",
                "Leakage over the dam goes from discharge to suction: flow falls while the drain hardly grows.",
            ),
            Check("Check suction pressure and air in the oil.", "Cavitation erodes grooves and will do so again."),
            Check(
                "Look at the valve plate and the block face at the next opening.",
                "Scratches and erosion are to be seen there.",
            ),
        ),
        "loose_slipper": (
            Check("Stop the pump and look soon.", "A slipper that comes off its ball breaks the pump within turns."),
            Check(_OIL, "A loosened crimp sheds bronze or brass."),
            Check(
                "Measure the play of the slippers on their balls at the next opening.",
                "The axial play is what the class means.",
            ),
        ),
    }
)
"""Checks by class, the cheapest first."""


def next_checks(*labels: str, unknown: bool = False) -> tuple[Check, ...]:
    """What to check where one of `labels` was diagnosed; of a recording called unknown, what holds for any fault."""
    if unknown:
        return (_BEFORE, *_PLAUSIBLE, Check(_OIL, "Whatever wears sheds particles."), Check(_DRAIN, "Most wear leaks."))
    checks = tuple(
        check for label in labels for check in CHECKS.get(label, CHECKS.get(propose_class(label) or "", _PLAUSIBLE))
    )
    return checks if labels and all(map(is_healthy, labels)) else (_BEFORE, *checks)
