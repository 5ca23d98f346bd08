"""WAV files, as data recorders and sound cards write them."""

import struct
from pathlib import Path

import numpy as np

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings.columns import SideBySide
from swashtwin.recordings.formats.raw import Options, RawFile, load_extra, require_plausible_size
from swashtwin.recordings.recording import Recording

_UNPACKED = (1, 3, 0xFFFE)
"""Kinds of coding whose frames all have one size: integers, floats, and either with more said of them."""
_SINGLE = ("PCM_S8", "PCM_U8", "PCM_16", "PCM_24", "FLOAT")
"""Codings whose samples single precision holds to the last bit."""
_UNKNOWN_SIZE = 0x7FFFF000
"""A header that was written before the length was known says this or more [bytes]."""


def read(path: Path, options: Options) -> RawFile:
    """Channels of a WAV file; integer files yield shares of full scale, which need a calibration factor."""
    with path.open("rb") as file:
        head = file.read(1 << 16)
    _require_one_story(head, path)
    stated = int.from_bytes(head[4:8], "little") + 8
    if head[:4] == b"RIFF" and stated < _UNKNOWN_SIZE and stated > path.stat().st_size:
        raise DataError(f"{path} is cut off: its header states {stated} bytes, it has {path.stat().st_size}.")
    sound = load_extra("soundfile").SoundFile(str(path))
    require_plausible_size(path, 2 * sound.frames * sound.channels, f"{sound.frames} samples")

    kind = "float32" if sound.subtype in _SINGLE else "float64"

    def frames(start: int, stop: int) -> np.ndarray:
        sound.seek(start)
        signal = sound.read(stop - start, dtype=kind, always_2d=True)
        if len(signal) != stop - start:
            raise DataError(f"{path} is cut off: {start + len(signal)} of {sound.frames} samples are there.")
        return np.ascontiguousarray(signal.T)

    columns = SideBySide(frames, (sound.channels, sound.frames), np.dtype(kind)).columns()
    named = {f"channel_{number}": column for number, column in enumerate(columns)}
    return RawFile(named, float(sound.samplerate), full_scale=sound.subtype not in ("FLOAT", "DOUBLE"))


def _require_one_story(head: bytes, path: Path) -> None:
    """Refuse a header whose rate does not fit the bytes per second beside it: one of the two is damaged."""
    at = 12
    while head[at : at + 4] not in (b"fmt ", b""):
        at += 8 + int.from_bytes(head[at + 4 : at + 8], "little")
    if head[:4] not in (b"RIFF", b"RF64") or len(head) < at + 24:
        return
    kind, channels, rate, per_second, per_frame, bits = struct.unpack_from("<HHIIHH", head, at + 8)
    if kind in _UNPACKED and (per_second != rate * per_frame or per_frame != channels * ((bits + 7) // 8)):
        raise DataError(
            f"{path} is damaged: {rate} Hz of {channels} channels with {bits} bits are not the {per_second} bytes per "
            f"second and {per_frame} bytes per sample that its header states beside them."
        )


def write(recording: Recording, path: Path) -> None:
    """Write samples in their own unit as 32-bit floats; the unit belongs in the index, WAV has no place for it."""
    if recording.sample_rate != round(recording.sample_rate):
        raise InputError(
            f"{recording.recording_id}: a WAV file holds whole rates only, not {recording.sample_rate!r} Hz; write .h5."
        )
    soundfile = load_extra("soundfile")
    soundfile.write(str(path), recording.signal.T, int(recording.sample_rate), subtype="FLOAT", format="WAV")
