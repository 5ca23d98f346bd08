"""Commands of the group signal, which need no classifier: features, spectrum, trend."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from swashtwin.cli.console import (
    MAX_ROWS,
    format_label,
    iterate_with_progress,
    print_note,
    print_result,
    print_rows,
    print_table,
    print_text,
)
from swashtwin.cli.options import Index, Json, Reading, Sources, band_from, read_list, reads_files
from swashtwin.cli.outputs import FIGURE, Force, require_output
from swashtwin.cli.sources import load_sources
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.recordings import Recording
    from swashtwin.signals import IndicatorTable, ShaftAngle, Trend

T = TypeVar("T")
Pistons = Annotated[
    int | None,
    typer.Option(min=1, help="Number of pistons z, for lines at z and 2 z times the shaft."),
]
Bands = Annotated[
    list[str] | None,
    typer.Option(
        "--band", help='Band in Hz or shaft orders, "10-1000 Hz", "0.5-6.5x"; repeatable.'
    ),
]

_TABLE = "recording,channel,class,specimen,date,speed [rpm],pressure [MPa],"
"""Start of a table of indicators."""
_NO_ZONE = "No ISO zone is printed: no part of ISO 20816 or 10816 is made for axial piston pumps."
_SHOWN = ("rms", "velocity_rms", "crest_factor", "kurtosis")
"""Indicators that the screen has room for, beside the amplitudes of orders."""


class SpectrumKind(StrEnum):
    """Spectra that can be drawn."""

    amplitude = "amplitude"
    envelope = "envelope"
    order = "order"


class Order(StrEnum):
    """Order of the recordings of a trend."""

    time = "time"
    name = "name"


Tachometer = Annotated[
    str | None,
    typer.Option(
        metavar="CHANNEL[:PULSES]",
        help='Channel with the pulses of a tachometer; "tacho:60" has 60 a turn.',
    ),
]
Track = Annotated[
    str | None,
    typer.Option(
        metavar="ORDERS",
        help='Follow the clearest line of these orders for the shaft angle: "7,14,28".',
    ),
]


@dataclass(frozen=True)
class Shaft:
    """Where a recording's shaft angle comes from; options that contradict each other are a wrong
    command line.
    """

    tachometer: str | None
    track: str | None

    def __post_init__(self) -> None:
        if self.tachometer is not None and self.track is not None:
            raise typer.BadParameter(
                "give either --tachometer or --track, not both.", param_hint="--track"
            )
        read_list(self.track, int, "--track")

    def angle_of(self, recording: "Recording") -> "ShaftAngle | None":
        """The shaft's angle, or None where no option says how to find it."""
        if self.tachometer is not None:
            from swashtwin.recordings import load_extra_channel
            from swashtwin.signals import tachometer_angle

            channel, pulses = self._tachometer_of(recording)
            source = (
                recording
                if channel in recording.channels
                else load_extra_channel(recording, channel)
            )
            return tachometer_angle(source, channel, pulses)
        orders = read_list(self.track, int, "--track")
        if orders is None:
            return None
        from swashtwin.signals import track_shaft_angle

        return track_shaft_angle(recording, order=orders)

    def vibration_of(self, recording: "Recording") -> "Recording":
        """The recording without the tachometer."""
        if self.tachometer is None:
            return recording
        channel, _ = self._tachometer_of(recording)
        return recording.select_channels([name for name in recording.channels if name != channel])

    def _tachometer_of(self, recording: "Recording") -> tuple[str, int]:
        """Channel of the tachometer, and its pulses per turn; a channel's own name may hold a
        colon.
        """
        assert self.tachometer is not None
        channel, colon, pulses = self.tachometer.rpartition(":")
        if self.tachometer in recording.channels or not (
            colon and pulses.isdigit() and int(pulses) > 0
        ):
            return self.tachometer, 1
        return channel, int(pulses)


@reads_files
def features(
    source: Sources,
    reading: Reading,
    out: Annotated[
        Path | None, typer.Option(help="CSV file to write, all columns with their units.")
    ] = None,
    pistons: Pistons = None,
    band: Bands = None,
    tachometer: Tachometer = None,
    track: Track = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Table of indicators: velocity, levels, orders, envelope, for each recording and channel.

    No ISO zone is printed (none is made for axial piston pumps): compare with the machine's own
    baseline by swashtwin signal trend.
    """
    require_output(out, suffixes=[".csv"], inputs=source, marks=[_TABLE], force=force)
    from swashtwin.recordings import source_files

    shaft = Shaft(tachometer, track)
    recordings = load_sources(source, **reading)
    files = [(str(file.absolute()), file.stat()) for path in source for file in source_files(path)]
    stamps = [(file, stamp.st_size, stamp.st_mtime_ns) for file, stamp in files]
    settings = {
        "pistons": pistons,
        "bands": band,
        "shaft": asdict(shaft),
        "reading": reading,
        "sources": stamps,
    }
    indicators = _indicators_of(recordings, pistons, band, shaft, out, settings)
    if out is not None:
        from swashtwin.foundation import write_text

        write_text(out, indicators.csv)
    print_result(
        {"csv": out, **indicators.to_dict()}, as_json, lambda: _show_indicators(indicators, out)
    )


def _show_indicators(indicators: "IndicatorTable", out: Path | None) -> None:
    columns = [
        (index, column)
        for index, column in enumerate(indicators.columns)
        if column.name in _SHOWN or column.name.startswith("order_amplitude")
    ]
    values = [
        [row[index] * column.shown[0] for index, column in columns]
        for row in indicators.values.tolist()
    ]
    names = [
        column.name.removeprefix("order_amplitude ").replace("_", " ")
        + (f" [{column.shown[1]}]" if column.unit else "")
        for _, column in columns
    ]
    rows = [
        (row.recording_id, row.channel, *numbers)
        for row, numbers in zip(indicators.rows, values, strict=True)
    ]
    print_rows(f"{len(rows)} rows", ("recording", "channel", *names), rows, "--out or --json has")
    where = f": {out}" if out else "; --out FILE.csv writes them"
    print_text(f"{len(indicators.columns)} indicators in all{where}. {_NO_ZONE}")


@reads_files
def spectrum(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording to look at.")],
    reading: Reading,
    kind: Annotated[SpectrumKind, typer.Option(help="Which spectrum.")] = SpectrumKind.amplitude,
    out: Annotated[
        Path | None,
        typer.Option(help="SVG file to write, NAME-data.csv beside it; FILE_KIND.svg here."),
    ] = None,
    pistons: Pistons = None,
    band: Annotated[
        str | None,
        typer.Option(help='Band of the envelope, "2-5 kHz"; the kurtogram\'s by default.'),
    ] = None,
    tachometer: Tachometer = None,
    track: Track = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Amplitude, envelope or order spectrum with the lines of shaft and pistons marked: CSV and
    SVG.
    """
    from swashtwin.foundation import write_text
    from swashtwin.report import draw_spectrum
    from swashtwin.signals import spectrum_of

    target = out or Path(f"{file.stem}_{kind.value}.svg")
    csv_file = _csv_beside(target, [file], force)
    if band is not None and kind is not SpectrumKind.envelope:
        raise typer.BadParameter(
            "is the band of an envelope: --kind envelope.", param_hint="--band"
        )
    shaft = Shaft(tachometer, track)
    edges = None if band is None else band_from(band)
    recordings = load_sources([file], **reading)
    if len(recordings) != 1:
        raise typer.BadParameter(
            f"{file} holds {len(recordings)} recordings; name one file.", param_hint="FILE"
        )
    vibration, angle = shaft.vibration_of(recordings[0]), shaft.angle_of(recordings[0])
    lines = spectrum_of(vibration, kind.value, angle=angle, pistons=pistons, band=edges)
    drawing = draw_spectrum(lines)
    data = write_text(csv_file, drawing.csv)
    write_text(target, drawing.svg)
    marks = [
        {
            "name": mark.name,
            "at": mark.position,
            "value": dict(zip(lines.channels, lines.at(mark).tolist(), strict=True)),
        }
        for mark in lines.marks
    ]
    result = {
        "recording": lines.recording_id, "kind": lines.kind, "axis": lines.axis, "axis_unit": lines.axis_unit,
        "unit": lines.unit, "marks": marks, "bands_hz": dict(zip(lines.channels, lines.bands, strict=False)),
        "angle_from": lines.angle_from, "svg": target, "csv": data,
    }  # fmt: skip

    def show() -> None:
        for name, (low, high) in zip(lines.channels, lines.bands, strict=False):
            print_text(f"{name}: envelope of {low:.0f} to {high:.0f} Hz")
        axis = f"{lines.axis}{f' [{lines.axis_unit}]' if lines.axis_unit else ''}"
        header = ("line", axis, *(f"{name} [{lines.unit or '1'}]" for name in lines.channels))
        rows = [(mark.name, mark.position, *lines.at(mark).tolist()) for mark in lines.marks]
        if rows:
            print_table(f"{drawing.title}, at the expected lines", header, rows)
        else:
            print_note('The speed is not stated, so no line is marked; give --speed "860 rpm".')
        print_text(f"{target}\n{data}")

    print_result(result, as_json, show)


def trend(
    source: Index,
    indicator: Annotated[
        str,
        typer.Option(
            help="Indicator to follow, such as rms; swashtwin signal features lists them."
        ),
    ] = "rms",
    channel: Annotated[
        str | None, typer.Option(help="Channel to follow; the first by default.")
    ] = None,
    by: Annotated[
        Order, typer.Option(help="Order: by the attribute date, or by name.")
    ] = Order.name,
    threshold: Annotated[
        float,
        typer.Option(
            help="Spreads (1.4826 MAD) from the baseline at which a recording is flagged."
        ),
    ] = 5.0,
    baseline: Annotated[
        list[str] | None,
        typer.Option(
            help='Class, or pattern of recording ids, that is healthy; "normal" by default, repeatable.'
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="SVG file to write, NAME-data.csv beside it.")
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """An indicator over recordings, against the machine's own healthy baseline at the same speed
    and pressure.

    No ISO zone is printed (none is made for axial piston pumps). A baseline takes five healthy
    recordings at least.
    """
    from swashtwin.foundation import write_text
    from swashtwin.report import draw_trend
    from swashtwin.signals import trend_of

    csv_file = None if out is None else _csv_beside(out, [source], force)
    indicators = _indicators_of(load_sources([source]), None, None, Shaft(None, None))
    result = trend_of(
        indicators,
        indicator,
        channel=channel,
        by=by.value,
        k=threshold,
        healthy=baseline or ("normal",),
    )
    if out is not None and csv_file is not None:
        drawing = draw_trend(result)
        write_text(csv_file, drawing.csv)
        write_text(out, drawing.svg)

    def show() -> None:
        _show_points(result)
        counts = [point.count for point in result.points if point.status != "no baseline"]
        if without := len(result.points) - len(counts):
            count = f"{plural(without, 'recording')} {'has' if without == 1 else 'have'}"
            print_note(
                f"{count} no baseline: it takes 5 other healthy ones of the machine at that point."
            )
        if counts and min(counts) < 12:
            print_note(f"The smallest baseline has {plural(min(counts), 'recording')}; it flags some healthy ones "
                 "(docs/how-to/indicators.md).")  # fmt: skip
        flagged = f"{len(result.flagged)} of {len(counts)} flagged beyond {threshold:g} spreads."
        print_text(f"{flagged if counts else 'None could be judged.'} {_NO_ZONE}")
        if out is not None:
            print_text(f"{out}\n{csv_file}")

    print_result({**result.to_dict(), "svg": out, "csv": csv_file}, as_json, show)


def _show_points(trend: "Trend") -> None:
    factor, unit = trend.indicator.shown
    flagged = {
        point.row.recording_id: abs(point.value - point.median) / point.spread
        for point in trend.flagged
    }
    points = sorted(trend.points, key=lambda point: -flagged.get(point.row.recording_id, 0.0))
    rows = [
        (
            point.row.recording_id,
            format_label(point.row.label),
            *(factor * value for value in (point.value, point.median, point.spread)),
            point.count,
            point.status,
        )
        for point in (points if len(points) > MAX_ROWS else trend.points)
    ]
    header = (
        "recording",
        "class",
        f"{trend.indicator.name} [{unit or '1'}]",
        "baseline",
        "spread",
        "healthy",
        "status",
    )
    print_rows(f"{trend.indicator.name} of {trend.channel}", header, rows)


def _indicators_of(
    recordings: "Sequence[Recording]",
    pistons: int | None,
    bands: list[str] | None,
    shaft: Shaft,
    out: Path | None = None,
    settings: Mapping[str, Any] | None = None,
) -> "IndicatorTable":
    """Indicators of all recordings; orders are left out of a recording whose shaft angle cannot be
    found.
    """
    from swashtwin.foundation import DataError, InputError, from_table, to_table
    from swashtwin.signals import (
        BANDS,
        FAMILIES,
        Band,
        IndicatorTable,
        indicators_of,
        stack_tables,
        summarize_long_recording,
    )

    edges = tuple(Band.parse(text) for text in bands or ()) or BANDS
    refusals: dict[str, str] = {}

    def describe(recording: "Recording") -> "IndicatorTable":
        angle, names = None, list(FAMILIES)
        try:
            angle = shaft.angle_of(recording)
        except (DataError, InputError) as refusal:
            refusals.setdefault(recording.recording_id, str(refusal))  # of stretches, one each
            names.remove("orders")
        vibration = shaft.vibration_of(recording)
        return indicators_of(vibration, angle=angle, pistons=pistons, bands=edges, families=names)

    def result_of(recording: "Recording") -> tuple[Any, dict[str, str]]:
        found = to_table(summarize_long_recording(recording.unloaded(), describe))
        return found, {
            name: reason for name, reason in refusals.items() if name == recording.recording_id
        }

    tables = []
    for found, refused in _kept(
        out, settings, iterate_with_progress(recordings, "indicators"), result_of
    ):
        tables.append(from_table(found, IndicatorTable))
        refusals |= refused
    if refusals and len(refusals) == len(recordings):
        raise DataError(next(iter(refusals.values())))
    for reason in refusals.values():
        print_note(f"no orders: {reason}")
    return stack_tables(tables)


def _kept(
    out: Path | None,
    settings: Mapping[str, Any] | None,
    items: Iterable[T],
    result_of: Callable[[T], Any],
) -> Iterator[Any]:
    """The result of each item; those that an interrupted command of equal settings left beside
    `out` are read there.
    """
    from swashtwin.foundation import TEXT, VERSION, write_text

    if out is None:
        yield from map(result_of, items)
        return
    path, header = out.with_name(f"{out.name}.partial"), json.dumps([VERSION, settings])
    lines = (
        path.read_text(encoding="utf-8", errors="replace").split("\n")[:-1]
        if path.is_file()
        else []
    )
    lines = lines if lines[:1] == [header] else [header]
    write_text(path, "".join(f"{line}\n" for line in lines))
    try:
        with path.open("a", **TEXT) as file:
            for number, item in enumerate(items, 1):
                if number == len(lines):
                    lines.append(json.dumps(result_of(item)))
                    print(lines[number], file=file, flush=True)
                yield json.loads(lines[number])
    except Exception:
        path.unlink(missing_ok=True)
        raise
    path.unlink()


def _csv_beside(figure: Path, sources: list[Path], force: bool) -> Path:
    """The CSV file beside a figure; both are refused where they may not be written."""
    csv_file = figure.with_name(f"{figure.stem}-data.csv")
    require_output(figure, suffixes=[".svg"], inputs=sources, marks=[FIGURE], force=force)
    require_output(csv_file, inputs=sources, force=force or figure.exists())
    return csv_file
