"""The paper's questions as functions of recordings and seeds."""

from swashtwin.studies.case_one import CASE_ONE_SIZES, CaseOneSettings, run_case_one
from swashtwin.studies.result import Embedding, Outcome, StudyResult, TrainingCurve
from swashtwin.studies.table import StudyTable, Trial

__all__ = [
    "CASE_ONE_SIZES",
    "CaseOneSettings",
    "Embedding",
    "Outcome",
    "StudyResult",
    "StudyTable",
    "TrainingCurve",
    "Trial",
    "run_case_one",
]
