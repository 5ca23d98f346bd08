"""Names that other rooms import, and where each lives."""

from .alarm_scores import AlarmScores as AlarmScores
from .anomaly_detector import AnomalyDetector as AnomalyDetector
from .attribution import Band as Band
from .attribution import format_frequency as format_frequency
from .changed_bands import BandPowerChange as BandPowerChange
from .changed_bands import band_power_changes as band_power_changes
from .classifier_file import load_classifier as load_classifier
from .classifier_file import save_classifier as save_classifier
from .evidence import Evidence as Evidence
from .evidence import explain as explain
from .fault_classifier import FaultClassifier as FaultClassifier
from .fault_classifier import compare_with_healthy as compare_with_healthy
from .healthy_spectrum import HealthySpectrum as HealthySpectrum
from .model_evaluation import Exclusion as Exclusion
from .model_evaluation import evaluate_model as evaluate_model
from .model_loading import load_model as load_model
from .onnx_export import export_onnx as export_onnx
from .prior_classifier import PriorClassifier as PriorClassifier
from .prior_classifier import make_prior as make_prior
from .prior_head import order_band_powers as order_band_powers
from .reasons import describe_single_machine_faults as describe_single_machine_faults
from .recording_diagnosis import diagnose as diagnose
from .verdict import Check as Check
from .verdict import Diagnosis as Diagnosis
from .verdict import next_checks as next_checks
