"""The paper's questions as plans of tasks, run and resumed."""
