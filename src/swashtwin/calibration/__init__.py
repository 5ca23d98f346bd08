"""Calibration: six interface values from measured vibration, and how far to trust them.

`calibrate` takes a twin and recordings, searches with a `Calibrator` (`IPINN`, the paper's, or `GaussNewton`), and
gives a `Calibration`.
"""

from swashtwin.calibration.agreement import Agreement, Fit, Spectra, Waveforms
from swashtwin.calibration.amortized import AmortizedIPINN, AmortizedReading
from swashtwin.calibration.amortized_inputs import objective_without_recordings
from swashtwin.calibration.amortized_saving import load_amortized, save_amortized
from swashtwin.calibration.amortized_training import AmortizedTraining
from swashtwin.calibration.checkpoint import Checkpoint, ResumableCalibrator
from swashtwin.calibration.coverage import Coverage, check_coverage
from swashtwin.calibration.difference import Difference, difference
from swashtwin.calibration.dimensions import Dimension
from swashtwin.calibration.discrepancy import Discrepancy
from swashtwin.calibration.evolution import CMAES
from swashtwin.calibration.gauss_newton import GaussNewton
from swashtwin.calibration.gradient import LBFGS, DirectAdam
from swashtwin.calibration.hierarchy import FleetCalibration, calibrate_fleet
from swashtwin.calibration.identifiability import Estimate
from swashtwin.calibration.identification import Direction, IdentifiabilityReport, identifiability
from swashtwin.calibration.information import Candidate, Gain, candidates_for, expected_information_gain
from swashtwin.calibration.ipinn import IPINN
from swashtwin.calibration.loading import load_calibration
from swashtwin.calibration.measurement import DEFAULT_BAND, Lines, Measurement, measure
from swashtwin.calibration.objective import Comparison, Objective, objective_of
from swashtwin.calibration.population import Population, load_population
from swashtwin.calibration.posterior import Posterior
from swashtwin.calibration.procedure import calibrate
from swashtwin.calibration.profiles import Profile, profile, profiles
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.sampling import Sampling, sample_posterior
from swashtwin.calibration.search import Calibrator, History, Search
from swashtwin.calibration.severity import DimensionEstimate, Severity, SeverityTrend
from swashtwin.calibration.severity_search import SeveritySettings, estimate_severity
from swashtwin.calibration.space import SearchSpace, search_space
from swashtwin.calibration.tuning import PAPER_RATES, LearningRates, choose_learning_rate
from swashtwin.calibration.unknowns import Nuisances, Unknowns

__all__ = [
    "CMAES",
    "DEFAULT_BAND",
    "IPINN",
    "LBFGS",
    "PAPER_RATES",
    "Agreement",
    "AmortizedIPINN",
    "AmortizedReading",
    "AmortizedTraining",
    "Calibration",
    "Calibrator",
    "Candidate",
    "Checkpoint",
    "Comparison",
    "Coverage",
    "Difference",
    "Dimension",
    "DimensionEstimate",
    "DirectAdam",
    "Direction",
    "Discrepancy",
    "Estimate",
    "Fit",
    "FleetCalibration",
    "Gain",
    "GaussNewton",
    "History",
    "IdentifiabilityReport",
    "LearningRates",
    "Lines",
    "Measurement",
    "Nuisances",
    "Objective",
    "Population",
    "Posterior",
    "Profile",
    "ResumableCalibrator",
    "Sampling",
    "Search",
    "SearchSpace",
    "Severity",
    "SeveritySettings",
    "SeverityTrend",
    "Spectra",
    "Unknowns",
    "Waveforms",
    "calibrate",
    "calibrate_fleet",
    "candidates_for",
    "check_coverage",
    "choose_learning_rate",
    "difference",
    "estimate_severity",
    "expected_information_gain",
    "identifiability",
    "load_amortized",
    "load_calibration",
    "load_population",
    "measure",
    "objective_of",
    "objective_without_recordings",
    "profile",
    "profiles",
    "sample_posterior",
    "save_amortized",
    "search_space",
]
