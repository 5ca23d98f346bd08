"""Machines, recordings and alarms by their addresses."""

from collections.abc import Sequence

from fastapi import HTTPException

from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.history.tables import Alarm, Judgment
from swashtwin.monitoring.page.site import Site


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
