"""The paper's questions as functions of recordings and seeds."""

from swashtwin.studies.calibration import CONTENDERS, CalibrationStudySettings, run_calibration_study
from swashtwin.studies.case_one import CASE_ONE_SIZES, CaseOneSettings, run_case_one
from swashtwin.studies.misspecification import run_misspecification
from swashtwin.studies.result import Embedding, Outcome, StudyResult, TrainingCurve
from swashtwin.studies.table import StudyTable, Trial

__all__ = [
    "CASE_ONE_SIZES",
    "CONTENDERS",
    "CalibrationStudySettings",
    "CaseOneSettings",
    "Embedding",
    "Outcome",
    "StudyResult",
    "StudyTable",
    "TrainingCurve",
    "Trial",
    "run_calibration_study",
    "run_case_one",
    "run_misspecification",
]
