"""The explorer in a real Chromium: first picture of a folder, and from drag to picture.

    python benchmarks/explorer.py

A virtual rig of 270 recordings is served. First picture: from the address to the table's rows.
Sliders: time from a drag to its picture, 50th and 95th percentile. Pump: frames a second while it
turns, and time from a shaft angle to its picture. One line of JSON each, with the machine's load
beside, on which all depend. Needs playwright and /usr/bin/chromium. Frames a second over a long
recording are a nightly test.
"""

import json
import os
import tempfile
import time
from pathlib import Path
from urllib.parse import quote

# As the command ``swashtwin explore`` sets it.
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from playwright.sync_api import Page, sync_playwright

from swashtwin.explorer import Workspace, build_explorer
from swashtwin.monitoring import serving_page
from swashtwin_bench import build_rig

PORT = 18765
TOKEN = "benchmark"
ADDRESS = f"http://127.0.0.1:{PORT}/?token={TOKEN}"
RECESS = {
    "depth": 6e-4,
    "length": 0.03,
    "width": 0.024,
    "angle": 4.71,
    "corner": 0,
    "fall": 2,
    "gain": 1,
    "leakage": 1,
}
SLIDERS: list[tuple[str, str, dict[str, float]]] = [
    ("", "K_v: block", {}),
    ("", "Discharge pressure", {}),
    ("swash_plate", "Fault: depth", RECESS),
    ("piston", "Fault: clearance", {"clearance": 4e-5}),
    ("loose_slipper", "Fault: clearance", {"clearance": 1e-4}),
]


def told(**figures: object) -> None:
    """Print figures as a line of JSON."""
    print(json.dumps({**figures, "load": round(os.getloadavg()[0], 1)}), flush=True)


def first_picture(page: Page) -> None:
    """Time until the table stands, of an explorer that has opened nothing yet."""
    begun = time.perf_counter()
    page.goto(f"{ADDRESS}#recordings")
    page.locator("table.recordings tbody tr >> nth=8").wait_for()
    told(figure="first picture", seconds=round(time.perf_counter() - begun, 2))


# A picture shows the slider as it stood when its request was sent; it is drawn in the next frame.
WATCH_DRAGS = """() => {
  const pump = document.querySelector(".living-pump").pump;
  const fetchNow = fetch;
  const show = pump.show.bind(pump);
  const sent = [];
  let moved = 0;
  window.delays = [];
  addEventListener("input", () => { moved = performance.now(); }, true);
  window.fetch = (address, options) => {
    if (String(address).includes("twin_lines")) sent.push(moved);
    return fetchNow(address, options);
  };
  pump.show = (content) => {
    show(content);
    const begin = sent.shift();
    requestAnimationFrame(() => window.delays.push(performance.now() - begin));
  };
}"""


def slider(page: Page, fault: str, label: str, dimensions: dict[str, float]) -> None:
    """Times from a drag to its picture."""
    name = "B/B_swash_plate_15MPa_1.h5" if fault == "swash_plate" else "A/A_normal_15MPa_1.h5"
    setting = {
        "fault": fault,
        "recording": name,
        **({"dimensions": dimensions} if dimensions else {}),
    }
    page.goto("about:blank")
    page.goto(f"{ADDRESS}#twin?setting={quote(json.dumps(setting))}")
    page.locator("text=Misfit by line").wait_for()
    page.wait_for_timeout(1500)
    page.evaluate(WATCH_DRAGS)
    knob = page.get_by_label(label).first
    knob.scroll_into_view_if_needed()
    box = knob.bounding_box()
    assert box is not None
    height = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.3 * box["width"], height)
    page.mouse.down()
    for step in range(100):
        page.mouse.move(box["x"] + box["width"] * (0.5 + 0.35 * np.sin(step / 8)), height)
        page.wait_for_timeout(50)
    page.mouse.up()
    page.wait_for_timeout(500)
    delays = page.evaluate("window.delays")
    half, most = np.quantile(delays, [0.5, 0.95]).round().tolist()
    told(figure=f"{fault or 'healthy'}, {label}", pictures=len(delays), median_ms=half, p95_ms=most)


PUMP_TIMES = """async () => {
  const pump = document.querySelector(".living-pump").pump;
  const frames = pump.frames;
  await new Promise((done) => setTimeout(done, 5000));
  const rate = (pump.frames - frames) / 5;
  pump.turn(false);
  const begin = performance.now();
  for (let degrees = 0; degrees < 360; degrees++) pump.moveTo((degrees / 360) * 2 * Math.PI);
  return [rate, (performance.now() - begin) / 360];
}"""


def turning_pump(page: Page, fault: str) -> None:
    """Frames a second while the pump turns, and the time to draw one shaft angle."""
    setting = {"fault": fault, "recording": "A/A_normal_15MPa_1.h5"}
    page.goto("about:blank")
    page.goto(f"{ADDRESS}#twin?setting={quote(json.dumps(setting))}")
    page.locator("text=Misfit by line").wait_for()
    page.wait_for_timeout(1500)
    rate, draw_ms = page.evaluate(PUMP_TIMES)
    told(
        figure=f"{fault or 'healthy'}, turning pump",
        frames_a_second=round(rate, 1),
        draw_ms=round(draw_ms, 2),
    )


def main(folder: Path) -> None:
    """Serve, open, move and drag."""
    index = build_rig(folder / "rig", seed=0, size="small", jobs=2)
    with sync_playwright() as driver:
        chromium = driver.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox", "--disable-gpu"]
        )
        page = chromium.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(60_000)
        explorer = build_explorer(Workspace(index), address_token=TOKEN)
        with serving_page(explorer, "127.0.0.1", PORT):
            first_picture(page)
            page.locator("text=still being read").wait_for(state="hidden")
            for fault in ("", "loose_slipper"):
                turning_pump(page, fault)
            for each in SLIDERS:
                slider(page, *each)
        chromium.close()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        main(Path(made))
