"""Commands of the group signal, which require no classifier: features, spectrum, trend."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import (
    MAX_ROWS,
    format_label,
    print_note,
    print_result,
    print_rows,
    print_table,
    print_text,
    progress,
)
from swashtwin.cli.options import (
    Cluster,
    Index,
    Json,
    ReadingOptions,
    Sources,
    band_from,
    read_list,
    reads_files,
)
from swashtwin.cli.outputs import Force, require_output
from swashtwin.cli.sources import load_sources
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.foundation import FileStamp
    from swashtwin.recordings import Recording
    from swashtwin.signals import Band, IndicatorTable, LineSpectrum, ShaftAngle, Trend

Pistons = Annotated[
    int | None,
    typer.Option(
        min=1, help="Number of pistons z, for lines at z and 2 z times the shaft frequency."
    ),
]
Bands = Annotated[
    list[str] | None,
    typer.Option(
        "--band", help='Band in Hz or shaft orders: "10-1000 Hz", "0.5-6.5x". Repeatable.'
    ),
]
Tachometer = Annotated[
    str | None,
    typer.Option(
        metavar="CHANNEL[:PULSES]",
        help='Channel with the pulses of a tachometer; "tacho:60" has 60 per revolution.',
    ),
]
Track = Annotated[
    str | None,
    typer.Option(
        metavar="ORDERS",
        help='Orders of which the clearest line is tracked for the shaft angle: "7,14,28".',
    ),
]

_NO_ZONE = "No ISO zone is printed: ISO 20816 and 10816 do not cover axial piston pumps."

# Indicators that fit on the screen, with the amplitudes of orders.
_PRINTED_INDICATORS = ("rms", "velocity_rms", "crest_factor", "kurtosis")

# Healthy recordings below which a baseline flags some healthy recordings: with fewer, the spread
# (MAD) is underestimated often enough to be seen (docs/how-to/indicators.md).
_SMALL_BASELINE = 12


class SpectrumKind(StrEnum):
    """Spectra that can be drawn."""

    amplitude = "amplitude"
    envelope = "envelope"
    order = "order"


class Order(StrEnum):
    """Order of the recordings of a trend."""

    time = "time"
    name = "name"


@dataclass(frozen=True)
class Shaft:
    """Source of a recording's shaft angle; tachometer and tracking exclude each other."""

    tachometer: str | None
    track: str | None

    def __post_init__(self) -> None:
        if self.tachometer is not None and self.track is not None:
            raise typer.BadParameter(
                "excludes --tachometer. Specify one of them.", param_hint="--track"
            )
        read_list(self.track, int, "--track")

    def angle_of(self, recording: "Recording") -> "ShaftAngle | None":
        """Return the shaft's angle, or None if no option specifies its source."""
        if self.tachometer is not None:
            from swashtwin.recordings import load_extra_channel
            from swashtwin.signals import tachometer_angle

            channel, pulses = self._split_tachometer(recording)
            if channel not in recording.channels:
                recording = load_extra_channel(recording, channel)
            return tachometer_angle(recording, channel, pulses)

        orders = read_list(self.track, int, "--track")
        if orders is None:
            return None
        from swashtwin.signals import track_shaft_angle

        return track_shaft_angle(recording, order=orders)

    def vibration_of(self, recording: "Recording") -> "Recording":
        """Return the recording without the tachometer."""
        if self.tachometer is None:
            return recording
        channel, _ = self._split_tachometer(recording)
        return recording.select_channels([name for name in recording.channels if name != channel])

    def _split_tachometer(self, recording: "Recording") -> tuple[str, int]:
        """Return the channel of the tachometer, and its pulses per revolution."""
        assert self.tachometer is not None
        # The name of a channel may contain a colon itself.
        if self.tachometer in recording.channels:
            return self.tachometer, 1

        channel, colon, pulses = self.tachometer.rpartition(":")
        has_pulses = bool(colon) and pulses.isdigit() and int(pulses) > 0
        return (channel, int(pulses)) if has_pulses else (self.tachometer, 1)


@reads_files
def features(
    source: Sources,
    reading_options: ReadingOptions,
    out: Annotated[
        Path | None, typer.Option(help="CSV file to write, with all columns and their units.")
    ] = None,
    pistons: Pistons = None,
    band: Bands = None,
    tachometer: Tachometer = None,
    track: Track = None,
    cluster: Cluster = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute indicators of each recording and channel: velocity, levels, orders, envelope.

    No ISO zone is printed, because no standard covers axial piston pumps. Compare with the
    machine's own baseline by swashtwin signal trend.
    """
    from swashtwin.foundation import file_stamp, use_cluster, write_text
    from swashtwin.recordings import source_files

    require_output(out, suffixes=[".csv"], inputs=source, force=force)
    shaft = Shaft(tachometer, track)
    recordings = load_sources(source, **reading_options)

    # An interrupted run continues only if neither the settings nor the files have changed.
    stamps: list[tuple[str, FileStamp]] = []
    for path in source:
        for file in source_files(path):
            stamps.append((str(file.absolute()), file_stamp(file)))
    settings = {
        "pistons": pistons,
        "bands": band,
        "shaft": asdict(shaft),
        "reading_options": reading_options,
        "sources": stamps,
    }
    with use_cluster(cluster):
        indicators = _compute_indicators(recordings, pistons, band, shaft, out, settings)

    if out is not None:
        write_text(out, indicators.csv)
    result = {"csv": out, **indicators.to_dict()}
    print_result(result, as_json, lambda: _print_indicators(indicators, out))


def _print_indicators(indicators: "IndicatorTable", out: Path | None) -> None:
    printed_columns = [
        column
        for column, indicator in enumerate(indicators.columns)
        if indicator.name in _PRINTED_INDICATORS or indicator.name.startswith("order_amplitude")
    ]
    titles = []
    factors = []
    for column in printed_columns:
        indicator = indicators.columns[column]
        factor, unit = indicator.display_unit
        title = indicator.name.removeprefix("order_amplitude ").replace("_", " ")
        titles.append(f"{title} [{unit}]" if indicator.unit else title)
        factors.append(factor)

    rows = []
    for row, values in zip(indicators.rows, indicators.values.tolist(), strict=True):
        numbers = [
            factor * values[column] for factor, column in zip(factors, printed_columns, strict=True)
        ]
        rows.append((row.recording_id, row.channel, *numbers))
    print_rows(f"{len(rows)} rows", ("recording", "channel", *titles), rows, "--out or --json has")

    destination = f": {out}" if out else "; --out FILE.csv writes them"
    print_text(f"{len(indicators.columns)} indicators in all{destination}. {_NO_ZONE}")


@reads_files
def spectrum(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording to look at.")],
    reading_options: ReadingOptions,
    kind: Annotated[SpectrumKind, typer.Option(help="Kind of spectrum.")] = SpectrumKind.amplitude,
    out: Annotated[
        Path | None,
        typer.Option(
            help="SVG file to write, with NAME-data.csv beside it. Default: FILE_KIND.svg in the "
            "current folder."
        ),
    ] = None,
    pistons: Pistons = None,
    band: Annotated[
        str | None,
        typer.Option(
            help='Band of the envelope: "2-5 kHz". Default: the band with the highest kurtosis.'
        ),
    ] = None,
    tachometer: Tachometer = None,
    track: Track = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Draw an amplitude, envelope or order spectrum with the lines of shaft and pistons marked."""
    from swashtwin.foundation import write_text
    from swashtwin.report import draw_spectrum
    from swashtwin.signals import spectrum_of

    svg_file = out or Path(f"{file.stem}_{kind.value}.svg")
    csv_file = _require_figure(svg_file, [file], force)
    if band is not None and kind is not SpectrumKind.envelope:
        raise typer.BadParameter(
            "is the band of an envelope. Add --kind envelope.", param_hint="--band"
        )
    band_edges = None if band is None else band_from(band)
    shaft = Shaft(tachometer, track)
    recordings = load_sources([file], **reading_options)
    if len(recordings) != 1:
        raise typer.BadParameter(
            f"{file} has {len(recordings)} recordings. Specify one file.", param_hint="FILE"
        )

    vibration = shaft.vibration_of(recordings[0])
    angle = shaft.angle_of(recordings[0])
    lines = spectrum_of(vibration, kind.value, angle=angle, pistons=pistons, band=band_edges)
    drawing = draw_spectrum(lines)
    write_text(csv_file, drawing.csv)
    write_text(svg_file, drawing.svg)

    marks = [
        {
            "name": mark.name,
            "at": mark.position,
            "value": dict(zip(lines.channels, lines.at(mark).tolist(), strict=True)),
        }
        for mark in lines.marks
    ]
    result = {
        "recording": lines.recording_id,
        "kind": lines.kind,
        "axis": lines.axis,
        "axis_unit": lines.axis_unit,
        "unit": lines.unit,
        "marks": marks,
        "bands_hz": dict(zip(lines.channels, lines.bands, strict=False)),
        "angle_from": lines.angle_from,
        "svg": svg_file,
        "csv": csv_file,
    }

    def show() -> None:
        _print_lines(lines, drawing.title)
        print_text(f"{svg_file}\n{csv_file}")

    print_result(result, as_json, show)


def _print_lines(lines: "LineSpectrum", title: str) -> None:
    """Print the amplitudes at the expected lines of a spectrum."""
    for channel, (low, high) in zip(lines.channels, lines.bands, strict=False):
        print_text(f"{channel}: envelope of {low:.0f} to {high:.0f} Hz")
    if not lines.marks:
        print_note('The speed is unknown, so that no line is marked: add --speed "860 rpm".')
        return

    axis = f"{lines.axis} [{lines.axis_unit}]" if lines.axis_unit else lines.axis
    unit = lines.unit or "1"
    print_table(
        f"{title}, at the expected lines",
        ("line", axis, *(f"{channel} [{unit}]" for channel in lines.channels)),
        [(mark.name, mark.position, *lines.at(mark).tolist()) for mark in lines.marks],
    )


def trend(
    source: Index,
    indicator: Annotated[
        str,
        typer.Option(help="Indicator, such as rms; swashtwin signal features lists them."),
    ] = "rms",
    channel: Annotated[str | None, typer.Option(help="Channel. Default: the first one.")] = None,
    by: Annotated[
        Order, typer.Option(help="Order of the recordings: by the attribute date, or by name.")
    ] = Order.name,
    threshold: Annotated[
        float,
        typer.Option(
            help="Distance from the baseline at which a recording is flagged, in spreads "
            "(1.4826 MAD)."
        ),
    ] = 5.0,
    baseline: Annotated[
        list[str] | None,
        typer.Option(
            help='Class, or pattern of recording ids, that is healthy. Default: "normal". '
            "Repeatable."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="SVG file to write, with NAME-data.csv beside it.")
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Follow an indicator over recordings, relative to the machine's own healthy baseline.

    A baseline consists of at least five healthy recordings of the machine at the same speed and
    pressure. No ISO zone is printed, because no standard covers axial piston pumps.
    """
    from swashtwin.foundation import write_text
    from swashtwin.report import draw_trend
    from swashtwin.signals import trend_of

    csv_file = None if out is None else _require_figure(out, [source], force)
    no_shaft = Shaft(None, None)
    indicators = _compute_indicators(load_sources([source]), None, None, no_shaft)
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
        _print_trend(result, threshold)
        if out is not None:
            print_text(f"{out}\n{csv_file}")

    print_result({**result.to_dict(), "svg": out, "csv": csv_file}, as_json, show)


def _print_trend(trend: "Trend", threshold: float) -> None:
    _print_trend_points(trend)

    baseline_sizes = [point.count for point in trend.points if point.status != "no baseline"]
    n_without = len(trend.points) - len(baseline_sizes)
    if n_without:
        print_note(
            f"{plural(n_without, 'recording')} without a baseline: it requires 5 other healthy "
            "recordings of the machine at the same operating point."
        )
    if baseline_sizes and min(baseline_sizes) < _SMALL_BASELINE:
        print_note(
            f"The smallest baseline has {plural(min(baseline_sizes), 'recording')}, so that some "
            "healthy recordings are flagged (docs/how-to/indicators.md)."
        )

    if baseline_sizes:
        summary = (
            f"{len(trend.flagged)} of {len(baseline_sizes)} recordings flagged beyond "
            f"{threshold:g} spreads."
        )
    else:
        summary = "No recording could be judged."
    print_text(f"{summary} {_NO_ZONE}")


def _print_trend_points(trend: "Trend") -> None:
    """Print the points of a trend, the most deviating first if not all fit on the screen."""
    deviations = {
        point.row.recording_id: abs(point.value - point.median) / point.spread
        for point in trend.flagged
    }
    points = list(trend.points)
    if len(points) > MAX_ROWS:
        points.sort(key=lambda point: -deviations.get(point.row.recording_id, 0.0))

    factor, unit = trend.indicator.display_unit
    rows = [
        (
            point.row.recording_id,
            format_label(point.row.label),
            factor * point.value,
            factor * point.median,
            factor * point.spread,
            point.count,
            point.status,
        )
        for point in points
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


def _compute_indicators(
    recordings: "Sequence[Recording]",
    pistons: int | None,
    bands: list[str] | None,
    shaft: Shaft,
    out: Path | None = None,
    settings: Mapping[str, Any] | None = None,
) -> "IndicatorTable":
    """Return the indicators of all recordings.

    Orders are omitted for a recording whose shaft angle cannot be determined.

    Raises
    ------
    DataError
        No recording's shaft angle can be determined.
    """
    from swashtwin.foundation import DataError, from_table, parallel
    from swashtwin.signals import BANDS, Band, IndicatorTable, stack_tables

    band_values = tuple(Band.parse(text) for text in bands or ()) or BANDS

    def compute(start: int) -> Iterator[Any]:
        return parallel(
            partial(_describe_recording, shaft, pistons, band_values),
            [(recording,) for recording in recordings[start:]],
            files=[recording.samples.file for recording in recordings[start:]],
        )

    tables = []
    refusals: dict[str, str] = {}
    with progress("indicators") as bar:
        bar(0, len(recordings))
        for table, reasons in _resume_results(out, settings, compute):
            tables.append(from_table(table, IndicatorTable))
            refusals |= reasons
            bar(len(tables), len(recordings))

    if refusals and len(refusals) == len(recordings):
        raise DataError(next(iter(refusals.values())))
    for reason in refusals.values():
        print_note(f"no orders: {reason}")
    return stack_tables(tables)


def _describe_recording(
    shaft: Shaft, pistons: int | None, bands: "tuple[Band, ...]", recording: "Recording"
) -> tuple[Any, dict[str, str]]:
    """Return the table of a recording's indicators, and why it has no orders, by recording."""
    from swashtwin.foundation import DataError, InputError, to_table
    from swashtwin.signals import FAMILIES, indicators_of, summarize_long_recording

    refusals: dict[str, str] = {}

    def describe(part: "Recording") -> "IndicatorTable":
        angle = None
        families = list(FAMILIES)
        try:
            angle = shaft.angle_of(part)
        except (DataError, InputError) as refusal:
            # A long recording is described in stretches; its first reason suffices.
            refusals.setdefault(part.recording_id, str(refusal))
            families.remove("orders")
        vibration = shaft.vibration_of(part)
        return indicators_of(
            vibration, angle=angle, pistons=pistons, bands=bands, families=families
        )

    table = to_table(summarize_long_recording(recording.unloaded(), describe))
    return table, refusals


def _resume_results(
    out: Path | None,
    settings: Mapping[str, Any] | None,
    compute: Callable[[int], Iterator[Any]],
) -> Iterator[Any]:
    """Yield all results, and keep them beside `out` until all are computed.

    Results that an interrupted command with the same settings left there are not computed again.
    The file has a line for the settings, then a line for each result.

    Parameters
    ----------
    compute : yields the results from the one of this number on.
    """
    from swashtwin.foundation import TEXT, VERSION, ClusterError, write_text

    if out is None:
        yield from compute(0)
        return

    path = out.with_name(f"{out.name}.partial")
    header = json.dumps([VERSION, settings])
    lines = [header]
    if path.is_file():
        # What follows the final line end is a line that was not written completely.
        previous_lines = path.read_text(encoding="utf-8", errors="replace").split("\n")[:-1]
        if previous_lines[:1] == [header]:
            lines = previous_lines
    write_text(path, "".join(f"{line}\n" for line in lines))

    try:
        for line in lines[1:]:
            yield json.loads(line)
        with path.open("a", **TEXT) as file:
            for result in compute(len(lines) - 1):
                line = json.dumps(result)
                print(line, file=file, flush=True)
                yield json.loads(line)
    except ClusterError:
        raise  # what is finished was computed from sound files
    except Exception:
        # A damaged file must not make every later run fail; Ctrl-C is not an Exception.
        path.unlink(missing_ok=True)
        raise
    path.unlink()


def _require_figure(figure: Path, sources: list[Path], force: bool) -> Path:
    """Return the CSV file beside a figure; raise an error if either must not be written."""
    csv_file = figure.with_name(f"{figure.stem}-data.csv")
    require_output(figure, suffixes=[".svg"], inputs=sources, force=force)
    require_output(csv_file, inputs=sources, force=force or figure.exists())
    return csv_file
