"""Figures that the paper reports (DOI 10.1177/00202940261419020), by study and row.

They were measured on the paper's rig with the paper's BiTCN.
"""

from collections.abc import Mapping

PAPER_STUDY = "paper-"
"""Prefix of the name of a study by the paper's network and recipe."""

_BITCNS = ("spectral_bitcn", "bitcn", "paper_bitcn")
_CASE_ONE = {"accuracy": "0.98", "recall": "0.98", "f1": "0.98", "g_mean": "0.9748"}
_CASE_TWO = {"accuracy": "0.9240", "recall": "0.9240", "f1": "0.9236", "g_mean": "0.9029"}
_HEADINGS = {"accuracy": "accuracy", "recall": "recall", "f1": "F1", "g_mean": "G-mean"}

# The paper tests none of them.
_NOT_IN_PAPER = ("extra_trees", "logistic", "ridge", "svm")


def _rows(
    study: str, names: tuple[str, ...], claim: str, **factors: str
) -> list[tuple[str, Mapping[str, str], Mapping[str, str]]]:
    return [(study, {"classifier": name, **factors}, {"accuracy": claim}) for name in names]


REPORTED: tuple[tuple[str, Mapping[str, str], Mapping[str, str]], ...] = (
    ("case1", {"training_set": "measured"}, {"accuracy": "0.812"}),
    ("case1", {"training_set": "calibrated"}, _CASE_ONE),
    ("recess", {"training_set": "measured", "classifier": "paper_bitcn"}, {"accuracy": "0.812"}),
    ("recess", {"training_set": "calibrated", "classifier": "paper_bitcn"}, _CASE_ONE),
    ("case2", {"training_set": "calibrated"}, _CASE_TWO),
    *_rows("algorithms", _BITCNS, "0.98"),
    *_rows("related", ("paper_bitcn",), "0.98"),
    *_rows("algorithms", ("tcn", "lstm", "bilstm", "bigru"), "more than 8 points below BiTCN"),
    *_rows(
        "ablation",
        ("paper_ordinary", "paper_no_attention", "paper_forward"),
        "below the full model",
    ),
    *_rows("ablation", ("paper_bitcn",), "above each of the others; converges fastest"),
    *_rows("noise", _BITCNS, "0.980", training_set="calibrated", perturbation="clean"),
    *_rows("noise", _BITCNS, "0.910", training_set="calibrated", perturbation="5 dB"),
    *_rows(
        "noise", ("tcn",), "9 points below BiTCN", training_set="calibrated", perturbation="5 dB"
    ),
    *_rows(
        "noise", ("lstm",), "11 points below BiTCN", training_set="calibrated", perturbation="5 dB"
    ),
)
"""Study, factors, and the figure or claim by metric, of each row that the paper reports."""


def is_reported(study: str) -> bool:
    """Return whether the paper reports anything for a study."""
    return any(name == study.removeprefix(PAPER_STUDY) for name, *_ in REPORTED)


def format_reported(study: str, row: Mapping[str, str]) -> str:
    """Return what the paper reports for a row, or an empty text if it reports nothing.

    For a network that the paper does not have, such as ours, the text adds that the figure is that
    of the paper's BiTCN. The paper does not specify whether its tests are of other recordings (L2)
    or of random windows (L0), so its figures are shown for both, and for no other split.
    """
    classifier = row["classifier"]
    if row["split"] not in ("L0", "L2") or classifier in _NOT_IN_PAPER:
        return ""

    study_name = study.removeprefix(PAPER_STUDY)
    matches = [
        (factors, figures)
        for name, factors, figures in REPORTED
        if name == study_name and factors.items() <= row.items()
    ]
    if not matches:
        return ""

    factors, figures = matches[0]
    parts = []
    for metric, figure in figures.items():
        is_number = figure[0].isdigit() and " " not in figure
        parts.append(f"{_HEADINGS[metric]} {figure}" if is_number else figure)
    text = ", ".join(parts)

    is_listed = "classifier" in factors and not classifier.startswith(("spectral_", "bitcn"))
    if is_listed or classifier.startswith("paper_"):
        return text
    return f"the paper's BiTCN: {text}"
