"""``swashtwin watch demo``: a pump of the virtual rig that wears over weeks, watched in some
minutes.
"""

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
    from swashtwin.monitoring import Outcome
    from swashtwin.recordings import Recording

RECORDINGS, ONSET, PER_DAY, LEARNING = 90, 36, 3, 20

# First recordings that the twin is calibrated on.
_CALIBRATED = 6

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
baseline_recordings = {LEARNING}

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
    """Watch a pump of the virtual rig that wears over a month, in some minutes: page, alarm,
    suspect and severity.
    """
    from swashtwin.calibration import calibrate
    from swashtwin.cli import require_extra, stop_signals
    from swashtwin.foundation import InputError, write_text
    from swashtwin.monitoring import PageSettings, load_watch_config, run_watch, serving_page
    from swashtwin_bench import PlantCourse, plant_course

    require_extra()
    from fastapi import FastAPI

    if (out / "watch-data").exists():
        raise InputError(
            f"{out} holds an earlier demo; remove it, or name another folder with --out."
        )
    with serving_page(FastAPI(), PageSettings().host, port):
        pass  # a port that is taken is refused here, before minutes of work
    month = PlantCourse(recordings=RECORDINGS, kind="piston", onset=ONSET)
    course = (recording for recording, _ in plant_course(0, "A", month, batch=3))
    first = list(itertools.islice(course, _CALIBRATED))
    print_note(
        f"Calibrating the pump's twin on its first {_CALIBRATED} recordings, for the severity."
    )
    out.mkdir(parents=True, exist_ok=True)
    calibrate("25scy14-1b", first).save(out / "calibration.json")
    config = load_watch_config(write_text(out / "watch.toml", _CONFIG.replace("PORT", str(port))))
    incoming = config.path.parent / "incoming"
    writer = threading.Thread(
        target=_write, args=(itertools.chain(first, course), incoming), daemon=True
    )
    alarms: list[int] = []
    counts = {"judged": 0}

    def start(address: str | None) -> None:
        print_note(f"The page is at {address}. Weeks pass in minutes; Ctrl-C ends.")
        if address is not None and not end:
            webbrowser.open(address)
        writer.start()

    def show(outcome: "Outcome") -> None:
        counts["judged"] += 1
        number = counts["judged"]
        if outcome.state == "alarm" and not alarms:
            alarms.append(number)
        day = f"day {(number - 1) // PER_DAY + 1}"
        (print_note if as_json else print_text)(f"{day}, {outcome.file}: {outcome.sentence}")
        if number == RECORDINGS:
            finished(stop)

    def finished(stop: threading.Event) -> None:
        if end:
            stop.set()
        else:
            print_note(
                "All recordings are judged; the page stays until Ctrl-C. What was found beside the suspect: swashtwin "
                f"watch event {config.path} rig-pump --found 'worn pistons'"
            )

    with stop_signals() as stop:
        run_watch(config, stop=stop, started=start, progress=show)
    result = {
        "folder": out,
        "judged": counts["judged"],
        "onset": ONSET,
        "alarm": alarms[0] if alarms else None,
    }
    words = f"alarm at recording {alarms[0]}, " if alarms else "no alarm yet; "
    print_result(
        result,
        as_json,
        lambda: print_text(
            f"{words}the pistons wear from recording {ONSET + 1} on. Everything is in {out}."
        ),
    )


def _write(recordings: "Iterable[Recording]", folder: Path) -> None:
    """Write the recordings of a month into the folder that is watched, as fast as they are
    computed.
    """
    from swashtwin.recordings import write_recording

    first = time.time() - 86400 * RECORDINGS / PER_DAY
    for number, recording in enumerate(recordings):
        path = write_recording(recording.replace(label=None), folder / f".{number + 1:03}.h5")
        os.utime(path, (first + 86400 * number / PER_DAY,) * 2)
        path.rename(folder / f"{number + 1:03}.h5")
