"""The study of filling: which cells synthetic windows fill, and who makes them."""

from collections.abc import Mapping
from types import MappingProxyType

from swashtwin_bench.studies.ceilings import CEILINGS, PERFECT_MODEL
from swashtwin_bench.studies.training_sets import NO_GAIN, NOMINAL_TWINS, TrainingSet

SOURCES = ("nominal", NO_GAIN, "law", *CEILINGS)
"""Sources from the poorest knowledge of a pump to the truth: nominal twins with and without fitted
gain, calibrated twins with the law of the recess, and ceilings.
"""

EVERY_CLASS = "_every_class"
"""Ending of training sets that fill every class at the pressure of the missing cell."""

EVERYWHERE = "_everywhere"
"""Ending of training sets that fill every class at every pressure."""

FEW_ASSEMBLIES = 3
"""Assemblies in a cell of some training sets: as many as a measured cell of a short fleet has."""


def _build_training_sets() -> dict[str, TrainingSet]:
    """Return the measured windows, and each source in the cells that it may fill."""
    sets = {"measured": TrainingSet()}
    for source in SOURCES:
        sets[source] = TrainingSet(source)
        sets[f"{source}{EVERY_CLASS}"] = TrainingSet(source, every_class=True)
        sets[f"{source}{EVERYWHERE}"] = TrainingSet(source, every_class=True, every_pressure=True)

    for source in ("nominal", PERFECT_MODEL):
        sets[f"{source}_few"] = TrainingSet(source, assemblies=FEW_ASSEMBLIES)
    sets[f"nominal{EVERY_CLASS}_few"] = TrainingSet(
        "nominal", every_class=True, assemblies=FEW_ASSEMBLIES
    )
    sets[f"nominal{EVERY_CLASS}_alike"] = TrainingSet(
        "nominal", every_class=True, as_many_as_measured=True
    )
    return sets


TRAINING_SETS: Mapping[str, TrainingSet] = MappingProxyType(_build_training_sets())
"""Training sets by name.

A name without ending fills the missing cell alone. In ``_few`` the windows of a cell share
`FEW_ASSEMBLIES`; in ``_alike`` there are as many windows as measured ones.
"""

CONTRASTS: Mapping[str, tuple[tuple[str, str], ...]] = MappingProxyType(
    {
        "minus nominal twins in the missing cell alone": tuple(
            (name, "nominal") for name in TRAINING_SETS if name != "nominal"
        ),
        "every class at this pressure minus the missing cell alone": tuple(
            (f"{source}{EVERY_CLASS}", source) for source in SOURCES
        ),
        "every class at every pressure minus the missing cell alone": tuple(
            (f"{source}{EVERYWHERE}", source) for source in SOURCES
        ),
    }
)
"""Pairs of training sets that are compared, by question."""

FAIR_TRAINING_SETS: Mapping[str, TrainingSet] = MappingProxyType(
    {
        "measured": TRAINING_SETS["measured"],
        "nominal": TRAINING_SETS["nominal"],
        **{
            f"{source}{EVERY_CLASS}": TrainingSet(
                source, every_class=True, own_noise=source not in NOMINAL_TWINS
            )
            for source in (*NOMINAL_TWINS, "calibrated", "law", *CEILINGS)
        },
    }
)
"""Training sets of the second fair test: every source fills every class, and nominal twins the
missing cell alone too. Calibrated twins and ceilings have the noise and gains of their own pumps.
"""

FAIR_CONTRASTS: Mapping[str, tuple[tuple[str, str], ...]] = MappingProxyType(
    {
        "minus nominal twins without gain, every class": tuple(
            (f"{source}{EVERY_CLASS}", f"{NO_GAIN}{EVERY_CLASS}")
            for source in ("law", "calibrated", "nominal", *CEILINGS)
        ),
        "every class minus the missing cell alone": ((f"nominal{EVERY_CLASS}", "nominal"),),
        "minus measured windows only": (
            ("nominal", "measured"),
            (f"nominal{EVERY_CLASS}", "measured"),
            (f"law{EVERY_CLASS}", "measured"),
        ),
    }
)
"""Pairs of training sets that the second fair test compares, by question."""
