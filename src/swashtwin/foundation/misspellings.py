"""The name that somebody may have meant, for the message about a name that does not exist."""

import re
from collections.abc import Iterable

# A slip is one letter too many, too few, wrong or swapped; in a long name there may be two.
_LETTERS_PER_SLIP = 4
_MAX_SLIPS = 2

# Shorter names have no slips: nearly every other short name is one letter away.
_MIN_LETTERS_OF_SLIP = 3

# Letters from which the beginning of a name is an abbreviation of it.
_MIN_ABBREVIATION = 3


def closest_name(name: str, names: Iterable[str]) -> str | None:
    """Return the one of `names` that `name` may be a slip or an abbreviation of, or None.

    Capitals, blanks and hyphens do not count. Names with other digits are other names.

    Examples
    --------
    >>> closest_name("Swahs-plate", ["swash_plate", "valve_plate"])
    'swash_plate'
    >>> closest_name("valve", ["swash_plate", "valve_plate"])
    'valve_plate'
    >>> closest_name("swash_plate", ["normal", "valve_plate"])
    >>> closest_name("pump_2", ["pump_1"])
    >>> closest_name("lr", ["rr"])
    """
    word = _fold(name)
    max_slips = 0
    if len(word) >= _MIN_LETTERS_OF_SLIP:
        max_slips = min(_MAX_SLIPS, max(1, len(word) // _LETTERS_PER_SLIP))
    folded_names = {candidate: _fold(candidate) for candidate in sorted(names)}
    slips_by_name = {
        candidate: _count_slips(word, folded)
        for candidate, folded in folded_names.items()
        if _digits(folded) == _digits(word) and abs(len(folded) - len(word)) <= max_slips
    }
    closest = min(slips_by_name, key=slips_by_name.__getitem__, default=None)
    if closest is not None and slips_by_name[closest] <= max_slips:
        return closest

    if len(word) < _MIN_ABBREVIATION:
        return None
    longer_names = [
        candidate for candidate, folded in folded_names.items() if folded.startswith(word)
    ]
    return longer_names[0] if len(longer_names) == 1 else None


def _fold(name: str) -> str:
    return re.sub(r"[\s_-]+", "_", name.strip()).casefold()


def _digits(name: str) -> list[str]:
    return re.findall(r"\d+", name)


def _count_slips(first: str, second: str) -> int:
    """Return how many letters to insert, drop, replace or swap with the next one turn one word into
    the other (optimal string alignment).
    """
    before_previous: list[int] = []
    previous = list(range(len(second) + 1))
    for row, letter in enumerate(first, 1):
        current = [row]
        for column, other in enumerate(second, 1):
            n_slips = min(
                previous[column] + 1,
                current[column - 1] + 1,
                previous[column - 1] + (letter != other),
            )
            is_swapped = row > 1 and column > 1 and first[row - 2] == other
            if is_swapped and second[column - 2] == letter:
                n_slips = min(n_slips, before_previous[column - 2] + 1)
            current.append(n_slips)
        before_previous = previous
        previous = current
    return previous[-1]
