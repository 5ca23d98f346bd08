"""Classes that look wrong: one for all files, or with a machine in their names."""

import re
from collections.abc import Iterable, Mapping
from typing import Any

from swashtwin.pump import is_healthy
from swashtwin.recordings.findings import Finding
from swashtwin.recordings.path_labels import MACHINE_NAME

_MAX_LISTED_WORDS = 4


def move_machines_out_of_labels(entries: Iterable[dict[str, Any]]) -> list[Finding]:
    """Move the machine that begins each class, as in ``A_normal``, to the specimen.

    Returns
    -------
    The note about it; nothing if the classes do not begin with a machine.
    """
    labeled = [entry for entry in entries if "label" in entry and "specimen" not in entry]
    pairs = [_split_label(entry) for entry in labeled]
    are_machines = all(rest and MACHINE_NAME.fullmatch(word) for word, rest in pairs)
    # Only a healthy rest shows that the rest is the class: A_piston alone may be one.
    if len(pairs) < 2 or not are_machines or not any(is_healthy(rest) for _, rest in pairs):
        return []

    for entry, (word, rest) in zip(labeled, pairs, strict=True):
        entry["specimen"] = word
        entry["label"] = rest
    machines = ", ".join(sorted({word for word, _ in pairs}))
    message = (
        f"the classes begin with {machines}, which was read as the machine (specimen); "
        "correct the index if it is not."
    )
    return [Finding("machine_in_class", "note", None, message)]


def _split_label(entry: Mapping[str, Any]) -> tuple[str, str]:
    word, _, rest = str(entry["label"]).partition("_")
    return word, rest


def find_single_label(entries: Iterable[Mapping[str, Any]]) -> str | None:
    """Return the class of all of several files, if it is one and not that of a healthy pump."""
    labels = [entry.get("label") for entry in entries]
    if len(labels) < 2 or len(set(labels)) > 1 or is_healthy(labels[0]):
        return None
    return str(labels[0])


def label_hints(entries: Iterable[Mapping[str, Any]]) -> list[Finding]:
    """Return notes about labels: one for all files, or a first word that may be a machine."""
    labeled = [entry for entry in entries if "label" in entry]
    hints = []
    single_label = find_single_label(labeled)
    if single_label:
        message = f"every file is of the class {single_label!r}; is that a class?"
        remedy = "Specify how paths state the class with {label_pattern}."
        hints.append(Finding("single_class", "note", None, message, remedy))

    pairs = sorted({_split_label(entry) for entry in labeled})
    first_words = sorted({word for word, _ in pairs})
    have_rest = len(pairs) > 1 and all(rest for _, rest in pairs)
    if have_rest and (len(first_words) == 1 or any(is_healthy(rest) for _, rest in pairs)):
        listed = ", ".join(first_words[:_MAX_LISTED_WORDS])
        pattern = _pattern(labeled, first_words)
        remedy = f"If that is a machine, separate it from the class with {pattern}."
        hints.append(
            Finding("machine_in_class", "note", None, f"all classes begin with {listed}.", remedy)
        )
    return hints


def _pattern(labeled: Iterable[Mapping[str, Any]], first_words: Iterable[str]) -> str:
    """Return the settings that separate the words from the classes; without value if none fits."""
    machines = "|".join(map(re.escape, first_words))
    pattern = rf"(?P<specimen>{machines})[^a-zA-Z]+(?P<label>[a-zA-Z_]+)"
    for entry in labeled:
        match = re.search(pattern, entry["file"])
        if match is None or match["label"].strip("_") != _split_label(entry)[1]:
            return "{label_pattern}"

    if re.search("[{}']", pattern):
        # These characters would end the setting or its value.
        return "{label_pattern}"
    return f"{{label_pattern='{pattern}'}} and {{force=True}}, which replaces the index"
