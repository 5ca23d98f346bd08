"""Options that say where the shaft stood: a tachometer channel, or a line to follow."""

from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.options import list_of

if TYPE_CHECKING:
    from swashtwin.recordings import Recording
    from swashtwin.signals import ShaftAngle

Tachometer = Annotated[str | None, typer.Option(help="Channel with the pulses of a tachometer.")]
Pulses = Annotated[int | None, typer.Option(min=1, help="Pulses of the tachometer per turn; 1 by default.")]
Track = Annotated[
    str | None,
    typer.Option(
        metavar="ORDERS", help='Orders of which the clearest line is followed for the shaft angle: "7,14,28".'
    ),
]


def require_one_way(tachometer: str | None, pulses: int | None, track: str | None) -> None:
    """Refuse a tachometer beside a line to track, and pulses of no tachometer."""
    if tachometer is not None and track is not None:
        raise typer.BadParameter("a tachometer and a line to track are one too many.", param_hint="--track")
    if pulses is not None and tachometer is None:
        raise typer.BadParameter("are those of a channel; name it with --tachometer.", param_hint="--pulses")


def shaft_angle(
    recording: "Recording", tachometer: str | None, pulses: int | None, track: str | None
) -> "ShaftAngle | None":
    """The shaft's angle where an option says how to find it."""
    from swashtwin.signals import tachometer_speed, tracked_speed

    if tachometer is not None:
        return tachometer_speed(recording, tachometer, pulses or 1)
    orders = list_of(track, int, "--track")
    return None if orders is None else tracked_speed(recording, order=orders)


def vibration_of(recording: "Recording", tachometer: str | None) -> "Recording":
    """The channels with vibration."""
    return recording.picked([name for name in recording.channels if name != tachometer])
