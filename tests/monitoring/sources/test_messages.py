"""Messages of a broker: what they may be, and none lost or acknowledged too early."""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime

import numpy as np
import pytest
from mqtt_broker import wait_for

from swashtwin.monitoring.config.settings import MqttSource
from swashtwin.monitoring.sources.delivery import MAX_RECORDING_BYTES, RejectionError
from swashtwin.monitoring.sources.message_format import read_message, samples_recording
from swashtwin.monitoring.sources.mqtt import MqttWatch
from swashtwin.recordings import ReadOptions

NOW = datetime(2026, 11, 23, 14, tzinfo=UTC)
HEADER = {
    "rate": "25.6 kHz",
    "unit": "g",
    "channels": ["x", "y"],
    "type": "float32",
    "speed": "1500 rpm",
}


def block(number: float = 0.0, **changes) -> bytes:
    samples = np.full((8, 2), number, "<f4")
    return json.dumps(HEADER | changes).encode() + b"\n" + samples.tobytes()


def test_a_message_states_its_machine_before_its_topic() -> None:
    delivery, content = read_message(block(machine="pump-9"), "mqtt", NOW, "pump-1")
    assert (delivery.machine, delivery.problem, len(content)) == ("pump-9", None, 64)
    assert delivery.facts == HEADER | {"channels": "x,y"}


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "no line of JSON"),
        (b"[1]\n", "not a JSON object"),
        (b"{nonsense}\n", "not valid JSON"),
        (b'{"a":' * 50_000 + b"\n", "no line of JSON"),
        (b'{"rate": "25.6 kHz", "unit": "g"}\n', "does not specify channels"),
        (b'{"rate": 25600, "unit": "g", "channels": ["x"]}\n', "rate"),
        (b'{"machine": 7, "file": "a.wav"}\n', "machine must be text"),
        (b'{"file": "", "rate": "25.6 kHz"}\n', "does not specify unit"),
        (b'{"type": "float16"}\n', "must be one of float32"),
        (b'{"count": "many"}\n', "number of samples per channel"),
        ('{"file": "\ud800"}\n'.encode("utf-8", "surrogatepass"), "not valid JSON"),
    ],
)
def test_a_message_that_can_be_no_recording_is_delivered_with_the_reason(
    payload: bytes, reason: str
) -> None:
    delivery, content = read_message(payload, "mqtt", NOW, "pump-1")
    assert reason in str(delivery.problem)
    assert content == payload


WAVE = np.sin(np.arange(64) / 3).reshape(-1, 2)


@pytest.mark.parametrize(
    ("kind", "scale", "changes", "unit", "factor"),
    [
        ("<f4", 1, {}, "m/s^2", 9.80665),
        ("<f8", 1, {"type": "float64", "count": 32}, "m/s^2", 9.80665),
        ("<f4", 1, {"unit": "V", "sensitivity": "100 mV/g"}, "m/s^2", 98.0665),
        (
            "<i2",
            1000,
            {"type": "int16", "unit": "1", "sensitivity": ["1 mg/count", "1 mg/count"]},
            "m/s^2",
            9.80665,
        ),
    ],
)
def test_a_message_states_type_count_unit_and_sensitivity(
    tmp_path, kind, scale, changes, unit, factor
) -> None:
    payload = json.dumps(HEADER | changes).encode() + b"\n" + (WAVE * scale).astype(kind).tobytes()
    delivery, content = read_message(payload, "mqtt", NOW, None)
    assert delivery.problem is None
    (path := tmp_path / "message.f32").write_bytes(content)
    recording = samples_recording(path, delivery.facts, "m", ReadOptions())
    np.testing.assert_allclose(recording.signal, WAVE.T * factor, atol=2e-3 * factor)
    assert (recording.unit, recording.channels) == (unit, ("x", "y"))


@pytest.mark.parametrize(
    ("size", "count", "reason"),
    [
        (-4, "32", "not a whole number"),
        (None, "31", "32 float32 samples per channel, but specifies 31"),
    ],
)
def test_samples_of_another_number_than_stated_are_refused(tmp_path, size, count, reason) -> None:
    (path := tmp_path / "message.f32").write_bytes(WAVE.astype("<f4").tobytes()[:size])
    facts = HEADER | {"channels": "x,y", "count": count}
    with pytest.raises(RejectionError, match=reason):
        samples_recording(path, facts, "m", ReadOptions())


@contextmanager
def watching(broker, deliveries, **settings) -> Iterator[MqttWatch]:
    source = MqttSource(
        name="mqtt",
        host=broker.host,
        port=broker.port,
        **{"topic": "plant/+/vibration", **settings},
    )
    watch = MqttWatch(source, deliveries.accept, "test-watch")
    stop = threading.Event()
    watch.status.fail("not connected yet")
    thread = threading.Thread(target=watch.run, args=(stop,))
    thread.start()
    try:
        wait_for(lambda: watch.status.problem is None or deliveries.failures)
        yield watch
    finally:
        stop.set()
        thread.join(10)
        assert not thread.is_alive()


def names(deliveries) -> list[float]:
    return [float(np.frombuffer(content, "<f4")[0]) for _, content in deliveries.items]


def test_messages_of_a_topic_are_recordings_of_its_machine_and_one_too_large_is_listed(
    broker, deliveries
) -> None:
    with watching(broker, deliveries):
        broker.publish("plant/pump-7/vibration", block(3))
        broker.publish("plant/pump-7/vibration", block() + bytes(MAX_RECORDING_BYTES))
        wait_for(lambda: len(deliveries.items) == 2)
    assert names(deliveries)[0] == 3
    (delivery, _), (large, content) = deliveries.items
    assert (delivery.machine, large.machine, len(content)) == ("pump-7", "pump-7", 1 << 16)
    assert f"at most {MAX_RECORDING_BYTES} are taken" in str(large.problem)


def test_messages_that_come_while_the_watch_is_away_are_taken_when_it_is_back(
    broker, deliveries
) -> None:
    with watching(broker, deliveries):
        pass
    for number in range(5):
        broker.publish("plant/pump-1/vibration", block(number))
    with watching(broker, deliveries):
        wait_for(lambda: len(deliveries.items) == 5)
    assert names(deliveries) == [0, 1, 2, 3, 4]


def test_a_broker_that_stops_and_starts_loses_nothing(broker, deliveries) -> None:
    with watching(broker, deliveries) as watch:
        broker.publish("plant/pump-1/vibration", block(1))
        wait_for(lambda: deliveries.items)
        broker.stop()
        wait_for(lambda: watch.status.problem is not None)
        broker.start()
        broker.publish("plant/pump-1/vibration", block(2))
        wait_for(lambda: len(deliveries.items) == 2)
        wait_for(lambda: watch.status.problem is None)
    assert names(deliveries) == [1, 2]


def test_a_message_is_acknowledged_only_once_it_is_on_the_disk(broker, deliveries) -> None:
    with watching(broker, deliveries):
        pass
    broker.publish("plant/pump-1/vibration", block(5))
    deliveries.failures = 2
    with watching(broker, deliveries) as watch:
        wait_for(lambda: watch.status.received)
    with watching(broker, deliveries):
        time.sleep(0.3)
    assert names(deliveries) == [5]


def test_watches_of_one_group_share_the_messages(broker, deliveries) -> None:
    with (
        watching(broker, deliveries, group="plant", client="one") as first,
        watching(broker, deliveries, group="plant", client="two") as second,
    ):
        for number in range(20):
            broker.publish("plant/pump-1/vibration", block(number))
        wait_for(lambda: len(deliveries.items) == 20)
        time.sleep(0.2)
        assert first.status.received
        assert second.status.received
    assert sorted(names(deliveries)) == list(range(20))


def test_a_retained_message_is_taken_once(broker, deliveries) -> None:
    broker.publish("plant/pump-1/vibration", block(1), retain=True)
    with watching(broker, deliveries) as watch:
        wait_for(lambda: watch.status.received)
    with watching(broker, deliveries):
        time.sleep(0.3)
    assert names(deliveries) == [1]
