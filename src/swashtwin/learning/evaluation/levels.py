"""How far the test data lie from the training data: stated beside every score."""

LEVELS = {
    "L0": "random windows of known recordings: a diagnosis of the leak, never a headline",
    "L1": "later time of the same recording, behind a guard gap: optimistic",
    "L2": "another recording of the same specimen and condition",
    "L3": "another condition: a pressure or speed that was held out",
    "L4": "another specimen: a pump, bearing or actuator that was held out",
    "L5": "synthetic to measured: no measured window of that class (and condition) in training",
}
"""Meaning of each level of generalization, nearest first."""
