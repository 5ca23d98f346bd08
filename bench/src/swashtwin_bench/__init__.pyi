"""Names that other rooms import, and where each lives."""

from .demo import QUESTION as QUESTION
from .demo import Demo as Demo
from .demo import answer_of_demo as answer_of_demo
from .demo import run_demo as run_demo
from .fillers.registry import FILLERS as FILLERS
from .paper.page import paper_answer as paper_answer
from .paper.page import write_paper_page as write_paper_page
from .paper.running import EXPERIMENTS as EXPERIMENTS
from .paper.running import run_paper as run_paper
from .public.bearing_life import run_bearing_life as run_bearing_life
from .public.readers.registry import read_public_set as read_public_set
from .public.study import run_public as run_public
from .questions.alarms import AlarmStudySettings as AlarmStudySettings
from .questions.alarms import run_alarms as run_alarms
from .questions.calibration import CalibrationStudySettings as CalibrationStudySettings
from .questions.calibration import run_calibration_study as run_calibration_study
from .questions.confidence import ConfidenceStudySettings as ConfidenceStudySettings
from .questions.confidence import run_confidence as run_confidence
from .questions.contenders import CONTENDERS as CONTENDERS
from .questions.severity import run_severity as run_severity
from .questions.wrong_twin_study import run_wrong_twins as run_wrong_twins
from .questions.zero_shot import run_zero_shot as run_zero_shot
from .results.result import StudyResult as StudyResult
from .results.study_report import write_study_report as write_study_report
from .results.table import StudyTable as StudyTable
from .rigs.courses import PlantCourse as PlantCourse
from .rigs.courses import plant_course as plant_course
from .rigs.writing import RIG_VERSION as RIG_VERSION
from .rigs.writing import SIZES as SIZES
from .rigs.writing import build_rig as build_rig
from .rigs.writing import rig_recordings as rig_recordings
from .rivals.models import models_of as models_of
from .studies.collect import collect_studies as collect_studies
from .studies.plan import Plan as Plan
from .studies.registry import plan_of as plan_of
from .studies.registry import run_study as run_study
from .studies.runner import run_plan as run_plan
from .studies.sources import Fleets as Fleets
from .studies.sources import SameRecordings as SameRecordings
from .studies.sources import require_rig as require_rig
from .studies.workers import Workers as Workers

__all__ = [
    "CONTENDERS",
    "EXPERIMENTS",
    "FILLERS",
    "QUESTION",
    "RIG_VERSION",
    "SIZES",
    "AlarmStudySettings",
    "CalibrationStudySettings",
    "ConfidenceStudySettings",
    "Demo",
    "Fleets",
    "Plan",
    "PlantCourse",
    "SameRecordings",
    "StudyResult",
    "StudyTable",
    "Workers",
    "answer_of_demo",
    "build_rig",
    "collect_studies",
    "models_of",
    "paper_answer",
    "plan_of",
    "plant_course",
    "read_public_set",
    "require_rig",
    "rig_recordings",
    "run_alarms",
    "run_bearing_life",
    "run_calibration_study",
    "run_confidence",
    "run_demo",
    "run_paper",
    "run_plan",
    "run_public",
    "run_severity",
    "run_study",
    "run_wrong_twins",
    "run_zero_shot",
    "write_paper_page",
    "write_study_report",
]
