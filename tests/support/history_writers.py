"""Processes that write to a history, to be killed."""

from pathlib import Path

from judgments import judgment, waveform

from swashtwin.monitoring.config.settings import Retention
from swashtwin.monitoring.history.history import History

RETENTION = Retention(per_day=1, latest=5)
"""Small, so that files are removed all the time."""


def file_recordings(url: str, folder: Path, machine: str, count: int) -> None:
    """File recordings up to `count` that the machine does not have yet, each with its state and a
    message.

    The last one that it has comes again, as it does if a watch was killed before it removed the
    delivery.
    """
    history = History.open(url, folder, RETENTION)
    point = next(iter(history.reader.operating_points(machine)), None)
    filed = (point.test if point and point.test else {}).get("filed", 0)

    for number in range(max(0, filed - 1), count):
        facts = judgment(number)
        path = history.waveforms.write(machine, facts.time, facts.content, waveform(number))
        with history.machine(machine) as transaction:
            if transaction.recording_of(facts.content) is not None:
                continue
            point = transaction.operating_point("a")
            filed = 0 if point is None or point.test is None else point.test["filed"]
            recording = transaction.add_recording(facts, {("x", "rms"): float(number)}, path)
            transaction.save_operating_point("a", test={"filed": filed + 1})
            transaction.post("log", {"recording": recording})

    history.close()


def file_in_turns(url: str, folder: Path, machines: int, count: int) -> None:
    """File recordings of several machines, as one of several watches that get the same
    deliveries.
    """
    for number in range(machines):
        file_recordings(url, folder, f"pump-{number}", count)


def send_messages(url: str, folder: Path, target: Path) -> None:
    """Append the number of each message of the outbox to a file until none waits."""
    history = History.open(url, folder, RETENTION)
    with target.open("a", encoding="utf-8") as file:
        while history.outbox.waiting(["log"]):
            for message in history.outbox.claim(["log"], limit=5):
                file.write(f"{message.id}\n")
                file.flush()
                history.outbox.mark_sent(message.id)

    history.close()
