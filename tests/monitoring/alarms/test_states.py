"""Alarm conditions: raised by persistence with evidence, cleared after quiet recordings, the same after a restart."""

from hypothesis import given
from hypothesis import strategies as some

from swashtwin.monitoring.alarms.testing import PERSISTENCE, QUIET, RECENT, Condition

Course = some.lists(some.tuples(some.booleans(), some.booleans()), max_size=60)


def changes(course: list[tuple[bool, bool]]) -> list[str | None]:
    """What changed at each recording."""
    condition, result = Condition(), []
    for is_large, is_proven in course:
        condition, change = condition.after(is_large, is_proven=is_proven)
        result.append(change)
    return result


@given(Course)
def test_raised_and_cleared_take_turns(course: list[tuple[bool, bool]]) -> None:
    events = [change for change in changes(course) if change]
    assert events == [("raised", "cleared")[n % 2] for n in range(len(events))]


@given(Course)
def test_nothing_is_raised_without_evidence_or_without_two_large_recordings_of_three(
    course: list[tuple[bool, bool]],
) -> None:
    for number, change in enumerate(changes(course)):
        if change == "raised":
            assert course[number][1]
            assert sum(is_large for is_large, _ in course[max(number - RECENT + 1, 0) : number + 1]) >= PERSISTENCE


@given(Course)
def test_a_condition_is_cleared_exactly_after_five_quiet_recordings_in_a_row(course: list[tuple[bool, bool]]) -> None:
    raised = -1
    for number, change in enumerate(changes(course)):
        if change == "raised":
            raised = number
        quiet = [not is_large for is_large, _ in course[max(number - QUIET + 1, 0) : number + 1]]
        if raised >= 0 and number > raised:
            assert (change == "cleared") == (len(quiet) == QUIET and all(quiet))
        if change == "cleared":
            raised = -1
