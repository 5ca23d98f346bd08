"""The ways to calibrate that the calibration study compares."""

from dataclasses import dataclass, field

from swashtwin.calibration import IPINN, Calibrator, GaussNewton, Nuisances


@dataclass(frozen=True)
class Contender:
    """One way to calibrate."""

    method: Calibrator
    """The search."""
    nuisances: Nuisances = field(default_factory=Nuisances)
    """What is searched beside the six values."""
    phases: bool = False
    """Whether the lines' phases are compared too."""


CONTENDERS: dict[str, Contender] = {
    "calibrated": Contender(GaussNewton(), Nuisances.by_axis(), phases=True),
    "gauss_newton_housing_phases": Contender(GaussNewton(), Nuisances.housing(), phases=True),
    "gauss_newton_housing": Contender(GaussNewton(), Nuisances.housing()),
    "gauss_newton": Contender(GaussNewton()),
    "ipinn": Contender(IPINN()),
}
"""Ways to calibrate by name; ``calibrated`` is the one to use, ``ipinn`` the paper's."""
