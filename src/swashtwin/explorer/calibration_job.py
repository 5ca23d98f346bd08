"""Run one calibration in the background; it can be watched and stopped."""

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from swashtwin.foundation import InputError, SwashTwinError
from swashtwin.recordings import Recordings

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration
    from swashtwin.physics import Twin


class _StoppedError(Exception):
    """The calibration was stopped."""


@dataclass
class _Run:
    """Progress of one calibration; its thread writes, requests read."""

    state: str = "none"
    """``none``, ``running``, ``stopped``, ``failed`` or ``done``."""
    step: int = 0
    """Number of the newest step."""
    total: int = 0
    """Steps in all; 0 until it is known."""
    loss: float | None = None
    """Misfit of the newest step."""
    error: str = ""
    """Why it failed."""
    is_stopped: bool = False
    """Whether it shall stop after its current step."""


class CalibrationJob:
    """At most one running calibration, and the result of the last successful one."""

    def __init__(self) -> None:
        self.result: Calibration | None = None
        self._run = _Run()

    def start(self, twin: "Twin", recordings: Recordings) -> None:
        """Start to calibrate a twin on recordings.

        Raises
        ------
        InputError
            A calibration runs already.
        """
        if self._run.state == "running":
            raise InputError("A calibration is already running. Stop it first.")
        # A new object, so that a stopped run that still ends cannot change the new one's progress.
        self._run = _Run("running")
        arguments = (self._run, twin, recordings)
        threading.Thread(target=self._calibrate, args=arguments, daemon=True).start()

    def stop(self) -> None:
        """Stop after the current step."""
        self._run.is_stopped = True

    def progress(self) -> dict[str, Any]:
        """Return state and progress."""
        run = self._run
        return {
            "state": run.state,
            "step": run.step,
            "total": run.total,
            "loss": run.loss,
            "error": run.error,
        }

    def _calibrate(self, run: _Run, twin: "Twin", recordings: Recordings) -> None:
        from swashtwin.calibration import calibrate

        def report(step: int, total: int, loss: float) -> None:
            run.step = step
            run.total = total
            run.loss = float(loss)
            if run.is_stopped:
                raise _StoppedError

        try:
            self.result = calibrate(twin, recordings, progress=report)
            run.state = "done"
        except _StoppedError:
            run.state = "stopped"
        except SwashTwinError as cause:
            run.error = str(cause)
            run.state = "failed"
        except Exception as cause:
            # An error of ours is shown on the page, since the thread has no other reader.
            run.error = repr(cause)
            run.state = "failed"
