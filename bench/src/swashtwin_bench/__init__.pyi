"""Names that other rooms import, and where each lives."""

from .demo import QUESTION as QUESTION
from .demo import Demo as Demo
from .demo import run_demo as run_demo
from .demo import summarize_demo as summarize_demo
from .fillers.available_fillers import FILLERS as FILLERS
from .fillers.filler import fill_cell as fill_cell
from .paper.experiments import EXPERIMENTS as EXPERIMENTS
from .paper.experiments import paper_answer as paper_answer
from .paper.experiments import run_paper as run_paper
from .paper.experiments import write_paper_page as write_paper_page
from .public.sets import read_public_set as read_public_set
from .results.page import write_study_report as write_study_report
from .results.result import StudyResult as StudyResult
from .results.runs import Work as Work
from .results.table import StudyTable as StudyTable
from .rigs.courses import PlantCourse as PlantCourse
from .rigs.courses import plant_course as plant_course
from .rigs.writing import SIZES as SIZES
from .rigs.writing import build_rig as build_rig
from .rigs.writing import rig_recordings as rig_recordings
from .rivals.models import select_models as select_models
from .studies.plan import Plan as Plan
from .studies.plans import PLANS as PLANS
from .studies.plans import build_plan as build_plan
from .studies.registry import run_study as run_study
from .studies.runner import run_plan as run_plan
