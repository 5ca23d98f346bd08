"""Names that other rooms import, and where each lives."""

from .methods.gauss_newton import GaussNewton as GaussNewton
from .methods.ipinn import IPINN as IPINN
from .methods.ipinn import PAPER_RATES as PAPER_RATES
from .methods.search import Calibrator as Calibrator
from .next_recording import CandidateRecording as CandidateRecording
from .next_recording import RecordingPlan as RecordingPlan
from .next_recording import plan_recording as plan_recording
from .next_recording import total_width as total_width
from .notes import is_warning as is_warning
from .objective.agreement import Agreement as Agreement
from .objective.agreement import Fit as Fit
from .objective.agreement import Spectra as Spectra
from .objective.agreement import agreement as agreement
from .objective.agreement import agreement_of_lines as agreement_of_lines
from .objective.agreement import mean_agreement as mean_agreement
from .objective.measurement import GRAVITY as GRAVITY
from .objective.measurement import measure as measure
from .objective.recording_checks import shown_speed as shown_speed
from .objective.spectrum_objective import Objective as Objective
from .objective.spectrum_objective import objective_of as objective_of
from .objective.unknowns import VALUES as VALUES
from .objective.unknowns import Nuisances as Nuisances
from .procedure import PAPER_CALIBRATION as PAPER_CALIBRATION
from .procedure import calibrate as calibrate
from .result import Calibration as Calibration
from .result import load_calibration as load_calibration
from .result import twin_from_dict as twin_from_dict
from .result import twin_to_dict as twin_to_dict
from .severity.dimensions import Dimension as Dimension
from .severity.dimensions import SeveritySearch as SeveritySearch
from .severity.dimensions import register_severity as register_severity
from .severity.dimensions import search_of as search_of
from .severity.severity import Severity as Severity
from .severity.severity import SeveritySettings as SeveritySettings
from .severity.severity import SeverityTrend as SeverityTrend
from .severity.severity_search import estimate_severity as estimate_severity
from .uncertainty.identifiability_report import IdentifiabilityReport as IdentifiabilityReport
from .uncertainty.identifiability_report import identifiability as identifiability
from .uncertainty.posterior import QUANTILE as QUANTILE
from .uncertainty.posterior import Estimate as Estimate
from .uncertainty.posterior import Posterior as Posterior
from .uncertainty.profiles import THRESHOLD as THRESHOLD
from .uncertainty.profiles import Profile as Profile
from .uncertainty.profiles import profile as profile

__all__ = [
    "GRAVITY",
    "IPINN",
    "PAPER_CALIBRATION",
    "PAPER_RATES",
    "QUANTILE",
    "THRESHOLD",
    "VALUES",
    "Agreement",
    "Calibration",
    "Calibrator",
    "CandidateRecording",
    "Dimension",
    "Estimate",
    "Fit",
    "GaussNewton",
    "IdentifiabilityReport",
    "Nuisances",
    "Objective",
    "Posterior",
    "Profile",
    "RecordingPlan",
    "Severity",
    "SeveritySearch",
    "SeveritySettings",
    "SeverityTrend",
    "Spectra",
    "agreement",
    "agreement_of_lines",
    "calibrate",
    "estimate_severity",
    "identifiability",
    "is_warning",
    "load_calibration",
    "mean_agreement",
    "measure",
    "objective_of",
    "plan_recording",
    "profile",
    "register_severity",
    "search_of",
    "shown_speed",
    "total_width",
    "twin_from_dict",
    "twin_to_dict",
]
