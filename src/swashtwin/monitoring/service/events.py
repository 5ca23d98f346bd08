"""What people do to a machine, as the history keeps it."""

from datetime import UTC, datetime

from swashtwin.foundation import InputError
from swashtwin.monitoring.config import WatchConfig
from swashtwin.monitoring.history import History


def record_event(config: WatchConfig, history: History, machine: str, *, who: str, note: str, maintenance: bool) -> int:
    """Number of the event. After maintenance all baselines of the machine are learned anew, and its alarms are closed.

    Raises
    ------
    InputError
        The configuration has no such machine.
    """
    if config.machine(machine) is None:
        listed = ", ".join(item.name for item in config.machines[:20])
        raise InputError(f"{config.path} has no machine {machine!r}; there are {listed}.")
    with history.machine(machine) as transaction:
        number = transaction.add_event("maintenance" if maintenance else "note", who, note)
        if maintenance:
            transaction.forget_points()
            for alarm in transaction.alarms():
                if alarm.state == "open":
                    transaction.acknowledge(alarm.id, who, note)
                transaction.clear_alarm(alarm.id, datetime.now(UTC))
    return number
