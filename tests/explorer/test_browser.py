"""The explorer in a real Chromium: rooms opened, dragged, played, edited, undone, calibrated,
stopped, diagnosed.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from chromium import MARKS, check_access, check_phone, playwright, started_browser, tabs  # noqa: F401
from explored import HEALTHY, WORN
from mqtt_broker import free_port
from plant import Plant

from swashtwin.explorer import Workspace, build_explorer
from swashtwin.monitoring import serving_page
from swashtwin.recordings import Recording, read_index, write_recording

ROOMS = ["#recordings", f"#recording?name={WORN}", "#compare", "#twin", f"#diagnose?name={WORN}"]
SETTLED = {
    "#recordings": "table.recordings tbody tr >> nth=8",
    f"#recording?name={WORN}": "canvas[aria-label^='Waterfall']",
    "#compare": "text=What differs most",
    "#twin": "text=Misfit by line",
    f"#diagnose?name={WORN}": ".verdict",
}

pytestmark = MARKS


@pytest.fixture(scope="module")
def served(
    pair_folder: Path, plant: Plant, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[str, Path]]:
    """Address of an explorer, and its folder."""
    folder = Path(shutil.copytree(pair_folder, tmp_path_factory.mktemp("served") / "pair"))
    port = free_port()
    with serving_page(build_explorer(Workspace(folder), plant.model), "127.0.0.1", port):
        yield f"http://127.0.0.1:{port}", folder


@pytest.fixture
def tab(browser, served) -> Iterator[object]:
    """A tab of a wide screen."""
    yield from tabs(browser, served[0])


def enter(tab, room: str) -> None:
    tab.goto(f"/{room}")
    tab.locator(SETTLED[room]).first.wait_for()


def test_the_table_shows_the_broken_one_first_filters_and_opens_by_keyboard(tab) -> None:
    enter(tab, "#recordings")
    rows = tab.locator("table.recordings tbody tr")
    tab.get_by_text("▲ broken").wait_for()
    assert "broken" in rows.first.inner_text()
    tab.keyboard.press("/")
    tab.keyboard.type("A_swash 15MPa")
    playwright.expect(rows).to_have_count(2)
    tab.locator("h1").click()
    tab.keyboard.press("j")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="A_swash_plate_15MPa_1").wait_for()
    assert "name=recordings" in tab.url


def test_a_fact_is_edited_in_place_by_key_and_for_several_and_undone(tab, served) -> None:
    def labels() -> dict[str, str]:
        return {
            entry["file"]: entry["label"]
            for entry in read_index(served[1] / "recordings.toml")["recording"]
        }

    before = labels()
    enter(tab, "#recordings")
    playwright.expect(tab.locator("text=being read")).to_have_count(0)
    row = tab.locator("tr", has=tab.get_by_role("link", name="A_normal_15MPa_1"))
    row.get_by_title("Edit class").click()
    tab.get_by_label("Class", exact=True).fill("piston")
    tab.keyboard.press("Enter")
    tab.get_by_text("Class of recordings").wait_for()
    assert labels()[HEALTHY] == "piston"
    row.get_by_text("piston").wait_for()
    for name in ("B_normal_15MPa_1", "B_normal_15MPa_2"):
        tab.get_by_label(f"Select recordings/{name}.h5").check()
    tab.locator("tr", has=tab.get_by_role("link", name="B_normal_15MPa_1")).click(
        position={"x": 3, "y": 3}
    )
    tab.keyboard.press("3")  # normal, piston, swash_plate
    tab.get_by_text("Class of 2 recordings").wait_for()
    assert labels()["recordings/B_normal_15MPa_2.h5"] == "swash_plate"
    tab.get_by_label("Select all shown").check()
    playwright.expect(tab.locator("tbody input:checked")).to_have_count(9)
    for _ in range(2):
        with tab.expect_response("**/api/facts"):
            tab.get_by_role("button", name="Undo").click()
    tab.get_by_role("button", name="Undo").wait_for(state="hidden")
    assert labels() == before


def test_one_recording_is_moved_zoomed_read_copied_and_heard(tab) -> None:
    enter(tab, f"#recording?name={WORN}")
    wave = tab.get_by_role("img", name="Waveform")
    view = "document.querySelector('section[aria-label=wave]').chart.view"
    whole = tab.evaluate(view)
    wave.focus()
    tab.keyboard.press("+")
    assert tab.evaluate(view)[1] < whole[1]
    spectrum = tab.get_by_role("img", name="Spectrum", exact=True)
    spectrum.scroll_into_view_if_needed()
    box = spectrum.bounding_box()
    tab.mouse.move(box["x"] + 300, box["y"] + 100)
    assert "dB" in tab.locator("section[aria-label=spectrum] .tip").inner_text()
    tab.get_by_role("button", name="Drag a band").click()
    tab.mouse.move(box["x"] + 400, box["y"] + 100)
    tab.mouse.down()
    tab.mouse.move(box["x"] + 700, box["y"] + 100, steps=4)
    tab.mouse.up()
    tab.get_by_text("The kurtogram's band").wait_for()
    assert "low=" in tab.url
    for kind, start in (("SVG", "<svg"), ("CSV", '"Hz"')):
        tab.get_by_role("button", name=f"Copy as {kind}: Spectrum", exact=True).click()
        tab.get_by_text(f"copied as {kind}").wait_for()
        assert tab.evaluate("navigator.clipboard.readText()").startswith(start)
    tab.locator("h1").click()
    tab.keyboard.press("Space")
    tab.get_by_role("button", name="■ Stop").wait_for()
    tab.keyboard.press("j")
    tab.get_by_role("button", name="▶ Play").wait_for()
    assert WORN.split("/")[1] not in tab.url


def test_two_classes_are_compared(tab) -> None:
    enter(tab, "#compare")
    playwright.expect(tab.locator("figure.chart")).to_have_count(3)
    first = tab.get_by_role("region", name="What differs most").locator("tbody tr").first
    assert "dB" in first.inner_text()


def test_a_twin_is_moved_calibrated_stopped_and_shows_what_is_not_known(tab) -> None:
    enter(tab, "#twin")
    before = tab.locator("text=spectrum value error").inner_text()
    tab.get_by_label("K_v: block").focus()
    for _ in range(20):
        tab.keyboard.press("ArrowRight")
    playwright.expect(tab.locator("text=spectrum value error")).not_to_have_text(before)
    tab.get_by_role("button", name="Calibrate from here").click()
    tab.get_by_role("button", name="Stop").click()
    tab.get_by_text("Stopped; nothing changed.").wait_for()
    tab.get_by_role("button", name="Calibrate from here").click()
    tab.locator(".interval").nth(5).wait_for()
    tab.get_by_label("Fault").select_option("piston")
    tab.get_by_label("Fault: clearance").wait_for()
    playwright.expect(tab.locator(".cutaway text.suspect-name")).to_have_text("piston")


def test_a_verdict_leads_to_its_nearest_recordings_and_a_model_is_dropped(
    tab, plant: Plant
) -> None:
    enter(tab, f"#diagnose?name={WORN}")
    tab.get_by_text("Nearest training recordings").first.wait_for()
    tab.get_by_label("Model file").set_input_files(str(plant.synthetic))
    tab.locator(".drop .notice").wait_for()
    tab.get_by_label("Model file").set_input_files(str(plant.model))
    tab.locator(".verdict").wait_for()


def test_no_room_scrolls_sideways_on_a_phone(browser, served) -> None:
    check_phone(browser, served[0], ROOMS, enter)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_fault_in_any_room(browser, served, scheme: str) -> None:
    check_access(browser, served[0], ROOMS, enter, scheme)


def test_a_minute_at_50_khz_is_moved_at_thirty_frames_a_second(browser, tmp_path: Path) -> None:
    signal = np.random.default_rng(0).normal(size=(1, 3_000_000))
    path = write_recording(
        Recording(signal, 50_000.0, "long", label="normal"), tmp_path / "long.h5"
    )
    port = free_port()
    pan = """async () => {
      const chart = document.querySelector("section[aria-label=wave]").chart;
      const begin = performance.now(), frames = chart.frames;
      while (performance.now() - begin < 2000) {
        const start = 10 + (performance.now() - begin) / 200;
        chart.show([start, start + 4]);
        await new Promise((done) => requestAnimationFrame(done));
      }
      return (chart.frames - frames) / 2;
    }"""
    with serving_page(build_explorer(Workspace(path)), "127.0.0.1", port):
        for tab in tabs(browser, f"http://127.0.0.1:{port}"):
            tab.goto("/#recording?name=long")
            tab.locator("canvas[aria-label^='Waterfall']").wait_for()
            assert tab.evaluate(pan) >= 30
