"""Options that say where the shaft stood: a tachometer channel, or a line to follow."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.options import read_list

if TYPE_CHECKING:
    from swashtwin.recordings import Recording
    from swashtwin.signals import ShaftAngle

Tachometer = Annotated[str | None, typer.Option(help="Channel with the pulses of a tachometer.")]
Pulses = Annotated[int | None, typer.Option(min=1, help="Pulses of the tachometer per turn; 1 by default.")]
Track = Annotated[
    str | None,
    typer.Option(metavar="ORDERS", help='Follow the clearest line of these orders for the shaft angle: "7,14,28".'),
]


@dataclass(frozen=True)
class Shaft:
    """Where a recording's shaft angle comes from; options that contradict each other are a wrong command line."""

    tachometer: str | None
    pulses: int | None
    track: str | None

    def __post_init__(self) -> None:
        if self.tachometer is not None and self.track is not None:
            raise typer.BadParameter("give either --tachometer or --track, not both.", param_hint="--track")
        if self.pulses is not None and self.tachometer is None:
            raise typer.BadParameter("needs the channel that has them: --tachometer.", param_hint="--pulses")
        read_list(self.track, int, "--track")

    def angle_of(self, recording: "Recording") -> "ShaftAngle | None":
        """The shaft's angle, or None where no option says how to find it."""
        if self.tachometer is not None:
            from swashtwin.signals import tachometer_speed

            return tachometer_speed(recording, self.tachometer, self.pulses or 1)
        orders = read_list(self.track, int, "--track")
        if orders is None:
            return None
        from swashtwin.signals import tracked_speed

        return tracked_speed(recording, order=orders)

    def vibration_of(self, recording: "Recording") -> "Recording":
        """The recording without the tachometer."""
        return recording.picked([name for name in recording.channels if name != self.tachometer])
