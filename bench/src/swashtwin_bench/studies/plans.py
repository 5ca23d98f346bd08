"""The paper's studies and ours of scarcity as plans, by name, recipe and size.

A classifier must tell five classes apart at 15 MPa, but of the swash plate fault only one recording
was taken there (Case I), or none (Case II). Three training sets: what was measured; the same with
the scarce cell filled from the nominal twin; the same with it filled from calibrated twins. The
test sets are always measured, never simulated, and share no recording with training or calibration:

- L2: other recordings of the pumps that were trained on;
- L4: pumps that were never seen.

Our reading, where the paper is silent: the test is at the pressure of the scarce cell, all classes
alike; the windows of the scarce cell come from one recording of one pump; the twins are calibrated,
one for each training pump, on that pump's training recordings of the same fault at the pressure
nearest to the scarce one.

Recipe ``ours`` trains our network and the recommended settings; ``paper`` the paper's own network,
recipe and counts, in size ``paper`` at the full rate with all epochs, and both cases a second time
on windows dealt at random, for the paper does not say how it split.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from swashtwin.calibration import GaussNewton, Nuisances
from swashtwin.foundation import InputError
from swashtwin.learning import NOISE_SNR_RANGE_DB, PAPER_TRAINING, TrainingSettings
from swashtwin_bench.fillers.available_fillers import FILLERS
from swashtwin_bench.results.reported import PAPER_STUDY
from swashtwin_bench.rigs.fleet import PAPER_RECESS
from swashtwin_bench.rigs.writing import DEEP_VERSION
from swashtwin_bench.rivals.models import (
    BEST_CANDIDATE,
    DEFAULT,
    MODELS,
    NOISY,
    Model,
    select_models,
)
from swashtwin_bench.studies.perturbations import Perturbation, noises
from swashtwin_bench.studies.plan import Plan
from swashtwin_bench.studies.scenario import RANDOM_WINDOWS, Scenario
from swashtwin_bench.studies.training_sets import (
    FAIR_TRAINING_SETS,
    PAPER_TRAINING_SETS,
    TWIN_TRAINING_SETS,
    TrainingSet,
)

OURS, PAPER = "ours", "paper"

SIZES: Mapping[str, tuple[str, ...]] = {
    OURS: ("quick", "paper"),
    PAPER: ("quick", "medium", "paper"),
}
"""Sizes by recipe, the least first: minutes of a laptop; the paper's counts with 30 epochs and its
network on patches, which take hours; the paper's counts and epochs, with its own network weeks of a
CPU.
"""

_FULL = Scenario(windows=18, scarce_windows=50, synthetic=150)
_COUNTS = replace(_FULL, windows=19, class_windows=650)

SCENARIOS: dict[tuple[str, str], Scenario] = {
    (OURS, "quick"): Scenario(),
    (OURS, "paper"): _FULL,
    (PAPER, "quick"): Scenario(windows=2, scarce_windows=8, synthetic=24),
    (PAPER, "medium"): _COUNTS,
    (PAPER, "paper"): _COUNTS,
}
"""Case I by recipe and size. In full: 648 or 650 windows a class, 50 in the scarce cell, 150
synthetic ones.
"""

_EMPTY_CELL = {"scarce_windows": 0, "synthetic": 200, "test_windows": 50}

CASE_TWO: dict[tuple[str, str], Mapping[str, Any]] = {
    (OURS, "quick"): {**_EMPTY_CELL, "synthetic": 96},
    (OURS, "paper"): _EMPTY_CELL,
    (PAPER, "quick"): {"scarce_windows": 0, "synthetic": 32},
    (PAPER, "medium"): _EMPTY_CELL,
    (PAPER, "paper"): _EMPTY_CELL,
}
"""What Case II has in place of Case I's counts: as many synthetic windows as Case I has of both
kinds.
"""

TRAINING: dict[str, TrainingSettings] = {
    "quick": replace(PAPER_TRAINING, epochs=6, batch_size=10),
    "medium": replace(PAPER_TRAINING, epochs=30),
    "paper": PAPER_TRAINING,
}
"""The paper's recipe; ``quick`` in small batches, so that few windows still make a hundred
steps.
"""

MAIN = "paper_bitcn"
"""The paper's network: at the full rate, or in size medium on patches of `PATCH` samples."""

PATCH = 16
"""Samples of a step of the paper's network and its ablations in size medium: a sixteenth of the
arithmetic.
"""

NETWORKS: dict[str, tuple[str, Mapping[str, Any]]] = {
    MAIN: ("bitcn", {}),
    "paper_ordinary": ("bitcn", {"causal": False}),
    "paper_no_attention": ("bitcn", {"attention": False}),
    "paper_forward": ("bitcn", {"bidirectional": False}),
    **{
        name: (name, {})
        for name in ("tcn", "lstm", "bilstm", "bigru", "autoencoder", "sensor_graph")
    },
}
"""Kind and settings of each network that the paper trains or cites; all defaults are our
reading.
"""

CLASSIFIERS: Mapping[str, tuple[str, ...]] = {
    "algorithms": (MAIN, "tcn", "lstm", "bilstm", "bigru"),
    "ablation": (MAIN, "paper_ordinary", "paper_no_attention", "paper_forward"),
    "noise": (MAIN, "tcn", "lstm", "bilstm"),
    "related": (MAIN, "autoencoder", "sensor_graph"),
}
"""Networks of the paper's studies that compare them."""

SNRS = (20.0, 15.0, 10.0, 5.0)
"""Signal-to-noise ratios of the paper's tests [dB]."""

PERTURBATIONS = (
    *noises("white", *SNRS, 0.0),
    *noises("pink", 20.0, 10.0, 5.0, 0.0),
    *noises("hum", 20.0, 10.0, 5.0, 0.0),
    Perturbation("gain", 12.0),
    Perturbation("speed", 0.02),
)
"""What our tests of noise are changed by."""


def case_one(size: str, recipe: str) -> Plan:
    """Case I, few samples."""
    names = (DEFAULT, "extra_trees") if size == "quick" else (DEFAULT, "bitcn", "extra_trees")
    plan = Plan(
        study="case1" if recipe == OURS else f"{PAPER_STUDY}case1",
        title="Case I, few samples: measured, nominal and calibrated training sets",
        scenario=SCENARIOS[recipe, size],
        models=select_models(size, names) if recipe == OURS else _networks(size, (MAIN,)),
        size=size,
        reference_values={"training_set": "calibrated"},
        fleet="small" if size == "quick" else "paper",
    )
    return plan if recipe == OURS else _with_random_windows(plan)


def _with_random_windows(plan: Plan) -> Plan:
    """A case a second time, on windows that are dealt at random."""
    return replace(
        plan,
        varied="windows",
        variants={
            "by recording": {},
            "at random": {"splits": (RANDOM_WINDOWS, plan.scenario.splits[1])},
        },
        notes=(
            *plan.notes,
            "Windows at random (L0): those of training and nearer test are dealt anew in each class at the tested "
            "pressure, with the same counts, so other windows of the tested recordings are trained on: a diagnosis of "
            "the leak, never a headline. Twins are calibrated as in the split by recording.",
        ),
    )


def case_two(size: str, recipe: str) -> Plan:
    """Case II, a condition that was never measured with the fault."""
    scenario = replace(SCENARIOS[recipe, size], **CASE_TWO[recipe, size])
    title = "Case II, missing condition: no measured window in the cell that twins fill"
    note = "The filled cell itself is split L5: no measured window of this class was trained on at this pressure."
    plan = _like_case_one(size, recipe, "case2", title, scenario=scenario, notes=(note,))
    return plan if recipe == OURS else _with_random_windows(plan)


def recess(size: str) -> Plan:
    """Case I with the paper's recess of 0.6 mm, which the twins simulate too, by the paper's
    recipe.

    Trees on features, which keep the level, stand beside the network, whose windows are scaled one
    by one.
    """
    plan = _like_case_one(size, PAPER, "recess", "Case I with the paper's recess of 0.6 mm")
    return replace(
        plan,
        rig=DEEP_VERSION,
        scenario=replace(
            plan.scenario, faults={**plan.scenario.faults, "swash_plate": (PAPER_RECESS,)}
        ),
        models={**plan.models, "extra_trees": MODELS[size]["extra_trees"]},
    )


def algorithms(size: str, recipe: str) -> Plan:
    """The networks that the paper compares, trained repeatedly on the same data; by our recipe
    every classifier there is, on fleets.
    """
    others = (name for name in MODELS["quick"] if name != NOISY)
    names = dict.fromkeys((DEFAULT, *others))  # the first is the one that others are compared with
    plan = _calibrated(
        size, recipe, "algorithms", "Algorithms on Case I's calibrated training set", names
    )
    return (
        plan
        if recipe == OURS
        else replace(plan, repeats=2 if size == "quick" else 10, reference_values={})
    )


def ablation(size: str) -> Plan:
    """The paper's network without one of its parts on Case I's calibrated training set."""
    return _calibrated(size, PAPER, "ablation", "Ablation: BiTCN without one of its parts")


def related(size: str) -> Plan:
    """Networks that the paper names as related work, on Case I's calibrated training set."""
    return _calibrated(size, PAPER, "related", "Networks that the paper names as related work")


def noise(size: str, recipe: str) -> Plan:
    """Noise in the tests of classifiers trained clean; by our recipe gains and speeds too, and
    training with noise.
    """
    names = (DEFAULT, NOISY, "bitcn", "tcn", "lstm", "bilstm", "extra_trees")
    plan = _calibrated(
        size,
        recipe,
        "noise",
        "Noise, gains and speeds in tests, trained clean and with noise",
        names,
    )
    added = (
        "Added SNR: noise whose power is the variance of the whole recording (mean removed) over 10^(SNR/10), for each "
        "channel, added at the recording's own rate before windows are cut; the mean of draws seeded by recording, "
        "ratio and repeat. Without a name it is white and Gaussian."
    )
    if recipe == PAPER:
        draws = 1 if size == "quick" else 5
        return replace(plan, perturbations=noises("white", *SNRS), draws=draws, notes=(added,))
    return replace(
        plan,
        perturbations=PERTURBATIONS,
        notes=(
            f"{added} Pink is Gaussian with a density of 1/f; hum is the first 20 harmonics of 50 Hz with amplitudes "
            "of 1/h and phases drawn for each channel.",
            "Gain: each channel of a recording up to 12 dB louder or quieter, uniform in dB. Speed: time of a "
            "recording stretched by up to 2 %, uniform, which its stated speed does not say.",
            "New noise in every epoch: half the windows of each, at ratios between 0 and "
            f"{NOISE_SNR_RANGE_DB:g} dB, in twice the "
            "usual epochs.",
        ),
    )


def augmentation(size: str) -> Plan:
    """Whatever can fill the scarce cell of Case I, with the same number of windows each."""
    budgets = (0, 72, 200) if size == "quick" else (0, 50, 150, 200, 500)
    return _like_case_one(
        size, OURS, "augmentation", "Augmentation: what fills the scarce cell, by the number of synthetic windows",
        training_sets={
            "measured": TrainingSet(),
            "class_weights": TrainingSet(class_weights=True),
            **{name: TrainingSet(name) for name in FILLERS},
            **TWIN_TRAINING_SETS,
        },
        varied="synthetic",
        variants={str(budget): {"synthetic": budget} for budget in budgets},
        unfilled_variant="0",
        notes=(
            "AUROC measured/synthetic: how well trees on vibration features tell the measured windows of the filled "
            "cell from the synthetic ones; 0.5 is not at all. Where it is near 1 and only this cell is filled, a "
            "classifier can learn 'synthetic' for the class: then the recall in the scarce cell, which is of measured "
            "windows, falls behind. The row every class fills all classes at this pressure alike.",
            "Class weights change the training of networks only.",
        ),
    )  # fmt: skip


def fair_test(size: str) -> Plan:
    """The fair test, as docs/bench/fair-test.md fixed it before it was run."""
    scenario = Scenario(
        scarce_windows=0,
        synthetic=72,
        windows=18,
        held_out=3,
        method=GaussNewton(starts=1),
        nuisances=Nuisances.housing(),
        calibrated_on="law",
    )
    return _like_case_one(
        size, OURS, "fair-test", "The fair test: calibrated twins with the law of the recess less nominal ones",
        scenario=scenario,
        models=select_models(size, ("band_powers", "extra_trees", BEST_CANDIDATE, "bitcn")),
        training_sets=FAIR_TRAINING_SETS,
        varied="case",
        variants={
            "I": {"scarce_windows": 18, "synthetic": 54},
            "II": {},
            "never measured": {"scarce": ("swash_plate", "cylinder_block", "piston", "valve_plate")},
        },
        reference_values={"training_set": "law"},
        fleet="short",
    )  # fmt: skip


def _like_case_one(size: str, recipe: str, study: str, title: str, **changes: Any) -> Plan:
    """Case I by recording, with what differs."""
    name = study if recipe == OURS else f"{PAPER_STUDY}{study}"
    plan = replace(
        case_one(size, recipe), study=name, title=title, notes=(), varied="", variants={"": {}}
    )
    return replace(plan, **changes)


def _calibrated(size: str, recipe: str, study: str, title: str, ours: Iterable[str] = ()) -> Plan:
    """Case I's calibrated training set, learned by several classifiers: `ours`, or those of the
    paper.
    """
    models = select_models(size, ours) if recipe == OURS else _networks(size, CLASSIFIERS[study])
    sets = {"calibrated": PAPER_TRAINING_SETS["calibrated"]}
    reference_values = {"classifier": next(iter(models))}
    return _like_case_one(
        size,
        recipe,
        study,
        title,
        models=models,
        training_sets=sets,
        reference_values=reference_values,
    )


def _networks(size: str, names: Iterable[str]) -> dict[str, Model]:
    """Networks by the paper's recipe."""
    models = {}
    for name in names:
        kind, settings = NETWORKS[name]
        if size == "medium" and kind.startswith("bitcn"):
            settings = {**settings, "stride": PATCH}
        models[name] = Model(kind, settings, TRAINING[size])
    return models


def _by(plan: Callable[[str, str], Plan], recipe: str) -> Callable[[str], Plan]:
    return lambda size: plan(size, recipe)


_OF_BOTH = {"case1": case_one, "case2": case_two, "algorithms": algorithms, "noise": noise}

PLANS: Mapping[str, Callable[[str], Plan]] = MappingProxyType(
    {
        **{name: _by(plan, OURS) for name, plan in _OF_BOTH.items()},
        "augmentation": augmentation,
        "fair-test": fair_test,
        **{f"{PAPER_STUDY}{name}": _by(plan, PAPER) for name, plan in _OF_BOTH.items()},
        f"{PAPER_STUDY}recess": recess,
        f"{PAPER_STUDY}ablation": ablation,
        f"{PAPER_STUDY}related": related,
    }
)
"""Plan of each study, by its name and the name of a size; those by the paper's recipe begin with
`PAPER_STUDY`.
"""


def build_plan(study: str, size: str = "quick") -> Plan:
    """Plan of a study by its name and a size.

    Raises
    ------
    InputError
        There is none of that name or size.
    """
    if study not in PLANS:
        raise InputError(f"no study {study!r}; there are {', '.join(PLANS)}.")
    sizes = SIZES[PAPER if study.startswith(PAPER_STUDY) else OURS]
    if size not in sizes:
        raise InputError(f"{study} has no size {size!r}; its sizes are {', '.join(sizes)}.")
    return PLANS[study](size)
