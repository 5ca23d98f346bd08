"""The turning pumps of the alarms, computed in another process.

A twin needs torch, whose import takes seconds, and 320 MB that a watch would keep for good.
"""

import logging
import threading
from functools import lru_cache

from swashtwin.foundation import ChildDiedError, PressureUnit, run_in_child
from swashtwin.monitoring.config.settings import Machine
from swashtwin.monitoring.history.schema import Judgment
from swashtwin.report import LivingPump, build_living_pumps

BUILD_TIMEOUT_S = 120.0
"""Time limit of a drawing, which takes some seconds."""
N_CACHED_DRAWINGS = 16
"""Drawings that are kept, since an alarm is opened again and again; one takes 40 kB."""
_log = logging.getLogger("swashtwin.watch")


class PumpDrawings:
    """Draws pumps with a typical fault.

    Parameters
    ----------
    pressure_unit : unit in which their pressures are shown.
    """

    def __init__(self, pressure_unit: PressureUnit) -> None:
        self._pressure_unit = pressure_unit
        self._lock = threading.Lock()
        self._build = lru_cache(maxsize=N_CACHED_DRAWINGS)(_build_in_child)

    def draw(
        self, label: str, machine: Machine | None, judgment: Judgment | None
    ) -> tuple[LivingPump, ...]:
        """Return a machine's pump with a typical fault; empty if it cannot be simulated.

        Parameters
        ----------
        label : class of the fault.
        machine : the machine, if it is still configured.
        judgment : recording whose operating point is simulated.
        """
        facts = (
            None if machine is None else machine.pump,
            None if machine is None else machine.pistons,
            None if judgment is None else judgment.speed,
            None if judgment is None else judgment.pressure,
        )
        # Visitors who open the same alarm at the same time wait for one process.
        with self._lock:
            try:
                return self._build(label, *facts, self._pressure_unit)
            except ChildDiedError as cause:  # also at the end of the watch
                _log.warning("the pump of an alarm could not be drawn: %s", cause)
                return ()
            except Exception as cause:  # a page is complete without its drawing
                _log.warning("the pump of an alarm could not be drawn", exc_info=cause)
                return ()


def _build_in_child(
    label: str,
    pump: str | None,
    pistons: int | None,
    speed: float | None,
    pressure: float | None,
    pressure_unit: PressureUnit,
) -> tuple[LivingPump, ...]:
    return run_in_child(
        build_living_pumps,
        label,
        pump,
        pistons,
        speed,
        pressure,
        pressure_unit,
        timeout_s=BUILD_TIMEOUT_S,
    )
