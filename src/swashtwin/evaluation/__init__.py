"""Scores of a classifier on recordings it has never seen, with the level of generalization beside them."""

from swashtwin.evaluation.confidence import (
    ConfidenceScores,
    SureClassifier,
    learn_confidence,
    recording_answers,
    score_confidence,
)
from swashtwin.evaluation.levels import LEVELS
from swashtwin.evaluation.scores import CellScore, Classifier, Scores, evaluate, pooled_probabilities
from swashtwin.evaluation.unseen import unseen_recordings

__all__ = [
    "LEVELS",
    "CellScore",
    "Classifier",
    "ConfidenceScores",
    "Scores",
    "SureClassifier",
    "evaluate",
    "learn_confidence",
    "pooled_probabilities",
    "recording_answers",
    "score_confidence",
    "unseen_recordings",
]
