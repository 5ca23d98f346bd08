"""The paper's studies as plans: its two cases, the algorithms, the ablation, the noise.

A classifier must tell five classes apart at 15 MPa, but of the swash plate fault only one recording was taken there
(Case I), or none (Case II). Three training sets: what was measured; the same with the scarce cell filled from the
nominal twin; the same with it filled from calibrated twins. The test sets are always measured, never simulated, and
share no recording with training or calibration:

- L2: other recordings of the pumps that were trained on;
- L4: pumps that were never seen.

Our reading, where the paper is silent: the test is at the pressure of the scarce cell, all classes alike; the windows
of the scarce cell come from one recording of one pump; the twins are calibrated, one for each training pump, on that
pump's training recordings of the same fault at the pressure nearest to the scarce one.
"""

from collections.abc import Iterable
from dataclasses import replace

from swashtwin.learning import RANGE
from swashtwin_bench.rivals.models import ABLATED, DEFAULT, MODELS, NOISY, models_of
from swashtwin_bench.studies.perturbations import Perturbation, noises
from swashtwin_bench.studies.plan import Plan
from swashtwin_bench.studies.scenario import Scenario
from swashtwin_bench.studies.training_sets import PAPER_TRAINING_SETS, TRAINING_SNRS, TrainingSet

SCENARIOS: dict[str, Scenario] = {
    "quick": Scenario(),
    "paper": Scenario(windows=18, scarce_windows=50, synthetic=150),
}
"""``quick`` is the demo's. ``paper`` takes the paper's counts on the paper-sized rig: 648 windows a class, 50 in the
scarce cell, 150 synthetic ones."""

CASE_MODELS = {"quick": (DEFAULT, "extra_trees"), "paper": (DEFAULT, "bitcn", "extra_trees")}
"""Classifiers of the paper's cases: ours, the paper's, and the first rival to any network."""

ANGLE_MODELS = {"quick": (DEFAULT, "extra_trees"), "paper": (DEFAULT, "ridge", "svm", "extra_trees", "wdcnn")}
"""Ours, and the best rivals of the other kinds: linear, kernel, trees, and a network on samples."""

NOISE_MODELS = (DEFAULT, "spectral_noise", "bitcn", "tcn", "lstm", "bilstm", "extra_trees")
"""Ours, and ours with noise in training; those that the paper compares; and the first rival to any network."""

PERTURBATIONS = (
    *noises("white", 20.0, 15.0, 10.0, 5.0, 0.0),
    *noises("pink", 20.0, 10.0, 5.0, 0.0),
    *noises("hum", 20.0, 10.0, 5.0, 0.0),
    Perturbation("gain", 12.0),
    Perturbation("speed", 0.02),
)
"""What tests of noise are changed by."""

NOISE_IN_TRAINING = (
    f"New noise in every epoch: half the windows of each have white noise, at ratios between 0 and {RANGE:g} dB, in "
    "twice the usual epochs."
)
"""What is to be read with the rows of ``spectral_noise``."""

PAPER_ABLATED = ("bitcn_ordinary", "bitcn_no_attention", "bitcn_forward")
"""The paper's BiTCN without one of its parts."""

CASE_TWO_WINDOWS = {"quick": 96, "paper": 200}
"""Synthetic windows that fill the cell where nothing was measured: as many as Case I has of both kinds."""


def case_one(size: str) -> Plan:
    """Case I, few samples."""
    return Plan(
        study="case1",
        title="Case I, few samples: measured, nominal and calibrated training sets",
        scenario=SCENARIOS[size],
        models=models_of(size, CASE_MODELS[size]),
        size=size,
        rivals=CASE_MODELS[size][1:],
        compared={"training_set": "calibrated"},
    )


def _calibrated_case_one(size: str, study: str, title: str, models: Iterable[str]) -> Plan:
    """Case I's calibrated training set, learned by several classifiers."""
    return replace(
        case_one(size),
        study=study,
        title=title,
        models=models_of(size, models),
        training_sets={"calibrated": PAPER_TRAINING_SETS["calibrated"]},
        rivals=(),
        compared={"classifier": DEFAULT},
    )


def algorithms(size: str) -> Plan:
    """Every classifier there is on Case I's calibrated training set; the paper runs ten seeds."""
    names = [name for name in MODELS[size] if name not in (*ABLATED, NOISY) and not name.startswith("bitcn_")]
    return _calibrated_case_one(size, "algorithms", "Algorithms on Case I's calibrated training set", names)


def ablation(size: str) -> Plan:
    """BiTCN without one of its parts on Case I's calibrated training set."""
    papers = ("bitcn", *PAPER_ABLATED) if size == "paper" else ()
    title = "Ablation: BiTCN without one of its parts"
    plan = _calibrated_case_one(size, "ablation", title, (DEFAULT, *ABLATED, *papers))
    return replace(plan, compared={"classifier": {DEFAULT: (*ABLATED, "bitcn"), "bitcn": PAPER_ABLATED}})


def shaft_angle(size: str) -> Plan:
    """Case I from windows along the shaft's angle, beside those along time."""
    return replace(
        case_one(size),
        study="shaft-angle",
        title="Windows along the shaft's angle instead of along time",
        models=models_of(size, ANGLE_MODELS[size]),
        varied="domain",
        variants={"time": {}, "angle": {"along_angle": True}},
        rivals=(),
        compared={"domain": "angle", "training_set": "calibrated"},
        notes=(
            "Angle: every recording is put at even steps of the shaft's angle, as many a turn as there are samples at "
            "the stated speed; the angle comes from the clearest of its lowest six piston-pass lines. Twins are "
            "calibrated on recordings as they are. The same recordings lend to the scarce cell, and may hold a window "
            "or two less along the angle.",
        ),
    )


def noise(size: str) -> Plan:
    """Noise, gains and speeds in the tests, for classifiers trained clean and with noise."""
    names = [name for name in NOISE_MODELS if name in MODELS[size]]
    plan = _calibrated_case_one(size, "noise", "Noise, gains and speeds in tests, trained clean and with noise", names)
    return replace(
        plan,
        training_sets={**plan.training_sets, "calibrated_noise": TrainingSet("calibrated", noise=True)},
        perturbations=PERTURBATIONS,
        notes=(
            "Added SNR: noise whose power is the variance of the whole recording (mean removed) over 10^(SNR/10), for "
            "each channel, added at the recording's own rate before windows are cut; the mean of "
            f"{plan.draws} draws, seeded by recording, ratio and repeat. Without a name it is white and Gaussian; pink "
            "is Gaussian with a density of 1/f; hum is the first 20 harmonics of 50 Hz with amplitudes of 1/h and "
            "phases drawn for each channel.",
            "Gain: each channel of a recording up to 12 dB louder or quieter, uniform in dB. Speed: time of a "
            "recording stretched by up to 2 %, uniform, which its stated speed does not say.",
            "Trained with noise: every training recording and every synthetic window stands in the training set a "
            "second time with noise, at a ratio drawn between "
            f"{TRAINING_SNRS[0]:g} and {TRAINING_SNRS[1]:g} dB.",
        ),
        model_notes={"spectral_noise": NOISE_IN_TRAINING},
    )


def case_two(size: str) -> Plan:
    """Case II, a condition that was never measured with the fault."""
    return replace(
        case_one(size),
        study="case2",
        title="Case II, missing condition: no measured window in the cell that twins fill",
        scenario=replace(SCENARIOS[size], scarce_windows=0, synthetic=CASE_TWO_WINDOWS[size], test_windows=50),
        notes=(
            "The filled cell itself is level L5 at every test: no measured window of this class was trained on at this "
            "pressure.",
        ),
    )
