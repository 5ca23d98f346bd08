"""What recordings state of themselves, as the head of a page shows it."""

from swashtwin.recordings import RecordingFacts


def fact_entries(facts: RecordingFacts) -> tuple[tuple[str, str], ...]:
    """(name, value) of each fact that is stated."""
    entries = (
        _counted("Machine", facts.machine),
        ("Recorded", facts.date),
        ("Condition", facts.condition),
        _counted("File", facts.file),
    )
    return tuple((name, value) for name, value in entries if value)


def _counted(name: str, value: str) -> tuple[str, str]:
    """(name, value), the name in the plural where the value lists several or is their number."""
    count = value.removesuffix(f" {name.lower()}s")
    return (f"{name}s", count) if count != value or ", " in value else (name, value)


def rig_notice(facts: RecordingFacts) -> str:
    """That recordings are of no real pump; empty unless they state that they are of the virtual rig."""
    if "virtual rig" not in facts.origin:
        return ""
    return f"Recordings of the {facts.origin}: they stand in for a machine and say nothing about any real one."
