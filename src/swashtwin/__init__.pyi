"""Public names, and where each lives."""

from . import presets as presets
from .bench import FILLERS as FILLERS
from .bench import StudyResult as StudyResult
from .bench import build_rig as build_rig
from .bench import read_public_set as read_public_set
from .bench import rig_recordings as rig_recordings
from .bench import run_study as run_study
from .calibration import CMAES as CMAES
from .calibration import IPINN as IPINN
from .calibration import LBFGS as LBFGS
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
from .calibration import choose_learning_rate as choose_learning_rate
from .calibration import estimate_severity as estimate_severity
from .calibration import expected_information_gain as expected_information_gain
from .calibration import identifiability as identifiability
from .calibration import load_calibration as load_calibration
from .calibration import load_population as load_population
from .calibration import profile as profile
from .calibration import sample_posterior as sample_posterior
from .diagnosis import Diagnosis as Diagnosis
from .diagnosis import Evidence as Evidence
from .diagnosis import FaultClassifier as FaultClassifier
from .diagnosis import Trust as Trust
from .diagnosis import diagnose as diagnose
from .diagnosis import explain as explain
from .diagnosis import export_onnx as export_onnx
from .diagnosis import load_classifier as load_classifier
from .diagnosis import save_classifier as save_classifier
from .foundation import VERSION as VERSION
from .foundation import ArtifactError as ArtifactError
from .foundation import DataError as DataError
from .foundation import InputError as InputError
from .foundation import LeakError as LeakError
from .foundation import MissingExtraError as MissingExtraError
from .foundation import MissingFileError as MissingFileError
from .foundation import MPa as MPa
from .foundation import StabilityError as StabilityError
from .foundation import SwashTwinError as SwashTwinError
from .foundation import UnitError as UnitError
from .foundation import bar as bar
from .foundation import celsius as celsius
from .foundation import deg as deg
from .foundation import hertz as hertz
from .foundation import mm as mm
from .foundation import parse as parse
from .foundation import rpm as rpm
from .foundation import um as um
from .learning import BASELINES as BASELINES
from .learning import LEVELS as LEVELS
from .learning import NETWORKS as NETWORKS
from .learning import PAPER_TRAINING as PAPER_TRAINING
from .learning import RECOMMENDED_TRAINING as RECOMMENDED_TRAINING
from .learning import BiTCN as BiTCN
from .learning import ConfidenceScores as ConfidenceScores
from .learning import FittedBaseline as FittedBaseline
from .learning import FittedClassifier as FittedClassifier
from .learning import Network as Network
from .learning import Scores as Scores
from .learning import SpectralBiTCN as SpectralBiTCN
from .learning import TrainingSettings as TrainingSettings
from .learning import WindowSet as WindowSet
from .learning import build_network as build_network
from .learning import cut_windows as cut_windows
from .learning import evaluate as evaluate
from .learning import extract_features as extract_features
from .learning import fit as fit
from .learning import fit_baseline as fit_baseline
from .learning import fit_extra_trees as fit_extra_trees
from .learning import group_folds as group_folds
from .learning import hold_out as hold_out
from .learning import learn_confidence as learn_confidence
from .learning import load_windows as load_windows
from .learning import register_network as register_network
from .learning import save_windows as save_windows
from .learning import score_confidence as score_confidence
from .learning import split_by_recording as split_by_recording
from .learning import unseen_recordings as unseen_recordings
from .learning import window_batches as window_batches
from .physics import RK4 as RK4
from .physics import ContactCheck as ContactCheck
from .physics import HarmonicBalance as HarmonicBalance
from .physics import OperatingProfile as OperatingProfile
from .physics import OrderLines as OrderLines
from .physics import Scales as Scales
from .physics import SensorPath as SensorPath
from .physics import SlipperContact as SlipperContact
from .physics import SlipperFilm as SlipperFilm
from .physics import Twin as Twin
from .physics import accelerations as accelerations
from .physics import carry_over as carry_over
from .physics import film_of as film_of
from .physics import film_values as film_values
from .physics import profile_blocks as profile_blocks
from .physics import simulate_profile as simulate_profile
from .physics import steady_blocks as steady_blocks
from .physics import whole_revolutions as whole_revolutions
from .physics import with_film as with_film
from .pump import CLASSES as CLASSES
from .pump import BoreDefect as BoreDefect
from .pump import DamScratch as DamScratch
from .pump import GrooveErosion as GrooveErosion
from .pump import Interface as Interface
from .pump import Interfaces as Interfaces
from .pump import LooseSlipper as LooseSlipper
from .pump import OperatingCondition as OperatingCondition
from .pump import PistonWear as PistonWear
from .pump import Pump as Pump
from .pump import SealingLandScratch as SealingLandScratch
from .pump import SwashPlateDefect as SwashPlateDefect
from .pump import TiltedBlockFace as TiltedBlockFace
from .pump import ValvePlateWear as ValvePlateWear
from .pump import available_pumps as available_pumps
from .pump import canonical_label as canonical_label
from .pump import load_pump as load_pump
from .pump import new_pump as new_pump
from .pump import read_condition as read_condition
from .pump import read_fault as read_fault
from .recordings import InspectionReport as InspectionReport
from .recordings import RawFile as RawFile
from .recordings import Recording as Recording
from .recordings import Recordings as Recordings
from .recordings import inspect_recording as inspect_recording
from .recordings import inspect_recordings as inspect_recordings
from .recordings import join_blocks as join_blocks
from .recordings import load_recording as load_recording
from .recordings import load_recordings as load_recordings
from .recordings import narrow_index as narrow_index
from .recordings import propose_index as propose_index
from .recordings import recording_groups as recording_groups
from .recordings import register_format as register_format
from .recordings import save_index as save_index
from .recordings import write_blocks as write_blocks
from .recordings import write_index as write_index
from .recordings import write_recording as write_recording
from .recordings import write_series as write_series
from .recordings import write_store as write_store
from .report import write_report as write_report
from .signals import Band as Band
from .signals import IndicatorTable as IndicatorTable
from .signals import ShaftAngle as ShaftAngle
from .signals import add_noise as add_noise
from .signals import indicators_of as indicators_of
from .signals import resampled_by_angle as resampled_by_angle
from .signals import spectrum_of as spectrum_of
from .signals import stacked as stacked
from .signals import stated_angle as stated_angle
from .signals import tachometer_speed as tachometer_speed
from .signals import tracked_speed as tracked_speed
from .signals import trend_of as trend_of
from .synthesis import DEFAULT_VARIATION as DEFAULT_VARIATION
from .synthesis import Filler as Filler
from .synthesis import TwinFiller as TwinFiller
from .synthesis import Variation as Variation
from .synthesis import synthesize as synthesize

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
    "ArtifactError",
    "Band",
    "BiTCN",
    "BoreDefect",
    "Calibration",
    "ConfidenceScores",
    "ContactCheck",
    "DamScratch",
    "DataError",
    "Diagnosis",
    "DirectAdam",
    "Evidence",
    "FaultClassifier",
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
    "OperatingProfile",
    "OrderLines",
    "PistonWear",
    "Population",
    "Pump",
    "RawFile",
    "Recording",
    "Recordings",
    "Scales",
    "Scores",
    "SealingLandScratch",
    "SensorPath",
    "SeveritySettings",
    "SeverityTrend",
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
    "Trust",
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
    "choose_learning_rate",
    "cut_windows",
    "deg",
    "diagnose",
    "estimate_severity",
    "evaluate",
    "expected_information_gain",
    "explain",
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
    "identifiability",
    "indicators_of",
    "inspect_recording",
    "inspect_recordings",
    "join_blocks",
    "learn_confidence",
    "load_calibration",
    "load_classifier",
    "load_population",
    "load_pump",
    "load_recording",
    "load_recordings",
    "load_windows",
    "mm",
    "narrow_index",
    "new_pump",
    "parse",
    "presets",
    "profile",
    "profile_blocks",
    "propose_index",
    "read_condition",
    "read_fault",
    "read_public_set",
    "recording_groups",
    "register_network",
    "resampled_by_angle",
    "rig_recordings",
    "rpm",
    "run_study",
    "sample_posterior",
    "save_classifier",
    "save_index",
    "save_windows",
    "score_confidence",
    "simulate_profile",
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
    "window_batches",
    "with_film",
    "write_blocks",
    "write_index",
    "write_recording",
    "write_report",
    "write_series",
    "write_store",
]
