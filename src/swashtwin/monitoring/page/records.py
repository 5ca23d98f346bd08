"""Machines, recordings and alarms by their addresses, and the changes that a visitor may make."""

from collections.abc import Sequence
from datetime import timedelta

from fastapi import HTTPException

from swashtwin.foundation import InputError
from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.history.tables import Alarm, Judgment
from swashtwin.monitoring.page.site import Site
from swashtwin.monitoring.service.judging import record_event

MOST_HOURS = 24 * 366
"""Longest silence [h]."""


def all_machines(site: Site) -> Sequence[MachineOverview]:
    """Machines of the history, and those of the configuration that sent nothing yet."""
    stored = site.history.read.machines()
    names = {machine.name for machine in stored}
    return [*stored, *(MachineOverview(machine.name) for machine in site.config.machines if machine.name not in names)]


def find_machine(site: Site, name: str) -> MachineOverview:
    """A machine by its name; 404 where there is none."""
    for machine in all_machines(site):
        if machine.name == name:
            return machine
    raise HTTPException(404, f"There is no machine {name[:100]}.")


def find_recording(site: Site, identity: int) -> Judgment:
    """A stored recording by its id; 404 where there is none."""
    stored = site.history.read.recording(identity) if 0 < identity < 2**31 else None
    if stored is None:
        raise HTTPException(404, f"There is no recording {identity}.")
    return stored


def find_alarm(site: Site, identity: int) -> Alarm:
    """An alarm by its id; 404 where there is none."""
    alarm = site.history.read.alarm(identity) if 0 < identity < 2**31 else None
    if alarm is None:
        raise HTTPException(404, f"There is no alarm {identity}.")
    return alarm


def acknowledge(site: Site, identity: int, who: str, note: str) -> None:
    """Acknowledge an open alarm; 409 where somebody else did."""
    alarm = find_alarm(site, identity)
    try:
        with site.history.machine(alarm.machine) as machine:
            machine.acknowledge(identity, who, note)
    except InputError as error:
        raise HTTPException(409, str(error)) from None


def silence(site: Site, name: str, hours: float, who: str, note: str) -> None:
    """Send no message of a machine for so many hours."""
    find_machine(site, name)
    with site.history.machine(name) as machine:
        machine.silence(site.clock() + timedelta(hours=hours), who, note)


def end_silence(site: Site, name: str) -> None:
    """Send messages of a machine again."""
    find_machine(site, name)
    with site.history.machine(name) as machine:
        machine.end_silence()


def add_event(site: Site, name: str, kind: str, who: str, note: str) -> None:
    """Add an event to a machine's history; after ``maintenance`` its healthy baselines are learned anew."""
    find_machine(site, name)
    try:
        record_event(site.config, site.history, name, who=who, note=note, maintenance=kind == "maintenance")
    except InputError as error:
        raise HTTPException(422, str(error)) from None
