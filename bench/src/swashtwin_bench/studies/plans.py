"""The studies of scarcity, those of the paper and ours, as plans by name, recipe and size.

A classifier must distinguish five classes at 15 MPa, but of the swash plate fault only one
recording was taken there (Case I), or none (Case II). There are three training sets: the measured
windows; the same with the scarce cell filled by the nominal twin; the same with it filled by
calibrated twins. The test sets are always measured, never simulated, and share no recording with
training or calibration:

- L2: other recordings of the pumps that were trained on;
- L4: pumps that were never trained on.

Our reading of what the paper leaves open: the test is at the pressure of the scarce cell, with
equally many windows of all classes; the windows of the scarce cell come from one recording of one
pump; the twins are calibrated, one for each training pump, on that pump's training recordings of
the same fault at the pressure nearest to the scarce one.

Recipe ``ours`` trains our network with the recommended settings. Recipe ``paper`` has the network,
training and counts of the paper; in size ``paper`` at the full rate with all epochs. It runs both
cases a second time on windows dealt at random, because the paper does not specify how it split.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
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
    MODELS,
    NOISY,
    OWN_NETWORK,
    Model,
    select_models,
)
from swashtwin_bench.studies import filling
from swashtwin_bench.studies.perturbations import Perturbation, noises
from swashtwin_bench.studies.plan import Plan
from swashtwin_bench.studies.scenario import RANDOM_WINDOWS, Scenario
from swashtwin_bench.studies.training_sets import (
    DEMO_TRAINING_SETS,
    FAIR_TRAINING_SETS,
    PAPER_TRAINING_SETS,
    TWIN_TRAINING_SETS,
    TrainingSet,
)

OURS = "ours"
PAPER = "paper"

SIZES: Mapping[str, tuple[str, ...]] = {
    OURS: ("quick", "paper"),
    PAPER: ("quick", "medium", "paper"),
}
"""Sizes by recipe in ascending order.

``quick`` takes minutes on a laptop; ``medium`` has the counts of the paper, 30 epochs and its
network on patches, and takes hours; ``paper`` has the counts and epochs of the paper, and takes
weeks of CPU time with its network.
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
"""Case I by recipe and size.

In full: 648 or 650 windows of each class, 50 in the scarce cell, and 150 synthetic ones.
"""

_EMPTY_CELL = {"scarce_windows": 0, "synthetic": 200, "test_windows": 50}

CASE_TWO: dict[tuple[str, str], Mapping[str, Any]] = {
    (OURS, "quick"): {**_EMPTY_CELL, "synthetic": 96},
    (OURS, "paper"): _EMPTY_CELL,
    (PAPER, "quick"): {"scarce_windows": 0, "synthetic": 32},
    (PAPER, "medium"): _EMPTY_CELL,
    (PAPER, "paper"): _EMPTY_CELL,
}
"""Changes of Case I that make Case II: as many synthetic windows as Case I has of both kinds."""

TRAINING: dict[str, TrainingSettings] = {
    "quick": replace(PAPER_TRAINING, epochs=6, batch_size=10),
    "medium": replace(PAPER_TRAINING, epochs=30),
    "paper": PAPER_TRAINING,
}
"""Training of the paper by size; ``quick`` in small batches, so that few windows make 100 steps."""

PAPER_NETWORK = "paper_bitcn"
"""The network of the paper: at the full rate, or in size medium on patches of `PATCH` samples."""

PATCH = 16
"""Samples in a step of the paper's network in size medium: a sixteenth of the arithmetic."""

NETWORKS: dict[str, tuple[str, Mapping[str, Any]]] = {
    PAPER_NETWORK: ("bitcn", {}),
    "paper_ordinary": ("bitcn", {"causal": False}),
    "paper_no_attention": ("bitcn", {"attention": False}),
    "paper_forward": ("bitcn", {"bidirectional": False}),
    **{
        name: (name, {})
        for name in ("tcn", "lstm", "bilstm", "bigru", "autoencoder", "sensor_graph")
    },
}
"""Kind and settings of the networks that the paper trains or cites; defaults are our reading."""

CLASSIFIERS: Mapping[str, tuple[str, ...]] = {
    "algorithms": (PAPER_NETWORK, "tcn", "lstm", "bilstm", "bigru"),
    "ablation": (PAPER_NETWORK, "paper_ordinary", "paper_no_attention", "paper_forward"),
    "noise": (PAPER_NETWORK, "tcn", "lstm", "bilstm"),
    "related": (PAPER_NETWORK, "autoencoder", "sensor_graph"),
}
"""Networks that each study of the paper compares."""

SNRS = (20.0, 15.0, 10.0, 5.0)
"""Signal-to-noise ratios in the tests of the paper [dB]."""

PERTURBATIONS = (
    *noises("white", *SNRS, 0.0),
    *noises("pink", 20.0, 10.0, 5.0, 0.0),
    *noises("hum", 20.0, 10.0, 5.0, 0.0),
    Perturbation("gain", 12.0),
    Perturbation("speed", 0.02),
)
"""Changes of the recordings in our tests of noise."""


def case_one(size: str, recipe: str) -> Plan:
    """Return Case I, few samples."""
    if recipe == PAPER:
        models = _build_paper_models(size, (PAPER_NETWORK,))
    elif size == "quick":
        models = select_models(size, (OWN_NETWORK, "extra_trees"))
    else:
        models = select_models(size, (OWN_NETWORK, "bitcn", "extra_trees"))

    plan = Plan(
        study="case1" if recipe == OURS else f"{PAPER_STUDY}case1",
        title="Case I, few samples: measured, nominal and calibrated training sets",
        scenario=SCENARIOS[recipe, size],
        models=models,
        size=size,
        reference_values={"training_set": "calibrated"},
        fleet="small" if size == "quick" else "paper",
    )
    return plan if recipe == OURS else _with_random_windows(plan)


def _with_random_windows(plan: Plan) -> Plan:
    """Return a case with a second variant: windows dealt at random."""
    return replace(
        plan,
        varied="windows",
        variants={
            "by recording": {},
            "at random": {"splits": (RANDOM_WINDOWS, plan.scenario.splits[1])},
        },
        notes=(
            *plan.notes,
            "Windows at random (L0): windows of the training and of the test on known pumps are "
            "dealt again in each class at the tested pressure, with the same counts. Other windows "
            "of the tested recordings are then trained on: this measures the leak, and is no "
            "score to report. Twins are calibrated as in the split by recording.",
        ),
    )


def case_two(size: str, recipe: str) -> Plan:
    """Return Case II, an operating point at which the fault was never measured."""
    plan = _derive_from_case_one(
        size,
        recipe,
        "case2",
        "Case II, missing operating point: no measured window in the cell that twins fill",
        scenario=replace(SCENARIOS[recipe, size], **CASE_TWO[recipe, size]),
        notes=(
            "The filled cell itself is split L5: no measured window of this class was trained on "
            "at this pressure.",
        ),
    )
    return plan if recipe == OURS else _with_random_windows(plan)


def recess(size: str) -> Plan:
    """Return Case I with the paper's recess of 0.6 mm, which the twins simulate too.

    Trees on features are trained too: features keep the amplitude, while the windows of the network
    are scaled one by one.
    """
    plan = _derive_from_case_one(size, PAPER, "recess", "Case I with the paper's recess of 0.6 mm")
    faults = {**plan.scenario.faults, "swash_plate": (PAPER_RECESS,)}
    return replace(
        plan,
        rig=DEEP_VERSION,
        scenario=replace(plan.scenario, faults=faults),
        models={**plan.models, "extra_trees": MODELS[size]["extra_trees"]},
    )


def algorithms(size: str, recipe: str) -> Plan:
    """Return the comparison of networks.

    By the paper's recipe its networks are trained repeatedly on the same data, by ours all
    classifiers on several fleets.
    """
    # The first is the one that the others are compared with.
    names = [OWN_NETWORK, *(n for n in MODELS["quick"] if n not in (OWN_NETWORK, NOISY))]
    plan = _compare_classifiers(
        size, recipe, "algorithms", "Algorithms on Case I's calibrated training set", names
    )
    if recipe == OURS:
        return plan
    # The paper repeats each training ten times (docs/explanation/method.md).
    return replace(plan, repeats=2 if size == "quick" else 10, reference_values={})


def ablation(size: str) -> Plan:
    """Return the comparison of the paper's network with variants that lack one of its parts."""
    title = "Ablation: BiTCN without one of its parts"
    return _compare_classifiers(size, PAPER, "ablation", title)


def related(size: str) -> Plan:
    """Return the comparison of the paper's network with those that it names as related work."""
    title = "Networks that the paper names as related work"
    return _compare_classifiers(size, PAPER, "related", title)


def noise(size: str, recipe: str) -> Plan:
    """Return the tests with noise; by our recipe also gains, speeds, and training with noise."""
    plan = _compare_classifiers(
        size,
        recipe,
        "noise",
        "Noise, gains and speeds in tests, trained clean and with noise",
        (OWN_NETWORK, NOISY, "bitcn", "tcn", "lstm", "bilstm", "extra_trees"),
    )
    noise_note = (
        "SNR: the power of the noise is the variance of the whole recording (mean removed) over "
        "10^(SNR/10), for each channel. It is added at the sample rate of the recording before "
        "windows are cut. Scores are means over draws, which are seeded by recording, ratio and "
        "repeat. Noise without a name is white and Gaussian."
    )
    if recipe == PAPER:
        draws = 1 if size == "quick" else 5
        return replace(plan, perturbations=noises("white", *SNRS), draws=draws, notes=(noise_note,))

    return replace(
        plan,
        perturbations=PERTURBATIONS,
        notes=(
            f"{noise_note} Pink noise is Gaussian with a density of 1/f; hum is the first 20 "
            "harmonics of 50 Hz with amplitudes of 1/h and phases drawn for each channel.",
            "Gain: each channel of a recording is up to 12 dB louder or quieter, uniform in dB. "
            "Speed: the time axis of a recording is stretched by up to 2 %, uniform, while its "
            "specified speed stays.",
            "New noise in every epoch: half the windows of each epoch have noise at ratios between "
            f"0 and {NOISE_SNR_RANGE_DB:g} dB, and there are twice as many epochs.",
        ),
    )


def augmentation(size: str) -> Plan:
    """Return the comparison of all methods that fill the scarce cell of Case I."""
    budgets = (0, 72, 200) if size == "quick" else (0, 50, 150, 200, 500)
    return _derive_from_case_one(
        size,
        OURS,
        "augmentation",
        "Augmentation: what fills the scarce cell, by the number of synthetic windows",
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
            "AUROC measured/synthetic: separation of measured from synthetic windows of the filled "
            "cell by trees on vibration features (0.5 = indistinguishable). If it is near 1 and "
            "only this cell is filled, a classifier can learn 'synthetic' instead of the class: "
            "then the recall in the scarce cell, which is of measured windows, is low. In the row "
            "'every class' all classes at this pressure are filled alike.",
            "Class weights change the training of networks only.",
        ),
    )


FAIR_SCENARIO = Scenario(
    scarce_windows=0,
    synthetic=72,
    windows=18,
    # Three of the six pumps of a short fleet, as fair-test.md fixed it.
    held_out=3,
    method=GaussNewton(starts=1),
    nuisances=Nuisances.housing(),
    calibrated_on="law",
)
"""Case II of the fair test."""


def fair_test(size: str) -> Plan:
    """Return the fair test, as docs/bench/fair-test.md fixed it before it was run."""
    all_faults = ("swash_plate", "cylinder_block", "piston", "valve_plate")
    return _derive_from_case_one(
        size,
        OURS,
        "fair-test",
        "The fair test: calibrated twins with the law of the recess against nominal twins",
        scenario=FAIR_SCENARIO,
        models=select_models(size, ("band_powers", "extra_trees", BEST_CANDIDATE, "bitcn")),
        training_sets=FAIR_TRAINING_SETS,
        varied="case",
        variants={
            "I": {"scarce_windows": 18, "synthetic": 54},
            "II": {},
            "never measured": {"scarce": all_faults},
        },
        reference_values={"training_set": "law"},
        fleet="short",
    )


def fair_test_two(size: str) -> Plan:
    """Return the second fair test, as docs/bench/fair-test-2.md fixed it before it was run."""
    return _derive_from_case_one(
        size,
        OURS,
        "fair-test-2",
        "The second fair test: calibrated against nominal twins, with and without a healthy "
        "reference of the tested pump",
        # Three pumps are trained on, by a recording of each cell, as in the first fair test.
        scenario=replace(FAIR_SCENARIO, held_out=6, training_recordings=1, test_windows=108),
        models=select_models(size, ("extra_trees", "band_powers", BEST_CANDIDATE, "bitcn")),
        training_sets=filling.FAIR_TRAINING_SETS,
        varied="reference",
        variants={"without": {}, "with": {"with_reference": True}},
        reference_values={},
        metric="recording_accuracy",
        contrasts=filling.FAIR_CONTRASTS,
        fleet="many",
    )


def fill_classes(size: str) -> Plan:
    """Return the comparison of what twins fill, and of twins with models that know the truth."""
    return _derive_from_case_one(
        size,
        OURS,
        "filling",
        "Filling: the missing cell alone, every class at its pressure, or every class everywhere",
        scenario=FAIR_SCENARIO,
        models=select_models(size, ("extra_trees", "band_powers", BEST_CANDIDATE)),
        training_sets=filling.TRAINING_SETS,
        reference_values={},
        metric="recording_accuracy",
        contrasts=filling.CONTRASTS,
        fleet="short",
        notes=(
            f"Each filled cell has {FAIR_SCENARIO.synthetic} synthetic windows, so that every "
            "class has equally many unless only the missing cell is filled. 'alike': all cells "
            "together have as many as there are measured windows. 'few': the windows of a cell "
            f"share {filling.FEW_ASSEMBLIES} assemblies and severities instead of having one each.",
            "Ceilings know the hidden truth of the virtual rig: twins with the true values of the "
            "training pumps, and the rig's own lines of these pumps with the noise that windows of "
            "twins have. No product can make them. They show what the design can show.",
            "Everything here is of the virtual rig, and nothing of a real pump.",
        ),
    )


def compare_for_demo(size: str) -> Plan:
    """Return the comparison of the demo: without any fault at 15 MPa, and with twins.

    It is the fair test's case in which no fault was measured there, with calibrations of the six
    values and the law of the recess alone, so that it takes minutes.
    """
    plan = fair_test(size)
    scenario = replace(plan.scenario_of("never measured"), nuisances=Nuisances())
    return replace(
        plan,
        study="demo",
        title="No fault recorded at 15 MPa: measured windows alone, and with twins",
        scenario=scenario,
        models=select_models(size, ("band_powers", "extra_trees")),
        training_sets=DEMO_TRAINING_SETS,
        varied="",
        variants={"": {}},
        reference_values={"training_set": "calibrated"},
        metric="recording_accuracy",
        notes=(
            f"Twins simulate {scenario.synthetic} windows of each class at 15 MPa, of the healthy "
            "pump too. The calibrated ones have the values of the training pumps.",
        ),
    )


def _derive_from_case_one(size: str, recipe: str, study: str, title: str, **changes: Any) -> Plan:
    """Return Case I, split by recording, with changes."""
    plan = replace(
        case_one(size, recipe),
        study=study if recipe == OURS else f"{PAPER_STUDY}{study}",
        title=title,
        notes=(),
        varied="",
        variants={"": {}},
    )
    return replace(plan, **changes)


def _compare_classifiers(
    size: str, recipe: str, study: str, title: str, own_names: Iterable[str] = ()
) -> Plan:
    """Return a comparison of classifiers on Case I's calibrated training set.

    Parameters
    ----------
    own_names : classifiers by our recipe; by the paper's they are those of `CLASSIFIERS`.
    """
    if recipe == OURS:
        models = select_models(size, own_names)
    else:
        models = _build_paper_models(size, CLASSIFIERS[study])

    return _derive_from_case_one(
        size,
        recipe,
        study,
        title,
        models=models,
        training_sets={"calibrated": PAPER_TRAINING_SETS["calibrated"]},
        reference_values={"classifier": next(iter(models))},
    )


def _build_paper_models(size: str, names: Iterable[str]) -> dict[str, Model]:
    """Return networks with the training of the paper."""
    models = {}
    for name in names:
        kind, settings = NETWORKS[name]
        if size == "medium" and kind.startswith("bitcn"):
            settings = {**settings, "stride": PATCH}
        models[name] = Model(kind, settings, TRAINING[size])

    return models


# Studies that have both recipes.
_BOTH_RECIPES = {"case1": case_one, "case2": case_two, "algorithms": algorithms, "noise": noise}

PLANS: Mapping[str, Callable[[str], Plan]] = MappingProxyType(
    {
        **{name: partial(plan, recipe=OURS) for name, plan in _BOTH_RECIPES.items()},
        "augmentation": augmentation,
        "fair-test": fair_test,
        "fair-test-2": fair_test_two,
        "filling": fill_classes,
        "demo": compare_for_demo,
        **{
            f"{PAPER_STUDY}{name}": partial(plan, recipe=PAPER)
            for name, plan in _BOTH_RECIPES.items()
        },
        f"{PAPER_STUDY}recess": recess,
        f"{PAPER_STUDY}ablation": ablation,
        f"{PAPER_STUDY}related": related,
    }
)
"""Function of a size that returns the plan, by the name of the study.

Names of studies by the recipe of the paper begin with `PAPER_STUDY`.
"""


def build_plan(study: str, size: str = "quick") -> Plan:
    """Return the plan of a study by its name and a size.

    Raises
    ------
    InputError
        The study or the size does not exist.
    """
    if study not in PLANS:
        raise InputError(f"Unknown study {study!r}: must be one of {', '.join(PLANS)}.")

    sizes = SIZES[PAPER if study.startswith(PAPER_STUDY) else OURS]
    if size not in sizes:
        raise InputError(f"{study} has no size {size!r}; its sizes are {', '.join(sizes)}.")

    return PLANS[study](size)
