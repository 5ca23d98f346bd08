"""The explorer in a real Chromium, used as a person does: by mouse, keyboard and clipboard."""

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from chromium import (
    MARKS,
    PATIENCE,
    check_access,
    check_phone,
    playwright,
    started_browser,  # noqa: F401
    tabs,
)
from explored import ADDRESS_TOKEN, HEALTHY, WORN
from mqtt_broker import free_port
from plant import Plant

from swashtwin.explorer import Workspace, build_explorer
from swashtwin.explorer.mean_turn import align_turn, average_turns
from swashtwin.foundation import MPa, rpm
from swashtwin.monitoring import serving_page
from swashtwin.physics import Twin, solve_turn
from swashtwin.pump import OperatingCondition, load_pump
from swashtwin.recordings import Recording, read_index, write_recording

LOADED = {
    "#recordings": "table.recordings tbody tr >> nth=8",
    f"#recording?name={WORN}": "canvas[aria-label^='Waterfall']",
    "#compare": "text=What differs most",
    "#twin": "text=Misfit by line",
    f"#diagnose?name={WORN}": ".verdict",
}
"""Rooms of the explorer, and what is visible in each once it has loaded."""

pytestmark = MARKS


@pytest.fixture(scope="module")
def served_folder(pair_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that the explorer shows."""
    return Path(shutil.copytree(pair_folder, tmp_path_factory.mktemp("served") / "pair"))


@pytest.fixture(scope="module")
def address(served_folder: Path, plant: Plant) -> Iterator[str]:
    """Address of an explorer of the folder."""
    port = free_port()
    explorer = build_explorer(Workspace(served_folder), plant.model, address_token=ADDRESS_TOKEN)
    with serving_page(explorer, "127.0.0.1", port):
        yield f"http://127.0.0.1:{port}"


@pytest.fixture
def tab_of_own_explorer(browser, served_folder: Path, plant: Plant) -> Iterator[object]:
    """A tab for a test after which the twin room starts from another pump."""
    port = free_port()
    explorer = build_explorer(Workspace(served_folder), plant.model, address_token=ADDRESS_TOKEN)
    with serving_page(explorer, "127.0.0.1", port):
        yield from tabs(browser, f"http://127.0.0.1:{port}")


@pytest.fixture
def tab(browser, address: str) -> Iterator[object]:
    """A tab of a wide screen."""
    yield from tabs(browser, address)


def enter(tab, room: str) -> None:
    tab.goto(f"/?token={ADDRESS_TOKEN}{room}")
    tab.locator(LOADED[room]).first.wait_for()


def row_of(tab, name: str):
    return tab.locator("tr", has=tab.get_by_role("link", name=name))


def test_the_table_shows_an_unreadable_file_first(tab) -> None:
    enter(tab, "#recordings")

    tab.get_by_text("▲ broken").wait_for()

    assert "broken" in tab.locator("table.recordings tbody tr").first.inner_text()


def test_the_token_leaves_the_address_and_a_reload_still_shows_the_page(tab) -> None:
    enter(tab, "#recordings")
    assert ADDRESS_TOKEN not in tab.url

    tab.reload()
    tab.locator(LOADED["#recordings"]).first.wait_for()


def test_the_table_is_filtered_and_opened_by_keyboard(tab) -> None:
    enter(tab, "#recordings")

    tab.keyboard.press("/")
    tab.keyboard.type("A_swash 15MPa")
    playwright.expect(tab.locator("table.recordings tbody tr")).to_have_count(2)

    # leave the filter's field
    tab.locator("h1").click()
    tab.keyboard.press("j")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", name="A_swash_plate_15MPa_1").wait_for()
    assert "name=recordings" in tab.url


def test_classes_are_edited_in_place_by_key_for_several_rows_and_undone(
    tab, served_folder: Path
) -> None:
    def saved_labels() -> dict[str, str]:
        entries = read_index(served_folder / "recordings.toml")["recording"]
        return {entry["file"]: entry["label"] for entry in entries}

    original_labels = saved_labels()
    enter(tab, "#recordings")
    # rows that are read later would move under the pointer
    playwright.expect(tab.locator("text=being read")).to_have_count(0)

    # one row, in place
    row = row_of(tab, "A_normal_15MPa_1")
    row.get_by_title("Edit class").click()
    tab.get_by_label("Class", exact=True).fill("piston")
    tab.keyboard.press("Enter")
    tab.get_by_text("Class of recordings").wait_for()
    assert saved_labels()[HEALTHY] == "piston"
    row.get_by_text("piston").wait_for()

    # two rows, by the key of the third class: normal, piston, swash_plate
    for name in ("B_normal_15MPa_1", "B_normal_15MPa_2"):
        tab.get_by_label(f"Select recordings/{name}.h5").check()
    # in a corner of the row, beside its fields
    row_of(tab, "B_normal_15MPa_1").click(position={"x": 3, "y": 3})
    tab.keyboard.press("3")
    tab.get_by_text("Class of 2 recordings").wait_for()
    assert saved_labels()["recordings/B_normal_15MPa_2.h5"] == "swash_plate"

    tab.get_by_label("Select all shown").check()
    playwright.expect(tab.locator("tbody input:checked")).to_have_count(9)

    for _ in range(2):
        with tab.expect_response("**/api/facts"):
            tab.get_by_role("button", name="Undo").click()
    tab.get_by_role("button", name="Undo").wait_for(state="hidden")
    assert saved_labels() == original_labels


def test_a_waveform_is_zoomed_by_key(tab) -> None:
    enter(tab, f"#recording?name={WORN}")
    view = "document.querySelector('section[aria-label=wave]').chart.view"
    original_end = tab.evaluate(view)[1]

    tab.get_by_role("img", name="Waveform").focus()
    tab.keyboard.press("+")

    assert tab.evaluate(view)[1] < original_end


def test_a_spectrum_is_read_under_the_pointer_and_a_band_is_dragged(tab) -> None:
    enter(tab, f"#recording?name={WORN}")
    spectrum = tab.get_by_role("img", name="Spectrum", exact=True)
    spectrum.scroll_into_view_if_needed()
    box = spectrum.bounding_box()
    left = box["x"]
    middle = box["y"] + 100

    tab.mouse.move(left + 300, middle)
    assert "dB" in tab.locator("section[aria-label=spectrum] .tip").inner_text()

    tab.get_by_role("button", name="Drag a band").click()
    tab.mouse.move(left + 400, middle)
    tab.mouse.down()
    tab.mouse.move(left + 700, middle, steps=4)
    tab.mouse.up()
    tab.get_by_text("The kurtogram's band").wait_for()
    # a link to the page holds the band
    assert "low=" in tab.url


@pytest.mark.parametrize(("kind", "start"), [("SVG", "<svg"), ("CSV", '"Hz"')])
def test_a_spectrum_is_copied(tab, kind: str, start: str) -> None:
    enter(tab, f"#recording?name={WORN}")

    tab.get_by_role("button", name=f"Copy as {kind}: Spectrum", exact=True).click()
    tab.get_by_text(f"copied as {kind}").wait_for()

    assert tab.evaluate("navigator.clipboard.readText()").startswith(start)


def test_a_recording_is_played_until_the_next_is_opened(tab) -> None:
    enter(tab, f"#recording?name={WORN}")

    tab.locator("h1").click()
    tab.keyboard.press("Space")
    tab.get_by_role("button", name="■ Stop").wait_for()

    tab.keyboard.press("j")
    tab.get_by_role("button", name="▶ Play").wait_for()
    assert WORN.split("/")[1] not in tab.url


def test_two_classes_are_compared(tab) -> None:
    enter(tab, "#compare")

    playwright.expect(tab.locator("figure.chart")).to_have_count(2)
    assert "A: class normal, median and range of" in tab.locator(".sides").inner_text()
    tab.get_by_text("of the bands up to 3000 Hz lie outside the scatter").wait_for()
    first_row = tab.get_by_role("region", name="What differs most").locator("tbody tr").first
    assert "dB" in first_row.inner_text()


def test_the_sides_of_a_comparison_are_named_and_swapped(tab) -> None:
    enter(tab, "#compare")
    side_a = tab.locator("select >> nth=0")
    assert side_a.evaluate("menu => menu.selectedOptions[0].text") == "class normal"
    table = tab.get_by_role("region", name="What differs most")
    playwright.expect(table.locator("th").nth(2)).to_have_text("Change, B − A")
    change = float(table.locator("tbody tr td").nth(2).inner_text().split()[0])

    tab.get_by_role("button", name="Swap A and B").click()

    playwright.expect(
        tab.get_by_text("in B (class normal) than in A (class swash plate)")
    ).to_be_visible()
    swapped = float(table.locator("tbody tr td").nth(2).inner_text().split()[0])
    assert swapped == -change
    assert tab.locator(".sides").inner_text().startswith("A: class swash")


def test_two_classes_are_mirrored_and_heard_in_turns_near_a_line(tab) -> None:
    enter(tab, "#compare")

    tab.get_by_label("Drawn").select_option("mirrored")
    spectra = tab.get_by_role("img", name="Spectra of A (upward) and B (downward)")
    spectra.wait_for()
    tab.get_by_role("button", name="Listen to A").click()
    tab.get_by_role("button", name="Stop A").wait_for()
    tab.get_by_role("button", name="Listen to B").click()
    tab.get_by_role("button", name="Stop B").wait_for()
    spectra.click(position={"x": 300, "y": 100})
    tab.get_by_text("Only near").wait_for()
    tab.get_by_role("button", name="Hear all").click()

    tab.get_by_role("button", name="Stop B").click()

    tab.get_by_role("button", name="Listen to B").wait_for()
    assert tab.get_by_text("Only near").count() == 0


@pytest.fixture
def tab_of_known_difference(browser, tmp_path: Path) -> Iterator[object]:
    """A tab on one noise as four recordings, whose levels and scatter are known.

    Three healthy ones lie 0, +2 and -1 dB from it. In the worn one, twice the amplitude (6.02 dB)
    stands between 500 and 600 Hz.
    """
    rate = 12_800
    noise = np.random.default_rng(0).normal(0, 0.3, 8 * rate)
    lines = np.fft.rfft(noise)
    frequency = np.fft.rfftfreq(noise.size, 1 / rate)
    lines[(frequency >= 500) & (frequency < 600)] *= 2
    signals = {
        "worn": np.fft.irfft(lines, noise.size),
        "normal-1": noise,
        "normal-2": 10 ** (2 / 20) * noise,
        "normal-3": 10 ** (-1 / 20) * noise,
    }
    for name, signal in signals.items():
        recording = Recording(signal[None], float(rate), name, label=name.split("-")[0])
        write_recording(recording, tmp_path / f"{name}.h5")

    port = free_port()
    explorer = build_explorer(Workspace(tmp_path), address_token=ADDRESS_TOKEN)
    with serving_page(explorer, "127.0.0.1", port):
        yield from tabs(browser, f"http://127.0.0.1:{port}")


def test_a_difference_and_its_scatter_are_those_computed_by_hand(tab_of_known_difference) -> None:
    tab = tab_of_known_difference
    enter(tab, "#compare")

    tab.get_by_role("button", name="Copy as CSV: B − A").click()
    tab.get_by_text("copied as CSV").wait_for()
    header, *rows = tab.evaluate("navigator.clipboard.readText()").splitlines()

    assert header == '"Hz","B − A [dB]","lowest healthy [dB]","highest healthy [dB]"'
    frequency, change, lowest, highest = np.array([row.split(",") for row in rows], float).T
    # the median of the healthy ones is the noise itself
    assert lowest == pytest.approx(-1, abs=1e-3)
    assert highest == pytest.approx(2, abs=1e-3)
    # bands of 5 Hz; a taper blurs the two edges
    is_raised = (frequency > 505) & (frequency < 595)
    is_edge = (np.abs(frequency - 500) < 5) | (np.abs(frequency - 600) < 5)
    assert is_raised.sum() == 18
    assert change[is_raised] == pytest.approx(20 * np.log10(2), abs=1e-2)
    assert change[~is_raised & ~is_edge] == pytest.approx(0, abs=1e-2)
    # 20 of 600 bands
    tab.get_by_text("3 % of the bands up to 3000 Hz lie outside the scatter.").wait_for()
    tab.get_by_text("Farthest outside: +6.0 dB").wait_for()
    tab.get_by_text("deviation from the median of 3 healthy recordings").wait_for()


def test_a_slider_of_the_twin_changes_its_misfit(tab) -> None:
    enter(tab, "#twin")
    misfit = tab.locator("text=spectrum value error")
    original_misfit = misfit.inner_text()

    tab.get_by_label("K_v: block").focus()
    # one step alone may not change the digits that are shown
    for _ in range(20):
        tab.keyboard.press("ArrowRight")

    playwright.expect(misfit).not_to_have_text(original_misfit)


def test_a_moved_slider_names_the_line_that_changed_most(tab) -> None:
    enter(tab, "#twin")
    row = tab.locator(".slider", has=tab.get_by_label("Mounting stiffness"))

    row.locator("input").focus()
    for _ in range(40):
        tab.keyboard.press("ArrowRight")

    playwright.expect(row.locator(".change")).to_contain_text("Changed most: ")
    # only the slider that was moved last has a remark
    tab.get_by_label("Bearing stiffness").press("ArrowRight")
    playwright.expect(row.locator(".change")).to_be_empty()


def test_a_slider_marks_its_nominal_value(tab) -> None:
    enter(tab, "#twin")
    row = tab.locator(".slider", has=tab.get_by_label("K_v: block"))
    width = "node => node.getBoundingClientRect().left"

    # the start is the nominal pump, so that mark and handle are in the middle
    middle = row.evaluate("node => node.getBoundingClientRect().width") / 2
    left = row.locator(".nominal").evaluate(width) - row.evaluate(width)
    assert left == pytest.approx(middle, abs=3)


def test_a_calibration_is_stopped_and_finished(tab_of_own_explorer) -> None:
    tab = tab_of_own_explorer
    enter(tab, "#twin")

    tab.get_by_role("button", name="Calibrate from here").click()
    tab.get_by_role("button", name="Stop the calibration").click()
    tab.get_by_text("Stopped; nothing changed.").wait_for()

    tab.get_by_role("button", name="Calibrate from here").click()
    # the intervals of the six values
    tab.locator(".interval").nth(5).wait_for()


def test_a_selected_fault_shows_its_dimensions_and_its_part(tab) -> None:
    enter(tab, "#twin")

    tab.get_by_label("Fault").select_option("piston")

    tab.get_by_label("Fault: clearance").wait_for()
    playwright.expect(tab.locator(".cutaway text.suspect-name")).to_have_text("piston")


# a canvas whose cursor has the color of the mark: centers of its two dots [px]
DOTS = """() => {
  const { curves, ink } = document.querySelector(".living-pump").pump;
  const { width, height } = curves.canvas;
  const probe = new OffscreenCanvas(1, 1).getContext("2d");
  probe.fillStyle = ink.mark;
  probe.fillRect(0, 0, 1, 1);
  const mark = probe.getImageData(0, 0, 1, 1).data;
  const pixels = curves.pen.getImageData(0, 0, width, height).data;
  const sums = [[0, 0, 0], [0, 0, 0]];
  for (let n = 0; n < width * height; n++) {
    if (![0, 1, 2].every((part) => pixels[4 * n + part] === mark[part])) continue;
    const y = Math.floor(n / width);
    const sum = sums[y < height / 2 ? 0 : 1];
    sum[0] += (n % width) + 0.5;
    sum[1] += y + 0.5;
    sum[2] += 1;
  }
  return sums.map(([x, y, count]) => [x / count / curves.ratio, y / count / curves.ratio]);
}"""
# edges of the panels [px]: left, right, and lower and upper of pressure and waveform
PANELS = """() => {
  const pump = document.querySelector(".living-pump").pump;
  const edges = [pump.pixelOf(0), pump.pixelOf(2 * Math.PI)];
  for (const isUpper of [true, false]) {
    edges.push(pump.heightOf(0, isUpper), pump.heightOf(1, isUpper));
  }
  return edges;
}"""


def aligned_waveform(recording: Recording, twin: Twin) -> np.ndarray:
    """Return the mean turn of a recording at the twin's shaft angle."""
    mean_turn = average_turns(recording, 7, int(1.25 * 3000 / twin.condition.shaft_frequency) + 1)
    with torch.no_grad():
        return align_turn(mean_turn, twin, twin.acceleration().numpy()).waveform


@pytest.mark.parametrize("degrees", [0, 16, 197, 290])
def test_a_scrubbed_pump_shows_angle_pressure_and_both_waveforms(
    browser, address: str, served_folder: Path, degrees: int
) -> None:
    for tab in tabs(browser, address, reduced_motion="reduce"):
        enter(tab, "#twin")
        tab.locator(".living-pump select").select_option("1")
        name = tab.get_by_label("Measured").input_value()
        tab.get_by_label("Shaft angle").fill(str(degrees))
        left, right, *edges = tab.evaluate(PANELS)
        dots = tab.evaluate(DOTS)

        condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
        twin = Twin(load_pump("25scy14-1b"), condition, bandwidth=3000.0)
        turn = solve_turn(twin)
        measured = aligned_waveform(Workspace(served_folder).recording(name), twin)[1]
        largest = 1.05 * max(np.abs(turn.acceleration[1]).max(), np.abs(measured).max())
        cursor = tab.evaluate("document.querySelector('.living-pump').pump.cursor")
        for values, lowest, highest, (low, high), (x, y) in (
            (turn.chamber[0], 0.0, 1.05 * turn.chamber.max(), edges[:2], dots[0]),
            (turn.acceleration[1], -largest, largest, edges[2:], dots[1]),
            (measured, -largest, largest, edges[2:], (cursor["x"], cursor["measured"])),
        ):
            angles = np.arange(values.size) * 360 / values.size
            value = np.interp(degrees, angles, values, period=360)
            assert x == pytest.approx(left + (right - left) * degrees / 360, abs=1)
            share = (value - lowest) / (highest - lowest)
            assert y == pytest.approx(low + (high - low) * share, abs=1)
        assert tab.locator(".living-pump output").inner_text().startswith(f"{degrees}°")


def test_a_pump_that_was_out_of_sight_is_drawn_when_it_comes_into_view(
    browser, address: str
) -> None:
    pump = "document.querySelector('.living-pump').pump"

    def draws() -> str:
        return tab.evaluate("document.querySelector('.pump-curves').toDataURL()")

    def wait_until(condition: str) -> None:
        # The pages' policy forbids the evaluated text of `wait_for_function`.
        deadline = time.monotonic() + PATIENCE / 1000
        while not tab.evaluate(f"(pump => {condition})({pump})"):
            assert time.monotonic() < deadline, condition
            tab.wait_for_timeout(50)

    def move_pressure(value: int) -> None:
        slider = tab.get_by_label("Discharge pressure")
        slider.evaluate(
            f"slider => {{ slider.value = {value}; slider.dispatchEvent(new Event('input')); }}"
        )

    for tab in tabs(browser, address, reduced_motion="reduce"):
        enter(tab, "#twin")
        before = draws()
        tab.evaluate("scrollTo(0, document.body.scrollHeight)")
        wait_until("!pump.isVisible")
        move_pressure(25)
        wait_until("pump.isOutdated")
        assert draws() == before

        tab.evaluate("scrollTo(0, 0)")
        wait_until("!pump.isOutdated")
        moved = draws()
        assert moved != before

        # Paper shows what is out of view, too.
        tab.evaluate("scrollTo(0, document.body.scrollHeight)")
        wait_until("!pump.isVisible")
        for value in (5, 25):
            move_pressure(value)
            wait_until("pump.isOutdated")
            tab.evaluate("dispatchEvent(new Event('beforeprint'))")
            assert (draws() == moved) == (value == 25)


@pytest.mark.parametrize(("motion", "is_turning"), [("no-preference", True), ("reduce", False)])
def test_the_pump_turns_unless_motion_is_unwanted(
    browser, address: str, motion: str, is_turning: bool
) -> None:
    for tab in tabs(browser, address, reduced_motion=motion):
        enter(tab, "#twin")
        angle = "document.querySelector('.living-pump').pump.angle"
        start = tab.evaluate(angle)
        tab.wait_for_timeout(500)
        assert (tab.evaluate(angle) != start) == is_turning

        tab.get_by_role("button", name="the pump").click()
        start = tab.evaluate(angle)
        tab.wait_for_timeout(500)
        assert (tab.evaluate(angle) != start) != is_turning


def test_a_verdict_shows_the_nearest_training_recordings(tab) -> None:
    enter(tab, f"#diagnose?name={WORN}")
    tab.get_by_text("Nearest training recordings").first.wait_for()


def test_a_file_that_is_no_model_is_refused_until_a_model_is_dropped(tab, plant: Plant) -> None:
    enter(tab, f"#diagnose?name={WORN}")

    tab.get_by_label("Model file").set_input_files(str(plant.synthetic))
    tab.locator(".drop .notice").wait_for()

    tab.get_by_label("Model file").set_input_files(str(plant.model))
    tab.locator(".verdict").wait_for()


def test_no_room_scrolls_sideways_on_a_phone(browser, address: str) -> None:
    check_phone(browser, address, LOADED, enter)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_reports_no_serious_defect_in_any_room(browser, address: str, scheme: str) -> None:
    check_access(browser, address, LOADED, enter, scheme)


def test_a_minute_at_50_khz_is_panned_at_thirty_frames_a_second(browser, tmp_path: Path) -> None:
    signal = np.random.default_rng(0).normal(size=(1, 3_000_000))
    recording = Recording(signal, 50_000.0, "long", label="normal")
    path = write_recording(recording, tmp_path / "long.h5")
    port = free_port()
    # frames a second over two seconds, in which a view of 4 s moves over 10 s of the recording
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

    explorer = build_explorer(Workspace(path), address_token=ADDRESS_TOKEN)
    with serving_page(explorer, "127.0.0.1", port):
        for tab in tabs(browser, f"http://127.0.0.1:{port}"):
            tab.goto(f"/?token={ADDRESS_TOKEN}#recording?name=long")
            tab.locator("canvas[aria-label^='Waterfall']").wait_for()
            assert tab.evaluate(pan) >= 30
