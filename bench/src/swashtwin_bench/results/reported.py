"""What the paper prints (DOI 10.1177/00202940261419020), for its own rig and its own BiTCN, by study and row."""

from collections.abc import Mapping

from swashtwin_bench.results.result import StudyResult

PAPER_STUDY = "paper-"
"""Start of the name of a study that repeats one of the paper's with the paper's own network and recipe."""

_BITCNS = ("spectral_bitcn", "bitcn", "paper_bitcn")

_HEADINGS = {"accuracy": "accuracy", "recall": "recall", "f1": "F1", "g_mean": "G-mean"}
"""Heading of each metric that the paper prints."""

REPORTED: tuple[tuple[str, Mapping[str, str], Mapping[str, str]], ...] = (
    ("case1", {"training_set": "measured"}, {"accuracy": "0.812"}),
    (
        "case1",
        {"training_set": "calibrated"},
        {"accuracy": "0.98", "recall": "0.98", "f1": "0.98", "g_mean": "0.9748"},
    ),
    ("recess", {"training_set": "measured", "classifier": "paper_bitcn"}, {"accuracy": "0.812"}),
    (
        "recess",
        {"training_set": "calibrated", "classifier": "paper_bitcn"},
        {"accuracy": "0.98", "recall": "0.98", "f1": "0.98", "g_mean": "0.9748"},
    ),
    (
        "case2",
        {"training_set": "calibrated"},
        {"accuracy": "0.9240", "recall": "0.9240", "f1": "0.9236", "g_mean": "0.9029"},
    ),
    *(("algorithms", {"classifier": name}, {"accuracy": "0.98"}) for name in _BITCNS),
    ("related", {"classifier": "paper_bitcn"}, {"accuracy": "0.98"}),
    *(
        ("algorithms", {"classifier": name}, {"accuracy": "more than 8 points below BiTCN"})
        for name in ("tcn", "lstm", "bilstm", "bigru")
    ),
    *(
        ("ablation", {"classifier": name}, {"accuracy": "below the full model"})
        for kind in ("spectral", "bitcn", "paper")
        for name in (f"{kind}_ordinary", f"{kind}_no_attention", f"{kind}_forward")
    ),
    ("ablation", {"classifier": "paper_bitcn"}, {"accuracy": "above each of the others; converges fastest"}),
    *(
        (
            "noise",
            {"classifier": name, "training_set": "calibrated", "perturbation": test},
            {"accuracy": accuracy},
        )
        for name in _BITCNS
        for test, accuracy in (("clean", "0.980"), ("5 dB", "0.910"))
    ),
    *(
        (
            "noise",
            {"classifier": name, "training_set": "calibrated", "perturbation": "5 dB"},
            {"accuracy": f"{points} points below BiTCN"},
        )
        for name, points in (("tcn", 9), ("lstm", 11))
    ),
)
"""Study, factors, and by metric the figure or the claim of each row that the paper prints."""


def is_reported(study: StudyResult) -> bool:
    """Whether the paper prints anything for a study."""
    return any(name == _paper_name(study) for name, *_ in REPORTED)


def paper_words(study: StudyResult, key: Mapping[str, str]) -> str:
    """What the paper prints for a row; nothing at other levels than the nearest, or of rivals beside the study.

    Beside a network that the paper does not have, such as ours, it says whose figure it is. The paper does not say
    whether its tests are of other recordings (L2) or of random windows (L0).
    """
    if key["level"] not in ("L0", "L2") or key["classifier"] in study.rival_names:
        return ""
    figures = paper_figures(study, key)
    if not figures:
        return ""
    text = ", ".join(
        f"{_HEADINGS[metric]} {figure}" if figure[0].isdigit() and " " not in figure else figure
        for metric, figure in figures.items()
    )
    name = key["classifier"]
    is_papers = name.startswith("paper_") or name == "bitcn_paper"
    is_papers = is_papers or (_names_classifier(study, key) and not name.startswith(("spectral_", "bitcn")))
    return text if is_papers else f"the paper's BiTCN: {text}"


def paper_figures(study: StudyResult, key: Mapping[str, str]) -> Mapping[str, str]:
    """By metric, what the paper prints for the row of some factors; empty where it prints nothing."""
    return next((figures for _, figures in _matches(study, key)), {})


def _names_classifier(study: StudyResult, key: Mapping[str, str]) -> bool:
    """Whether the paper's row is of one classifier."""
    return any("classifier" in conditions for conditions, _ in _matches(study, key)[:1])


def _matches(study: StudyResult, key: Mapping[str, str]) -> list[tuple[Mapping[str, str], Mapping[str, str]]]:
    return [
        (conditions, figures)
        for name, conditions, figures in REPORTED
        if name == _paper_name(study) and conditions.items() <= key.items()
    ]


def _paper_name(study: StudyResult) -> str:
    return study.study.removeprefix(PAPER_STUDY).removesuffix("-random")
