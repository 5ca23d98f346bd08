"""The command that records a device as it measures."""

from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import print_note, print_result, print_text
from swashtwin.cli.options import Json, read_pairs, spell_as_option
from swashtwin.cli.outputs import require_folder
from swashtwin.cli.signal import Pistons, Tachometer
from swashtwin.cli.watching import stop_signals
from swashtwin.foundation import DataError, InputError, parse_quantity, plural, shell_command

if TYPE_CHECKING:
    from swashtwin.recordings import Recording


def record(
    device: Annotated[
        str,
        typer.Argument(
            metavar="DEVICE",
            help='Connection string of openDAQ: "daq.nd://192.168.0.9", or "daqref://device0" for '
            "generated signals.",
        ),
    ],
    out: Annotated[
        Path, typer.Option(help="Folder for the recordings, .h5.", callback=require_folder)
    ],
    length: Annotated[str, typer.Option(help="Length of each recording.")] = "10 s",
    interval: Annotated[
        str | None,
        typer.Option(
            help='Time from one start to the next, such as "5 min". Default: no gap between '
            "recordings."
        ),
    ] = None,
    count: Annotated[
        int | None, typer.Option(min=1, help="Recordings to make. Default: until Ctrl-C.")
    ] = None,
    channels: Annotated[
        list[str] | None, typer.Option(help="Channel to record, by name. Repeatable.")
    ] = None,
    sample_rate: Annotated[
        str | None, typer.Option(help='Sample rate to set, such as "25.6 kHz".')
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Unit of channels for which the device states none.")
    ] = None,
    sensitivity: Annotated[
        list[str] | None,
        typer.Option(
            help='Scale of the channels: "99.7 mV/g", or NAME=SCALE for one channel. Repeatable.'
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help='Other setting of the device by its name in openDAQ, or "AI 1/NAME=VALUE" of a '
            "channel. Repeatable.",
        ),
    ] = None,
    tachometer: Tachometer = None,
    speed: Annotated[str | None, typer.Option(help='Shaft speed: "860 rpm".')] = None,
    pressure: Annotated[
        str | None, typer.Option(help='Absolute discharge pressure: "15 MPa".')
    ] = None,
    tags: Annotated[
        Path | None,
        typer.Option(
            exists=True, dir_okay=False, help="CSV table of speeds and pressures by time."
        ),
    ] = None,
    pistons: Pistons = None,
    as_json: Json = False,
) -> None:
    """Record a measuring device, one file after the other or one per interval.

    Without a speed, tags or a tachometer, --pistons estimates the speed from the spectrum.
    """
    from swashtwin.monitoring import DeviceSettings, LiveRecorder, LiveSettings
    from swashtwin.recordings import Finding

    tacho, pulses_per_turn = _split_tachometer(tachometer)
    if tags is not None and (speed is not None or pressure is not None):
        raise InputError("Tags hold speed and pressure: specify either them or --tags.")
    if pressure is not None and speed is None:
        raise InputError("A pressure makes an operating point only with --speed.")

    live_settings = LiveSettings(
        DeviceSettings(
            device,
            channels=tuple(channels or ()),
            tacho=tacho,
            sample_rate=_read_optional(sample_rate, "Hz", "sample_rate"),
            unit=unit,
            sensitivity=tuple(sensitivity) if sensitivity else None,
            properties=read_pairs(settings, "--set"),
        ),
        parse_quantity(length, "s", name="length"),
        interval=_read_optional(interval, "s", "interval"),
        pulses_per_turn=pulses_per_turn,
        speed=_read_optional(speed, "rad/s", "speed"),
        pressure=_read_optional(pressure, "Pa", "pressure"),
        tags=tags,
        piston_count=pistons,
    )

    n_recordings = 0
    seconds = 0.0
    findings: Counter[str] = Counter()
    reason = "it was stopped before a sample arrived."
    with closing(LiveRecorder(live_settings)) as recorder, stop_signals() as stop:
        print_note(f"recording {device} into {out}. Press Ctrl-C to stop.")
        for item in recorder.run(stop):
            if isinstance(item, Finding):
                findings[item.kind] += 1
                reason = item.message
                print_note(f"{item.severity}: {item.describe(spell_as_option)}")
                continue

            path = _write(item, out)
            n_recordings += 1
            seconds += item.duration
            if not as_json:
                print_text(f"{path}: {_describe(item)}")
            if n_recordings == count:
                break

    if not n_recordings:
        raise DataError(f"No recording was made of {device}: {reason}")

    result = {
        "folder": out,
        "recordings": n_recordings,
        "seconds": seconds,
        "findings": dict(findings),
    }

    def show() -> None:
        print_text(f"{out}: {plural(n_recordings, 'recording')}, {seconds:.4g} s")
        print_text(f"Next: {shell_command('index', out)}")

    print_result(result, as_json, show)


def _read_optional(text: str | None, unit: str, name: str) -> float | None:
    """Return the SI number of an option, which must be above zero; None if it is not given."""
    if text is None:
        return None
    value = parse_quantity(text, unit, name=name)
    if value <= 0:
        raise InputError(f"{name} = {text!r} must be above zero.", field=name)
    return value


def _split_tachometer(text: str | None) -> tuple[str | None, int]:
    """Return the channel of the tachometer, and its pulses per revolution."""
    if text is None:
        return None, 1
    channel, colon, pulses = text.rpartition(":")
    if colon and pulses.isdigit() and int(pulses) > 0:
        return channel, int(pulses)
    return text, 1


def _write(recording: "Recording", folder: Path) -> Path:
    """Write a recording into a new file of a folder, and return its path."""
    from swashtwin.recordings import write_recording

    path = folder / f"{recording.recording_id}.h5"
    number = 1
    while path.exists():  # the clock of this computer was set back
        number += 1
        path = folder / f"{recording.recording_id}-{number}.h5"
    try:
        return write_recording(recording.replace(recording_id=path.stem), path)
    except OSError as cause:
        reason = cause.strerror or cause
        raise DataError(
            f"{path} cannot be written ({reason}), and its {recording.duration:.4g} s are lost; "
            f"all earlier recordings are complete. Free space in {folder} or choose another "
            "folder, then record again."
        ) from cause


def _describe(recording: "Recording") -> str:
    text = (
        f"{recording.duration:.4g} s, {plural(recording.n_channels, 'channel')} in "
        f"{recording.unit} at {recording.sample_rate:g} Hz"
    )
    attributes = recording.attributes
    if "speed" in attributes:
        text += f", {attributes['speed']} ({attributes['speed_source']})"
    return text
