"""One message of a broker as a recording: a line of JSON, then samples or a whole file.

The line states ``rate``, ``unit``, ``channels`` (a list of names), ``type`` and what else is known by the names of
`FACTS`. Little-endian samples of that type follow, all channels of the first instant, then of the second. Where the
line states ``file``, a name such as ``"a.wav"``, the bytes of such a file follow instead.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, InputError, parse, plural
from swashtwin.monitoring.sources.delivery import (
    LARGEST,
    TYPES,
    Delivery,
    UnfitError,
    channel_names,
    check_facts,
    entry_facts,
)
from swashtwin.recordings import Options, RawFile, Recording, scale

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
        for key in ("channels", "sensitivity"):
            if isinstance(texts := header.get(key), list):
                header[key] = ",".join(map(str, texts))
        if type(count := header.get("count")) is int:
            header["count"] = str(count)
        facts = check_facts(header)
        if name is None and (missing := [key for key in ("rate", "unit", "channels", "type") if key not in facts]):
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


def samples_recording(path: Path, facts: Mapping[str, str], name: str, options: Options) -> Recording:
    """The recording of a message's samples, in the spool at `path`.

    Parameters
    ----------
    options : what the configuration says of the machine's recordings; the message comes first.

    Raises
    ------
    UnfitError
        The samples are no whole number of instants, or not as many as stated.
    DataError
        The unit and the sensitivity do not fit.
    """
    channels, kind, data = channel_names(facts["channels"]), facts["type"], path.read_bytes()
    size = np.dtype(TYPES[kind]).itemsize
    if not channels or not data or len(data) % (size * len(channels)):
        raise UnfitError(
            "broken", f"{len(data)} bytes are no whole number of {kind} samples of {plural(len(channels), 'channel')}."
        )
    samples = np.frombuffer(data, TYPES[kind]).reshape(-1, len(channels)).T
    if "count" in facts and samples.shape[1] != int(facts["count"]):
        raise UnfitError("broken", f"it has {samples.shape[1]} {kind} samples of each channel, not {facts['count']}.")
    raw = RawFile(dict(zip(channels, samples, strict=True)), units=dict.fromkeys(channels, facts["unit"]))
    sensitivity = entry_facts(facts).get("sensitivity", options.sensitivity)
    factors, unit = scale(raw, replace(options, sensitivity=sensitivity), channels, "the message")
    scaled = samples * np.array(factors)[:, None]
    return Recording(scaled, parse(facts["rate"], "Hz", name="rate"), name, channels=tuple(channels), unit=unit)
