"""WAV files, as data recorders and sound cards write them."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, InputError, load_extra
from swashtwin.recordings.columns import matrix_columns
from swashtwin.recordings.formats.raw_file import (
    UNCLOSED,
    RawFile,
    ReadOptions,
    require_plausible_size,
)
from swashtwin.recordings.recording import Recording

soundfile: Any = load_extra("soundfile", "readers", "a WAV file")

# Code of a format whose sample type follows further down in its chunk.
_EXTENSIBLE = 0xFFFE

# Codes of formats whose frames all have one size: integers, floats, and extensible.
_FIXED_SIZE_FORMATS = (1, 3, _EXTENSIBLE)

# Sample types that single precision holds exactly.
_SINGLE_PRECISION = ("PCM_S8", "PCM_U8", "PCM_16", "PCM_24", "FLOAT")

# Sample types of soundfile by format code and bits.
_SUBTYPES = {
    (1, 8): "PCM_U8",
    (1, 16): "PCM_16",
    (1, 24): "PCM_24",
    (1, 32): "PCM_32",
    (3, 32): "FLOAT",
    (3, 64): "DOUBLE",
}

# Stated size [byte] from which a header was written before the length was known.
_MIN_UNKNOWN_SIZE = 0x7FFFF000

# Beginning of a file in which its chunks are searched.
_HEAD_BYTES = 1 << 16


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return the channels of a WAV file; integers are shares of full scale without a
    sensitivity.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    sound, is_unclosed = _open_sound(path, head)
    require_plausible_size(path, 2 * sound.frames * sound.channels, f"{sound.frames} samples")

    dtype = "float32" if sound.subtype in _SINGLE_PRECISION else "float64"

    def read_frames(start: int, stop: int) -> np.ndarray:
        sound.seek(start)
        signal = sound.read(stop - start, dtype=dtype, always_2d=True)
        if len(signal) != stop - start:
            raise DataError(
                f"{path} is cut off: it has {start + len(signal)} of {sound.frames} samples."
            )
        return np.ascontiguousarray(signal.T)

    columns = matrix_columns(read_frames, (sound.channels, sound.frames), np.dtype(dtype))
    named_columns = {f"channel_{number}": column for number, column in enumerate(columns)}
    is_integer = sound.subtype not in ("FLOAT", "DOUBLE")
    attributes = {UNCLOSED: "its end may be missing"} if is_unclosed else {}
    return RawFile(
        named_columns, float(sound.samplerate), attributes=attributes, full_scale=is_integer
    )


@dataclass(frozen=True)
class _Format:
    """Content of the chunk ``fmt``."""

    code: int
    channels: int
    rate: int
    bytes_per_second: int
    bytes_per_frame: int
    bits: int

    @classmethod
    def read(cls, head: bytes, offset: int) -> "_Format":
        return cls(*struct.unpack_from("<HHIIHH", head, offset))

    @property
    def is_consistent(self) -> bool:
        """Whether the sizes follow from rate, channels and bits, as they must."""
        if self.code not in _FIXED_SIZE_FORMATS:
            return True
        frame_size = self.channels * ((self.bits + 7) // 8)
        return (
            self.bytes_per_second == self.rate * self.bytes_per_frame
            and self.bytes_per_frame == frame_size
        )


def _open_sound(path: Path, head: bytes) -> tuple[Any, bool]:
    """Return the file as soundfile opens it, and whether its recorder never closed it.

    The length of the file counts if its header is wrong.

    A recorder that lost power leaves a size of zero, and sizes above 4 GiB wrap. A rate that
    contradicts the bytes per second in the header is refused: one of the two is damaged.
    """
    data_offset = _chunk_offset(head, b"data")
    format_offset = _chunk_offset(head, b"fmt ")
    has_format = format_offset is not None and len(head) >= format_offset + 16
    if head[:4] not in (b"RIFF", b"RF64") or format_offset is None or not has_format:
        return soundfile.SoundFile(str(path)), False

    wav_format = _Format.read(head, format_offset)
    if not wav_format.is_consistent:
        raise DataError(
            f"{path} is damaged: {wav_format.rate} Hz of {wav_format.channels} channels with "
            f"{wav_format.bits} bits contradict the {wav_format.bytes_per_second} bytes per second "
            f"and {wav_format.bytes_per_frame} bytes per sample that its header also states."
        )
    if head[:4] != b"RIFF" or data_offset is None:
        return soundfile.SoundFile(str(path)), False

    stated_size = int.from_bytes(head[data_offset - 4 : data_offset], "little")
    is_unknown = stated_size == 0 or stated_size >= _MIN_UNKNOWN_SIZE
    data_size = path.stat().st_size - data_offset
    if stated_size > data_size and not is_unknown:
        raise DataError(
            f"{path} is cut off: its header states {stated_size} bytes of samples, "
            f"it has {data_size}."
        )
    if not is_unknown and _ends_with_data(
        path, data_offset + stated_size + stated_size % 2, wav_format
    ):
        return soundfile.SoundFile(str(path)), False

    code = wav_format.code
    if code == _EXTENSIBLE and len(head) >= format_offset + 26:
        code = int.from_bytes(head[format_offset + 24 : format_offset + 26], "little")
    subtype = _SUBTYPES.get((code, wav_format.bits))
    if subtype is None or data_size < 2 * wav_format.channels * wav_format.bits // 8:
        raise DataError(
            f"{path}: its header was never finished: it states {stated_size} bytes of samples; "
            "repair it."
        )
    sound = soundfile.SoundFile(
        _FileFrom(path, data_offset),
        format="RAW",
        channels=wav_format.channels,
        samplerate=wav_format.rate,
        subtype=subtype,
        endian="LITTLE",
    )
    return sound, is_unknown


def _ends_with_data(path: Path, data_end: int, wav_format: _Format) -> bool:
    """Return whether nothing but another chunk, or padding, follows the stated samples.

    Anything else is samples beyond a size that wrapped.
    """
    with path.open("rb") as file:
        file.seek(data_end)
        rest = file.read(1 << 20)
        is_chunk = len(rest) >= 4 and all(32 <= byte < 127 for byte in rest[:4])
        if is_chunk or len(rest) < wav_format.channels * wav_format.bits // 8:
            return True

        while rest and not rest.strip(b"\0"):
            rest = file.read(1 << 20)
        return not rest


def _chunk_offset(head: bytes, name: bytes) -> int | None:
    """Return where the content of a chunk begins [byte], or None if it is not in the head."""
    offset = 12
    while offset + 8 <= len(head):
        if head[offset : offset + 4] == name:
            return offset + 8
        length = int.from_bytes(head[offset + 4 : offset + 8], "little")
        offset += 8 + length + length % 2  # chunks begin at even offsets
    return None


class _FileFrom:
    """A file without its first bytes."""

    def __init__(self, path: Path, start: int) -> None:
        self._file = path.open("rb")
        self._start = start
        self._file.seek(start)
        self.read = self._file.read
        self.readinto = self._file.readinto

    def seek(self, offset: int, whence: int = 0) -> int:
        """Return the new offset [byte]."""
        if whence == 0:
            offset += self._start
        return self._file.seek(offset, whence) - self._start

    def tell(self) -> int:
        return self._file.tell() - self._start


def write(recording: Recording, path: Path) -> None:
    """Write samples in the recording's unit as 32-bit floats.

    WAV has no place for the unit, which belongs in the index.
    """
    if recording.sample_rate != round(recording.sample_rate):
        raise InputError(
            f"{recording.recording_id}: a WAV file holds whole rates only, "
            f"not {recording.sample_rate!r} Hz; write .h5."
        )
    soundfile.write(
        str(path), recording.signal.T, int(recording.sample_rate), subtype="FLOAT", format="WAV"
    )
