"""How fast the paper's network and its ablations converge: against epochs, and against seconds."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.lines import Line2D

from swashtwin.plot import figure_style, name_decades, panels, series_colors
from swashtwin.report import Cell, Drawing, Table, number, render_drawing, tabulate
from swashtwin_bench.paper.plans import MAIN
from swashtwin_bench.results.naming import classifier_words
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.runs import Run
from swashtwin_bench.studies.plan import EPOCH_TIME


def convergence_table(study: StudyResult) -> Table:
    """Epochs and CPU seconds that each network takes to a training loss that all of them reach."""
    rows = [
        (
            Cell(classifier_words(name)),
            Cell(number(float(np.mean(epochs)))),
            Cell(number(float(np.mean(seconds)))),
            Cell(number(float(np.mean([run.history[-1].loss for run in _runs(study, name)])))),
            Cell(number(float(np.mean([_epoch_s(run) for run in _runs(study, name)])))),
            Cell(str(len(epochs))),
        )
        for name, (epochs, seconds) in _times(study).items()
    ]
    return Table(
        "Convergence: the first epoch, and the CPU time until its end, at which the training loss is at most the least "
        "loss of the network that comes down least, under each seed; means over the seeds.",
        ("network", "epochs to the common loss", "seconds to it", "loss at the end", "seconds an epoch", "n"),
        tuple(rows),
    )


def convergence_sentence(study: StudyResult) -> str:
    """Epochs and seconds of each network to the common loss, and whether the full network is the first by both."""
    times = _times(study)
    if not times:
        return "no fleet has a training of every network yet."
    epochs, seconds = ({name: float(np.mean(both[kind])) for name, both in times.items()} for kind in (0, 1))
    timed = all(map(math.isfinite, seconds.values()))
    listed = "; ".join(
        f"{classifier_words(name)} {number(epochs[name])} epochs" + (f" and {number(seconds[name])} s" if timed else "")
        for name in times
    )
    if MAIN not in times or not timed:
        return f"to a training loss that all reach: {listed}" + ("." if timed else "; not every epoch was timed.")
    others = [name for name in times if name != MAIN]
    is_first = all(values[MAIN] < values[name] for values in (epochs, seconds) for name in others)
    return f"to a training loss that all reach: {listed}. The full network is {'' if is_first else 'not '}the fastest."


@figure_style()
def convergence_drawing(study: StudyResult, key: str) -> Drawing:
    """Training loss and accuracy of each network against epochs and against CPU seconds."""
    names = list(dict.fromkeys(run.task.factors["classifier"] for run in study.runs))
    colors = series_colors(names)
    figure, axes = panels(2, 2, 5.6, sharex="col", sharey="row")
    rows = []
    for name in names:
        for run in _runs(study, name):
            epoch = np.arange(1, len(run.history) + 1)
            seconds = epoch * _epoch_s(run)
            for line, quantity in enumerate(("loss", "accuracy")):
                values = [getattr(entry, quantity) for entry in run.history]
                for column, along in enumerate((epoch, seconds)):
                    axes[line, column].plot(along, values, color=colors[name], linewidth=1.2)
            rows += [
                {"network": name, "seed": run.task.seed, "epoch": entry.number, "cpu_s": at, "loss": entry.loss,
                 "accuracy": entry.accuracy}
                for entry, at in zip(run.history, seconds.tolist(), strict=True)
            ]  # fmt: skip
    axes[0, 0].set(ylabel="cross-entropy [1]", yscale="log")
    name_decades(axes[0, 0])
    axes[1, 0].set(ylabel="accuracy [1]", xlabel="epoch", ylim=(0, 1.03))
    axes[1, 1].set(xlabel="CPU time of the training [s]")
    marks = [Line2D([], [], color=colors[name], linewidth=2) for name in names]
    figure.legend(marks, [classifier_words(name) for name in names], loc="outside upper center", ncols=2)
    return render_drawing(
        f"{key}_convergence",
        figure,
        tabulate(rows),
        title="Convergence of the paper's network and its ablations",
        caption="Training windows, while the weights move; a line for each seed. An epoch counts the mean CPU time of "
        "its training's epochs. These are no test scores.",
    )


def _times(study: StudyResult) -> dict[str, tuple[list[int], list[float]]]:
    """By network, under each seed that has all of them: epochs and seconds to the loss that all reach."""
    names = list(dict.fromkeys(run.task.factors["classifier"] for run in study.runs))
    by_seed = {seed: [run for run in study.runs if run.task.seed == seed] for seed in study.seeds}
    complete = [runs for runs in by_seed.values() if len(runs) == len(names)]
    times: dict[str, tuple[list[int], list[float]]] = {name: ([], []) for name in names} if complete else {}
    for runs in complete:
        common = max(min(_losses(run)) for run in runs)
        for run in runs:
            epoch = 1 + next(index for index, loss in enumerate(_losses(run)) if loss <= common)
            epochs, seconds = times[run.task.factors["classifier"]]
            epochs.append(epoch)
            seconds.append(epoch * _epoch_s(run))
    return times


def _runs(study: StudyResult, name: str) -> list[Run]:
    return [run for run in study.runs if run.task.factors["classifier"] == name]


def _losses(run: Run) -> Sequence[float]:
    return [epoch.loss for epoch in run.history]


def _epoch_s(run: Run) -> float:
    """CPU time of an epoch [s]; NaN where none was timed."""
    return run.values.get(EPOCH_TIME, math.nan)
