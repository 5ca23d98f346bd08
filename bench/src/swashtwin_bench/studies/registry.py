"""Studies of classifiers by name, and the functions that run them."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from swashtwin.foundation import InputError
from swashtwin_bench.paper import plans as paper
from swashtwin_bench.studies.cases import ablation, algorithms, case_one, case_two, noise, shaft_angle
from swashtwin_bench.studies.plan import Plan
from swashtwin_bench.studies.scarcity import augmentation, calibrators, few_shot, unseen_pressure, unseen_specimen

PLANS: Mapping[str, Callable[[str], Plan]] = MappingProxyType(
    {
        "case1": case_one,
        "case2": case_two,
        "algorithms": algorithms,
        "ablation": ablation,
        "noise": noise,
        "shaft-angle": shaft_angle,
        "augmentation": augmentation,
        "calibrators": calibrators,
        "few-shot": few_shot,
        "unseen-pressure": unseen_pressure,
        "unseen-specimen": unseen_specimen,
        **paper.PAPER_PLANS,
    }
)
"""Plan of each study, by its name and the name of a size."""

SIZES = ("quick", "paper")
"""How much a study takes: minutes of a laptop, or the paper's counts. The paper's own have `paper.plans.SIZES`."""


def plan_of(study: str, size: str) -> Plan:
    """Plan of a study by its name and a size's."""
    sizes = sizes_of(study)
    if study not in PLANS or size not in sizes:
        raise InputError(
            f"no study {study!r} of size {size!r}; studies are {', '.join(PLANS)}, sizes {', '.join(sizes)}."
        )
    return PLANS[study](size)


def sizes_of(study: str) -> tuple[str, ...]:
    """Sizes of a study, the least first."""
    return paper.SIZES if study in paper.PAPER_PLANS else SIZES
