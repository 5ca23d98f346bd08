"""WAV files, as data recorders and sound cards write them."""

import struct
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, InputError, load_extra
from swashtwin.recordings.formats.columns import matrix_columns
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions, require_plausible_size
from swashtwin.recordings.recording import Recording

soundfile: Any = load_extra("soundfile", "readers", "a WAV file")

_UNPACKED = (1, 3, 0xFFFE)
"""Kinds of coding whose frames all have one size: integers, floats, and either with more said of
them.
"""
_SINGLE = ("PCM_S8", "PCM_U8", "PCM_16", "PCM_24", "FLOAT")
"""Codings whose samples single precision holds to the last bit."""
_SUBTYPES = {
    (1, 8): "PCM_U8",
    (1, 16): "PCM_16",
    (1, 24): "PCM_24",
    (1, 32): "PCM_32",
    (3, 32): "FLOAT",
    (3, 64): "DOUBLE",
}
"""What soundfile calls a kind of coding with so many bits."""
_UNKNOWN_SIZE = 0x7FFFF000
"""A header that was written before the length was known says this or more [bytes]."""


def read(path: Path, options: ReadOptions) -> RawFile:
    """Channels of a WAV file; integer files yield shares of full scale, which need a
    sensitivity.
    """
    with path.open("rb") as file:
        head = file.read(1 << 16)
    sound = _opened(path, head)
    require_plausible_size(path, 2 * sound.frames * sound.channels, f"{sound.frames} samples")

    kind = "float32" if sound.subtype in _SINGLE else "float64"

    def frames(start: int, stop: int) -> np.ndarray:
        sound.seek(start)
        signal = sound.read(stop - start, dtype=kind, always_2d=True)
        if len(signal) != stop - start:
            raise DataError(
                f"{path} is cut off: {start + len(signal)} of {sound.frames} samples are there."
            )
        return np.ascontiguousarray(signal.T)

    columns = matrix_columns(frames, (sound.channels, sound.frames), np.dtype(kind))
    named = {f"channel_{number}": column for number, column in enumerate(columns)}
    return RawFile(
        named, float(sound.samplerate), full_scale=sound.subtype not in ("FLOAT", "DOUBLE")
    )


def _opened(path: Path, head: bytes) -> Any:
    """The file as soundfile opens it; where the sizes in its header are wrong, the length of the
    file is believed.

    A recorder that lost power leaves a size of zero, and sizes above 4 GiB wrap. A rate that does
    not fit the bytes per second beside it is refused: one of the two is damaged.
    """
    size = path.stat().st_size
    data, layout = _chunk(head, b"data"), _chunk(head, b"fmt ")
    if head[:4] not in (b"RIFF", b"RF64") or layout is None or len(head) < layout + 16:
        return soundfile.SoundFile(str(path))
    kind, channels, rate, per_second, per_frame, bits = struct.unpack_from("<HHIIHH", head, layout)
    if kind in _UNPACKED and (
        per_second != rate * per_frame or per_frame != channels * ((bits + 7) // 8)
    ):
        raise DataError(
            f"{path} is damaged: {rate} Hz of {channels} channels with {bits} bits are not the {per_second} bytes per "
            f"second and {per_frame} bytes per sample that its header states beside them."
        )
    if head[:4] != b"RIFF" or data is None:
        return soundfile.SoundFile(str(path))
    stated = int.from_bytes(head[data - 4 : data], "little")
    is_unknown = stated == 0 or stated >= _UNKNOWN_SIZE
    if data + stated > size and not is_unknown:
        raise DataError(
            f"{path} is cut off: its header states {stated} bytes of samples, it has {size - data}."
        )
    with path.open("rb") as file:
        file.seek(data + stated + stated % 2)
        after = file.read(1 << 20)
        is_chunk = len(after) >= 4 and all(32 <= byte < 127 for byte in after[:4])
        is_padding = len(after) < channels * bits // 8
        if not is_unknown and not is_chunk and not is_padding:
            while after and not after.strip(b"\0"):
                after = file.read(1 << 20)
            is_padding = not after
    if not is_unknown and (is_chunk or is_padding):
        return soundfile.SoundFile(str(path))
    if kind == 0xFFFE and len(head) >= layout + 26:
        kind = int.from_bytes(head[layout + 24 : layout + 26], "little")
    subtype = _SUBTYPES.get((kind, bits))
    if subtype is None or size - data < 2 * channels * bits // 8:
        raise DataError(
            f"{path}: its header was never finished: it states {stated} bytes of samples; repair it."
        )
    stream = _Tail(path, data)
    return soundfile.SoundFile(
        stream, format="RAW", channels=channels, samplerate=rate, subtype=subtype, endian="LITTLE"
    )


def _chunk(head: bytes, name: bytes) -> int | None:
    at = 12
    while at + 8 <= len(head):
        if head[at : at + 4] == name:
            return at + 8
        length = int.from_bytes(head[at + 4 : at + 8], "little")
        at += 8 + length + length % 2
    return None


class _Tail:
    """A file without its first bytes."""

    def __init__(self, path: Path, first: int) -> None:
        self._file, self._first = path.open("rb"), first
        self._file.seek(first)
        self.read, self.readinto = self._file.read, self._file.readinto

    def seek(self, offset: int, whence: int = 0) -> int:
        """Offset [byte] that was gone to."""
        return self._file.seek(offset + (self._first if whence == 0 else 0), whence) - self._first

    def tell(self) -> int:
        return self._file.tell() - self._first


def write(recording: Recording, path: Path) -> None:
    """Write samples in their own unit as 32-bit floats; the unit belongs in the index, WAV has no
    place for it.
    """
    if recording.sample_rate != round(recording.sample_rate):
        raise InputError(
            f"{recording.recording_id}: a WAV file holds whole rates only, not {recording.sample_rate!r} Hz; write .h5."
        )
    soundfile.write(
        str(path), recording.signal.T, int(recording.sample_rate), subtype="FLOAT", format="WAV"
    )
