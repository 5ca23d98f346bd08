"""A measuring device that streams its samples, through openDAQ.

openDAQ reads the devices of several makers, and a reference device that generates signals. Name,
unit, scale and sample rate of a channel come from the descriptor of its signal.
"""

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import (
    DataError,
    InputError,
    closest_name,
    load_extra,
    plain_text,
)
from swashtwin.recordings import SAMPLE_RATE_RANGE_HZ, RawFile, ReadOptions, resolve_scaling

RATE_PROPERTIES = ("GlobalSampleRate", "SampleRate")
"""Properties that set the sample rate of a device or of a channel, in the order they are tried."""
RATE_TOLERANCE = 1e-3
"""Relative difference of two sample rates that count as equal: clocks of instruments differ."""
READ_TIME_S = 0.2
"""Time of samples that one read waits for."""
MAX_READ_TIME_S = 2.0
"""Time of samples that one read returns at most, if samples wait."""
MAX_BACKLOG_S = 30.0
"""Time of samples that may wait in memory; beyond it they are discarded, so that memory stays
bounded.
"""
LOST_AFTER_S = 3.0
"""Time without a sample after which a device counts as vanished."""


# Tried with openDAQ 3.40.0 and 3.40.3 on Linux.
_SOUND_CARD_PREFIX = "miniaudio:"


class DeviceChangedError(DataError):
    """The device changed what it measures: its rate or a unit."""


class DeviceLostError(DataError):
    """The device does not answer, or no longer delivers samples."""


@dataclass(frozen=True)
class DeviceSettings:
    """Which channels of which device are measured, and how."""

    device: str
    """Connection string of openDAQ, such as ``"daqref://device0"``."""
    channels: tuple[str, ...] = ()
    """Names of the channels, in this order; empty: all but the tachometer."""
    tacho: str | None = None
    """Channel with the pulses of a tachometer, which is no channel of the recordings."""
    sample_rate: float | None = None
    """Rate that the device must give [Hz]; None takes the rate that it is set to."""
    unit: str | None = None
    """Unit of channels whose descriptor states none."""
    sensitivity: str | tuple[str, ...] | None = None
    """Sensitivity of the sensors, as of a file: ``"99.7 mV/g"``."""
    properties: Mapping[str, str | bool | int | float] | None = None
    """Further properties, by their names in openDAQ: of the device, or ``"AI 1/Range"`` of a
    channel.
    """


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples of all channels."""

    signal: Float[np.ndarray, "channel time"]
    """Samples in the unit of the recording."""
    tacho: Float[np.ndarray, " time"] | None
    """Samples of the tachometer in its own unit."""
    n_missing: int
    """Samples that are missing before the block; below zero if the device's clock was set back."""
    n_discarded: int
    """Those of them that were discarded here, because they were not taken in time."""
    start: datetime
    """When the first sample arrived (UTC), by this computer's clock: that of a device may be
    unset.
    """

    def split(self, count: int, sample_rate: float) -> "tuple[Block, Block | None]":
        """Return the first `count` samples, and the others if there are any."""
        if self.signal.shape[1] <= count:
            return self, None
        first_tacho = rest_tacho = None
        if self.tacho is not None:
            first_tacho = self.tacho[:count]
            rest_tacho = self.tacho[count:]

        first = replace(self, signal=self.signal[:, :count], tacho=first_tacho)
        rest = Block(
            self.signal[:, count:],
            rest_tacho,
            n_missing=0,
            n_discarded=0,
            start=self.start + timedelta(seconds=count / sample_rate),
        )
        return first, rest


class LiveDevice:
    """A device that is open, and delivers samples from now on."""

    def __init__(self, settings: DeviceSettings) -> None:
        """Connect and set up the device.

        Raises
        ------
        MissingExtraError
            openDAQ is not installed.
        DeviceLostError
            The device does not answer.
        InputError, DataError
            It has no such channel or property, does not give the rate, or a unit is unknown.
        """
        self._daq = load_extra("opendaq", "live", "recording from a device")
        self._settings = settings
        self._instance = _open_instance()
        self._reader: Any = None
        self._device = self._connect()
        try:
            self.set_up()
        except BaseException:
            self.close()
            raise

    def _connect(self) -> Any:
        name = self._settings.device
        if name.startswith(_SOUND_CARD_PREFIX):
            raise InputError(
                f"The sound card {name!r} cannot be recorded: openDAQ's module for sound cards "
                "ends this program or never returns. Record a .wav file with another program; "
                "swashtwin reads it."
            )
        try:
            return self._instance.add_device(name)
        except RuntimeError as cause:
            raise DeviceLostError(
                f"The device {name!r} does not answer. Check its cable and address, or that no "
                f"other program uses it. {self._describe_devices()}"
            ) from cause

    def _describe_devices(self) -> str:
        """Return a sentence with the devices that can be recorded here."""
        try:
            devices = [device.connection_string for device in self._instance.available_devices]
        except RuntimeError as cause:
            return f"The devices that answer here cannot be listed: {cause}"
        names = [name for name in devices if not name.startswith(_SOUND_CARD_PREFIX)]
        return f"Devices that answer here: {', '.join(names)}."

    def set_up(self) -> None:
        """Set the device up, also again after it changed, and read it from now on.

        Raises
        ------
        DeviceLostError, InputError, DataError
            As when it is opened.
        """
        with _reporting_as_lost(self._settings.device):
            self._set_up()

    def _set_up(self) -> None:
        # Those of the device first: they decide which channels there are.
        properties = self._settings.properties or {}
        for name in sorted(properties, key=lambda name: "/" in name):
            self._set_property(name, properties[name])
        self._set_rate()

        signals = self._find_signals()
        names = self._settings.channels
        if not names:
            names = tuple(name for name in signals if name != self._settings.tacho)
        self._require_distinct(names)
        all_names = names
        if self._settings.tacho is not None:
            all_names = (*names, self._settings.tacho)
        for name in all_names:
            if name not in signals:
                raise InputError(
                    f"{self._settings.device} has no channel {name!r}. Its channels are "
                    f"{', '.join(signals)}.",
                    field="channels" if name in names else "tachometer",
                )

        self.channels: tuple[str, ...] = tuple(names)
        self._signals = [signals[name] for name in all_names]
        self.sample_rate = self._read_rate(all_names)
        self._step = _time_step(self._signals[0])
        self._require_rate()
        self._factors, self.unit = self._read_scaling()
        self._start_reading()

    def _require_distinct(self, names: Sequence[str]) -> None:
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"Channel {name!r} is given twice.", field="channels")
        if self._settings.tacho in names:
            raise InputError(
                f"{self._settings.tacho!r} is both a channel and the tachometer: the tachometer is "
                "no channel of the recordings.",
                field="channels",
            )

    def _find_signals(self) -> dict[str, Any]:
        """Return the signals that are sampled at a constant rate, by the names of their channels.

        A name that several have is followed by the part of its address that differs.
        """
        waveforms = [signal for signal in self._device.signals_recursive if _is_waveform(signal)]
        if not waveforms:
            raise DataError(f"{self._settings.device} has no channel with a constant sample rate.")

        names = [_channel_name(signal) for signal in waveforms]
        signals = {}
        for name, signal in zip(names, waveforms, strict=True):
            unique_name = name
            if names.count(name) > 1:
                unique_name = f"{name} ({signal.global_id.rpartition('/Sig/')[0]})"
            signals[unique_name] = signal
        return signals

    def _set_property(self, name: str, setting: str | bool | int | float) -> None:
        """Set a property of the device, or of a channel: ``"AI 1/Range"``."""
        channel_name, slash, property_name = name.rpartition("/")
        component = self._device
        owner = self._settings.device
        if slash:
            component = self._find_channel(channel_name)
            owner = f"Channel {channel_name!r} of {owner}"

        # One that was set before may have hidden another one, which still can be set.
        names = [entry.name for entry in component.all_properties]
        if property_name not in names:
            visible_names = [entry.name for entry in component.visible_properties]
            raise InputError(
                f"{owner} has no property {property_name!r}.{_hint(property_name, names)} Its "
                f"properties are {', '.join(visible_names)}."
            )

        try:
            value = _convert_property(component.get_property(property_name), setting)
            component.set_property_value(property_name, value)
            actual = component.get_property_value(property_name)
        except (ValueError, TypeError, RuntimeError) as cause:
            raise InputError(
                f"{owner} does not take {property_name} = {setting!r}: {str(cause).rstrip('.')}."
            ) from cause
        if not _is_same(actual, value):
            raise InputError(
                f"{owner} does not take {property_name} = {setting!r}: it sets {actual!r} instead."
            )

    def _find_channel(self, name: str) -> Any:
        """Return the channel that a name stands for, which is the name of its signal."""
        signals = self._find_signals()
        if name not in signals:
            raise InputError(
                f"{self._settings.device} has no channel {name!r}.{_hint(name, signals)} Its "
                f"channels are {', '.join(signals)}."
            )
        for channel in self._device.channels_recursive:
            ids = [signal.global_id for signal in channel.signals_recursive]
            if signals[name].global_id in ids:
                return channel
        raise InputError(f"The signal {name!r} of {self._settings.device} has no properties.")

    def _set_rate(self) -> None:
        """Set the sample rate that the settings require; whether it took is checked later."""
        rate = self._settings.sample_rate
        if rate is None:
            return
        for component in (self._device, *self._device.channels_recursive):
            names = [entry.name for entry in component.visible_properties]
            for name in RATE_PROPERTIES:
                if name in names:
                    with suppress(RuntimeError, ValueError, TypeError):
                        _set_rate_property(component, name, rate)
                    break

    def _read_rate(self, names: Sequence[str]) -> float:
        """Return the sample rate that all channels have [Hz]."""
        rates = {}
        for name, signal in zip(names, self._signals, strict=True):
            rates[name] = _sample_rate(signal)
        first = next(iter(rates.values()))
        if any(rate != first for rate in rates.values()):
            described = ", ".join(f"{name} {rate:g} Hz" for name, rate in rates.items())
            raise DataError(
                f"The channels of {self._settings.device} have different sample rates ({described}"
                "); a recording has one.",
                field="channels",
                remedy="Select {channels} of one rate.",
            )

        low, high = SAMPLE_RATE_RANGE_HZ
        if not low <= first <= high:
            raise DataError(
                f"{self._settings.device} samples at {first:g} Hz; a vibration recording has "
                f"{low:g} to {high:g} Hz.",
                field="sample_rate",
                remedy="Set {sample_rate='25.6 kHz'}.",
            )
        return first

    def _require_rate(self) -> None:
        rate = self._settings.sample_rate
        if rate is None or abs(self.sample_rate / rate - 1) <= RATE_TOLERANCE:
            return
        raise DataError(
            f"{self._settings.device} does not give a sample rate of {rate:g} Hz: it samples at "
            f"{self.sample_rate:g} Hz.",
            field="sample_rate",
            remedy=f"Set {{sample_rate='{self.sample_rate:g} Hz'}}, or leave it out.",
        )

    def _read_scaling(self) -> tuple[Float[np.ndarray, "channel 1"], str]:
        """Return the factor of each channel, and the unit that it gives."""
        units = {}
        for name, signal in zip(self.channels, self._signals, strict=False):
            unit = signal.descriptor.unit
            if unit is not None and unit.symbol:
                units[name] = unit.symbol

        raw = RawFile(dict.fromkeys(self.channels, np.empty(0)), units=units)
        options = ReadOptions(unit=self._settings.unit, sensitivity=self._settings.sensitivity)
        factors, unit = resolve_scaling(raw, options, self.channels, self._settings.device)
        return np.array(factors)[:, None], unit

    def _start_reading(self) -> None:
        types = self._daq.SampleType
        # One reader of all channels starts them at the same time.
        self._reader = self._daq.MultiReader(self._signals, types.Float64, types.Int64)
        self._next_tick: int | None = None
        self._n_discarded = 0
        self._may_have_changed = False
        self._last_sample_s = time.monotonic()

    def read(self) -> list[Block]:
        """Return the samples that arrived, as one block for each stretch without a gap.

        Raises
        ------
        DeviceChangedError
            The rate or a unit changed; the device must be set up again.
        DeviceLostError
            No sample arrived for `LOST_AFTER_S`, or openDAQ reports an error.
        """
        with _reporting_as_lost(self._settings.device):
            return self._read()

    def _read(self) -> list[Block]:
        # The event came after the samples of the previous read.
        if self._may_have_changed:
            self._require_same_scaling()
            self._may_have_changed = False

        n_waiting = self._reader.available_count
        if n_waiting > MAX_BACKLOG_S * self.sample_rate:
            self._n_discarded += int(self._reader.skip_samples(n_waiting))
            n_waiting = 0
            # An event among them is skipped, too.
            self._require_same_scaling()

        count = max(1, round(READ_TIME_S * self.sample_rate))
        if n_waiting > count:
            count = min(n_waiting, round(MAX_READ_TIME_S * self.sample_rate))
        timeout_ms = round(2000 * READ_TIME_S)
        values, ticks, status = self._reader.read_with_domain(count, timeout_ms, True)

        if values.shape[-1]:
            self._last_sample_s = time.monotonic()
            self._may_have_changed = status.read_status == self._daq.ReadStatus.Event
            return self._split_at_gaps(np.atleast_2d(values), np.atleast_2d(ticks)[0])
        if not status.valid:
            raise DeviceChangedError(self._describe_change())
        # A reader stays valid if only a unit changes, and returns samples in the new unit.
        self._require_same_scaling()
        if time.monotonic() - self._last_sample_s > LOST_AFTER_S:
            raise DeviceLostError(
                f"{self._settings.device} has delivered no sample for {LOST_AFTER_S:g} s."
            )
        return []

    def _require_same_scaling(self) -> None:
        """Raise an error if the samples are no longer in the units they had at the start."""
        name = self._settings.device
        try:
            factors, unit = self._read_scaling()
        except (InputError, DataError) as cause:
            raise DeviceChangedError(f"{name} changed a unit: {cause}") from cause
        if unit != self.unit or not np.array_equal(factors, self._factors):
            raise DeviceChangedError(f"{name} changed the unit of a channel.")

    def _split_at_gaps(self, values: np.ndarray, ticks: np.ndarray) -> list[Block]:
        # A device may round the time of its samples, but not by half the time between two.
        is_gap = np.abs(np.diff(ticks) - self._step) > self._step / 2
        bounds = [0, *(np.flatnonzero(is_gap) + 1), ticks.size]
        # Samples that wait have arrived, too.
        delay = timedelta(seconds=self._reader.available_count / self.sample_rate)
        end = datetime.now(UTC) - delay

        blocks = []
        for start, stop in pairwise(bounds):
            n_missing = 0
            if self._next_tick is not None:
                n_missing = round((int(ticks[start]) - self._next_tick) / self._step)
            self._next_tick = int(ticks[stop - 1]) + self._step
            age = (int(ticks[-1]) - int(ticks[start])) / self._step / self.sample_rate
            time_of_start = end - timedelta(seconds=age)
            blocks.append(self._block(values[:, start:stop], n_missing, time_of_start))
        return blocks

    def _block(self, values: np.ndarray, n_missing: int, start: datetime) -> Block:
        n_channels = len(self.channels)
        tacho = None
        if self._settings.tacho is not None:
            # A view would keep the samples of all channels in memory.
            tacho = values[n_channels].copy()

        n_discarded = self._n_discarded
        self._n_discarded = 0
        return Block(values[:n_channels] * self._factors, tacho, n_missing, n_discarded, start)

    def _describe_change(self) -> str:
        """Return what changed, as far as the descriptors show it."""
        name = self._settings.device
        try:
            rate = _sample_rate(self._signals[0])
        except (DataError, RuntimeError):
            return f"{name} changed how its samples are timed."
        if abs(rate / self.sample_rate - 1) > RATE_TOLERANCE:
            return f"{name} changed its sample rate from {self.sample_rate:g} to {rate:g} Hz."
        return f"{name} changed the unit, the range or the type of a channel."

    def close(self) -> None:
        """Disconnect the device."""
        self._reader = None
        self._signals = []
        with suppress(RuntimeError):  # it was removed already
            self._instance.remove_device(self._device)


@contextmanager
def _reporting_as_lost(device: str) -> Iterator[None]:
    """Raise an error of openDAQ as `DeviceLostError`, with its words."""
    try:
        yield
    except RuntimeError as cause:
        raise DeviceLostError(f"{device} does not answer: {str(cause).rstrip('.')}.") from cause


@cache
def _open_instance() -> Any:
    """Return the instance of openDAQ of this process, which loads its modules once."""
    daq = load_extra("opendaq", "live", "recording from a device")
    builder = daq.InstanceBuilder()
    # It writes each failed attempt to connect to the terminal.
    builder.global_log_level = daq.LogLevel.Off
    return builder.build()


def _is_waveform(signal: Any) -> bool:
    """Whether a signal has single numbers at a constant rate."""
    descriptor = signal.descriptor
    domain = signal.domain_signal
    if descriptor is None or domain is None or domain.descriptor is None:
        return False
    if len(descriptor.dimensions) or descriptor.sample_type.name not in _REAL_TYPES:
        return False
    rule = domain.descriptor.rule
    return domain.descriptor.tick_resolution is not None and rule.type.name == "Linear"


_REAL_TYPES = (
    *("Float32", "Float64"),
    *("Int8", "Int16", "Int32", "Int64", "UInt8", "UInt16", "UInt32", "UInt64"),
)


def _channel_name(signal: Any) -> str:
    return plain_text(signal.descriptor.name or signal.name) or signal.global_id


def _time_step(signal: Any) -> int:
    """Return the ticks between two samples."""
    parameters = dict(signal.domain_signal.descriptor.rule.parameters)
    return int(parameters["delta"])


def _sample_rate(signal: Any) -> float:
    """Return the samples per second that the domain of a signal states [Hz]."""
    resolution = signal.domain_signal.descriptor.tick_resolution
    if resolution is None:
        raise DataError(f"{signal.name} states no sample rate.")
    return float(resolution.denominator) / (_time_step(signal) * float(resolution.numerator))


def _hint(name: str, names: Iterable[str]) -> str:
    suggestion = closest_name(name, names)
    return f" Did you mean {suggestion!r}?" if suggestion else ""


def _read_choices(entry: Any) -> dict[int, str]:
    """Return the choices of a property, by the number that selects each; without choices, nothing.

    openDAQ has them as a dictionary, or as a list in which the place is the number.
    """
    choices = entry.selection_values
    if choices is None:
        return {}
    pairs = dict(choices).items() if hasattr(choices, "keys") else enumerate(choices)
    return {int(number): str(choice) for number, choice in pairs}


def _find_choice(choices: Mapping[int, str], text: str) -> int | None:
    """Return the number of the choice that a text names: ``"10"`` is ``"10.0"``, too."""
    for number, choice in choices.items():
        if text.casefold() == choice.casefold():
            return number
    for number, choice in choices.items():
        with suppress(ValueError):
            if math.isclose(float(choice), float(text), rel_tol=RATE_TOLERANCE):
                return number
    return None


def _convert_property(entry: Any, setting: str | bool | int | float) -> bool | int | float | str:
    """Return a setting as a value of a property: as one of its choices, or as its type.

    Raises
    ------
    ValueError
        The property does not take this setting.
    """
    if entry.read_only:
        raise ValueError("it can only be read")
    text = str(setting)
    choices = _read_choices(entry)
    if choices:
        number = _find_choice(choices, text)
        if number is None:
            raise ValueError(f"choose one of {', '.join(choices.values())}")
        return number

    kind = entry.value_type.name
    if kind == "ctBool":
        if text.lower() not in ("true", "false"):
            raise ValueError("it must be true or false")
        return text.lower() == "true"
    if kind in ("ctInt", "ctFloat"):
        return _convert_number(text, is_whole=kind == "ctInt")
    if kind != "ctString":
        raise ValueError("it holds neither a number nor text")
    # A version 1.10 would become 1.1.
    if not isinstance(setting, str):
        raise ValueError("it is a text; write it in quotes")
    return text


def _convert_number(text: str, *, is_whole: bool) -> int | float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number) or (is_whole and not number.is_integer()):
        raise ValueError(f"it must be a {'whole ' if is_whole else ''}number")
    return int(number) if is_whole else number


def _is_same(actual: object, value: object) -> bool:
    if isinstance(actual, float) and isinstance(value, float):
        return math.isclose(actual, value, rel_tol=RATE_TOLERANCE)
    return actual == value


def _set_rate_property(component: Any, name: str, rate: float) -> None:
    """Set a rate as a number, or as the choice of that number."""
    choices = _read_choices(component.get_property(name))
    value: float | None = rate
    if choices:
        value = _find_choice(choices, f"{rate}")
    if value is not None:
        component.set_property_value(name, value)
