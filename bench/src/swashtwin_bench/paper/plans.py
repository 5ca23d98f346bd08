"""The paper's studies of classifiers as plans, with its own network, recipe and counts.

Studies of the same questions with our network are in `studies.cases`. Here every network is trained by the paper's
recipe, in size ``paper`` at the full rate and with all epochs. Both cases stand a second time on windows dealt at
random, for the paper does not say how it split.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from swashtwin.learning import PAPER_TRAINING, TrainingSettings
from swashtwin_bench.results.reported import PAPER_STUDY
from swashtwin_bench.rigs.fleet import PAPER_RECESS
from swashtwin_bench.rivals.models import Model
from swashtwin_bench.studies.cases import SCENARIOS
from swashtwin_bench.studies.perturbations import noises
from swashtwin_bench.studies.plan import Plan
from swashtwin_bench.studies.scenario import RANDOM_WINDOWS, Scenario
from swashtwin_bench.studies.training_sets import PAPER_TRAINING_SETS

SIZES = ("small", "medium", "paper")
"""Minutes of two cores; the paper's counts with fewer epochs and its network on patches, which take hours; and the
paper's network at the full rate, which takes weeks of a CPU."""

TRAINING: Mapping[str, TrainingSettings] = {
    "small": replace(PAPER_TRAINING, epochs=6, batch_size=10),
    "medium": replace(PAPER_TRAINING, epochs=30),
    "paper": PAPER_TRAINING,
}
"""The paper's recipe. ``medium`` trains 30 epochs, as our other studies do; ``small`` 6, in small batches, so that few
windows still make a hundred steps."""

_COUNTS = replace(SCENARIOS["paper"], windows=19, class_windows=650)

COUNTS: Mapping[str, Scenario] = {
    "small": Scenario(windows=2, scarce_windows=8, synthetic=24),
    "medium": _COUNTS,
    "paper": _COUNTS,
}
"""The paper's counts: 650 windows a class, of the swash plate fault 500 measured ones, 50 of them in the scarce cell,
and 150 synthetic ones; ``small`` has a ninth of them."""

_CASE_TWO = {"scarce_windows": 0, "synthetic": 200, "test_windows": 50}

CASE_TWO: Mapping[str, Mapping[str, Any]] = {
    "small": {"scarce_windows": 0, "synthetic": 32},
    "medium": _CASE_TWO,
    "paper": _CASE_TWO,
}
"""What Case II has in place of Case I's counts."""

REPEATS = {"small": 2, "medium": 10, "paper": 10}
"""Trainings of each algorithm on the same data."""

MAIN = "paper_bitcn"
"""The paper's network: at the full rate, or in size medium on patches of `PATCH` samples."""

PATCH = 16
"""Samples of a step of the paper's network and its ablations in size medium: a sixteenth of the arithmetic."""

NETWORKS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    MAIN: ("bitcn", {}),
    "tcn": ("tcn", {}),
    "lstm": ("lstm", {}),
    "bilstm": ("bilstm", {}),
    "bigru": ("bigru", {}),
    "paper_ordinary": ("bitcn_ordinary", {}),
    "paper_no_attention": ("bitcn_no_attention", {}),
    "paper_forward": ("bitcn_forward", {}),
    "autoencoder": ("autoencoder", {}),
    "sensor_graph": ("sensor_graph", {}),
}
"""Kind and settings of each network that the paper trains or cites; all defaults are our reading
(`swashtwin.learning`)."""

ALGORITHMS = (MAIN, "tcn", "lstm", "bilstm", "bigru")
ABLATED = (MAIN, "paper_ordinary", "paper_no_attention", "paper_forward")
UNDER_NOISE = (MAIN, "tcn", "lstm", "bilstm")
RELATED = (MAIN, "autoencoder", "sensor_graph")

SNRS = (20.0, 15.0, 10.0, 5.0)
"""Signal-to-noise ratios of the paper's tests [dB]."""


def case_one(size: str) -> Plan:
    """Case I, few samples."""
    return Plan(
        study=f"{PAPER_STUDY}case1",
        title="The paper's Case I, few samples",
        scenario=COUNTS[size],
        models=_networks(size, (MAIN,)),
        size=size,
        compared={"training_set": "calibrated"},
    )


def case_two(size: str) -> Plan:
    """Case II, a condition that was never measured with the fault."""
    return replace(
        case_one(size),
        study=f"{PAPER_STUDY}case2",
        title="The paper's Case II, missing condition",
        scenario=replace(COUNTS[size], **CASE_TWO[size]),
    )


def recess(size: str) -> Plan:
    """Case I with the paper's recess of 0.6 mm, which the twins simulate too; for fleets of the rig's `DEEP_VERSION`.

    Trees on features, which keep the level, stand beside the network, whose windows are scaled one by one.
    """
    plan = case_one(size)
    return replace(
        plan,
        study=f"{PAPER_STUDY}recess",
        title="The paper's Case I with its recess of 0.6 mm",
        scenario=replace(plan.scenario, faults={**plan.scenario.faults, "swash_plate": (PAPER_RECESS,)}),
        models={**plan.models, "extra_trees": Model("extra_trees")},
    )


def at_random(case: Callable[[str], Plan]) -> Callable[[str], Plan]:
    """A case whose windows are dealt at random."""

    def plan(size: str) -> Plan:
        by_recording = case(size)
        levels = (RANDOM_WINDOWS, by_recording.scenario.levels[1])
        return replace(
            by_recording,
            study=f"{by_recording.study}-random",
            title=by_recording.title.replace(",", " on random windows,"),
            scenario=replace(by_recording.scenario, levels=levels),
            notes=(
                "Windows at random: the windows of training and nearer test are dealt anew in each class at the tested "
                "pressure, with the same counts, so other windows of the tested recordings are trained on. Twins are "
                "calibrated as in the split by recording.",
            ),
        )

    return plan


def algorithms(size: str) -> Plan:
    """The five networks that the paper compares, trained on Case I's calibrated set."""
    return _calibrated(size, "algorithms", "The paper's algorithms: repeated trainings on the same data", ALGORITHMS)


def ablation(size: str) -> Plan:
    """The paper's network, and the same without one of its parts."""
    plan = _calibrated(size, "ablation", "The paper's ablation of its own network", ABLATED)
    return replace(plan, compared={"classifier": MAIN})


def related(size: str) -> Plan:
    """Networks that the paper names as related work, on Case I's calibrated set by the paper's recipe."""
    plan = _calibrated(size, "related", "Networks that the paper names as related work", RELATED)
    return replace(plan, compared={"classifier": MAIN})


def noise(size: str) -> Plan:
    """White noise in the tests of networks trained clean."""
    plan = _calibrated(size, "noise", "The paper's noise: trained clean, tested with noise", UNDER_NOISE)
    draws = 1 if size == "small" else 5
    return replace(plan, perturbations=noises("white", *SNRS), draws=draws, compared={"classifier": MAIN})


def _calibrated(size: str, name: str, title: str, networks: tuple[str, ...]) -> Plan:
    """Case I's calibrated training set, learned by several networks."""
    return replace(
        case_one(size),
        study=f"{PAPER_STUDY}{name}",
        title=title,
        models=_networks(size, networks),
        training_sets={"calibrated": PAPER_TRAINING_SETS["calibrated"]},
        compared={},
    )


def _networks(size: str, names: tuple[str, ...]) -> dict[str, Model]:
    models = {}
    for name in names:
        kind, settings = NETWORKS[name]
        if size == "medium" and kind.startswith("bitcn"):
            settings = {**settings, "stride": PATCH}
        models[name] = Model(kind, settings, TRAINING[size])
    return models


PAPER_PLANS: Mapping[str, Callable[[str], Plan]] = MappingProxyType(
    {
        "paper-case1": case_one,
        "paper-case1-random": at_random(case_one),
        "paper-case2": case_two,
        "paper-case2-random": at_random(case_two),
        "paper-recess": recess,
        "paper-algorithms": algorithms,
        "paper-ablation": ablation,
        "paper-noise": noise,
        "paper-related": related,
    }
)
"""Plan of each study, by its name and the name of a size."""
