"""What recordings state of themselves, as the head of a page shows it."""

from swashtwin.recordings import RecordingFacts


def fact_entries(facts: RecordingFacts) -> tuple[tuple[str, str], ...]:
    """(name, value) of each fact that is stated."""
    entries = (
        ("Machine", facts.machine),
        ("Recorded", facts.date),
        ("Condition", facts.condition),
        ("File", facts.file),
    )
    return tuple((name, value) for name, value in entries if value)


def rig_notice(facts: RecordingFacts) -> str:
    """That recordings are of no real pump; empty unless they state that they are of the virtual rig."""
    if "virtual rig" not in facts.origin:
        return ""
    return f"Recordings of the {facts.origin}: they stand in for a machine and say nothing about any real one."
