"""Part of the page about the check of a data set."""

from swashtwin.foundation import plural
from swashtwin.learning import DataCheck
from swashtwin.plot import words
from swashtwin.report.page import Bullets, Cell, Part, Section, SectionOrder, Table
from swashtwin.report.wording import number

_STATES = {"yes": "yes", "partly": "in part", "no": "no"}
_SEVERITIES = {
    "error": "Must be mended or left out",
    "warning": "Look at these",
    "note": "Worth knowing",
}

_LIMITS = (
    "The check reads the files and what their index states of them. It cannot see whether a class, a specimen or a "
    "speed was written down wrongly where the signals do not contradict it."
)


def check_part(check: DataCheck, key: str) -> Part:
    """Part of the page about one check.

    Parameters
    ----------
    key : not used; a check has no figures.
    """
    total = plural(sum(count.recordings for count in check.counts), "usable recording")
    classes = len({count.label for count in check.counts if count.label})
    uses = Table(
        "What the recordings suffice for.",
        ("", "enough?", "with what, or what is missing"),
        tuple((Cell(use.name), Cell(_STATES[use.state]), Cell(_in_words(use.reason, check))) for use in check.uses),
    )
    return Part(
        title="Check of the recordings",
        answer=(f"{total} of {classes} class{'es' * (classes != 1)}.",),
        notice="",
        sections=(
            Section(SectionOrder.VERDICT, "What can be done with them", (uses, _counts_table(check))),
            Section(SectionOrder.SCORES, "What was found", _findings(check)),
        ),
        results={"checks": [check.to_dict()]},
        verdict=check.answer,
        tone="good" if check.is_sound and check.is_enough else "bad" if not check.is_sound else "unsure",
        certainty=(_LIMITS,),
        actions=(
            *(("Train a model on them: swashtwin train INDEX.",) if check.is_sound and check.is_enough else ()),
            *(f"{use.name[:1].upper()}{use.name[1:]}: {use.reason}" for use in check.uses if use.state != "yes"),
        ),
    )


def _in_words(text: str, check: DataCheck) -> str:
    """The text with its classes in words."""
    for label in {count.label for count in check.counts if count.label}:
        text = text.replace(label, words(label))
    return text


def _counts_table(check: DataCheck) -> Table:
    """Recordings by class and condition, and specimens of each class."""
    conditions = list(dict.fromkeys(count.condition for count in check.counts))
    rows = []
    for label in dict.fromkeys(count.label for count in check.counts):
        counts = {count.condition: count for count in check.counts if count.label == label}
        cells = [
            Cell(f"{counts[name].recordings} ({len(counts[name].specimens) or '—'})") if name in counts else Cell("0")
            for name in conditions
        ]
        seconds = number(sum(count.seconds for count in counts.values()))
        rows.append((Cell(words(label) if label else "no class"), *cells, Cell(f"{seconds} s")))
    header = ("class", *(name if name != "-" else "condition not stated" for name in conditions), "length")
    return Table("Recordings, and in brackets specimens, by class and operating condition.", header, tuple(rows))


def _findings(check: DataCheck) -> tuple[Bullets, ...]:
    blocks = []
    for severity, title in _SEVERITIES.items():
        items = [text for kind, text in check.inspection.merged(by_kind=True) if kind == severity]
        if severity == "error":
            items += [
                f"{copy.again.recording_id}, {copy.again.channel} is a copy of {copy.first.recording_id} at another "
                "gain; use one."
                for copy in check.copies
            ]
        if severity == "warning":
            items += [f"{words(label)} was not measured at {condition}." for label, condition in check.gaps]
        if severity == "note":
            items += check.notes
        blocks.append(Bullets(title, tuple(items)))
    if not any(block.items for block in blocks):
        blocks = [Bullets("Nothing suspicious was found", ("No recording and no comparison raised a finding.",))]
    return tuple(blocks)
