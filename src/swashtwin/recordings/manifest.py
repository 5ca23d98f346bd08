"""Manifests: which recordings had a part in something, by name and by content.

A manifest maps the id of each recording to the hashes of its channels (`Recording.content_hashes`)
and to their `fingerprints`, or to nothing if its content is unknown. Content decides; the name does
only if the content of one side is unknown.
"""

from collections.abc import Iterable, Mapping

from swashtwin.recordings.fingerprints import (
    FINGERPRINT_MARK,
    compute_fingerprints,
    find_altered_copies,
)
from swashtwin.recordings.recording import Recording

Manifest = Mapping[str, tuple[str, ...]]
"""Hashes and fingerprints of the content of each recording, by its id."""


def build_manifest(recordings: Iterable[Recording]) -> dict[str, tuple[str, ...]]:
    """Return the manifest of recordings; their samples are read once."""
    manifests = []
    for recording in recordings:
        content = (*recording.content_hashes(), *compute_fingerprints(recording))
        manifests.append({recording.recording_id: content})
    return join_manifests(manifests)


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

    Besides `find_exact_copies` these are copies that were cut, filtered, scaled, resampled or
    reversed (`find_altered_copies`).
    """
    listed = join_manifests([manifest])
    copies = find_exact_copies(listed, recordings)
    remaining = {name: hashes for name, hashes in recordings.items() if name not in copies}
    altered = find_altered_copies(_fingerprints_of(listed), _fingerprints_of(remaining))
    return {**copies, **altered}


def find_duplicates(manifest: Manifest) -> dict[str, str]:
    """Return recordings with the content of an earlier one of the manifest: its id by their id."""
    duplicates: dict[str, str] = {}
    names: dict[str, str] = {}
    for name, hashes in manifest.items():
        original = _first_match(hashes, names)
        if original is not None:
            duplicates[name] = original
        for digest in hashes:
            names.setdefault(digest, name)
    return duplicates


def describe_copies(copies: Mapping[str, str]) -> str:
    """Return the first result of `find_copies`, and how many more, to begin a sentence with.

    Examples
    --------
    >>> describe_copies({"new": "a", "b": "b"})
    'recording new, a copy of a, altered or not, and 1 more'
    """
    name, original = next(iter(copies.items()))
    text = f"recording {name}"
    if name != original:
        text += f", a copy of {original}, altered or not,"
    if len(copies) > 1:
        text += f" and {len(copies) - 1} more"
    return text


def _first_match(hashes: Iterable[str], names: Mapping[str, str]) -> str | None:
    return next((names[digest] for digest in hashes if digest in names), None)


def _fingerprints_of(manifest: Manifest) -> dict[str, list[str]]:
    fingerprints = {}
    for name, hashes in manifest.items():
        fingerprints[name] = [text for text in hashes if text.startswith(FINGERPRINT_MARK)]
    return fingerprints
