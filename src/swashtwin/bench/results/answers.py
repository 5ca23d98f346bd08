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
    return tuple(_level_sentence(study, level, snr) for level, snr in tests)


def _level_sentence(study: StudyResult, level: str, snr: str) -> str:
    rows = [row for row in study.rows() if (row["level"], row.get("snr", "")) == (level, snr)]
    most = max(len(row["accuracy"]["values"]) for row in rows)
    of_all = [row for row in rows if len(row["accuracy"]["values"]) == most]
    best = max(of_all, key=lambda row: row["accuracy"]["mean"] or 0.0)
    where = f"{level}{f', {snr}' if snr else ''}"
    among = "" if len(of_all) == len(rows) else f" of those of {most} seeds"
    text = f"{where}: highest accuracy{among} {best['accuracy']['mean']:.3f} ({_named(study, best)})"
    matching = [
        contrast
        for contrast in study.contrasts
        if (contrast.first["level"], contrast.first.get("snr", "")) == (level, snr)
    ]
    if all(contrast.first["classifier"] != contrast.second["classifier"] for contrast in matching):
        matching.sort(key=lambda contrast: contrast.mean)
    words = [_contrast_words(contrast, matching) for contrast in matching[:MOST_CONTRASTS]]
    return f"{text}. {' '.join(words)}".strip()


def _named(study: StudyResult, row: Mapping[str, object]) -> str:
    return ", ".join(_words(name, str(row[name])) for name in study.factors if name not in ("level", "snr"))


def _words(factor: str, value: str) -> str:
    """A factor's value in words."""
    if factor == "classifier":
        return classifier_words(value)
    return training_set_words(value) if factor == "training_set" else value.replace("_", " ")


def _contrast_words(contrast: Contrast, others: Sequence[Contrast]) -> str:
    """A difference in points, with its interval, and which factor makes it."""
    factor = next(name for name in contrast.first if contrast.first[name] != contrast.second[name])
    fixed = [
        _words(name, contrast.first[name])
        for name in contrast.first
        if name not in (factor, "level", "snr") and len({other.first[name] for other in others}) > 1
    ]
    where = f" ({', '.join(fixed)})" if fixed else ""
    low, high = (100 * value for value in contrast.interval)
    first, second = (_words(factor, row[factor]) for row in (contrast.first, contrast.second))
    if low != low:
        return f"{first} less {second}{where}: {100 * contrast.mean:+.1f} points, one seed."
    clear = "" if contrast.is_clear else ", which may be chance"
    return f"{first} less {second}{where}: {100 * contrast.mean:+.1f} points ({low:+.1f} to {high:+.1f}){clear}."
