"""Training that chooses among candidates, each tried on inner folds."""
