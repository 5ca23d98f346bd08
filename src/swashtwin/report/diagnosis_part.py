"""Part of the page about the diagnosis of one recording."""

from matplotlib.ticker import PercentFormatter

from swashtwin.diagnosis import Diagnosis
from swashtwin.foundation import plural
from swashtwin.report.drawing import Drawing, panels, render_drawing
from swashtwin.report.page import Bullets, Cell, Paragraph, Part, Picture, Section, SectionOrder, Table
from swashtwin.report.style import class_colors, figure_style
from swashtwin.report.wording import percent, words

_NOT_CHECKED = (
    "Whether the pump has a fault of a class that was never trained: the answer is always one of the classes listed.",
    "Whether it has two faults at once.",
    "Whether pump, sensors and mounting resemble those of the training; scores at L4 show the cost of another pump.",
    "Whether the score is a probability: windows of one recording are not independent, so it only ranks the classes.",
)
_NOT_CHECKED_BY_TRUST = (
    _NOT_CHECKED[1],
    "Whether this recording resembles those that calibrated the confidence: rates and thresholds hold only for their "
    "pumps, sensors, mountings and conditions.",
    "A fault never trained that looks like a trained class: only recordings far from all trained classes are called "
    "unknown.",
)


def diagnosis_part(diagnosis: Diagnosis, key: str) -> Part:
    """Part of the page about one diagnosis."""
    if diagnosis.label is None:
        return _no_verdict_part(diagnosis)
    agreeing = round(diagnosis.agreement * diagnosis.n_windows)
    trust = diagnosis.trust
    kind = "score" if trust is None else "probability"
    answer = (
        f"Recording {diagnosis.recording_id}: {words(diagnosis.label)}. Taken alone, {agreeing} of "
        f"{diagnosis.n_windows} windows say so ({percent(diagnosis.agreement)}); all windows together give this class "
        f"a {kind} of {percent(diagnosis.probabilities[diagnosis.label])} among {len(diagnosis.probabilities)} "
        "classes.",
        *(() if trust is None else (trust.sentence(),)),
    )
    blocks = (
        Bullets("What to know before trusting it", diagnosis.notes),
        Picture(probability_drawing(diagnosis, key)),
        Picture(window_drawing(diagnosis, key)),
        *_choice_blocks(diagnosis),
        Bullets("What was not checked", _NOT_CHECKED if trust is None else _NOT_CHECKED_BY_TRUST),
    )
    return Part(
        title=f"Diagnosis of {diagnosis.recording_id}",
        answer=answer,
        notice="",
        sections=(Section(SectionOrder.VERDICT, f"Diagnosis of {diagnosis.recording_id}", blocks),),
        results={"diagnoses": [diagnosis.to_dict()]},
    )


def _choice_blocks(diagnosis: Diagnosis) -> tuple[Paragraph | Table, ...]:
    """How the model was chosen, where training chose it."""
    choice = diagnosis.choice
    if choice is None:
        return ()
    rows = tuple(
        (
            Cell(f"{trial.candidate} (chosen)" if trial.candidate == choice.chosen else trial.candidate),
            Cell(percent(trial.clean)),
            Cell(percent(trial.disturbed)),
            Cell("yes" if trial.is_tied else ""),
        )
        for trial in choice.trials
    )
    caption = (
        f"What training tried: share of the windows of {choice.group}s that were left out told right, mean over the "
        f"classes, {plural(choice.n_folds, 'fold')}. Of those as good as the best within one standard error the first "
        "was taken."
    )
    header = ("candidate", "as measured", "with noise, gain, speed", "as good as the best")
    return (Paragraph(choice.sentence()), *((Table(caption, header, rows),) if rows else ()))


def _no_verdict_part(diagnosis: Diagnosis) -> Part:
    title = f"Diagnosis of {diagnosis.recording_id}"
    reason = f"Recording {diagnosis.recording_id}: no verdict. {diagnosis.no_verdict}"
    blocks = (Bullets("Why there is no verdict", (diagnosis.no_verdict or "",)), Bullets("Notes", diagnosis.notes))
    section = Section(SectionOrder.VERDICT, title, blocks)
    return Part(title, (reason,), "", (section,), {"diagnoses": [diagnosis.to_dict()]})


@figure_style()
def probability_drawing(diagnosis: Diagnosis, key: str) -> Drawing:
    """Score of each class."""
    classes, shares = list(diagnosis.probabilities), list(diagnosis.probabilities.values())
    colors = class_colors(classes)
    figure, axes = panels(1, 1, 0.9 + 0.34 * len(classes))
    panel = axes[0, 0]
    panel.barh(range(len(classes)), shares, color=[colors[name] for name in classes], height=0.7)
    for height, share in enumerate(shares):
        panel.text(share + 0.01, height, percent(share), va="center", fontsize=9)
    panel.set(yticks=range(len(classes)), yticklabels=[words(name) for name in classes], xlim=(0, 1.1))
    kind = "score" if diagnosis.trust is None else "probability"
    panel.set_xlabel(f"{kind} of the class, all windows together")
    panel.xaxis.set_major_formatter(PercentFormatter(1, symbol=" %"))
    panel.set_xticks([0, 0.2, 0.4, 0.6, 0.8, 1])
    panel.invert_yaxis()
    panel.grid(axis="y", visible=False)
    caption = "From the mean log-probability over the windows. It ranks the classes and is no calibrated probability."
    if diagnosis.trust is not None:
        possible = ", ".join(words(name) for name in diagnosis.trust.prediction_set)
        caption = (
            "Pooled over the windows, with the temperature and the dependence of windows by "
            f"{diagnosis.trust.basis}. Not ruled out at an error rate of {percent(diagnosis.trust.error_rate)}: "
            f"{possible}."
        )
    columns: dict[str, list] = {"class": classes, "score": shares}
    return render_drawing(f"{key}_scores", figure, columns, title=f"{kind.capitalize()} of each class", caption=caption)


@figure_style()
def window_drawing(diagnosis: Diagnosis, key: str) -> Drawing:
    """Class of each window in order of time."""
    classes, number = list(diagnosis.probabilities), list(range(1, diagnosis.n_windows + 1))
    colors = class_colors(classes)
    figure, axes = panels(1, 1, 0.9 + 0.34 * len(classes))
    panel = axes[0, 0]
    labels = [name or "" for name in diagnosis.window_labels]
    heights = [classes.index(name) for name in labels]
    panel.scatter(number, heights, c=[colors[name] for name in labels], marker="s", s=22)
    panel.set(
        yticks=range(len(classes)), yticklabels=[words(name) for name in classes], xlabel="window, in order of time"
    )
    panel.set(ylim=(len(classes) - 0.5, -0.5), xlim=(0.3, len(number) + 0.7))
    panel.xaxis.get_major_locator().set_params(integer=True)
    caption = "The likeliest class of each window alone."
    columns: dict[str, list] = {"window": number, "class": labels}
    return render_drawing(f"{key}_windows", figure, columns, title="Class of each window", caption=caption)
