"""Training that chooses: candidates, the trial of each by inner folds, and the choice."""
