"""Manifests: which recordings had a part in something, by name and by content.

A manifest maps the id of each recording to the hashes of its channels (`Recording.content_hashes`) and to their
`fingerprints`, or to none where its content is not known. Content decides; only where one side has none, the name does.
"""

from collections.abc import Iterable, Mapping

from swashtwin.recordings.likeness import MARK, fingerprints, near_copies
from swashtwin.recordings.recording import Recording

Manifest = Mapping[str, tuple[str, ...]]
"""Hashes and fingerprints of the content of each recording, by its id."""


def manifest_of(recordings: Iterable[Recording]) -> dict[str, tuple[str, ...]]:
    """Manifest of recordings; their samples are read once."""
    return join_manifests(
        {recording.recording_id: (*recording.content_hashes(), *fingerprints(recording))} for recording in recordings
    )


def join_manifests(manifests: "Iterable[Manifest | Iterable[str]]") -> dict[str, tuple[str, ...]]:
    """One manifest of several, by id; mere ids are recordings whose content is not known.

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


def listed_recordings(manifest: "Manifest | Iterable[str]", recordings: Manifest) -> dict[str, str]:
    """Those of `recordings` whose samples, as they are, stand in `manifest`: id there, by id here.

    A recording is in it if it shares the content of a channel with one of the manifest, whatever both are called; where
    the content of either is not known, if the names are the same. Altered copies are those of `seen_recordings`, whose
    cost grows with the manifest.

    Examples
    --------
    >>> listed_recordings({"a": ("1f",), "twin": ()}, {"a": ("2e",), "copy of a": ("1f",), "twin": ("3d",)})
    {'copy of a': 'a', 'twin': 'twin'}
    """
    listed = join_manifests([manifest])
    names = {digest: name for name, hashes in listed.items() for digest in hashes}
    seen: dict[str, str] = {}
    for name, hashes in recordings.items():
        same = next((names[digest] for digest in hashes if digest in names), None)
        if same is not None:
            seen[name] = same
        elif name in listed and not (hashes and listed[name]):
            seen[name] = name
    return seen


def seen_recordings(manifest: "Manifest | Iterable[str]", recordings: Manifest) -> dict[str, str]:
    """Those of `recordings` that are in `manifest`, as they are or altered: id there, by id here.

    Besides `listed_recordings` these are copies that were cut, filtered, scaled, resampled or reversed (`near_copies`).
    """
    listed = join_manifests([manifest])
    seen = listed_recordings(listed, recordings)
    others = {name: hashes for name, hashes in recordings.items() if name not in seen}
    known, new = (
        {name: [text for text in entries if text.startswith(MARK)] for name, entries in manifest.items()}
        for manifest in (listed, others)
    )
    return {**seen, **near_copies(known, new)}


def repeated_recordings(manifest: Manifest) -> dict[str, str]:
    """Recordings that hold what an earlier one of the manifest holds: the id of that, by their own."""
    repeated: dict[str, str] = {}
    firsts: dict[str, str] = {}
    for name, hashes in manifest.items():
        first = next((firsts[digest] for digest in hashes if digest in firsts), None)
        if first is not None:
            repeated[name] = first
        for digest in hashes:
            firsts.setdefault(digest, name)
    return repeated


def say_seen(seen: Mapping[str, str]) -> str:
    """The first of `seen_recordings`, and how many more, to begin a sentence with."""
    name, listed = next(iter(seen.items()))
    same = "" if name == listed else f", which holds the samples of {listed}, as they are or altered,"
    more = f" and {len(seen) - 1} more" if len(seen) > 1 else ""
    return f"recording {name}{same}{more}"
