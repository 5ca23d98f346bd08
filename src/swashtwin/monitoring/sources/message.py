"""One message of a broker as a recording: a line of JSON, then float32 samples or a whole file.

The line states ``machine``, ``rate``, ``unit``, ``channels`` (a list of names) and what else is known by the names of
`FACTS`. Samples follow as little-endian float32, all channels of the first instant, then of the second. Where the line
states ``file``, a name such as ``"a.wav"``, the bytes of such a file follow instead.
"""

import json
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, InputError, parse
from swashtwin.monitoring.sources.delivery import LARGEST, Delivery, UnfitError, channel_names, check_facts
from swashtwin.recordings import Recording, acceleration_factor

SAMPLES = ".f32"
"""Suffix of the samples of a message in the spool."""
_LONGEST_HEADER = 1 << 16


def read_message(payload: bytes, source: str, received: datetime, machine: str | None) -> tuple[Delivery, bytes]:
    """(what the message says of its recording, the content behind its first line).

    A message that cannot be one is a delivery with its `problem`, and its payload as content; of one that is too large
    the beginning.

    Parameters
    ----------
    machine : machine that the topic or the configuration names, where the message does not.
    """
    if len(payload) > LARGEST:
        problem = f"a message has {len(payload)} bytes; at most {LARGEST} are taken: send shorter recordings."
        return Delivery(source, "message.bin", received, machine, {}, problem=problem), payload[:_LONGEST_HEADER]
    try:
        header, content = _header(payload)
        stated = header.pop("machine", machine)
        if stated is not None and not (isinstance(stated, str) and stated):
            raise InputError('machine must be text, such as "pump-1".')
        name = header.pop("file", None)
        if name is not None and not isinstance(name, str):
            raise InputError('file must be text, such as "a.wav".')
        if isinstance(channels := header.get("channels"), list):
            header["channels"] = ",".join(map(str, channels))
        facts = check_facts(header)
        if name is None and (missing := [key for key in ("rate", "unit", "channels") if key not in facts]):
            raise InputError(f"its first line states no {missing[0]}.")
    except (InputError, DataError) as cause:
        return Delivery(source, "message.bin", received, machine, {}, problem=f"a message is broken: {cause}"), payload
    return Delivery(source, name or f"message{SAMPLES}", received, stated, facts), content


def _header(payload: bytes) -> tuple[dict[str, Any], bytes]:
    end = payload.find(b"\n", 0, _LONGEST_HEADER)
    if end < 0:
        raise InputError("it has no line of JSON before its samples.")
    try:
        header = json.loads(payload[:end].decode("utf-8"))
    except (ValueError, RecursionError):
        raise InputError("its first line is no JSON.") from None
    if not isinstance(header, dict):
        raise InputError("its first line is no JSON object.")
    return header, payload[end + 1 :]


def samples_recording(path: Path, facts: Mapping[str, str], name: str) -> Recording:
    """The recording of a message's samples, in the spool at `path`.

    Raises
    ------
    UnfitError
        The samples are no whole number of instants.
    """
    channels = channel_names(facts["channels"])
    data = path.read_bytes()
    if not channels or not data or len(data) % (4 * len(channels)):
        count = len(channels)
        raise UnfitError("broken", f"{len(data)} bytes are no whole number of float32 samples of {count} channels.")
    factor = acceleration_factor(facts["unit"])
    samples = np.frombuffer(data, "<f4").reshape(-1, len(channels)).T * np.float64(1.0 if factor is None else factor)
    rate, unit = parse(facts["rate"], "Hz", name="rate"), facts["unit"] if factor is None else "m/s^2"
    return Recording(samples, rate, name, channels=tuple(channels), unit=unit)
