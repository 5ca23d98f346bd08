"""Manifests: which recordings had a part in something, by name and by content.

A manifest maps the id of each recording to the hashes of its channels (`Recording.content_hashes`),
their `fingerprints` and their `sample_patterns`, or to nothing if its content is unknown. Content
decides; the name does only if the content of one side is unknown.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from swashtwin.recordings.findings import join_names
from swashtwin.recordings.fingerprints import (
    FINGERPRINT_MARK,
    compute_fingerprints,
    find_altered_copies,
    find_altered_pairs,
    read_beginning,
)
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.sample_patterns import (
    PATTERN_MARK,
    compute_patterns,
    find_shared_pairs,
    find_shared_patterns,
)

CONTENT_MARKS = (FINGERPRINT_MARK, PATTERN_MARK)
"""First characters of the texts of a manifest that are not hashes."""

# Samples above this are not measured, and their squares may not be finite.
#
# A number of double precision, which a comparison with samples of single precision keeps.
_MAX_SAMPLE = np.float64(1e100)

Manifest = Mapping[str, tuple[str, ...]]
"""Hashes, fingerprints and patterns of the content of each recording, by its id."""


def build_manifest(recordings: Iterable[Recording]) -> dict[str, tuple[str, ...]]:
    """Return the manifest of recordings; their samples are read once."""
    manifests = []
    for recording in recordings:
        manifests.append({recording.recording_id: describe_content(recording)})
    return join_manifests(manifests)


def describe_content(recording: Recording) -> tuple[str, ...]:
    """Return the hashes, fingerprints and patterns of a recording's channels."""
    beginning = read_beginning(recording)
    is_usable = (np.abs(beginning) < _MAX_SAMPLE).all(axis=1)  # not so if a sample is missing
    beginning = beginning[is_usable]
    patterns = [compute_patterns(channel) for channel in beginning]
    return (
        *recording.content_hashes(),
        *compute_fingerprints(beginning, float(recording.sample_rate)),
        *filter(None, patterns),
    )


def join_manifests(manifests: "Iterable[Manifest | Iterable[str]]") -> dict[str, tuple[str, ...]]:
    """Return one manifest of several, by id; mere ids are recordings of unknown content.

    Examples
    --------
    >>> join_manifests([{"b": ("1f",)}, ["a"], {"b": ("2e",)}])
    {'a': (), 'b': ('1f', '2e')}
    """
    joined: dict[str, set[str]] = {}
    for manifest in manifests:
        for name in manifest:
            hashes = manifest[name] if isinstance(manifest, Mapping) else ()
            joined.setdefault(str(name), set()).update(hashes)
    return {name: tuple(sorted(joined[name])) for name in sorted(joined)}


def find_exact_copies(manifest: "Manifest | Iterable[str]", recordings: Manifest) -> dict[str, str]:
    """Return those of `recordings` whose unaltered samples are in `manifest`: its id by their id.

    A recording is in it if it shares the content of a channel with one of the manifest, whatever
    both are called; if the content of either is unknown, if the names are the same. Altered copies
    are found by `find_copies`, whose cost grows with the manifest.

    Examples
    --------
    >>> recordings = {"a": ("2e",), "copy of a": ("1f",), "twin": ("3d",)}
    >>> find_exact_copies({"a": ("1f",), "twin": ()}, recordings)
    {'copy of a': 'a', 'twin': 'twin'}
    """
    listed = join_manifests([manifest])
    names = {digest: name for name, hashes in listed.items() for digest in hashes}

    copies: dict[str, str] = {}
    for name, hashes in recordings.items():
        original = _first_match(hashes, names)
        if original is not None:
            copies[name] = original
        elif name in listed and not (hashes and listed[name]):
            copies[name] = name
    return copies


def find_copies(manifest: "Manifest | Iterable[str]", recordings: Manifest) -> dict[str, str]:
    """Return those of `recordings` that are in `manifest`, altered or not: its id by their id.

    Besides `find_exact_copies` these are recordings that were put together from blocks of others
    (`find_shared_patterns`), and copies that were cut, filtered, scaled, resampled or reversed
    (`find_altered_copies`).
    """
    listed = join_manifests([manifest])
    copies = find_exact_copies(listed, recordings)

    remaining = {name: content for name, content in recordings.items() if name not in copies}
    copies |= find_shared_patterns(
        _select_content(listed, PATTERN_MARK), _select_content(remaining, PATTERN_MARK)
    )

    remaining = {name: content for name, content in recordings.items() if name not in copies}
    altered = find_altered_copies(
        _select_content(listed, FINGERPRINT_MARK), _select_content(remaining, FINGERPRINT_MARK)
    )
    return {**copies, **altered}


def find_duplicates(manifest: Manifest) -> dict[str, str]:
    """Return recordings that are copies of an earlier one of the manifest: its id by their id.

    They share the content of a channel, or are copies as `find_copies` detects them. A recording
    that is a copy only of such copies is not one of them: consecutive parts that overlap are
    copies of their neighbors, but every second part holds other samples.
    """
    altered: dict[str, list[str]] = {}
    for later, earlier in find_altered_duplicates(manifest):
        altered.setdefault(later, []).append(earlier)

    duplicates: dict[str, str] = {}
    names: dict[str, str] = {}
    for name, hashes in manifest.items():
        original = _first_match(hashes, names)
        if original is None:
            distinct = [other for other in altered.get(name, ()) if other not in duplicates]
            original = next(iter(distinct), None)
        if original is not None:
            duplicates[name] = original
            continue
        for digest in hashes:
            names[digest] = name
    return duplicates


def find_altered_duplicates(manifest: Manifest) -> list[tuple[str, str]]:
    """Return the pairs of recordings that are altered or overlapping copies: (later, earlier)."""
    pairs = [
        *find_shared_pairs(_select_content(manifest, PATTERN_MARK)),
        *find_altered_pairs(_select_content(manifest, FINGERPRINT_MARK)),
    ]
    return list(dict.fromkeys(pairs))


def describe_copies(copies: Mapping[str, str]) -> str:
    """Return the first result of `find_copies`, and how many more, to begin a sentence with.

    Examples
    --------
    >>> describe_copies({"new": "a", "b": "b"})
    'recording new, of the same measurement as a, and 1 more'
    """
    name, original = next(iter(copies.items()))
    text = f"recording {name}"
    if name != original:
        text += f", of the same measurement as {original},"
    if len(copies) > 1:
        text += f" and {len(copies) - 1} more"
    return text


def describe_duplicates(duplicates: Mapping[str, str], consequence: str) -> list[str]:
    """Return a note on the result of `find_duplicates`; none if there is no duplicate.

    Parameters
    ----------
    consequence : rest of the sentence.

    Examples
    --------
    >>> describe_duplicates({"b": "a"}, "not counted.")
    ['b holds samples of the same measurement as a (altered, overlapping or equal); not counted.']
    """
    if not duplicates:
        return []
    if len(duplicates) == 1:
        ((name, original),) = duplicates.items()
        subject = f"{name} holds samples of the same measurement as {original}"
    else:
        names = join_names(list(duplicates))
        subject = (
            f"{len(duplicates)} recordings, {names}, hold samples of the same measurements as "
            "others"
        )
    return [f"{subject} (altered, overlapping or equal); {consequence}"]


def _first_match(hashes: Iterable[str], names: Mapping[str, str]) -> str | None:
    return next((names[digest] for digest in hashes if digest in names), None)


def _select_content(manifest: Manifest, mark: str) -> dict[str, list[str]]:
    """Return the texts of each recording that begin with a mark."""
    selected = {}
    for name, content in manifest.items():
        selected[name] = [text for text in content if text.startswith(mark)]
    return selected
