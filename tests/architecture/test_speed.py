"""The nightly comparison of speed fails at a loss of more than a fifth, and at no smaller one."""

import pytest
from benchmarks.speed import TASKS, find_falls


def row(ratio: float) -> dict[str, str]:
    return dict.fromkeys(TASKS, f"{ratio:.3f}")


@pytest.mark.parametrize(
    ("earlier", "ratio", "has_fallen"),
    [
        # without rows the reference itself is compared with
        ([], 0.81, False),
        ([], 0.79, True),
        ([2.0], 1.61, False),
        ([2.0], 1.59, True),
        # one lucky night is not the measure, nor are nights before the last five
        ([1.0, 1.0, 1.5], 0.85, False),
        ([2.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0], 0.85, False),
    ],
)
def test_a_task_that_lost_more_than_a_fifth_of_its_speed_is_named(
    earlier: list[float], ratio: float, has_fallen: bool
) -> None:
    falls = find_falls([row(value) for value in earlier], {"watch": ratio})
    assert [fall.split()[0] for fall in falls] == ["watch"] * has_fallen
