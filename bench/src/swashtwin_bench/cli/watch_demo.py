"""The command watch demo: watch a pump of the virtual rig whose pistons wear over weeks."""

import itertools
import os
import threading
import time
import webbrowser
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli import Json, print_note, print_result, print_text, require_folder

if TYPE_CHECKING:
    from swashtwin.monitoring import Outcome, WatchConfig
    from swashtwin.recordings import Recording

RECORDINGS = 90
"""Recordings of the month."""

RECORDINGS_PER_DAY = 3
"""Recordings of a day."""

ONSET = 36
"""Number of healthy recordings before the pistons begin to wear."""

BASELINE_RECORDINGS = 20
"""Recordings from which the watch learns the baseline."""

CALIBRATION_RECORDINGS = 6
"""First recordings, on which the twin is calibrated."""

SECONDS_PER_DAY = 86400

_CONFIG = f"""\
# What swashtwin watch demo watches: a pump of the virtual rig whose pistons wear.
folder = "watch-data"

[[machine]]
name = "rig-pump"
pump = "25scy14-1b"
calibration = "calibration.json"

[[source]]
kind = "folder"
path = "incoming"
settle_time = "0.2 s"
remove = true

[alarms]
baseline_recordings = {BASELINE_RECORDINGS}

[[channel]]
kind = "log"

[page]
port = PORT
"""


def demo(
    out: Annotated[
        Path, typer.Option(help="Folder for the watch and its history.", callback=require_folder)
    ] = Path("swashtwin-watch-demo"),
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the page.")] = 8642,
    end: Annotated[
        bool, typer.Option("--end", help="End after the last recording instead of at Ctrl-C.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Watch a pump of the virtual rig whose pistons wear: a month of recordings in minutes.

    The page shows the alarm, the suspected fault and its severity.
    """
    from swashtwin.cli import require_extra, stop_signals
    from swashtwin.monitoring import run_watch

    require_extra()
    config, writer = _prepare_watch(out, port)

    alarms: list[int] = []
    n_assessed = 0

    def start(address: str | None) -> None:
        print_note(f"The page is at {address}. A month passes in minutes. Stop with Ctrl-C.")
        if address is not None and not end:
            webbrowser.open(address)
        writer.start()

    def show(outcome: "Outcome") -> None:
        nonlocal n_assessed
        n_assessed += 1
        if outcome.state == "alarm" and not alarms:
            alarms.append(n_assessed)

        day = (n_assessed - 1) // RECORDINGS_PER_DAY + 1
        text = f"day {day}, {outcome.file}: {outcome.sentence}"
        if as_json:
            print_note(text)  # standard output is for the JSON alone
        else:
            print_text(text)

        if n_assessed == RECORDINGS:
            finish()

    def finish() -> None:
        if end:
            stop.set()
            return
        print_note(
            "All recordings are assessed. The page stays until Ctrl-C. To record what an "
            f"inspection finds: swashtwin watch event {config.path} rig-pump --found 'worn pistons'"
        )

    with stop_signals() as stop:
        run_watch(config, stop=stop, started=start, progress=show)

    def show_result() -> None:
        alarm = f"Alarm at recording {alarms[0]}" if alarms else "No alarm yet"
        print_text(f"{alarm}; the pistons wear from recording {ONSET + 1} on. Folder: {out}")

    result = {
        "folder": out,
        "judged": n_assessed,
        "onset": ONSET,
        "alarm": alarms[0] if alarms else None,
    }
    print_result(result, as_json, show_result)


def _prepare_watch(out: Path, port: int) -> "tuple[WatchConfig, threading.Thread]":
    """Calibrate the twin and write the configuration.

    Returns
    -------
    The configuration, and a thread that is yet to be started and writes the recordings.
    """
    from fastapi import FastAPI

    from swashtwin.calibration import calibrate
    from swashtwin.foundation import InputError, write_text
    from swashtwin.monitoring import PageSettings, load_watch_config, serving_page
    from swashtwin_bench import PlantCourse, plant_course

    if (out / "watch-data").exists():
        raise InputError(
            f"{out} contains an earlier demo: delete it, or choose another folder with --out."
        )
    with serving_page(FastAPI(), PageSettings().host, port):
        pass  # refuses a port that is in use here, before minutes of work

    month = PlantCourse(recordings=RECORDINGS, kind="piston", onset=ONSET)
    recordings = (recording for recording, _ in plant_course(0, "A", month, batch=3))
    first_recordings = list(itertools.islice(recordings, CALIBRATION_RECORDINGS))

    print_note(
        f"Calibrating the twin of the pump on its first {CALIBRATION_RECORDINGS} recordings, to "
        "estimate the severity later."
    )
    out.mkdir(parents=True, exist_ok=True)
    calibrate("25scy14-1b", first_recordings).save(out / "calibration.json")
    config_text = _CONFIG.replace("PORT", str(port))
    config = load_watch_config(write_text(out / "watch.toml", config_text))

    writer = threading.Thread(
        target=_write_month,
        args=(itertools.chain(first_recordings, recordings), config.path.parent / "incoming"),
        daemon=True,
    )
    return config, writer


def _write_month(recordings: "Iterable[Recording]", folder: Path) -> None:
    """Write each recording into the watched folder once it is computed.

    The times of the files are spread over the month that ends now.
    """
    from swashtwin.recordings import write_recording

    month_start = time.time() - SECONDS_PER_DAY * RECORDINGS / RECORDINGS_PER_DAY
    for index, recording in enumerate(recordings):
        # A name with a leading dot is not read by the watch: it sees the file complete, and with
        # its time, or not at all. Without its label, because a plant does not know it.
        path = write_recording(recording.replace(label=None), folder / f".{index + 1:03}.h5")
        recorded_at = month_start + SECONDS_PER_DAY * index / RECORDINGS_PER_DAY
        os.utime(path, (recorded_at, recorded_at))
        path.rename(folder / f"{index + 1:03}.h5")
