"""Part of the page about the test of a detector of deviations."""

from swashtwin.diagnosis import AlarmScores
from swashtwin.foundation import plural
from swashtwin.plot import words
from swashtwin.pump import is_healthy
from swashtwin.report.page import Cell, Part, Section, SectionOrder, Table
from swashtwin.report.wording import number, percent


def alarms_part(scores: AlarmScores, key: str) -> Part:
    """Part of the page about the alarms on one test set.

    Parameters
    ----------
    key : not used; it has no figures.
    """
    healthy = [item for item in scores.classes if is_healthy(item.label)]
    faulty = [item for item in scores.classes if not is_healthy(item.label)]
    alarms, total = (sum(getattr(item, name) for item in faulty) for name in ("n_alarms", "n_recordings"))
    rows = tuple(
        (
            Cell(words(item.label)),
            Cell(str(item.n_recordings)),
            Cell(str(item.n_no_verdict)),
            Cell(str(item.n_alarms)),
            Cell(percent(item.share)),
            Cell(f"{percent(item.interval[0])} to {percent(item.interval[1])}"),
            Cell(number(item.auroc)),
        )
        for item in scores.classes
    )
    header = ("class", "recordings", "no verdict", "alarms", "share", "95 % interval", "AUROC")
    table = Table("Alarms by class. AUROC is of the class against the healthy recordings.", header, rows)
    return Part(
        title="Test of a detector of deviations",
        answer=tuple(
            f"Of {plural(item.n_recordings, 'healthy recording')}, {item.n_alarms} raised a false alarm."
            for item in healthy
        )
        or ("No healthy recording was tested, so this test says nothing about false alarms.",),
        notice="",
        sections=(Section(SectionOrder.SCORES, "Alarms", (table,)),),
        results={"alarms": [scores.to_dict()]},
        verdict=f"{alarms} of {plural(total, 'faulty recording')} raised an alarm" if faulty else "No fault tested",
        certainty=(f"The detector states a false-alarm rate of {percent(scores.error_rate)}.",),
        actions=(
            *(() if healthy else ("Test it on healthy recordings that had no part in it.",)),
            "Use it: swashtwin diagnose MODEL FILE --report page.html.",
        ),
    )
