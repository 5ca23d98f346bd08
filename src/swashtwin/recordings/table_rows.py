"""Rows of a data frame that lists files, as facts of recordings."""

from dataclasses import fields
from typing import Any

from swashtwin.foundation import InputError, closest_name
from swashtwin.recordings.entry import Entry

# Names of facts as in an index, and as in other tables.
_SYNONYMS = {"recording_id": "id", "discharge_pressure": "pressure"}
_KEYS = {field.name for field in fields(Entry)} - {"attributes"}

# How pandas and polars print a missing value.
_BLANKS = ("", "None", "nan", "NaN", "NaT", "<NA>")


def table_rows(frame: Any) -> list[dict[str, Any]]:
    """Return the arguments of `load_recording` for each row of a data frame of pandas or polars.

    Raises
    ------
    InputError
        It is not a data frame, or has no column ``file``, a misspelt one, or a blank file.
    """
    if hasattr(frame, "to_dicts"):
        rows = frame.to_dicts()
    elif hasattr(frame, "iloc"):
        rows = frame.to_dict("records")
    else:
        raise InputError(
            f"frame is a {type(frame).__name__}; give a data frame of pandas or polars with one "
            "row for each file."
        )

    columns = {str(name): _SYNONYMS.get(str(name), str(name)) for name in frame.columns}
    _require_columns(list(columns.values()))

    facts = []
    for number, row in enumerate(rows):
        cells = {str(name): value for name, value in row.items() if not _is_blank(value)}
        if "file" not in cells:
            raise InputError(f"Row {number} has no file; fill the column, or drop the row.")

        fact: dict[str, Any] = {}
        for name, value in cells.items():
            key = columns[name]
            if key not in _KEYS:
                fact.setdefault("attributes", {})[key] = str(value)
            else:
                fact[key] = str(value) if key in ("file", "id", "label", "specimen") else value
        facts.append(fact)
    return facts


def _require_columns(names: list[str]) -> None:
    if "duration" in names and "file" in names:
        raise InputError(
            "The frame is one of to_pandas, whose facts are those after reading. To select "
            "recordings, use recordings.where(ids=frame.recording_id)."
        )
    if "file" not in names:
        raise InputError(
            f"The frame has no column 'file'; it has {', '.join(names) or 'none'}. Rename the "
            "column that names the files."
        )
    for name in names:
        meant = None if name in _KEYS else closest_name(name, _KEYS)
        if meant:
            raise InputError(
                f"Unknown column {name!r}: did you mean {meant!r}? Rename it; an attribute needs "
                "a name that resembles no fact."
            )


def _is_blank(value: Any) -> bool:
    return not isinstance(value, list | tuple) and str(value).strip() in _BLANKS
