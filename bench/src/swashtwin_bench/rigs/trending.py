"""Recordings of one of the rig's pumps with faults of chosen severity, which `rig_recordings` does not have."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from swashtwin.foundation import MPa, deg, stream, um
from swashtwin.pump import BoreDefect, DamScratch, Fault, GrooveErosion, PistonWear, load_pump
from swashtwin.recordings import Recording
from swashtwin_bench.rigs.fleet import RECESS, draw_specimen
from swashtwin_bench.rigs.measuring import Run, measure
from swashtwin_bench.rigs.version_three.fleet import MODES, Damage
from swashtwin_bench.rigs.writing import SAMPLE_RATE, recording_of, run_of

TRENDS: Mapping[str, Fault] = MappingProxyType(
    {
        "swash_plate": RECESS,
        "piston": PistonWear(um(60)),
        "cylinder_block": BoreDefect(um(270), half_width=deg(40)),
        "scratched_valve_plate": DamScratch(0.8e-6),
        "eroded_grooves": GrooveErosion(deg(5)),
    }
)
"""Fault of each trend, as severe as the rig's typical one (docs/bench/rig.md)."""


def trends_of(version: str) -> Mapping[str, Fault]:
    """Typical fault of each trend in a version of the rig; versions 1 and 2 have the same, `TRENDS`."""
    return {mode: Damage(1.0, mode) for modes in MODES.values() for mode in modes} if version == "3" else TRENDS


def trend_recordings(
    seed: int,
    specimen: str,
    *,
    severities: Sequence[float] = (0.3, 0.6, 1.0, 1.7, 3.0),
    healthy: int = 5,
    pressure: float = MPa(10),
    duration: float = 4.0,
) -> Iterator[tuple[Recording, Run]]:
    """Healthy recordings of one pump, then its trend with each fault of `TRENDS`, each with the truth behind it.

    As in the rig, the pump is taken apart before each recording, and its condition varies. No recording of
    `rig_recordings` is among them.

    Parameters
    ----------
    seed : which fleet.
    specimen : which pump of it, such as ``"A"``.
    severities : over the typical one; the widths of bores scatter as in the rig.
    pressure : set discharge pressure [Pa].
    duration : length of each recording [s].
    """
    pump = draw_specimen(load_pump("25scy14-1b"), specimen, seed)
    named_faults: list[tuple[str, Fault | None]] = [(f"{specimen}_trend_normal_{n + 1}", None) for n in range(healthy)]
    for kind, typical in TRENDS.items():
        named_faults += [(f"{specimen}_trend_{kind}_{factor:g}", typical.scaled(factor)) for factor in severities]
    runs = []
    for name, fault in named_faults:
        run = run_of(name, pump, pressure, seed, None)
        if isinstance(fault, BoreDefect):
            fault = replace(fault, half_width=deg(stream(seed, "trend", name).uniform(36, 44)))
        runs.append(replace(run, fault=fault))
    signals = measure(runs, duration, SAMPLE_RATE, [(seed, name) for name, _ in named_faults])
    for (name, fault), run, signal in zip(named_faults, runs, signals, strict=True):
        label = "normal" if fault is None else fault.label
        yield recording_of(name, label, pressure, run, signal), run
