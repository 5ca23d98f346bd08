"""WAV files, as data recorders and sound cards write them."""

from pathlib import Path

import numpy as np

from swashtwin.errors import DataError, InputError
from swashtwin.readers.raw import Options, RawFile, load_extra
from swashtwin.recording import Recording

_UNKNOWN_SIZE = 0x7FFFF000
"""A header that was written before the length was known says this or more [bytes]."""


def read(path: Path, options: Options) -> RawFile:
    """Channels of a WAV file; integer files yield shares of full scale, which need a calibration factor."""
    with path.open("rb") as file:
        head = file.read(12)
    stated = int.from_bytes(head[4:8], "little") + 8
    if head[:4] == b"RIFF" and stated < _UNKNOWN_SIZE and stated > path.stat().st_size:
        raise DataError(f"{path} is cut off: its header states {stated} bytes, it has {path.stat().st_size}.")
    soundfile = load_extra("soundfile")
    with soundfile.SoundFile(str(path)) as sound:
        integer = sound.subtype not in ("FLOAT", "DOUBLE")
        rate = float(sound.samplerate)
        frames = sound.frames
        signal = sound.read(dtype="float64", always_2d=True)
    if len(signal) != frames:
        raise DataError(f"{path} is cut off: {len(signal)} of {frames} readings are there.")
    columns = {f"channel_{number}": np.ascontiguousarray(row) for number, row in enumerate(signal.T)}
    return RawFile(columns, rate, full_scale=integer)


def write(recording: Recording, path: Path) -> None:
    """Write readings in their own unit as 32-bit floats; the unit belongs in the index, WAV has no place for it."""
    if recording.sample_rate != round(recording.sample_rate):
        raise InputError(
            f"{recording.recording_id}: a WAV file holds whole rates only, not {recording.sample_rate!r} Hz; write .h5."
        )
    soundfile = load_extra("soundfile")
    soundfile.write(str(path), recording.signal.T, int(recording.sample_rate), subtype="FLOAT", format="WAV")
