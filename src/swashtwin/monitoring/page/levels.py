"""Which level of a machine's recordings a trend shows, and its baseline."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, urlencode

from swashtwin.monitoring.alarms import baseline_levels
from swashtwin.monitoring.history import MachineOverview
from swashtwin.monitoring.page.site import Site
from swashtwin.monitoring.page.wording import VERDICT_NAMES, grouped_levels, stored_name


@dataclass(frozen=True)
class LevelChoice:
    """One level of one machine."""

    machine: str
    """Machine."""
    channel: str
    """Channel; empty for what is stored of the recording as a whole."""
    level: str
    """Name of the level."""
    point: str
    """Operating point, or empty for all."""
    channels: tuple[str, ...]
    """Channels to choose from."""
    levels: Sequence[tuple[str, Sequence[str]]]
    """Levels of the channel to choose from, by kind."""
    points: tuple[str, ...]
    """Operating points to choose from."""

    @property
    def title(self) -> str:
        """Name of the level and its channel."""
        return VERDICT_NAMES[self.level][0] if self.level in VERDICT_NAMES else f"{self.channel}: {self.level}"

    def address(self, channel: str, level: str) -> str:
        """Address of the figure of a level at this choice's operating point."""
        query = urlencode({"channel": channel, "level": level, "point": self.point})
        return f"/charts/machines/{quote(self.machine, safe='')}/trend?{query}"

    def context(self) -> dict[str, Any]:
        """What the template of the machine's page needs."""
        return {
            "channel": self.channel,
            "level": self.level,
            "point": self.point,
            "channels": self.channels,
            "levels": self.levels,
            "points": self.points,
            "level_title": self.title,
            "verdict_names": {name: title for name, (title, _) in VERDICT_NAMES.items()},
            "figure_addresses": {
                "evidence": self.address("", "capital"),
                "level": self.address(self.channel, self.level),
            },
        }


def chosen_level(
    site: Site, machine: MachineOverview, channel: str | None, level: str | None, point: str | None
) -> LevelChoice:
    """What was asked for, where the machine has it; else what moved most in its alarm, else its first order."""
    names = site.history.read.indicator_names(machine.name)
    by_channel: dict[str, list[str]] = {}
    for name_of_channel, name in names:
        by_channel.setdefault(name_of_channel, []).append(name)
    by_channel[""] = list(VERDICT_NAMES)
    points = tuple(key.name for key in site.history.read.points(machine.name))
    if point is None:
        point = (machine.last.point if machine.last is not None else None) or ""
    if channel is None:
        channel, level = _most_moved(machine) or (next(iter(by_channel)), None)
    if channel not in by_channel:
        channel = next(iter(by_channel))
    if level not in by_channel[channel]:
        level = grouped_levels(by_channel[channel])[0][1][0]
    return LevelChoice(
        machine.name,
        channel,
        level,
        point if point in points else "",
        tuple(by_channel),
        grouped_levels(by_channel[channel]),
        points,
    )


def baseline_band(site: Site, machine: str, point: str, channel: str, level: str) -> tuple[float, float] | None:
    """(median, spread) of a level's healthy baseline [dB]; None where there is none yet."""
    baseline = site.history.read.baseline(machine, point)
    return baseline_levels(baseline).get((channel, level)) if baseline else None


def _most_moved(machine: MachineOverview) -> tuple[str, str] | None:
    changes = [change for alarm in machine.alarms for change in alarm.evidence.get("moved") or []]
    furthest = max(changes, key=lambda change: abs(change["change"]), default=None)
    return None if furthest is None else (furthest["channel"], stored_name(furthest["level"]))
