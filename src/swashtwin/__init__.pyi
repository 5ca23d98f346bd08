"""Public names, and where each lives."""

from .augmentation import DEFAULT_VARIATION as DEFAULT_VARIATION
from .augmentation import FILLERS as FILLERS
from .augmentation import Filler as Filler
from .augmentation import TwinFiller as TwinFiller
from .augmentation import Variation as Variation
from .augmentation import synthesize as synthesize
from .baselines import BASELINES as BASELINES
from .baselines import FittedBaseline as FittedBaseline
from .baselines import fit_baseline as fit_baseline
from .baselines import fit_extra_trees as fit_extra_trees
from .calibration import CMAES as CMAES
from .calibration import IPINN as IPINN
from .calibration import LBFGS as LBFGS
from .calibration import AmortizedIPINN as AmortizedIPINN
from .calibration import AmortizedTraining as AmortizedTraining
from .calibration import Calibration as Calibration
from .calibration import DirectAdam as DirectAdam
from .calibration import FleetCalibration as FleetCalibration
from .calibration import GaussNewton as GaussNewton
from .calibration import IdentifiabilityReport as IdentifiabilityReport
from .calibration import LearningRates as LearningRates
from .calibration import Population as Population
from .calibration import SeveritySettings as SeveritySettings
from .calibration import SeverityTrend as SeverityTrend
from .calibration import calibrate as calibrate
from .calibration import calibrate_fleet as calibrate_fleet
from .calibration import check_coverage as check_coverage
from .calibration import choose_learning_rate as choose_learning_rate
from .calibration import estimate_severity as estimate_severity
from .calibration import expected_information_gain as expected_information_gain
from .calibration import identifiability as identifiability
from .calibration import load_amortized as load_amortized
from .calibration import load_calibration as load_calibration
from .calibration import load_population as load_population
from .calibration import objective_without_recordings as objective_without_recordings
from .calibration import profile as profile
from .calibration import sample_posterior as sample_posterior
from .calibration import save_amortized as save_amortized
from .condition import OperatingCondition as OperatingCondition
from .contacts import ContactCheck as ContactCheck
from .contacts import SlipperContact as SlipperContact
from .diagnosis import Diagnosis as Diagnosis
from .diagnosis import Evidence as Evidence
from .diagnosis import Trust as Trust
from .diagnosis import diagnose as diagnose
from .diagnosis import explain as explain
from .diagnosis import export_onnx as export_onnx
from .diagnosis import load_classifier as load_classifier
from .diagnosis import save_classifier as save_classifier
from .errors import ArtifactError as ArtifactError
from .errors import DataError as DataError
from .errors import InputError as InputError
from .errors import LeakError as LeakError
from .errors import MissingExtraError as MissingExtraError
from .errors import MissingFileError as MissingFileError
from .errors import StabilityError as StabilityError
from .errors import SwashTwinError as SwashTwinError
from .errors import UnitError as UnitError
from .evaluation import LEVELS as LEVELS
from .evaluation import ConfidenceScores as ConfidenceScores
from .evaluation import Scores as Scores
from .evaluation import evaluate as evaluate
from .evaluation import learn_confidence as learn_confidence
from .evaluation import score_confidence as score_confidence
from .evaluation import unseen_recordings as unseen_recordings
from .faults import CLASSES as CLASSES
from .faults import BoreDefect as BoreDefect
from .faults import DamScratch as DamScratch
from .faults import GrooveErosion as GrooveErosion
from .faults import LooseSlipper as LooseSlipper
from .faults import PistonWear as PistonWear
from .faults import SealingLandScratch as SealingLandScratch
from .faults import SwashPlateDefect as SwashPlateDefect
from .faults import TiltedBlockFace as TiltedBlockFace
from .faults import ValvePlateWear as ValvePlateWear
from .faults import canonical_label as canonical_label
from .features import extract_features as extract_features
from .indicators import Band as Band
from .indicators import IndicatorTable as IndicatorTable
from .indicators import indicators_of as indicators_of
from .indicators import spectrum_of as spectrum_of
from .indicators import stacked as stacked
from .indicators import trend_of as trend_of
from .inspection import InspectionReport as InspectionReport
from .inspection import inspect_recording as inspect_recording
from .inspection import inspect_recordings as inspect_recordings
from .integrators import RK4 as RK4
from .integrators import HarmonicBalance as HarmonicBalance
from .networks import NETWORKS as NETWORKS
from .networks import BiTCN as BiTCN
from .networks import Network as Network
from .networks import SpectralBiTCN as SpectralBiTCN
from .networks import build_network as build_network
from .order_domain import ShaftAngle as ShaftAngle
from .order_domain import resampled_by_angle as resampled_by_angle
from .order_domain import stated_angle as stated_angle
from .order_domain import tachometer_speed as tachometer_speed
from .order_domain import tracked_speed as tracked_speed
from .pump import Interface as Interface
from .pump import Interfaces as Interfaces
from .pump import Pump as Pump
from .pump_files import available_pumps as available_pumps
from .pump_files import load_pump as load_pump
from .pump_files import new_pump as new_pump
from .quantities import read_condition as read_condition
from .quantities import read_fault as read_fault
from .readers import narrow_index as narrow_index
from .readers import open_recording as open_recording
from .readers import open_recordings as open_recordings
from .readers import open_store as open_store
from .readers import propose_index as propose_index
from .readers import read_public_set as read_public_set
from .readers import read_recording as read_recording
from .readers import read_recordings as read_recordings
from .readers import save_index as save_index
from .readers import write_blocks as write_blocks
from .readers import write_index as write_index
from .readers import write_recording as write_recording
from .readers import write_series as write_series
from .readers import write_store as write_store
from .recording import Recording as Recording
from .recording import joined as joined
from .recording import select as select
from .report import write_report as write_report
from .rig import build_rig as build_rig
from .rig import rig_recordings as rig_recordings
from .signals import add_noise as add_noise
from .studies import StudyResult as StudyResult
from .studies import run_study as run_study
from .training import PAPER_TRAINING as PAPER_TRAINING
from .training import RECOMMENDED_TRAINING as RECOMMENDED_TRAINING
from .training import FittedClassifier as FittedClassifier
from .training import TrainingSettings as TrainingSettings
from .training import fit as fit
from .twin import Course as Course
from .twin import OrderLines as OrderLines
from .twin import Scales as Scales
from .twin import SensorPath as SensorPath
from .twin import SlipperFilm as SlipperFilm
from .twin import Twin as Twin
from .twin import accelerations as accelerations
from .twin import carry_over as carry_over
from .twin import course_blocks as course_blocks
from .twin import film_of as film_of
from .twin import film_values as film_values
from .twin import simulate_course as simulate_course
from .twin import steady_blocks as steady_blocks
from .twin import whole_revolutions as whole_revolutions
from .twin import with_film as with_film
from .units import MPa as MPa
from .units import bar as bar
from .units import celsius as celsius
from .units import deg as deg
from .units import hertz as hertz
from .units import mm as mm
from .units import parse as parse
from .units import rpm as rpm
from .units import um as um
from .version import VERSION as VERSION
from .windows import WindowSet as WindowSet
from .windows import cut_windows as cut_windows
from .windows import group_folds as group_folds
from .windows import hold_out as hold_out
from .windows import hold_out_specimens as hold_out_specimens
from .windows import load_windows as load_windows
from .windows import recording_groups as recording_groups
from .windows import save_windows as save_windows
from .windows import split_by_recording as split_by_recording
from .windows import window_batches as window_batches

__all__ = [
    "BASELINES",
    "CLASSES",
    "CMAES",
    "DEFAULT_VARIATION",
    "FILLERS",
    "IPINN",
    "LBFGS",
    "LEVELS",
    "NETWORKS",
    "PAPER_TRAINING",
    "RECOMMENDED_TRAINING",
    "RK4",
    "VERSION",
    "AmortizedIPINN",
    "AmortizedTraining",
    "ArtifactError",
    "Band",
    "BiTCN",
    "BoreDefect",
    "Calibration",
    "ContactCheck",
    "Course",
    "DamScratch",
    "DataError",
    "Diagnosis",
    "DirectAdam",
    "Filler",
    "FittedBaseline",
    "FittedClassifier",
    "FleetCalibration",
    "GaussNewton",
    "GrooveErosion",
    "HarmonicBalance",
    "IdentifiabilityReport",
    "IndicatorTable",
    "InputError",
    "InspectionReport",
    "Interface",
    "Interfaces",
    "LeakError",
    "LearningRates",
    "LooseSlipper",
    "MPa",
    "MissingExtraError",
    "MissingFileError",
    "Network",
    "OperatingCondition",
    "OrderLines",
    "PistonWear",
    "Population",
    "Pump",
    "Recording",
    "Scales",
    "Scores",
    "SealingLandScratch",
    "SensorPath",
    "ShaftAngle",
    "SlipperContact",
    "SlipperFilm",
    "SpectralBiTCN",
    "StabilityError",
    "StudyResult",
    "SwashPlateDefect",
    "SwashTwinError",
    "TiltedBlockFace",
    "TrainingSettings",
    "Twin",
    "TwinFiller",
    "UnitError",
    "ValvePlateWear",
    "Variation",
    "WindowSet",
    "accelerations",
    "add_noise",
    "available_pumps",
    "bar",
    "build_network",
    "build_rig",
    "calibrate",
    "calibrate_fleet",
    "canonical_label",
    "carry_over",
    "celsius",
    "check_coverage",
    "choose_learning_rate",
    "course_blocks",
    "cut_windows",
    "deg",
    "diagnose",
    "evaluate",
    "expected_information_gain",
    "export_onnx",
    "extract_features",
    "film_of",
    "film_values",
    "fit",
    "fit_baseline",
    "fit_extra_trees",
    "group_folds",
    "hertz",
    "hold_out",
    "hold_out_specimens",
    "identifiability",
    "indicators_of",
    "inspect_recording",
    "inspect_recordings",
    "joined",
    "load_amortized",
    "load_calibration",
    "load_classifier",
    "load_population",
    "load_pump",
    "load_windows",
    "mm",
    "narrow_index",
    "new_pump",
    "objective_without_recordings",
    "parse",
    "profile",
    "propose_index",
    "read_condition",
    "read_fault",
    "read_recording",
    "read_recordings",
    "recording_groups",
    "resampled_by_angle",
    "rig_recordings",
    "rpm",
    "run_study",
    "sample_posterior",
    "save_amortized",
    "save_classifier",
    "save_index",
    "save_windows",
    "select",
    "simulate_course",
    "spectrum_of",
    "split_by_recording",
    "stacked",
    "stated_angle",
    "steady_blocks",
    "synthesize",
    "tachometer_speed",
    "tracked_speed",
    "trend_of",
    "um",
    "unseen_recordings",
    "whole_revolutions",
    "with_film",
    "write_blocks",
    "write_index",
    "write_recording",
    "write_report",
    "write_series",
]
