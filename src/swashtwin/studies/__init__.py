"""The paper's questions as functions of recordings and seeds."""

from swashtwin.studies.calibration import CONTENDERS, CalibrationStudySettings, run_calibration_study
from swashtwin.studies.carrying import run_plan
from swashtwin.studies.confidence import ConfidenceStudySettings, run_confidence
from swashtwin.studies.fault_map import run_fault_map
from swashtwin.studies.leakage import run_leakage
from swashtwin.studies.misspecification import run_misspecification
from swashtwin.studies.models import MODELS, Model, models_of
from swashtwin.studies.plan import Plan
from swashtwin.studies.registry import PLANS, plan_of, run_study
from swashtwin.studies.result import StudyResult, TrainingCurve
from swashtwin.studies.runs import Embedding, Outcome, Run, Task, load_runs
from swashtwin.studies.scenario import Scenario
from swashtwin.studies.severity import run_severity
from swashtwin.studies.sources import Fleets
from swashtwin.studies.table import StudyTable, Trial
from swashtwin.studies.workers import Workers
from swashtwin.studies.zero_shot import ZERO_SHOT_SIZES, run_zero_shot
from swashtwin.studies.zero_shot_data import ZeroShotSettings
from swashtwin.studies.zero_shot_table import chosen_zero_shot

__all__ = [
    "CONTENDERS",
    "MODELS",
    "PLANS",
    "ZERO_SHOT_SIZES",
    "CalibrationStudySettings",
    "ConfidenceStudySettings",
    "Embedding",
    "Fleets",
    "Model",
    "Outcome",
    "Plan",
    "Run",
    "Scenario",
    "StudyResult",
    "StudyTable",
    "Task",
    "TrainingCurve",
    "Trial",
    "Workers",
    "ZeroShotSettings",
    "chosen_zero_shot",
    "load_runs",
    "models_of",
    "plan_of",
    "run_calibration_study",
    "run_confidence",
    "run_fault_map",
    "run_leakage",
    "run_misspecification",
    "run_plan",
    "run_severity",
    "run_study",
    "run_zero_shot",
]
