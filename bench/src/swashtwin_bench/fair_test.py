"""The results of the second fair test, recomputed from the runs in bench/evidence.

    python -m swashtwin_bench.fair_test collect FOLDER ...    adds to bench/evidence/fair-test-2.csv
    python -m swashtwin_bench.fair_test page                  writes docs/bench/fair-test-2.md

``collect`` reads the runs in the folders in which the study was run, and keeps those that the table
already has. ``page`` replaces what stands below the marker of the page; what stands above it was
fixed before any fleet was scored.
"""

import argparse
import csv
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy import stats

from swashtwin.foundation import InputError, random_stream
from swashtwin_bench.evidence import FOLDER, PAGE
from swashtwin_bench.results.naming import format_factor
from swashtwin_bench.results.runs import Run
from swashtwin_bench.results.table import paired_interval

STUDY = "fair-test-2"
RUNS = FOLDER / f"{STUDY}.csv"
TEST_PAGE = PAGE.with_name(f"{STUDY}.md")

COMMIT = "fb65d069"
"""Commit at which all fleets were scored."""

MARKER = "<!-- Made by `python -m swashtwin_bench.fair_test page` from here on. -->\n"
"""Line of the page below which the results stand."""

SPREADS = {"1": "standard", "1-wide": "wide"}
"""Spread of the pumps by version of the rig."""

RELEVANT_DIFFERENCE = 0.05
"""Accuracy below which a gain is of no practical use, as in the first fair test."""

ERROR_RATE = 0.05
"""Family-wise rate of errors of the secondary contrasts."""

READING = (
    "**What it means.** Calibration improves windows of twins for pumps that differ widely from",
    "their drawing, if the classifier sees absolute levels and is tested on the pumps that the",
    "twins were calibrated on. That is the paper's design. With extra trees the gain is clear;",
    "the band-power network and the default training reach more without calibration than trees",
    "with it, and gain nothing clear. On new pumps, and with a healthy reference, no gain is",
    "significant after correction. Twins without the law of the recess are worse in every row.",
    "For trees on trained pumps the ceiling with the true interface values is little above the",
    "calibrated twins, and that of the rig's own lines far above: what is missing is the rest of",
    "the model, not the interface values.",
    "",
    "To fill every class instead of the missing cell alone helps nearly everywhere, and twins of",
    "either kind help over measured windows alone in every row.",
    "",
    "Windows over the mean healthy spectrum are classified worse than windows as measured, with",
    "measured windows alone too. The probable reason: the rig assembles a pump anew for each",
    "recording, so a reference of one recording adds the scatter of its assembly to each window.",
    "",
    "The paper's BiTCN, on five fleets, is below extra trees in every set and gains nothing clear",
    "by calibration; twins of either kind help it too. Why it is so low was not investigated: 30",
    "epochs, which were fixed beforehand for the time they take, may be too few.",
)
"""What the results mean, in lines of the page; it has no figure, since the tables have them."""

BOOTSTRAP_DRAWS = 2000

NEW_PUMPS = "L4"
"""Split whose test pumps were not trained on."""

TRAINED_PUMPS = "L2"
"""Split of the test on other recordings of the trained pumps."""


@dataclass(frozen=True)
class Score:
    """Recordings of a test that a classifier named right."""

    spread: str
    fleet: int
    reference: str
    classifier: str
    training_set: str
    split: str
    correct: tuple[int, ...]
    """Recordings named right of each tested pump."""
    total: tuple[int, ...]
    """Tested recordings of each pump."""
    scarce_recall: float
    """Recall of windows of the class that was not measured at this pressure."""
    run: str
    """Key of the run, which a hash of its settings and data is part of."""

    @property
    def accuracy(self) -> float:
        """Share of the recordings that were named right."""
        return sum(self.correct) / sum(self.total)


@dataclass(frozen=True)
class Contrast:
    """Difference in accuracy between two training sets, all else equal."""

    first: str
    second: str
    spread: str
    reference: str
    classifier: str
    split: str = NEW_PUMPS

    def differences(self, scores: Iterable[Score]) -> list[float]:
        """Return first less second in each fleet that has both, in the order of the fleets."""
        accuracy: dict[tuple[str, int], float] = {}
        for score in scores:
            setting = (score.spread, score.reference, score.classifier, score.split)
            if setting == (self.spread, self.reference, self.classifier, self.split):
                accuracy[score.training_set, score.fleet] = score.accuracy

        fleets = sorted(fleet for name, fleet in accuracy if name == self.first)
        return [
            accuracy[self.first, fleet] - accuracy[self.second, fleet]
            for fleet in fleets
            if (self.second, fleet) in accuracy
        ]


PRIMARY = (
    Contrast(
        "law_every_class", "no_gain_every_class", "wide", "without", "extra_trees", TRAINED_PUMPS
    ),
    # windows of 80 ms are not compared with healthy ones in the default training
    Contrast("nominal_every_class", "nominal", "standard", "without", "chosen"),
)
"""The two primary contrasts, in the order of the page."""

SECONDARY_PAIRS = (
    ("law_every_class", "no_gain_every_class"),
    ("law_every_class", "nominal_every_class"),
    ("law_every_class", "calibrated_every_class"),
    ("ceiling_true_every_class", "no_gain_every_class"),
    ("ceiling_perfect_every_class", "no_gain_every_class"),
    ("nominal_every_class", "nominal"),
    ("nominal_every_class", "measured"),
)
"""Pairs of training sets that are compared for every spread, regime, classifier and test."""


def collect_runs(folders: Sequence[Path]) -> list[Score]:
    """Return the scores of all runs of the study in some folders, each run once.

    Raises
    ------
    InputError
        A folder has no run of the study, a run is of another rig, or two runs are of the same
        fleet and training.
    """
    scores: dict[tuple[str, ...], Score] = {}
    files_of_scores: dict[tuple[str, ...], Path] = {}
    for folder in folders:
        files = sorted(folder.glob(f"{STUDY}/*/result.json"))
        if not files:
            raise InputError(f"{folder} has no run of {STUDY}.")

        for file in files:
            run = json.loads(file.read_text(encoding="utf-8"))
            for score in _scores_of(run, file):
                test = _test_of(score)
                if test in scores and scores[test].run != score.run:
                    raise _duplicate_error(score, files_of_scores[test], file)
                scores[test] = score
                files_of_scores[test] = file

    return _sorted(scores.values())


def add_scores(table: Sequence[Score], collected: Sequence[Score]) -> list[Score]:
    """Return the scores of the table and those that were collected since.

    Raises
    ------
    InputError
        A test is in both, of two different runs: each fleet is scored once.
    """
    scores = {_test_of(score): score for score in table}
    for score in collected:
        earlier = scores.setdefault(_test_of(score), score)
        if earlier.run != score.run:
            raise InputError(
                f"{RUNS.name} has run {earlier.run}, and the folders have {score.run} of the same "
                "fleet and training. If the later one repeats it after a fix, delete the earlier "
                f"one's lines in {RUNS.name}; if not, delete the later one's folder."
            )
    return _sorted(scores.values())


def _sorted(scores: Iterable[Score]) -> list[Score]:
    return sorted(scores, key=lambda score: (score.run, score.split))


def _duplicate_error(score: Score, *files: Path) -> InputError:
    """Return the error of two runs of one fleet and training, such as one before a fix."""
    earlier, later = sorted(files, key=lambda file: file.stat().st_mtime)
    return InputError(
        f"Two runs train {score.classifier} on {score.training_set}, {score.reference} reference, "
        f"for fleet {score.fleet} of the {score.spread} spread: {earlier.parent} and "
        f"{later.parent}. Delete the earlier one: {earlier.parent}."
    )


def _scores_of(run: Run, file: Path) -> Iterator[Score]:
    """Yield the scores of a run, which was read from `file`."""
    version = run["origin"].partition("version ")[2].partition(":")[0]
    if version not in SPREADS:
        raise InputError(
            f"{file.parent} is a run on version {version or 'unknown'} of the rig; {STUDY} needs "
            f"version {' or '.join(SPREADS)}. Delete this folder."
        )

    for row in run["rows"]:
        counts = list(row["correct_recordings"].values())
        yield Score(
            spread=SPREADS[version],
            fleet=run["seed"],
            reference=run["factors"]["reference"],
            classifier=run["factors"]["classifier"],
            training_set=run["factors"]["training_set"],
            split=row["split"],
            correct=tuple(count[0] for count in counts),
            total=tuple(count[1] for count in counts),
            scarce_recall=row["scarce_recall"],
            run=run["key"],
        )


def write_scores(scores: Sequence[Score], path: Path = RUNS) -> None:
    """Write scores as a table, a line for each test of a run."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(
            file, [column.name for column in fields(Score)], lineterminator="\n"
        )
        writer.writeheader()
        for score in scores:
            texts = {
                "correct": " ".join(map(str, score.correct)),
                "total": " ".join(map(str, score.total)),
                "scarce_recall": f"{score.scarce_recall:.4f}",
            }
            writer.writerow({**asdict(score), **texts})


def load_scores(path: Path = RUNS) -> list[Score]:
    """Return the scores of a table, none if there is no such file."""
    if not path.is_file():
        return []

    scores = []
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            score = Score(
                spread=row["spread"],
                fleet=int(row["fleet"]),
                reference=row["reference"],
                classifier=row["classifier"],
                training_set=row["training_set"],
                split=row["split"],
                correct=tuple(map(int, row["correct"].split())),
                total=tuple(map(int, row["total"].split())),
                scarce_recall=float(row["scarce_recall"]),
                run=row["run"],
            )
            scores.append(score)
    return scores


def pump_interval(scores: Sequence[Score]) -> tuple[float, float]:
    """Return the 95 % interval of the accuracy by bootstrap over fleets and their pumps.

    Recordings of a pump are no independent trials, and neither are pumps tested by one training.
    """
    correct = np.array([score.correct for score in scores])
    total = np.array([score.total for score in scores])
    n_fleets, n_pumps = total.shape

    rng = random_stream(0, "pumps of fair test 2")
    fleet = rng.integers(n_fleets, size=(BOOTSTRAP_DRAWS, n_fleets, 1))
    pump = rng.integers(n_pumps, size=(BOOTSTRAP_DRAWS, n_fleets, n_pumps))
    draws = correct[fleet, pump].sum(axis=(1, 2)) / total[fleet, pump].sum(axis=(1, 2))

    low, high = np.percentile(draws, [2.5, 97.5])
    return float(low), float(high)


def holm(p_values: Sequence[float]) -> Float[np.ndarray, " test"]:
    """Return Holm's adjusted p-values (1979), which control the family-wise error rate.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03]).round(3).tolist()
    [0.03, 0.06, 0.06]
    """
    values = np.asarray(p_values, dtype=float)
    order = np.argsort(values)
    factors = len(values) - np.arange(len(values))
    adjusted = np.empty_like(values)
    adjusted[order] = np.minimum(np.maximum.accumulate(factors * values[order]), 1.0)
    return adjusted


def describe_primary(contrast: Contrast, scores: Iterable[Score]) -> str:
    """Return the result of a primary contrast as a sentence."""
    differences = contrast.differences(scores)
    name = _name_pair(contrast.first, contrast.second)
    if len(differences) < 2:
        return f"{name}: not yet run."

    low, high = paired_interval(differences)
    if low > 0:
        verdict = "shown"
    elif high < RELEVANT_DIFFERENCE:
        verdict = "refuted for practical purposes"
    else:
        verdict = "neither shown nor refuted"
    return (
        f"{name}: **{_format_points(differences)}, {verdict}** (n = {len(differences)} fleets, "
        f"standard deviation of the differences {100 * np.std(differences, ddof=1):.1f} points)."
    )


def build_results(scores: Sequence[Score]) -> str:
    """Return what stands below the marker of the page."""
    lines = ["", "## Result"]
    if not scores:
        return "\n".join([*lines, "No reporting fleet has been scored yet.", ""])

    lines += [f"Run at commit {COMMIT}. Twins fill every class, unless *cell alone* is stated.", ""]
    for number, contrast in enumerate(PRIMARY, 1):
        lines.append(f"{number}. {describe_primary(contrast, scores)}")
    lines += ["", *READING]
    lines += ["", *_tabulate_accuracies(scores), "", *_tabulate_secondary(scores), ""]
    return "\n".join(lines)


def _tabulate_accuracies(scores: Sequence[Score]) -> list[str]:
    """Return the accuracy on new pumps by spread, regime and classifier (rows), and training set.

    The interval is that of `pump_interval`; after it stands the accuracy on trained pumps.
    """
    sets = list(dict.fromkeys(name for pair in SECONDARY_PAIRS for name in reversed(pair)))
    lines = [
        "Accuracy by recording on new pumps (95 % interval by bootstrap over fleets and pumps); on "
        "trained pumps:",
        "",
        "|spread, reference, classifier|" + "|".join(map(_name_set, sets)) + "|",
        "|" + "---|" * (len(sets) + 1),
    ]
    for setting in _settings(scores):
        cells = []
        for name in sets:
            in_row = [score for score in scores if _setting_of(score) == setting]
            of_set = [score for score in in_row if score.training_set == name]

            new = [score for score in of_set if score.split == NEW_PUMPS]
            trained = [score for score in of_set if score.split == TRAINED_PUMPS]
            cells.append(_format_accuracy(new, trained))
        lines.append("|" + "|".join([_name_setting(setting), *cells]) + "|")
    return lines


def _format_accuracy(new: Sequence[Score], trained: Sequence[Score]) -> str:
    if not new:
        return "-"
    low, high = pump_interval(new)
    accuracy = np.mean([score.accuracy for score in new])
    text = f"{accuracy:.3f} ({low:.2f}…{high:.2f})"
    if not trained:
        return text
    return f"{text}; {np.mean([score.accuracy for score in trained]):.3f}"


def _tabulate_secondary(scores: Sequence[Score]) -> list[str]:
    """Return the secondary contrasts, bold if significant after Holm's correction over all."""
    contrasts = []
    for (spread, reference, classifier), split, (first, second) in product(
        _settings(scores), (NEW_PUMPS, TRAINED_PUMPS), SECONDARY_PAIRS
    ):
        contrast = Contrast(first, second, spread, reference, classifier, split)
        if contrast not in PRIMARY and len(contrast.differences(scores)) > 1:
            contrasts.append(contrast)

    differences = [contrast.differences(scores) for contrast in contrasts]
    adjusted = holm([_p_value(values) for values in differences])
    cells = {}
    for contrast, values, p_value in zip(contrasts, differences, adjusted, strict=True):
        text = _format_points(values)
        cells[contrast] = f"**{text}**" if p_value < ERROR_RATE else text

    lines = [
        f"Differences in points, paired by fleet (95 %), secondary: bold after Holm's correction "
        f"over all {len(contrasts)}; on new pumps, then on trained ones:",
        "",
        "|spread, reference, classifier|"
        + "|".join(_name_pair(*pair) for pair in SECONDARY_PAIRS)
        + "|",
        "|" + "---|" * (len(SECONDARY_PAIRS) + 1),
    ]
    for setting in _settings(scores):
        row = [_name_setting(setting)]
        for first, second in SECONDARY_PAIRS:
            both = [
                Contrast(first, second, *setting, split) for split in (NEW_PUMPS, TRAINED_PUMPS)
            ]
            texts = [
                "primary" if contrast in PRIMARY else cells.get(contrast, "-") for contrast in both
            ]
            row.append("; ".join(texts))
        lines.append("|" + "|".join(row) + "|")
    return lines


def _p_value(differences: Sequence[float]) -> float:
    """Return the two-sided p-value of a mean difference of 0; 1 if all differences are equal."""
    if np.ptp(differences) == 0:
        return 1.0

    n_pairs = len(differences)
    statistic = np.mean(differences) / (np.std(differences, ddof=1) / math.sqrt(n_pairs))
    return float(2 * stats.t.sf(abs(statistic), n_pairs - 1))


def _setting_of(score: Score) -> tuple[str, str, str]:
    return score.spread, score.reference, score.classifier


def _test_of(score: Score) -> tuple[str, ...]:
    """Return what a test has in common with its repetition."""
    return (*_setting_of(score), score.training_set, str(score.fleet), score.split)


def _settings(scores: Iterable[Score]) -> list[tuple[str, str, str]]:
    return sorted({_setting_of(score) for score in scores})


def _name_setting(setting: tuple[str, str, str]) -> str:
    spread, reference, classifier = setting
    return f"{spread}, {reference}, {format_factor('classifier', classifier)}"


def _name_set(name: str) -> str:
    """Return the short name of a training set: they fill every class but one."""
    if name == "nominal":
        return "nominal, cell alone"
    return name.removesuffix("_every_class").replace("_", " ")


def _name_pair(first: str, second: str) -> str:
    if (first, second) == ("nominal_every_class", "nominal"):
        return "nominal: every class minus cell alone"
    return f"{_name_set(first)} minus {_name_set(second)}"


def _format_points(differences: Sequence[float]) -> str:
    low, high = (100 * limit for limit in paired_interval(differences))
    return f"{100 * np.mean(differences):+.1f} ({low:+.1f}…{high:+.1f})"


def build_page(page: str, scores: Sequence[Score]) -> str:
    """Return the page with the results of these scores.

    Raises
    ------
    InputError
        The page has no marker.
    """
    fixed, marker, _ = page.partition(MARKER)
    if not marker:
        raise InputError(f"The page has no line {MARKER.strip()!r}.")
    return fixed + marker + build_results(scores)


def main() -> None:
    """Collect the runs, or write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    actions = parser.add_subparsers(dest="action", required=True)
    actions.add_parser("page", help="write the page")
    collect = actions.add_parser("collect", help="add runs to the table")
    collect.add_argument("folders", type=Path, nargs="+", help="folders of the study")

    options = parser.parse_args()
    if options.action == "collect":
        write_scores(add_scores(load_scores(), collect_runs(options.folders)))
    page = TEST_PAGE.read_text(encoding="utf-8")
    TEST_PAGE.write_text(build_page(page, load_scores()), encoding="utf-8")


if __name__ == "__main__":
    main()
