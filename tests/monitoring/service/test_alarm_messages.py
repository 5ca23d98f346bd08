"""What messages of alarms say."""

from pathlib import Path

from judgments import START
from msgspec.structs import replace
from watched_pumps import watch_config

from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.service.alarm_messages import AlarmPoster, Occasion


def test_a_message_states_pressures_in_the_unit_of_the_configuration(tmp_path: Path) -> None:
    config = replace(watch_config(tmp_path, '[[channel]]\nkind = "log"'), pressure_unit="bar")
    history = History.open("", tmp_path)
    reasons = ["Discharge pressure 15 MPa was not trained (trained: 5 and 10.5 MPa)."]

    with history.machine("pump-1") as machine:
        alarm = machine.open_alarm("pump", "1500 rpm, 15 MPa", START, {}, None)
        occasion = Occasion(START, START, "c0ffee")
        AlarmPoster(config).post(machine, "opened", alarm, occasion, reasons)
    (message,) = history.outbox.claim(["log"], limit=1)
    history.close()

    assert message.body["point"] == "1500 rpm, 150 bar"
    assert message.body["reasons"] == [
        "Discharge pressure 150 bar was not trained (trained: 50 and 105 bar)."
    ]
