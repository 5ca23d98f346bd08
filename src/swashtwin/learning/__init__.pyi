"""Names that other rooms import, and where each lives."""

from .choice.choice import CANDIDATES as CANDIDATES
from .choice.choice import Candidate as Candidate
from .choice.choice import Choice as Choice
from .choice.choice import Trial as Trial
from .choice.choosing import BUDGET as BUDGET
from .choice.choosing import choose as choose
from .choice.choosing import fit_chosen as fit_chosen
from .copies import copied_recordings as copied_recordings
from .data_check import DataCheck as DataCheck
from .data_check import check_recordings as check_recordings
from .estimators.fitted import FittedBaseline as FittedBaseline
from .estimators.fitted import fit_baseline as fit_baseline
from .estimators.fitted import fit_extra_trees as fit_extra_trees
from .estimators.forest import Forest as Forest
from .estimators.forest import fit_forest as fit_forest
from .estimators.registry import BASELINES as BASELINES
from .estimators.registry import RIDGE_PENALTIES as RIDGE_PENALTIES
from .estimators.registry import Baseline as Baseline
from .estimators.registry import DecisionSoftmax as DecisionSoftmax
from .evaluation.confidence import ConfidenceScores as ConfidenceScores
from .evaluation.confidence import cross_fit as cross_fit
from .evaluation.confidence import cross_fitted_confidence as cross_fitted_confidence
from .evaluation.confidence import learn_confidence as learn_confidence
from .evaluation.confidence import recording_answers as recording_answers
from .evaluation.confidence import score_confidence as score_confidence
from .evaluation.levels import LEVELS as LEVELS
from .evaluation.levels import level_between as level_between
from .evaluation.metrics import g_mean as g_mean
from .evaluation.metrics import recalls as recalls
from .evaluation.metrics import wilson_interval as wilson_interval
from .evaluation.pooling import likeliest_class as likeliest_class
from .evaluation.pooling import pooled_probabilities as pooled_probabilities
from .evaluation.pooling import window_counts as window_counts
from .evaluation.protocols import Classifier as Classifier
from .evaluation.protocols import DiagnosingClassifier as DiagnosingClassifier
from .evaluation.protocols import SureClassifier as SureClassifier
from .evaluation.protocols import unseen_recordings as unseen_recordings
from .evaluation.scores import Scores as Scores
from .evaluation.scores import evaluate as evaluate
from .features import FeatureTable as FeatureTable
from .features import band_energies as band_energies
from .features import extract_features as extract_features
from .features import level_spectrum as level_spectrum
from .healthy.healthy_levels import USUAL_ERROR_RATE as USUAL_ERROR_RATE
from .healthy.healthy_levels import Deviation as Deviation
from .healthy.healthy_levels import HealthyLevels as HealthyLevels
from .healthy.healthy_levels import level_layout as level_layout
from .healthy.healthy_levels import measure_healthy as measure_healthy
from .healthy.levels import Level as Level
from .healthy.levels import LevelLayout as LevelLayout
from .networks.bitcn import BiTCN as BiTCN
from .networks.branch import Branch as Branch
from .networks.level_network import LevelNetwork as LevelNetwork
from .networks.network import Network as Network
from .networks.network import batches as batches
from .networks.registry import BUILT_IN as BUILT_IN
from .networks.registry import NETWORKS as NETWORKS
from .networks.registry import build_network as build_network
from .networks.registry import has_network as has_network
from .networks.registry import register_network as register_network
from .networks.representation import FLOOR as FLOOR
from .networks.representation import bands_of as bands_of
from .networks.representation import power_of as power_of
from .networks.representation import taper_of as taper_of
from .networks.representation import waveform_shape as waveform_shape
from .networks.settings import default_settings as default_settings
from .networks.window_levels import WindowLevel as WindowLevel
from .training.checkpoint import checkpoint_epochs as checkpoint_epochs
from .training.classifier import FittedClassifier as FittedClassifier
from .training.classifier import require_verdicts as require_verdicts
from .training.confidence import Confidence as Confidence
from .training.confidence import ValidationPlan as ValidationPlan
from .training.confidence import allowed_error_rate as allowed_error_rate
from .training.confidence import least_validation as least_validation
from .training.confidence import plan_validation as plan_validation
from .training.confidence import require_enough as require_enough
from .training.loop import fit as fit
from .training.normalization import Normalization as Normalization
from .training.settings import NORMALIZATIONS as NORMALIZATIONS
from .training.settings import PAPER_TRAINING as PAPER_TRAINING
from .training.settings import RECOMMENDED_TRAINING as RECOMMENDED_TRAINING
from .training.settings import Epoch as Epoch
from .training.settings import TrainingSettings as TrainingSettings
from .training.signal_facts import N_FACTS as N_FACTS
from .training.signal_facts import OutsideFact as OutsideFact
from .training.signal_facts import outside_facts as outside_facts
from .training.signal_facts import signal_facts as signal_facts
from .training.signal_facts import swapped_channels as swapped_channels
from .training.train_transforms import RANGE as RANGE
from .training.train_transforms import at_other_speeds as at_other_speeds
from .training.train_transforms import with_gains as with_gains
from .training.training_reference import TrainingReference as TrainingReference
from .windows.cutting import cut_windows as cut_windows
from .windows.cutting import window_batches as window_batches
from .windows.folding import Fold as Fold
from .windows.folding import group_folds as group_folds
from .windows.folding import without_overlap as without_overlap
from .windows.grouping import window_groups as window_groups
from .windows.operating_point import refuse_other_values as refuse_other_values
from .windows.operating_point import require_shared_speed as require_shared_speed
from .windows.saving import load_windows as load_windows
from .windows.saving import save_windows as save_windows
from .windows.splitting import check_disjoint as check_disjoint
from .windows.splitting import hold_out as hold_out
from .windows.splitting import split_by_recording as split_by_recording
from .windows.window_set import WindowLayout as WindowLayout
from .windows.window_set import WindowSet as WindowSet

__all__ = [
    "BASELINES",
    "BUDGET",
    "BUILT_IN",
    "CANDIDATES",
    "FLOOR",
    "LEVELS",
    "NETWORKS",
    "NORMALIZATIONS",
    "N_FACTS",
    "PAPER_TRAINING",
    "RANGE",
    "RECOMMENDED_TRAINING",
    "RIDGE_PENALTIES",
    "USUAL_ERROR_RATE",
    "Baseline",
    "BiTCN",
    "Branch",
    "Candidate",
    "Choice",
    "Classifier",
    "Confidence",
    "ConfidenceScores",
    "DataCheck",
    "DecisionSoftmax",
    "Deviation",
    "DiagnosingClassifier",
    "Epoch",
    "FeatureTable",
    "FittedBaseline",
    "FittedClassifier",
    "Fold",
    "Forest",
    "HealthyLevels",
    "Level",
    "LevelLayout",
    "LevelNetwork",
    "Network",
    "Normalization",
    "OutsideFact",
    "Scores",
    "SureClassifier",
    "TrainingReference",
    "TrainingSettings",
    "Trial",
    "ValidationPlan",
    "WindowLayout",
    "WindowLevel",
    "WindowSet",
    "allowed_error_rate",
    "at_other_speeds",
    "band_energies",
    "bands_of",
    "batches",
    "build_network",
    "check_disjoint",
    "check_recordings",
    "checkpoint_epochs",
    "choose",
    "copied_recordings",
    "cross_fit",
    "cross_fitted_confidence",
    "cut_windows",
    "default_settings",
    "evaluate",
    "extract_features",
    "fit",
    "fit_baseline",
    "fit_chosen",
    "fit_extra_trees",
    "fit_forest",
    "g_mean",
    "group_folds",
    "has_network",
    "hold_out",
    "learn_confidence",
    "least_validation",
    "level_between",
    "level_layout",
    "level_spectrum",
    "likeliest_class",
    "load_windows",
    "measure_healthy",
    "outside_facts",
    "plan_validation",
    "pooled_probabilities",
    "power_of",
    "recalls",
    "recording_answers",
    "refuse_other_values",
    "register_network",
    "require_enough",
    "require_shared_speed",
    "require_verdicts",
    "save_windows",
    "score_confidence",
    "signal_facts",
    "split_by_recording",
    "swapped_channels",
    "taper_of",
    "unseen_recordings",
    "waveform_shape",
    "wilson_interval",
    "window_batches",
    "window_counts",
    "window_groups",
    "with_gains",
    "without_overlap",
]
