"""What the paper prints (DOI 10.1177/00202940261419020), for its own rig and its own BiTCN, by
study and row.
"""

from collections.abc import Mapping

PAPER_STUDY = "paper-"
"""Start of the name of a study by the paper's own network and recipe."""

_BITCNS = ("spectral_bitcn", "bitcn", "paper_bitcn")
_CASE_ONE = {"accuracy": "0.98", "recall": "0.98", "f1": "0.98", "g_mean": "0.9748"}
_CASE_TWO = {"accuracy": "0.9240", "recall": "0.9240", "f1": "0.9236", "g_mean": "0.9029"}
_HEADINGS = {"accuracy": "accuracy", "recall": "recall", "f1": "F1", "g_mean": "G-mean"}


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
"""Study, factors, and by metric the figure or the claim of each row that the paper prints."""


def is_reported(study: str) -> bool:
    """Whether the paper prints anything for a study."""
    return any(name == study.removeprefix(PAPER_STUDY) for name, *_ in REPORTED)


def format_reported(study: str, row: Mapping[str, str]) -> str:
    """What the paper prints for a row; nothing at farther splits than L2, and of trees that the
    paper does not have.

    Beside a network that the paper does not have, such as ours, it says whose figure it is. The
    paper does not say whether its tests are of other recordings (L2) or of random windows (L0).
    """
    name, classifier = study.removeprefix(PAPER_STUDY), row["classifier"]
    matching = [
        (keys, figures)
        for of, keys, figures in REPORTED
        if of == name and keys.items() <= row.items()
    ]
    if (
        row["split"] not in ("L0", "L2")
        or not matching
        or classifier in ("extra_trees", "logistic", "ridge", "svm")
    ):
        return ""
    keys, figures = matching[0]
    text = ", ".join(
        f"{_HEADINGS[metric]} {figure}" if figure[0].isdigit() and " " not in figure else figure
        for metric, figure in figures.items()
    )
    named = "classifier" in keys and not classifier.startswith(("spectral_", "bitcn"))
    is_papers = named or classifier.startswith("paper_")
    return text if is_papers else f"the paper's BiTCN: {text}"
