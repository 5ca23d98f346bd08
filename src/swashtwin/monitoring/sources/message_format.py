"""The format of a recording in a message: a line of JSON, then samples or a whole file.

The line specifies ``rate``, ``unit``, ``channels`` (a list of names), ``type`` and further facts by
the names of `FACTS`. Little-endian samples of that type follow: all channels of the first instant,
then of the second. If the line specifies ``file``, a name such as ``"a.wav"``, the bytes of such a
file follow instead.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, InputError, parse_quantity, plural
from swashtwin.monitoring.sources.delivery import (
    MAX_RECORDING_BYTES,
    SAMPLE_TYPES,
    Delivery,
    RejectionError,
    accept_facts,
    channel_names,
    entry_facts,
)
from swashtwin.recordings import RawFile, ReadOptions, Recording, resolve_scaling

SAMPLES_SUFFIX = ".f32"
"""Suffix of the samples of a message in the spool."""
MAX_HEADER_BYTES = 1 << 16
"""Bytes of the line of JSON; also what is kept of a message that is too large."""
REQUIRED_FACTS = ("rate", "unit", "channels", "type")
"""Facts without which samples cannot be read."""
INVALID_MESSAGE_FILE = "message.bin"
"""Name of the file of a message that cannot be read."""


def read_message(
    payload: bytes, source: str, received: datetime, machine: str | None
) -> tuple[Delivery, bytes]:
    """Return what a message specifies of its recording, and the content behind its first line.

    A message that cannot be read is a delivery with its `problem` and with its payload as content;
    of one that is too large only the beginning is kept.

    Parameters
    ----------
    machine : machine of the topic or the configuration, used if the message specifies none.
    """
    if len(payload) > MAX_RECORDING_BYTES:
        problem = (
            f"a message has {len(payload)} bytes; at most {MAX_RECORDING_BYTES} are taken. "
            "Send shorter recordings."
        )
        delivery = Delivery(source, INVALID_MESSAGE_FILE, received, machine, problem=problem)
        return delivery, payload[:MAX_HEADER_BYTES]

    try:
        header, content = _split_message(payload)
        specified_machine = _read_machine(header, machine)
        file_name = _read_file_name(header)
        facts = accept_facts(_facts_as_text(header))
        if not file_name:
            _require_facts(facts)
    except (InputError, DataError) as cause:
        problem = f"invalid message: {cause}"
        delivery = Delivery(source, INVALID_MESSAGE_FILE, received, machine, problem=problem)
        return delivery, payload

    file_name = file_name or f"message{SAMPLES_SUFFIX}"
    return Delivery(source, file_name, received, specified_machine, facts), content


def _split_message(payload: bytes) -> tuple[dict[str, Any], bytes]:
    """Return the header of a message, and the bytes behind it."""
    end = payload.find(b"\n", 0, MAX_HEADER_BYTES)
    if end < 0:
        raise InputError("there is no line of JSON before the samples.")
    try:
        header = json.loads(payload[:end].decode("utf-8"))
    except (ValueError, RecursionError):
        raise InputError("the first line is not valid JSON.") from None
    if not isinstance(header, dict):
        raise InputError("the first line is not a JSON object.")
    return header, payload[end + 1 :]


def _read_machine(header: dict[str, Any], default: str | None) -> str | None:
    machine = header.pop("machine", default)
    if machine is None:
        return None
    if not isinstance(machine, str) or not machine:
        raise InputError('machine must be text, such as "pump-1".')
    return machine


def _read_file_name(header: dict[str, Any]) -> str | None:
    file_name = header.pop("file", None)
    if file_name is not None and not isinstance(file_name, str):
        raise InputError('file must be text, such as "a.wav".')
    return file_name


def _facts_as_text(header: dict[str, Any]) -> dict[str, Any]:
    """Return the header with lists and the count as text, as an upload specifies them."""
    facts = dict(header)
    for name in ("channels", "sensitivity"):
        if isinstance(facts.get(name), list):
            facts[name] = ",".join(map(str, facts[name]))
    # Not isinstance: true would be a count of 1.
    if type(facts.get("count")) is int:
        facts["count"] = str(facts["count"])
    return facts


def _require_facts(facts: Mapping[str, str]) -> None:
    for name in REQUIRED_FACTS:
        if name not in facts:
            raise InputError(f"the first line does not specify {name}.")


def samples_recording(
    path: Path, facts: Mapping[str, str], name: str, options: ReadOptions
) -> Recording:
    """Return the recording of a message's samples, in the spool at `path`.

    Parameters
    ----------
    facts : of the delivery.
    options : sensitivity that is used if the message specifies none.

    Raises
    ------
    RejectionError
        The bytes are not whole samples of all channels, or not as many as specified.
    DataError
        The unit and the sensitivity do not fit.
    """
    channels = channel_names(facts["channels"])
    sample_type = facts["type"]
    data = path.read_bytes()

    frame_size = np.dtype(SAMPLE_TYPES[sample_type]).itemsize * len(channels)
    if not channels or not data or len(data) % frame_size:
        raise RejectionError(
            "broken",
            f"{len(data)} bytes are not a whole number of {sample_type} samples of "
            f"{plural(len(channels), 'channel')}.",
        )
    samples = np.frombuffer(data, SAMPLE_TYPES[sample_type]).reshape(-1, len(channels)).T
    n_samples = samples.shape[1]
    if "count" in facts and n_samples != int(facts["count"]):
        raise RejectionError(
            "broken",
            f"the message has {n_samples} {sample_type} samples per channel, "
            f"but specifies {facts['count']}.",
        )

    raw = RawFile(
        dict(zip(channels, samples, strict=True)), units=dict.fromkeys(channels, facts["unit"])
    )
    sensitivity = entry_facts(facts).get("sensitivity", options.sensitivity)
    factors, unit = resolve_scaling(
        raw, replace(options, sensitivity=sensitivity), channels, "the message"
    )
    return Recording(
        samples * np.array(factors)[:, None],
        parse_quantity(facts["rate"], "Hz", name="rate"),
        name,
        channels=tuple(channels),
        unit=unit,
    )
