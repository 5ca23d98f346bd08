"""The paper's questions as functions of recordings and seeds."""

from swashtwin.studies.calibration import CONTENDERS, CalibrationStudySettings, run_calibration_study
from swashtwin.studies.case_one import CASE_ONE_SIZES, CaseOneSettings, run_case_one
from swashtwin.studies.confidence import ConfidenceStudySettings, run_confidence
from swashtwin.studies.fault_map import run_fault_map
from swashtwin.studies.leakage import run_leakage
from swashtwin.studies.misspecification import run_misspecification
from swashtwin.studies.result import Embedding, Outcome, StudyResult, TrainingCurve
from swashtwin.studies.severity import run_severity
from swashtwin.studies.table import StudyTable, Trial
from swashtwin.studies.zero_shot import ZERO_SHOT_SIZES, run_zero_shot
from swashtwin.studies.zero_shot_data import ZeroShotSettings
from swashtwin.studies.zero_shot_table import chosen_zero_shot

__all__ = [
    "CASE_ONE_SIZES",
    "CONTENDERS",
    "ZERO_SHOT_SIZES",
    "CalibrationStudySettings",
    "CaseOneSettings",
    "ConfidenceStudySettings",
    "Embedding",
    "Outcome",
    "StudyResult",
    "StudyTable",
    "TrainingCurve",
    "Trial",
    "ZeroShotSettings",
    "chosen_zero_shot",
    "run_calibration_study",
    "run_case_one",
    "run_confidence",
    "run_fault_map",
    "run_leakage",
    "run_misspecification",
    "run_severity",
    "run_zero_shot",
]
