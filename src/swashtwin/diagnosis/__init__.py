"""A fitted classifier at work: saved, loaded, and asked about a recording."""

from swashtwin.diagnosis.artifact import load_classifier, save_classifier
from swashtwin.diagnosis.evidence import Evidence, explain
from swashtwin.diagnosis.next_checks import Check, next_checks
from swashtwin.diagnosis.onnx_export import export_onnx
from swashtwin.diagnosis.trust import Trust
from swashtwin.diagnosis.verdict import Diagnosis, diagnose

__all__ = [
    "Check",
    "Diagnosis",
    "Evidence",
    "Trust",
    "diagnose",
    "explain",
    "export_onnx",
    "load_classifier",
    "next_checks",
    "save_classifier",
]
