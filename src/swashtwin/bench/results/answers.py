"""What came out of a study of classifiers, in sentences, whichever way it went."""

from collections.abc import Mapping, Sequence

from swashtwin.bench.results.contrasts import Contrast
from swashtwin.bench.results.naming import classifier_words, training_set_words
from swashtwin.bench.results.result import StudyResult

MOST_CONTRASTS = 4
"""Contrasts told of each level, those of classifiers by how near they come; the table has them all."""


def answer_of(study: StudyResult) -> tuple[str, ...]:
    """For each test the best row of those of as many seeds as any, and what the study compares, paired by seed."""
    rows = study.rows()
    tests = list(dict.fromkeys((row["level"], row.get("snr", "")) for row in rows))
    return tuple(_told(study, level, snr) for level, snr in tests)


def _told(study: StudyResult, level: str, snr: str) -> str:
    rows = [row for row in study.rows() if (row["level"], row.get("snr", "")) == (level, snr)]
    most = max(len(row["accuracy"]["values"]) for row in rows)
    of_all = [row for row in rows if len(row["accuracy"]["values"]) == most]
    best = max(of_all, key=lambda row: row["accuracy"]["mean"] or 0.0)
    where = f"{level}{f', {snr}' if snr else ''}"
    among = "" if len(of_all) == len(rows) else f" of those of {most} seeds"
    text = f"{where}: highest accuracy{among} {best['accuracy']['mean']:.3f} ({_named(study, best)})"
    own = [one for one in study.contrasts if (one.first["level"], one.first.get("snr", "")) == (level, snr)]
    if all(one.first["classifier"] != one.second["classifier"] for one in own):
        own.sort(key=lambda one: one.mean)
    told = [_contrast_words(one, own) for one in own[:MOST_CONTRASTS]]
    return f"{text}. {' '.join(told)}".strip()


def _named(study: StudyResult, row: Mapping[str, object]) -> str:
    return ", ".join(_words(name, str(row[name])) for name in study.factors if name not in ("level", "snr"))


def _words(factor: str, value: str) -> str:
    """A factor's value in words."""
    if factor == "classifier":
        return classifier_words(value)
    return training_set_words(value) if factor == "training_set" else value.replace("_", " ")


def _contrast_words(one: Contrast, others: Sequence[Contrast]) -> str:
    """A difference in points, with its interval, and which factor makes it."""
    factor = next(name for name in one.first if one.first[name] != one.second[name])
    held = [
        _words(name, one.first[name])
        for name in one.first
        if name not in (factor, "level", "snr") and len({other.first[name] for other in others}) > 1
    ]
    where = f" ({', '.join(held)})" if held else ""
    low, high = (100 * value for value in one.interval)
    first, second = (_words(factor, row[factor]) for row in (one.first, one.second))
    if low != low:
        return f"{first} less {second}{where}: {100 * one.mean:+.1f} points, one seed."
    clear = "" if one.is_clear else ", which may be chance"
    return f"{first} less {second}{where}: {100 * one.mean:+.1f} points ({low:+.1f} to {high:+.1f}){clear}."
