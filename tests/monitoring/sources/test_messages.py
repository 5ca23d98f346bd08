"""Messages of a broker: their format, and that none is lost or acknowledged too early."""

import json
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mqtt_broker import wait_for

from swashtwin.monitoring.config.settings import MqttSource
from swashtwin.monitoring.sources.delivery import MAX_RECORDING_BYTES, RejectionError
from swashtwin.monitoring.sources.message_format import read_message, samples_recording
from swashtwin.monitoring.sources.mqtt import MqttWatch
from swashtwin.recordings import ReadOptions, Recording

NOW = datetime(2026, 11, 23, 14, tzinfo=UTC)
TOPIC = "plant/pump-1/vibration"
# A message that a watch shall not take would come within this time.
SETTLE_TIME_S = 0.3
HEADER = {
    "rate": "25.6 kHz",
    "unit": "g",
    "channels": ["x", "y"],
    "type": "float32",
    "speed": "1500 rpm",
}
WAVE = np.sin(np.arange(64) / 3).reshape(-1, 2)


def payload_of(samples: np.ndarray, **changes: object) -> bytes:
    """Return a message of samples, with changes of its header."""
    return json.dumps(HEADER | changes).encode() + b"\n" + samples.tobytes()


def message(value: float = 0.0, **changes: object) -> bytes:
    """Return a message all of whose samples have one value, by which a test knows it again."""
    return payload_of(np.full((8, 2), value, "<f4"), **changes)


def test_a_message_specifies_its_machine_before_its_topic() -> None:
    delivery, content = read_message(message(machine="pump-9"), "mqtt", NOW, "pump-1")

    assert delivery.machine == "pump-9"
    assert delivery.problem is None
    # Facts are text, as an upload specifies them.
    assert delivery.facts == HEADER | {"channels": "x,y"}
    assert len(content) == 64


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        pytest.param(b"", "no line of JSON", id="empty"),
        pytest.param(b"[1]\n", "not a JSON object", id="list"),
        pytest.param(b"{nonsense}\n", "not valid JSON", id="not JSON"),
        # Deep enough to exhaust the stack of a parser, if the line were not too long.
        pytest.param(b'{"a":' * 50_000 + b"\n", "no line of JSON", id="deeply nested"),
        pytest.param(
            b'{"rate": "25.6 kHz", "unit": "g"}\n', "does not specify channels", id="no channels"
        ),
        pytest.param(
            b'{"rate": 25600, "unit": "g", "channels": ["x"]}\n', "rate", id="rate without unit"
        ),
        pytest.param(
            b'{"machine": 7, "file": "a.wav"}\n', "machine must be text", id="machine is a number"
        ),
        # Without a file the samples follow, whose facts are needed.
        pytest.param(
            b'{"file": "", "rate": "25.6 kHz"}\n', "does not specify unit", id="empty file name"
        ),
        pytest.param(b'{"type": "float16"}\n', "must be one of float32", id="unknown type"),
        pytest.param(
            b'{"count": "many"}\n', "number of samples per channel", id="count is no number"
        ),
        pytest.param(
            '{"file": "\ud800"}\n'.encode("utf-8", "surrogatepass"), "not valid JSON", id="no UTF-8"
        ),
    ],
)
def test_an_invalid_message_is_delivered_whole_and_with_the_reason(
    payload: bytes, reason: str
) -> None:
    delivery, content = read_message(payload, "mqtt", NOW, "pump-1")

    assert reason in str(delivery.problem)
    assert content == payload


def read_samples(content: bytes, facts: Mapping[str, Any], folder: Path) -> Recording:
    """Return the recording of the samples of a message, which the spool keeps in a file."""
    path = folder / "message.f32"
    path.write_bytes(content)
    return samples_recording(path, facts, "m", ReadOptions())


@pytest.mark.parametrize(
    ("samples", "changes", "factor"),
    [
        pytest.param(WAVE.astype("<f4"), {}, 9.80665, id="single precision"),
        pytest.param(
            WAVE.astype("<f8"), {"type": "float64", "count": 32}, 9.80665, id="double with count"
        ),
        pytest.param(
            WAVE.astype("<f4"),
            {"unit": "V", "sensitivity": "100 mV/g"},
            98.0665,
            id="one sensitivity",
        ),
        # Thousandths of g, since an integer would round the wave to nothing.
        pytest.param(
            (WAVE * 1000).astype("<i2"),
            {"type": "int16", "unit": "1", "sensitivity": ["1 mg/count", "1 mg/count"]},
            9.80665,
            id="counts with a sensitivity for each channel",
        ),
    ],
)
def test_a_message_specifies_type_count_unit_and_sensitivity(
    tmp_path: Path, samples: np.ndarray, changes: dict[str, object], factor: float
) -> None:
    payload = payload_of(samples, **changes)

    delivery, content = read_message(payload, "mqtt", NOW, None)
    assert delivery.problem is None

    recording = read_samples(content, delivery.facts, tmp_path)
    # two steps of the integer samples
    np.testing.assert_allclose(recording.signal, WAVE.T * factor, atol=2e-3 * factor)
    assert recording.unit == "m/s^2"
    assert recording.channels == ("x", "y")


@pytest.mark.parametrize(
    ("n_lost_bytes", "count", "reason"),
    [
        pytest.param(4, "32", "not a whole number", id="half an instant"),
        pytest.param(
            0,
            "31",
            "32 float32 samples per channel, but specifies 31",
            id="other count",
        ),
    ],
)
def test_samples_of_another_number_than_specified_are_refused(
    tmp_path: Path, n_lost_bytes: int, count: str, reason: str
) -> None:
    content = WAVE.astype("<f4").tobytes()
    facts = HEADER | {"channels": "x,y", "count": count}

    with pytest.raises(RejectionError, match=reason):
        read_samples(content[: len(content) - n_lost_bytes], facts, tmp_path)


@contextmanager
def watching(broker, deliveries, **settings) -> Iterator[MqttWatch]:
    """Run a watch of the broker, from when it is connected or fails to the end of the block."""
    source = MqttSource(
        name="mqtt",
        host=broker.host,
        port=broker.port,
        **{"topic": "plant/+/vibration", **settings},
    )
    watch = MqttWatch(source, deliveries.accept, "test-watch")
    # A watch that has not tried yet has no problem either.
    watch.status.fail("not connected yet")

    stop = threading.Event()
    thread = threading.Thread(target=watch.run, args=(stop,))
    thread.start()
    try:
        wait_for(lambda: watch.status.problem is None or deliveries.failures)
        yield watch
    finally:
        stop.set()
        thread.join(10)
        assert not thread.is_alive()


def delivered_values(deliveries) -> list[float]:
    return [float(np.frombuffer(content, "<f4")[0]) for _, content in deliveries.items]


def test_a_message_is_a_recording_of_the_machine_in_its_topic(broker, deliveries) -> None:
    with watching(broker, deliveries):
        broker.publish("plant/pump-7/vibration", message(3))
        wait_for(lambda: deliveries.items)

    ((delivery, _),) = deliveries.items
    assert delivery.machine == "pump-7"
    assert delivered_values(deliveries) == [3]


def test_of_a_message_that_is_too_large_only_the_beginning_is_delivered(broker, deliveries) -> None:
    with watching(broker, deliveries):
        broker.publish("plant/pump-7/vibration", message() + bytes(MAX_RECORDING_BYTES))
        wait_for(lambda: deliveries.items)

    # It is listed as rejected with its machine; refused without a trace, nobody would look for it.
    ((delivery, content),) = deliveries.items
    assert delivery.machine == "pump-7"
    assert f"at most {MAX_RECORDING_BYTES} are taken" in str(delivery.problem)
    assert len(content) == 1 << 16


def test_messages_sent_between_two_runs_of_the_watch_are_taken_by_the_second(
    broker, deliveries
) -> None:
    # The first run opens the session, for which the broker keeps messages.
    with watching(broker, deliveries):
        pass

    for value in range(5):
        broker.publish(TOPIC, message(value))
    with watching(broker, deliveries):
        wait_for(lambda: len(deliveries.items) == 5)

    assert delivered_values(deliveries) == [0, 1, 2, 3, 4]


def test_a_broker_that_stops_and_starts_loses_nothing(broker, deliveries) -> None:
    with watching(broker, deliveries) as watch:
        broker.publish(TOPIC, message(1))
        wait_for(lambda: deliveries.items)

        broker.stop()
        wait_for(lambda: watch.status.problem is not None)

        broker.start()
        broker.publish(TOPIC, message(2))
        wait_for(lambda: len(deliveries.items) == 2)
        wait_for(lambda: watch.status.problem is None)

    assert delivered_values(deliveries) == [1, 2]


def test_a_message_is_acknowledged_only_once_it_is_on_the_disk(broker, deliveries) -> None:
    with watching(broker, deliveries):
        pass
    broker.publish(TOPIC, message(5))

    # Twice the disk is full, so twice the broker must send the message again.
    deliveries.failures = 2
    with watching(broker, deliveries) as watch:
        wait_for(lambda: watch.status.received)

    # After the acknowledgment it must not.
    with watching(broker, deliveries):
        time.sleep(SETTLE_TIME_S)
    assert delivered_values(deliveries) == [5]


def test_watches_of_one_group_share_the_messages(broker, deliveries) -> None:
    with (
        watching(broker, deliveries, group="plant", client="one") as first,
        watching(broker, deliveries, group="plant", client="two") as second,
    ):
        for value in range(20):
            broker.publish(TOPIC, message(value))
        wait_for(lambda: len(deliveries.items) == 20)
        # A message that both watches got would come a little later.
        time.sleep(SETTLE_TIME_S)

        assert first.status.received
        assert second.status.received
    assert sorted(delivered_values(deliveries)) == list(range(20))


def test_a_retained_message_is_taken_once(broker, deliveries) -> None:
    # A broker sends it to each new subscription, which a watch makes at each start.
    broker.publish(TOPIC, message(1), retain=True)

    with watching(broker, deliveries) as watch:
        wait_for(lambda: watch.status.received)
    with watching(broker, deliveries):
        time.sleep(SETTLE_TIME_S)

    assert delivered_values(deliveries) == [1]
