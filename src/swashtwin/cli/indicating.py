"""Commands about what a recording tells without a classifier: features, spectrum, trend."""

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, say, table, tell
from swashtwin.cli.exits import require_target
from swashtwin.cli.indicator_tables import number_or_none, show_medians, show_points, show_trend_summary
from swashtwin.cli.options import CalibrationFactor, Channels, Json, SampleRate, Unit, given
from swashtwin.cli.recordings import load_all, refuse_source
from swashtwin.cli.shaft import Pulses, Tachometer, Track, require_one_way, shaft_angle, vibration_of
from swashtwin.cli.summaries import MOST_ROWS, All

if TYPE_CHECKING:
    from swashtwin.recordings import Recording
    from swashtwin.signals import Indicator, IndicatorTable

Sources = Annotated[list[Path], typer.Argument(metavar="FILE|INDEX...", help="Files, indexes, or folders with one.")]
Pistons = Annotated[
    int | None, typer.Option(min=1, help="Number of pistons z, for lines at z and 2 z times the shaft.")
]
OwnSpeed = Annotated[str | None, typer.Option(help='Shaft speed where a file does not say it: "860 rpm".')]
Bands = Annotated[
    list[str] | None, typer.Option("--band", help='Band in Hz or shaft orders, "10-1000 Hz", "0.5-6.5x"; repeatable.')
]

_NO_ZONE = "No ISO zone is printed: no part of ISO 20816 or 10816 is made for axial piston pumps."
_FEW = ("rms", "velocity_rms", "crest_factor", "kurtosis")
"""Indicators that the screen has room for, beside the amplitudes of orders."""


class SpectrumKind(StrEnum):
    """Spectra that can be drawn."""

    amplitude = "amplitude"
    envelope = "envelope"
    order = "order"
    cepstrum = "cepstrum"


class Order(StrEnum):
    """What a trend goes by."""

    time = "time"
    name = "name"


def features(
    source: Sources,
    out: Annotated[Path | None, typer.Option(help="CSV file to write, all columns with their units.")] = None,
    pistons: Pistons = None,
    band: Bands = None,
    family: Annotated[
        list[str] | None, typer.Option(help="Only this family (statistics, velocity, bands, ...); repeatable.")
    ] = None,
    tachometer: Tachometer = None,
    pulses: Pulses = None,
    track: Track = None,
    speed: OwnSpeed = None,
    sample_rate: SampleRate = None,
    unit: Unit = None,
    calibration_factor: CalibrationFactor = None,
    channels: Channels = None,
    show_all: All = False,
    as_json: Json = False,
) -> None:
    """Table of indicators: velocity, levels, orders, envelope, cepstrum, for each recording and channel.

    No ISO zone is printed (none is made for axial piston pumps): compare with the machine's own baseline by swashtwin
    trend.
    """
    if out is not None:
        require_target(out, ".csv")
        refuse_source(out, source)
    facts = given(
        sample_rate=sample_rate, unit=unit, calibration_factor=calibration_factor, channels=channels, speed=speed
    )
    made = _table_of(load_all(source, **facts), pistons, band, family, tachometer, pulses, track)
    if out is not None:
        from swashtwin.foundation import write_text

        write_text(out, made.csv)

    def show() -> None:
        picked = [one for one in made.columns if one.name in _FEW or one.name.startswith("order_amplitude")]
        shown = [[row[made.columns.index(one)] * one.shown[0] for one in picked] for row in made.values.tolist()]
        names = [_header(one) for one in picked]
        if show_all or len({row.recording_id for row in made.rows}) <= MOST_ROWS:
            told = zip(made.rows, shown, strict=True)
            rows = [(row.recording_id, row.channel, *map(number_or_none, values)) for row, values in told]
            table(f"{len(made.rows)} rows", ("recording", "channel", *names), rows)
        else:
            show_medians(made.rows, shown, names)
        say(f"{len(made.columns)} indicators in all{f': {out}' if out else '; --out FILE.csv keeps them'}. {_NO_ZONE}")

    tell({"csv": out, **made.to_dict()}, as_json, show)


def spectrum(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording to look at.")],
    kind: Annotated[SpectrumKind, typer.Option(help="Which spectrum.")] = SpectrumKind.amplitude,
    out: Annotated[
        Path | None, typer.Option(help="SVG file to write, NAME-data.csv beside it; FILE_KIND.svg here.")
    ] = None,
    pistons: Pistons = None,
    band: Annotated[
        str | None, typer.Option(help='Band of the envelope, "2-5 kHz"; the kurtogram\'s by default.')
    ] = None,
    resolution: Annotated[
        float | None, typer.Option(help="Spacing of lines in Hz, or in orders; the whole recording at once by default.")
    ] = None,
    top: Annotated[float | None, typer.Option(help="End of the drawn axis, in its unit (Hz, orders, s).")] = None,
    tachometer: Tachometer = None,
    pulses: Pulses = None,
    track: Track = None,
    speed: OwnSpeed = None,
    sample_rate: SampleRate = None,
    unit: Unit = None,
    calibration_factor: CalibrationFactor = None,
    channels: Channels = None,
    as_json: Json = False,
) -> None:
    """Amplitude, envelope or order spectrum, or cepstrum, with the lines of shaft and pistons marked: CSV and SVG."""
    from swashtwin.foundation import write_text
    from swashtwin.report import spectrum_drawing
    from swashtwin.signals import Band, spectrum_of

    target = out or Path(f"{file.stem}_{kind.value}.svg")
    numbers = _targets(target, [file])
    if band is not None and kind is not SpectrumKind.envelope:
        raise typer.BadParameter("is the band of an envelope: --kind envelope.", param_hint="--band")
    if resolution is not None and kind is SpectrumKind.cepstrum:
        raise typer.BadParameter("a cepstrum is of the whole recording at once.", param_hint="--resolution")
    facts = given(
        sample_rate=sample_rate, unit=unit, calibration_factor=calibration_factor, channels=channels, speed=speed
    )
    recordings = load_all([file], **facts)
    if len(recordings) != 1:
        raise typer.BadParameter(f"{file} holds {len(recordings)} recordings; name one file.", param_hint="FILE")
    require_one_way(tachometer, pulses, track)
    angle = shaft_angle(recordings[0], tachometer, pulses, track)
    shown = vibration_of(recordings[0], tachometer)
    edges = None if band is None else _hertz(Band.parse(band))
    made = spectrum_of(shown, kind.value, angle=angle, pistons=pistons, band=edges, resolution=resolution)
    drawing = spectrum_drawing(made, top=top)
    data = write_text(numbers, drawing.csv)
    write_text(target, drawing.svg)
    marks = [
        {"name": mark.name, "at": mark.at, "value": dict(zip(made.channels, made.at(mark).tolist(), strict=True))}
        for mark in made.marks
    ]
    result = {
        "recording": made.recording_id, "kind": made.kind, "axis": made.axis, "axis_unit": made.axis_unit,
        "unit": made.unit, "marks": marks, "bands_hz": dict(zip(made.channels, made.bands, strict=False)),
        "angle_from": made.angle_from, "svg": target, "csv": data,
    }  # fmt: skip

    def show() -> None:
        for name, (low, high) in zip(made.channels, made.bands, strict=False):
            say(f"{name}: envelope of {low:.0f} to {high:.0f} Hz")
        axis = f"{made.axis}{f' [{made.axis_unit}]' if made.axis_unit else ''}"
        header = ("line", axis, *(f"{name} [{made.unit or '1'}]" for name in made.channels))
        rows = [
            (mark.name, mark.at, *(number_or_none(value) for value in made.at(mark).tolist())) for mark in made.marks
        ]
        if rows:
            table(f"{drawing.title}, at the expected lines", header, rows)
        else:
            note('Nobody stated the speed, so no line is marked; give --speed "860 rpm".')
        say(f"{target}\n{data}")

    tell(result, as_json, show)


def trend(
    source: Sources,
    indicator: Annotated[
        str, typer.Option(help="Indicator to follow, such as rms; swashtwin features lists them.")
    ] = "rms",
    channel: Annotated[str | None, typer.Option(help="Channel to follow; the first by default.")] = None,
    by: Annotated[Order, typer.Option(help="Order: by the attribute date, or by name.")] = Order.name,
    k: Annotated[
        float, typer.Option(help="Spreads (1.4826 MAD) from the baseline at which a recording is flagged.")
    ] = 5.0,
    healthy: Annotated[
        list[str] | None,
        typer.Option(help='Class, or pattern of recording ids, stated to be healthy; "normal" by default, repeatable.'),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="SVG file to write, NAME-data.csv beside it.")] = None,
    pistons: Pistons = None,
    band: Bands = None,
    tachometer: Tachometer = None,
    pulses: Pulses = None,
    track: Track = None,
    speed: OwnSpeed = None,
    sample_rate: SampleRate = None,
    unit: Unit = None,
    calibration_factor: CalibrationFactor = None,
    channels: Channels = None,
    show_all: All = False,
    as_json: Json = False,
) -> None:
    """An indicator over recordings, against the machine's own healthy baseline at the same speed and pressure.

    No ISO zone is printed (none is made for axial piston pumps). A baseline takes five healthy recordings at least.
    """
    from swashtwin.foundation import write_text
    from swashtwin.report import trend_drawing
    from swashtwin.signals import trend_of

    numbers = None if out is None else _targets(out, source)
    facts = given(
        sample_rate=sample_rate, unit=unit, calibration_factor=calibration_factor, channels=channels, speed=speed
    )
    made = _table_of(load_all(source, **facts), pistons, band, None, tachometer, pulses, track)
    found = trend_of(made, indicator, channel=channel, by=by.value, k=k, healthy=healthy or ("normal",))
    data = None
    if out is not None and numbers is not None:
        drawing = trend_drawing(found)
        data = write_text(numbers, drawing.csv)
        write_text(out, drawing.svg)

    def show() -> None:
        if show_all or len(found.points) <= MOST_ROWS:
            show_points(found)
        else:
            show_trend_summary(found)
        without = sum(point.status == "no baseline" for point in found.points)
        if without:
            note(f"{without} recordings have no baseline: it takes 5 other healthy ones of the machine at that point.")
        small = min((point.count for point in found.points if point.status != "no baseline"), default=12)
        if small < 12:
            note(f"The smallest baseline has {small} recordings; it flags some healthy ones (docs/indicators.md).")
        say(f"{len(found.flagged)} of {len(found.points)} flagged beyond {k:g} spreads. {_NO_ZONE}")
        if out is not None:
            say(f"{out}\n{data}")

    tell({**found.to_dict(), "svg": out, "csv": data}, as_json, show)


def _table_of(
    recordings: "Sequence[Recording]",
    pistons: int | None,
    bands: list[str] | None,
    families: list[str] | None,
    tachometer: str | None,
    pulses: int | None,
    track: str | None,
) -> "IndicatorTable":
    from swashtwin.foundation import DataError, InputError
    from swashtwin.signals import BANDS, FAMILIES, Band, indicators_of, stacked

    require_one_way(tachometer, pulses, track)
    wanted = tuple(Band.parse(text) for text in bands or ()) or BANDS
    asked = families or list(FAMILIES)
    tables, refusals = [], []
    for recording in recordings:
        angle, without = None, asked
        try:
            angle = shaft_angle(recording, tachometer, pulses, track)
        except (DataError, InputError) as refusal:
            refusals.append(refusal)
            without = [name for name in asked if name != "orders"]
        shown = vibration_of(recording, tachometer)
        tables.append(indicators_of(shown, angle=angle, pistons=pistons, bands=wanted, families=without))
    if refusals and len(refusals) == len(recordings):
        raise refusals[0]
    for reason in refusals:
        note(f"no orders: {reason}")
    return stacked(tables)


def _targets(figure: Path, sources: list[Path]) -> Path:
    """The CSV file beside a figure; neither may be one of the files read."""
    require_target(figure, ".svg")
    numbers = figure.with_name(f"{figure.stem}-data.csv")
    for target in (figure, numbers):
        refuse_source(target, sources)
    return numbers


def _header(indicator: "Indicator") -> str:
    name = indicator.name.removeprefix("order_amplitude ").replace("_", " ")
    return f"{name} [{indicator.shown[1]}]" if indicator.unit else name


def _hertz(band: Any) -> tuple[float, float]:
    if band.in_orders:
        raise typer.BadParameter("the band of an envelope is in Hz: 2-5 kHz.", param_hint="--band")
    return band.low, band.high
