"""Recording the reference device of openDAQ."""

import math
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from errno import ENOSPC
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import run, run_json

from swashtwin.foundation import DataError, InputError, MissingExtraError
from swashtwin.monitoring.sources import live_device
from swashtwin.monitoring.sources.live_device import (
    DeviceChangedError,
    DeviceLostError,
    DeviceSettings,
    LiveDevice,
)
from swashtwin.monitoring.sources.live_recorder import LiveRecorder, LiveSettings
from swashtwin.recordings import Finding, Recording, load_recording

DEVICE = "daqref://device0"
AMPLITUDE_V = 5.0
"""Amplitude of the sines of the reference device, which have 10 Hz."""


@pytest.fixture(autouse=True)
def _opendaq() -> None:
    pytest.importorskip("opendaq")


def settings(device: str = DEVICE, **changes: Any) -> DeviceSettings:
    facts = {"sample_rate": 50e3, "sensitivity": "100 mV/g", **changes}
    return DeviceSettings(device, **facts)


def take(recorder: LiveRecorder, count: int) -> Iterator[Recording | Finding]:
    """Yield what a recorder yields, until `count` recordings are complete."""
    for item in recorder.run(threading.Event()):
        yield item
        count -= isinstance(item, Recording)
        if not count:
            return


def test_numbers_and_facts_are_those_of_the_descriptor() -> None:
    recorder = LiveRecorder(LiveSettings(settings(properties={"NumberOfChannels": "3"}), 0.2))
    first, second = take(recorder, 2)
    recorder.close()

    assert isinstance(first, Recording)
    assert isinstance(second, Recording)
    assert first.channels == ("AI 1", "AI 2", "AI 3")
    assert (first.unit, first.sample_rate, first.n_samples) == ("m/s^2", 50e3, 10_000)

    # 5 V at 100 mV/g are 50 g.
    signal = np.concatenate([first.signal, second.signal], axis=1)
    assert signal.max(axis=1) == pytest.approx([50 * 9.80665] * 3, rel=1e-6)

    # The second recording continues the first: a sine obeys its differential equation throughout.
    curvature = np.diff(signal, 2) * 50e3**2
    expected = -((2 * math.pi * 10) ** 2) * signal[:, 1:-1]
    assert np.abs(curvature - expected).max() < 1e-3 * np.abs(expected).max()


def test_a_channel_is_set_up_by_its_own_properties() -> None:
    properties = {"AI 1/Amplitude": "2", "AI 2/Waveform": "rect"}
    recorder = LiveRecorder(LiveSettings(settings(properties=properties, sensitivity=None), 0.2))
    (recording,) = take(recorder, 1)
    recorder.close()

    assert isinstance(recording, Recording)
    sine, rectangle = recording.signal
    assert np.abs(sine).max() == pytest.approx(2, rel=1e-6)
    assert set(np.abs(rectangle)) == {AMPLITUDE_V}


def test_a_property_is_a_number_or_a_truth_value() -> None:
    properties = {"NumberOfChannels": 3.0, "EnableLogging": False, "AI 3/ClientSideScaling": True}
    device = LiveDevice(settings(properties=properties))
    device.close()
    assert device.channels == ("AI 1", "AI 2", "AI 3")


def test_the_order_of_properties_does_not_matter_and_they_are_set_again() -> None:
    # a constant waveform hides the amplitude, and the channel exists only if there are three
    properties = {"AI 3/Waveform": "Constant", "AI 3/DC": "1", "NumberOfChannels": "3"}
    device = LiveDevice(settings(properties=properties))
    device.set_up()

    assert device.channels == ("AI 1", "AI 2", "AI 3")
    device.close()


@dataclass
class ChoiceProperty:
    """A property that offers sample rates, as openDAQ describes it."""

    selection_values: object


@pytest.mark.parametrize(
    ("choices", "number"),
    [(["Off", "1000", "25600.0"], 2), ({7: "25600", 9: "51200"}, 7), (["1000"], None)],
)
def test_a_rate_is_set_by_the_number_of_its_choice(choices: object, number: int | None) -> None:
    values: dict[str, float] = {}

    class Device:
        def get_property(self, name: str) -> ChoiceProperty:
            return ChoiceProperty(choices)

        def set_property_value(self, name: str, value: float) -> None:
            values[name] = value

    live_device._set_rate_property(Device(), "SampleRate", 25.6e3)

    assert values == ({} if number is None else {"SampleRate": number})


def test_volts_stay_volts_without_a_sensitivity() -> None:
    device = LiveDevice(settings(sensitivity=None))

    assert device.unit == "V"
    device.close()


def test_a_tachometer_gives_the_speed_and_is_no_channel() -> None:
    device = settings(channels=("AI 1",), tacho="AI 2")
    recorder = LiveRecorder(LiveSettings(device, 0.5, pulses_per_turn=2))
    (recording,) = take(recorder, 1)
    recorder.close()

    assert isinstance(recording, Recording)
    assert recording.channels == ("AI 1",)
    assert recording.attributes["speed"] == "300 rpm"  # ten pulses a second, two in a turn
    assert recording.speed is not None
    np.testing.assert_allclose(recording.speed, 10 * math.pi, rtol=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"sample_rate": 51.2e3},
            "does not give a sample rate of 51200 Hz: it samples at 50000 Hz. Set "
            "sample_rate='50000 Hz', or leave it out.",
        ),
        ({"channels": ("AI 1", "AI 1")}, "Channel 'AI 1' is given twice."),
        ({"channels": ("AI 1",), "tacho": "AI 1"}, "'AI 1' is both a channel and the tachometer"),
        ({"channels": ("AI 7",)}, "has no channel 'AI 7'. Its channels are AI 1, AI 2."),
        ({"properties": {"Gain": "2"}}, "has no property 'Gain'. Its properties are Number"),
        ({"properties": {"NumberOfChannels": "two"}}, "does not take NumberOfChannels = 'two'"),
        ({"properties": {"AI 9/DC": "1"}}, "has no channel 'AI 9'. Its channels are AI 1, AI 2."),
        (
            {"properties": {"AI 1/Gain": "2"}},
            "Channel 'AI 1' of daqref://device0 has no property 'Gain'. Its properties are Wave",
        ),
        ({"properties": {"ai 1/DC": "1"}}, "no channel 'ai 1'. Did you mean 'AI 1'? Its channels"),
        (
            {"properties": {"AI 1/NoiseAmplitudes": "1"}},
            "has no property 'NoiseAmplitudes'. Did you mean 'NoiseAmplitude'? Its properties",
        ),
        ({"properties": {"AI 1/": "1"}}, "has no property ''. Its properties are Wave"),
        ({"properties": {"/DC": "1"}}, "has no channel ''. Its channels are AI 1, AI 2."),
        ({"properties": {"NumberOfChannels": 2.5}}, "= 2.5: it must be a whole number."),
        # A version 1.10 would become 1.1.
        ({"properties": {"location": 1.1}}, "location = 1.1: it is a text; write it in quotes."),
        ({"properties": {"AI 1/Amplitude": "99"}}, "it sets 10.0 instead."),
        ({"properties": {"AI 1/Amplitude": "nan"}}, "it must be a number."),
        ({"properties": {"AI 1/Offset": "1.5"}}, "it must be a whole number."),
        ({"properties": {"AI 1/TestReadOnly": "false"}}, "it can only be read."),
        ({"properties": {"AI 1/CustomRange": "1"}}, "it holds neither a number nor text."),
        ({"properties": {"AI 1/Waveform": "saw"}}, "choose one of Sine, Rect, None, Counter"),
        ({"sensitivity": "fast"}, "sensitivity (fast) must be a number with its unit"),
        ({"device": "daqref://device9"}, "does not answer. Check its cable and address, or"),
        ({"device": "nonsense"}, "Devices that answer here: daqref://device0"),
        ({"device": "miniaudio://alsa/null"}, "The sound card 'miniaudio://alsa/null' cannot be"),
    ],
)
def test_what_a_device_cannot_do_is_refused_with_the_fix(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises((DataError, InputError)) as caught:
        LiveDevice(settings(**changes))

    assert message in str(caught.value)
    # The failed attempt does not hold the device.
    LiveDevice(settings()).close()


def test_without_opendaq_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opendaq", None)

    with pytest.raises(MissingExtraError, match=r'pip install "swashtwin\[live\]"'):
        LiveDevice(settings())


def test_a_changed_rate_is_a_finding_and_recorded_on() -> None:
    recorder = LiveRecorder(LiveSettings(settings(sample_rate=None), 0.3))
    items = recorder.run(threading.Event())
    first = next(items)
    recorder._device._device.set_property_value("GlobalSampleRate", 20e3)
    findings = []
    for item in items:
        if isinstance(item, Recording) and item.sample_rate == 20e3:
            break
        if isinstance(item, Finding):
            findings.append(item)
    items.close()
    recorder.close()

    assert isinstance(first, Recording)
    assert findings[0].kind == "changed"
    assert "changed its sample rate from 1000 to 20000 Hz" in findings[0].message
    assert findings[-1].kind == "back"


def test_a_device_that_vanishes_is_found_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_device, "LOST_AFTER_S", 1.0)
    recorder = LiveRecorder(LiveSettings(settings(), 0.3))
    items = recorder.run(threading.Event())
    next(items)

    device = recorder._device
    device._instance.remove_device(device._device)
    kinds = []
    for item in items:
        if isinstance(item, Recording) and "back" in kinds:
            break
        if isinstance(item, Finding):
            kinds.append(item.kind)
    items.close()
    recorder.close()

    assert kinds[0] == "vanished"
    assert kinds[-1] == "back"


def test_samples_that_nobody_takes_are_discarded_and_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(live_device, "MAX_BACKLOG_S", 0.2)
    recorder = LiveRecorder(LiveSettings(settings(), 0.2))
    items = recorder.run(threading.Event())
    next(items)

    threading.Event().wait(0.5)
    overrun = next(item for item in items if isinstance(item, Finding))
    items.close()
    recorder.close()

    assert overrun.kind == "overrun"
    assert "were discarded: they arrived faster" in overrun.message


class SentSamples(LiveDevice):
    """A device of one channel in volts, whose samples and descriptors a test sends.

    Its signals and their reader are those of openDAQ.
    """

    def __init__(self) -> None:
        import opendaq as daq

        self._daq = daq
        self._settings = DeviceSettings("sent", sensitivity="100 mV/g", tacho="pulses")
        self._n_sent = 0

        time = daq.DataDescriptorBuilder()
        time.sample_type = daq.SampleType.Int64
        time.rule = daq.LinearDataRule(1000, 0)
        time.tick_resolution = daq.Ratio(1, 1_000_000)
        time.unit = daq.Unit(-1, "s", "second", "time")
        time.origin = "1970-01-01T00:00:00Z"
        self._time = time.build()

        self._instance = live_device._open_instance()
        context = self._instance.context
        volts = self.descriptor("V")
        self._clock = daq.SignalWithDescriptor(context, self._time, None, "time", None)
        self._sources = []
        for name in ("x", "pulses"):
            source = daq.SignalWithDescriptor(context, volts, None, name, None)
            source.domain_signal = self._clock
            self._sources.append(source)

        self._signals = [daq.ISignal.cast_from(source) for source in self._sources]
        self.channels = ("x",)
        self.sample_rate = 1000.0
        self._step = 1000
        self._factors, self.unit = self._read_scaling()
        self._start_reading()

    def descriptor(self, unit: str) -> Any:
        builder = self._daq.DataDescriptorBuilder()
        builder.sample_type = self._daq.SampleType.Float64
        builder.unit = self._daq.Unit(-1, unit, "", "")
        return builder.build()

    def send(self, count: int) -> None:
        domain = self._daq.DataPacket(self._time, count, self._n_sent * 1000)
        self._n_sent += count
        self._clock.send_packet(domain)
        for source, signal in zip(self._sources, self._signals, strict=True):
            packet = self._daq.DataPacketWithDomain(domain, signal.descriptor, count, 0)
            source.send_packet(packet)

    def read_samples(self) -> list[live_device.Block]:
        """Return the blocks of the first read that has some."""
        for _ in range(5):
            blocks = self.read()
            if blocks:
                return blocks
        raise AssertionError("no samples")


def test_a_changed_unit_is_reported_before_a_sample_is_scaled_wrongly() -> None:
    device = SentSamples()
    device.send(200)
    (block,) = device.read_samples()
    assert block.signal.shape == (1, 200)

    device._sources[0].descriptor = device.descriptor("mV")
    device.send(200)

    with pytest.raises(DeviceChangedError, match="sent changed the unit of a channel"):
        device.read_samples()


def test_a_tachometer_does_not_keep_the_other_channels_in_memory() -> None:
    device = SentSamples()
    device.send(200)
    (block,) = device.read_samples()

    assert block.tacho is not None
    assert block.tacho.base is None


class Failing:
    """A reader or a list of devices of openDAQ that fails."""

    def __getattr__(self, name: str) -> Any:
        raise RuntimeError("The connection was lost.")


def test_an_error_of_opendaq_is_a_device_that_vanished() -> None:
    device = SentSamples()
    device._reader = Failing()
    with pytest.raises(DeviceLostError, match=r"^sent does not answer: The connection was lost\.$"):
        device.read()

    device._device = Failing()
    with pytest.raises(DeviceLostError, match=r"sent does not answer: The connection was lost\.$"):
        device.set_up()

    assert "miniaudio" not in device._describe_devices()
    device._instance = Failing()
    with pytest.raises(DeviceLostError, match=r"cannot be listed: The connection was lost\.$"):
        device._connect()


COMMAND = ("record", DEVICE, "--length", "0.2 s", "--sample-rate", "50 kHz")


def test_the_command_writes_recordings_that_other_commands_read(tmp_path: Path) -> None:
    scale = ("--sensitivity", "100 mV/g", "--speed", "860 rpm", "--channels", "AI 2")
    answer = run_json(*COMMAND, "--out", tmp_path, "--count", 2, *scale)

    files = sorted(tmp_path.iterdir())
    assert answer["recordings"] == len(files) == 2
    assert answer["findings"] == {}
    recording = load_recording(files[0])
    assert recording.unit == "m/s^2"
    assert recording.attributes["speed"] == "860 rpm"
    assert recording.attributes["device"] == DEVICE
    assert run_json("inspect", files[0])["recordings"][0]["channels"][0]["name"] == "AI 2"


def test_a_command_without_a_recording_fails_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped = Finding("stopped", "note", None, "The 0.05 s before it are too short to be kept.")
    monkeypatch.setattr(LiveRecorder, "run", lambda recorder, stop: iter([stopped]))

    result = run(*COMMAND, "--out", tmp_path, code=3)

    assert f"No recording was made of {DEVICE}: The 0.05 s before it are too" in result.stderr
    assert "Next:" not in result.stdout


def test_a_full_disk_loses_no_file_and_leaves_no_half(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from swashtwin.recordings.formats import hdf5

    def fail(recording: Recording, path: Path) -> None:
        path.write_bytes(b"half")
        raise OSError(ENOSPC, "No space left on device")

    monkeypatch.setattr(hdf5, "write", fail)
    result = run(*COMMAND, "--out", tmp_path, code=3)

    assert "(No space left on device), and its 0.2 s are lost; all earlier" in result.stderr
    assert list(tmp_path.iterdir()) == []
