"""Names that other rooms import, and where each lives."""

from .evidence import Evidence as Evidence
from .evidence import explain as explain
from .evidence import hertz as hertz
from .fault_classifier import FaultClassifier as FaultClassifier
from .onnx_export import export_onnx as export_onnx
from .saving import load_classifier as load_classifier
from .saving import save_classifier as save_classifier
from .verdict import Diagnosis as Diagnosis
from .verdict import diagnose as diagnose

__all__ = [
    "Diagnosis",
    "Evidence",
    "FaultClassifier",
    "diagnose",
    "explain",
    "export_onnx",
    "hertz",
    "load_classifier",
    "save_classifier",
]
