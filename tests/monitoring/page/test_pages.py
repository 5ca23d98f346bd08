"""The pages as a browser without scripts sees them."""

import re
from datetime import UTC, datetime, timedelta
from html import unescape
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as some
from judgments import judgment
from msgspec.structs import replace
from starlette.testclient import TestClient

from swashtwin.diagnosis import next_checks
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.page.axis import Axis
from swashtwin.monitoring.page.charts import HEIGHT
from swashtwin.monitoring.page.watch_page import build_watch_page


def send(client: TestClient, address: str, **values: object):
    token = re.search(r'name="form_token" value="([0-9a-f]+)"', client.get("/machines/pump-2").text)
    assert token
    return client.post(address, data={"form_token": token[1], **values})


def newest_recording(plant, machine: str) -> int:
    return plant.history.reader.recordings(machine, limit=1)[0].id


def silence_of_pump_1(plant) -> datetime | None:
    machines = {machine.name: machine for machine in plant.history.reader.machines()}
    return machines["pump-1"].silenced


def test_the_overview_shows_the_most_urgent_machine_first_and_filters_by_state_or_name(
    reader: TestClient,
) -> None:
    text = reader.get("/").text
    positions = [
        text.index(f"/machines/{name}") for name in ("pump-1", "presse-4", "pump-2", "pump-3")
    ]

    assert positions == sorted(positions)
    assert "Swash plate" in text
    assert "1 Sensor alarm" in text

    for query, expected_text in (
        ("state=normal", "pump-2"),
        ("text=PRESSE", "presse-4"),
        ("text=no", "No machine matches."),
    ):
        text = reader.get(f"/?{query}").text
        assert expected_text in text
        assert "pump-1" not in text


def test_a_machine_that_sent_nothing_yet_is_shown(plant, client: TestClient) -> None:
    machine = replace(plant.config.machines[0], name="pump-8")
    config = replace(plant.config, machines=(*plant.config.machines, machine))
    client = TestClient(build_watch_page(config, plant.history), base_url="http://127.0.0.1")

    assert "No recording yet" in client.get("/machines/pump-8").text
    assert "pump-8" in client.get("/?state=empty").text


def test_a_machine_shows_its_alarm_its_most_changed_trend_and_its_recordings(
    client: TestClient, plant
) -> None:
    text = client.get("/machines/pump-1").text
    assert "/alarms/1/acknowledge" in text
    titles = [drawing.get("aria-label") for drawing in drawings(text)]
    assert titles[:2] == ["Deviation [spreads]", "Evidence"]
    assert titles[3] == "Shaft order"
    assert titles[4].endswith("over shaft orders")
    assert f"/recordings/{newest_recording(plant, 'pump-1')}" in text
    assert re.search(r'<option value="(shaft order (7|14|21|28)|\d+ to \d+ Hz)" selected>', text)


def test_a_recording_shows_verdict_evidence_and_what_to_check(client: TestClient, plant) -> None:
    text = client.get(f"/recordings/{newest_recording(plant, 'pump-1')}").text
    assert "Swash plate 93 %" in text
    assert "shaft order" in text
    assert next_checks("swash_plate")[-1].what in text
    assert text.count('<svg class="drawing"') == 3
    assert "1500 rpm" in text


def test_an_unknown_recording_has_no_shares_of_trained_classes(client: TestClient, plant) -> None:
    verdict = {"unknown": True, "error_rate": 0.1, "probabilities": {"swash_plate": 0.99}}
    suspect = {"certainty": "unknown", "sentence": "Suspect unknown.", "probabilities": {"a": 0.99}}
    reasons: dict[str, object] = {name: [] for name in ("findings", "moved", "sentences", "notes")}
    reasons |= {"verdict": verdict, "suspect": suspect}
    unknown = judgment(900, label="unknown", ood_p=0.01, reasons=reasons)
    with plant.history.machine("pump-1") as transaction:
        transaction.add_recording(unknown)
        number = unknown.id

    text = client.get(f"/recordings/{number}").text
    assert "differs from every trained class" in text
    assert "99 %" not in text


def test_a_recording_that_a_pump_prior_does_not_know_states_its_reason(
    client: TestClient, plant
) -> None:
    # A prior has no error rate, and its p-value is not why lines that changed little are unknown.
    verdict = {"unknown": True, "error_rate": None, "reasons": ["Its lines changed little."]}
    reasons: dict[str, object] = {name: [] for name in ("findings", "moved", "sentences", "notes")}
    unknown = judgment(901, label="unknown", ood_p=0.4, reasons=reasons | {"verdict": verdict})
    with plant.history.machine("pump-1") as transaction:
        transaction.add_recording(unknown)
        number = unknown.id

    text = client.get(f"/recordings/{number}").text

    assert "Its lines changed little." in text
    assert "differs from every trained class" not in text


def test_an_alarm_with_a_suspect_shows_how_such_a_fault_acts(client: TestClient, plant) -> None:
    pytest.importorskip("torch", reason="the twin needs torch")
    alarm = plant.history.reader.alarm(1)
    suspect = {"certainty": "sure", "label": "piston", "sentence": "Suspect: piston."}
    with plant.history.machine("pump-1") as machine:
        opened = machine.open_alarm(
            "pump", None, alarm.opened, {"suspect": suspect}, alarm.recording
        )
        number = opened.id

    text = unescape(client.get(f"/alarms/{number}").text)
    for check in next_checks("piston"):
        assert check.what in text
    for file in ("living_pump.js", "living_pump.css"):
        assert f'"/static/{file}?' in text
        assert client.get(f"/static/{file}").status_code == 200

    # The page does not wait for the twin, which its script asks for.
    pump = client.get(f"/alarms/{number}/pump").text
    assert f'data-content="/alarms/{number}/pump"' in text
    assert pump.count('class="living-pump"') == 1
    assert "1500 rpm" in pump

    assert "data-content" not in client.get("/alarms/1").text
    assert client.get("/alarms/1/pump").status_code == 204


def test_pressures_are_shown_in_the_unit_of_the_configuration(plant) -> None:
    config = replace(plant.config, pressure_unit="bar")
    page = build_watch_page(config, plant.history)
    client = TestClient(page, base_url="http://127.0.0.1:8642")
    recording_id = newest_recording(plant, "pump-1")
    trend = {"channel": "", "indicator": "pressure"}

    for address in ("/", "/alarms", "/alarms/1", f"/recordings/{recording_id}", "/log"):
        assert " MPa" not in client.get(address).text
    assert "1500 rpm, 150 bar" in client.get("/alarms/1").text
    assert "<dd>150 bar</dd>" in client.get(f"/recordings/{recording_id}").text

    # The form keeps the name under which the history stores an operating point.
    text = client.get("/machines/pump-1", params=trend).text
    assert '<option value="1500 rpm, 15 MPa" selected>1500 rpm, 150 bar</option>' in text
    assert "Discharge pressure [bar]" in text
    low, high = map(float, drawings(text)[2].get("data-y").split())
    assert low < 150 < high


def test_an_open_alarm_stays_listed_after_hundreds_of_closed_ones(
    client: TestClient, plant
) -> None:
    alarm = plant.history.reader.alarm(1)
    with plant.history.machine("pump-2") as machine:
        for _ in range(210):
            closed_alarm = machine.open_alarm(
                alarm.kind, alarm.point, alarm.opened, alarm.evidence, None
            )
            machine.acknowledge(closed_alarm.id, "Ada")
            machine.clear_alarm(closed_alarm.id, alarm.opened)

    for address in ("/alarms", "/alarms?state=open"):
        text = client.get(address).text
        assert "/alarms/1/acknowledge" in text
        assert text.count("<article") == 2

    assert "/alarms/1/" not in client.get("/alarms?state=closed").text


def test_a_recording_of_a_dead_sensor_names_its_channel_and_has_no_spectrum(
    client: TestClient, plant
) -> None:
    recording_id = newest_recording(plant, "presse-4")
    text = client.get(f"/recordings/{recording_id}").text

    # in its alarm, and as evidence
    assert text.count("channel y does not move") == 2
    assert "No verdict on the pump" in text
    assert "Normal" not in text
    assert '<svg class="drawing"' not in text


def test_a_recording_without_samples_has_no_drawing(client: TestClient, plant) -> None:
    recording_id = newest_recording(plant, "pump-2")
    for path in plant.config.folder.rglob("*.h5"):
        path.unlink()

    assert '<svg class="drawing"' not in client.get(f"/recordings/{recording_id}").text


def test_a_form_acknowledges_an_alarm_once(client: TestClient, plant) -> None:
    answer = send(client, "/alarms/1/acknowledge", who="Ada", note="on it", next="/machines/pump-1")
    assert answer.status_code == 303

    alarm = plant.history.reader.alarm(1)
    assert (alarm.state, alarm.who, alarm.note) == ("acknowledged", "Ada", "on it")

    assert send(client, "/alarms/1/acknowledge", who="Bob").status_code == 409
    assert "Acknowledged by Ada" in client.get("/machines/pump-1").text


def test_a_silence_has_an_end_and_can_be_ended(client: TestClient, plant) -> None:
    for hours in ("0", "-1", "nan", "inf", "1e9", "x", ""):
        assert send(client, "/machines/pump-1/silence", hours=hours).status_code == 422
    assert silence_of_pump_1(plant) is None

    send(client, "/machines/pump-1/silence", who="Ada", hours=8, note="test run")
    until = silence_of_pump_1(plant)
    assert timedelta(hours=7.9) < until - datetime.now(UTC) < timedelta(hours=8.1)
    assert "Messages are silenced until" in client.get("/machines/pump-1").text
    assert "Silenced" in client.get("/").text

    send(client, "/machines/pump-1/silence/end", who="Ada")
    assert "Messages are silenced until" not in client.get("/machines/pump-1").text


def test_after_maintenance_the_baseline_is_learned_anew_and_alarms_are_closed(
    client: TestClient, plant
) -> None:
    send(
        client,
        "/machines/pump-1/events",
        kind="maintenance",
        who="Ada",
        note="new slippers",
        finding="slipper 2",
    )

    assert plant.history.reader.alarm(1).state == "closed"
    assert plant.history.reader.operating_points("pump-1") == []

    text = client.get("/machines/pump-1").text
    assert "new slippers" in text
    assert "Earlier alarms" in text
    assert "Finding: slipper 2" in text
    assert "No suspect is named" in text


@pytest.mark.parametrize(
    "address",
    [
        "/machines/x",
        "/recordings/99999",
        "/recordings/0",
        # beyond the integers of the database
        "/recordings/9" + "9" * 40,
        "/alarms/77",
        "/nothing",
        "/recordings/x",
        "/machines/pump-1?before=0",
        "/machines/pump-1?before=99999999999999999999",
    ],
)
def test_an_address_that_does_not_exist_is_answered_by_a_page(
    reader: TestClient, address: str
) -> None:
    answer = reader.get(address)
    assert answer.status_code in (404, 422)
    assert "<h1>" in answer.text
    assert "Traceback" not in answer.text


def test_an_error_page_answers_while_the_history_cannot_be_reached(
    client: TestClient, plant, monkeypatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise HistoryError("postgresql://user:secret@host is gone")

    for name in ("machines", "sequence", "recordings_by_state"):
        monkeypatch.setattr(type(plant.history.reader), name, fail)

    answer = client.get("/")
    assert answer.status_code == 503
    assert "secret" not in answer.text

    assert client.get("/api/machines").status_code == 503
    assert client.get("/health").status_code == 503
    assert "swashtwin_history_up 0.0" in client.get("/metrics").text


def drawings(text: str) -> list[ElementTree.Element]:
    """Return the figures of a page."""
    return [
        ElementTree.fromstring(svg)
        for svg in re.findall(r'<svg class="drawing".*?</svg>.*?</svg>', text)
    ]


def field(drawing: ElementTree.Element) -> list[str | None]:
    """Return the kinds of the elements in the field of a figure."""
    return [part.get("class") for part in drawing[0]]


def points(drawing: ElementTree.Element, kind: str) -> np.ndarray:
    """Return the coordinates of a line's points in the field."""
    (path,) = (part for part in drawing[0] if part.get("class") == kind)
    return np.array(re.findall(r"[\d.-]+", str(path.get("d"))), float).reshape(-1, 2)


def test_the_figure_of_a_band_power_has_its_healthy_band_and_its_alarm(
    reader: TestClient,
) -> None:
    query = {"channel": "x", "indicator": "shaft order 7", "point": "1500 rpm, 15 MPa"}

    deviation, evidence, band_power, order_map, _ = drawings(
        reader.get("/machines/pump-1", params=query).text
    )
    assert field(deviation) == ["alarm", "main", "dots"]
    assert field(evidence) == ["alarm", "alarm", "main", "dots"]
    assert field(order_map)[-2:] == ["rise-4", "alarm"]
    assert field(band_power) == ["band", "median", "alarm", "main", "dots"]
    assert len(points(band_power, "main")) == len(band_power.get("data-ids").split()) == 34

    trend = reader.get("/api/machines/pump-1/trend", params=query).json()["values"]
    low, high = map(float, band_power.get("data-y").split())
    heights = 1 - points(band_power, "main")[:, 1] / HEIGHT
    assert low + heights * (high - low) == pytest.approx(trend, abs=0.05)


def test_the_figure_of_a_spectrum_lies_over_healthy_recordings_and_marks_the_pistons(
    client: TestClient, plant
) -> None:
    recording_id = newest_recording(plant, "pump-1")
    figures = drawings(client.get(f"/recordings/{recording_id}").text)

    assert [field(figure)[-2:] for figure in figures] == [["band", "main"]] * 3
    assert [text.text for text in figures[0] if text.get("class") == "name"][:2] == ["7×", "14×"]

    # The axis ends a little beyond the fourth line of seven pistons; the field is 1000 wide.
    end_order = float(figures[0].get("data-x").split()[1])
    assert 28 < end_order < 32
    piston_x = 1000 * 7 / end_order

    def peak_y(kind: str) -> float:
        line = points(figures[0], kind)
        return line[np.abs(line[:, 0] - piston_x) < 3][:, 1].min()

    # y counts downward: a lower value is a higher amplitude
    low, high = map(float, figures[0].get("data-y").split())
    decades_above_healthy = (peak_y("band") - peak_y("main")) / HEIGHT * (high - low)
    assert 10**decades_above_healthy > 2


def test_all_frequencies_of_a_recording_are_shown_on_request(reader: TestClient) -> None:
    text = reader.get("/recordings/34").text
    assert 'href="?axis=frequency#spectrum"' in text

    text = reader.get("/recordings/34?axis=frequency").text
    (figure, *_) = drawings(text)
    assert figure.get("aria-label") == "x [m/s²] over frequency [Hz]"
    assert figure.get("data-x").split()[1] == "3200.0"
    assert 'href="?#spectrum"' in text


@pytest.mark.parametrize("kind", ["", "log", "time"])
@given(some.lists(some.floats(1e-6, 1e10), min_size=1, max_size=5))
@example([2.9])  # the highest tick is the end, and its share was rounded to above one
@example([1e10, 9_999_999_999.999998])  # the space at the ends was lost in rounding
def test_an_axis_has_some_round_values_within_its_ends(kind: str, values: list[float]) -> None:
    axis = Axis.around(values, kind=kind)

    assert len(axis.ticks()) <= 8
    assert all(0 <= share <= 1 for share, _ in axis.ticks())

    shares = axis.share(np.array(values))
    assert ((shares > 0) & (shares < 1)).all()


def test_only_scripts_and_styles_are_cached_and_no_other_file_is_served(
    reader: TestClient,
) -> None:
    assert "max-age" in reader.get("/static/page.js").headers["cache-control"]
    assert "no-store" in reader.get("/").headers["cache-control"]

    for name in ("..%2fpage.py", "page.py", "%2e%2e/users.py", "nothing"):
        assert reader.get(f"/static/{name}").status_code == 404
