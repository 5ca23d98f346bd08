"""Options that say where the shaft stood: a tachometer channel, or a line to follow."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.options import read_list

if TYPE_CHECKING:
    from swashtwin.recordings import Recording
    from swashtwin.signals import ShaftAngle

Tachometer = Annotated[
    str | None,
    typer.Option(metavar="CHANNEL[:PULSES]", help='Channel with the pulses of a tachometer; "tacho:60" has 60 a turn.'),
]
Track = Annotated[
    str | None,
    typer.Option(metavar="ORDERS", help='Follow the clearest line of these orders for the shaft angle: "7,14,28".'),
]


@dataclass(frozen=True)
class Shaft:
    """Where a recording's shaft angle comes from; options that contradict each other are a wrong command line."""

    tachometer: str | None
    track: str | None

    def __post_init__(self) -> None:
        if self.tachometer is not None and self.track is not None:
            raise typer.BadParameter("give either --tachometer or --track, not both.", param_hint="--track")
        read_list(self.track, int, "--track")

    def angle_of(self, recording: "Recording") -> "ShaftAngle | None":
        """The shaft's angle, or None where no option says how to find it."""
        if self.tachometer is not None:
            from swashtwin.recordings import load_beside
            from swashtwin.signals import tachometer_speed

            channel, pulses = self._tachometer_of(recording)
            source = recording if channel in recording.channels else load_beside(recording, channel)
            return tachometer_speed(source, channel, pulses)
        orders = read_list(self.track, int, "--track")
        if orders is None:
            return None
        from swashtwin.signals import tracked_speed

        return tracked_speed(recording, order=orders)

    def vibration_of(self, recording: "Recording") -> "Recording":
        """The recording without the tachometer."""
        if self.tachometer is None:
            return recording
        channel, _ = self._tachometer_of(recording)
        return recording.picked([name for name in recording.channels if name != channel])

    def _tachometer_of(self, recording: "Recording") -> tuple[str, int]:
        """Channel of the tachometer, and its pulses per turn; a channel's own name may hold a colon."""
        assert self.tachometer is not None
        channel, colon, pulses = self.tachometer.rpartition(":")
        if self.tachometer in recording.channels or not (colon and pulses.isdigit() and int(pulses) > 0):
            return self.tachometer, 1
        return channel, int(pulses)
