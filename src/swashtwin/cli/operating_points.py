"""Operating points that the options --speed, --pressure and --temperature name."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.options import condition_from

if TYPE_CHECKING:
    from swashtwin.physics import Twin
    from swashtwin.pump import Fault, Pump
    from swashtwin.recordings import Recording

_SPEED_TOLERANCE = 0.01  # as in a calibration, whose lines move with the speed

Speeds = Annotated[
    str | None, typer.Option("--speed", help='Use recordings at this shaft speed only, such as "860 rpm".')
]
Pressures = Annotated[
    list[str] | None,
    typer.Option(
        "--pressure", help='Use recordings at this absolute discharge pressure only, such as "15 MPa"; repeatable.'
    ),
]
OptionalTemperature = Annotated[
    str | None,
    typer.Option("--temperature", help='Oil temperature where --speed and --pressure are given, such as "45 degC".'),
]


@dataclass(frozen=True)
class OperatingPoints:
    """Operating points that the options name: all, those of one speed or of some pressures, or complete ones."""

    speed: str | None
    pressures: Sequence[str]
    temperature: str | None

    def __post_init__(self) -> None:
        if self.temperature is not None and not self.is_complete:
            raise typer.BadParameter("needs --speed and --pressure.", param_hint="--temperature")

    @property
    def is_complete(self) -> bool:
        """Whether speed and pressure are named, so that no recording has to state them."""
        return self.speed is not None and bool(self.pressures)

    def twins(self, pump: "Pump", fault: "Fault | None") -> "Pump | list[Twin]":
        """A twin at each operating point; the pump itself where the recordings state the points."""
        from swashtwin.physics import Twin

        if self.speed is None or not self.pressures:
            return pump
        conditions = [condition_from(self.speed, text, self.temperature) for text in self.pressures]
        return [Twin(pump, condition, fault) for condition in conditions]

    def select(self, recordings: "Sequence[Recording]") -> "Sequence[Recording]":
        """The recordings within 1 % of the speed or 6 % of a pressure, where only one of both is named."""
        from swashtwin.foundation import DataError, parse
        from swashtwin.pump import PRESSURE_TOLERANCE, values_match

        if self.is_complete or (self.speed is None and not self.pressures):
            return recordings
        speeds = [] if self.speed is None else [parse(self.speed, "rad/s", name="--speed")]
        pressures = [parse(text, "Pa", name="--pressure") for text in self.pressures]
        chosen = [
            recording
            for recording in recordings
            if (condition := recording.condition) is not None
            and all(values_match(condition.speed, speed, _SPEED_TOLERANCE) for speed in speeds)
            and (
                not pressures
                or any(values_match(condition.discharge_pressure, limit, PRESSURE_TOLERANCE) for limit in pressures)
            )
        ]
        if not chosen:
            words = ", ".join(self.pressures) or self.speed
            raise DataError(
                f"no recording states an operating point at {words}; swashtwin inspect shows what there is."
            )
        return chosen
