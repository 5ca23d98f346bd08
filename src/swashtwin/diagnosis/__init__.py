"""A fitted classifier at work: saved, loaded, and asked about a recording."""

from swashtwin.diagnosis.artifact import load_classifier, save_classifier
from swashtwin.diagnosis.trust import Trust
from swashtwin.diagnosis.verdict import Diagnosis, diagnose

__all__ = ["Diagnosis", "Trust", "diagnose", "load_classifier", "save_classifier"]
