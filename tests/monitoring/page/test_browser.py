"""The page in a real Chromium: scripts, live changes, phone, keyboard and accessibility."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from chromium import MARKS, PHONE, check_access, check_phone, playwright, started_browser, tabs  # noqa: F401
from large_plant import write_large_plant
from mqtt_broker import free_port

from swashtwin.monitoring.config.config_file import load_watch_config
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.page.server import serving_page
from swashtwin.monitoring.page.watch_page import build_watch_page

pytestmark = MARKS


@dataclass
class ServedPage:
    """A page that is served, and the history that it shows."""

    address: str
    history: History
    suspect_address: str
    """Address of an alarm that suspects a part, below that of the page."""

    def newest_recording(self, machine: str) -> str:
        """Return the address of the newest recording of a machine, below that of the page."""
        (newest,) = self.history.reader.recordings(machine, limit=1)
        return f"/recordings/{newest.id}"

    def all_addresses(self) -> list[str]:
        """Return an address of each kind of page."""
        return [
            "/",
            "/machines/pump-1",
            "/machines/pump-2",
            self.newest_recording("pump-1"),
            self.newest_recording("presse-4"),
            "/alarms",
            "/alarms/1",
            self.suspect_address,
            "/log",
            "/login",
        ]


@pytest.fixture(scope="module")
def served(filled_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedPage]:
    """The plant's page at a free port."""
    folder = tmp_path_factory.mktemp("served") / "plant"
    shutil.copytree(filled_folder, folder)
    config = load_watch_config(folder / "watch.toml")
    history = History.open("", config.folder)

    alarm = history.reader.alarm(1)
    suspect = {"certainty": "sure", "label": "piston", "sentence": "Suspect: piston."}
    with history.machine("pump-1") as machine:
        machine.acknowledge(
            machine.open_alarm("pump", None, alarm.opened, {"suspect": suspect}, 34).id, "Ada"
        )
    suspect_address = f"/alarms/{history.reader.alarms('pump-1')[0].id}"

    port = free_port()
    with serving_page(build_watch_page(config, history), "127.0.0.1", port):
        yield ServedPage(f"http://127.0.0.1:{port}", history, suspect_address)
    history.close()


@pytest.fixture
def tab(browser, served: ServedPage) -> Iterator[object]:
    """A tab of a wide screen."""
    yield from tabs(browser, served.address)


def test_the_overview_leads_to_a_machine_and_its_newest_recording(tab) -> None:
    tab.goto("/")
    tab.get_by_role("link", name="pump-1").click()
    playwright.expect(tab.locator("figure .drawing")).to_have_count(5)

    recordings = tab.get_by_role("region", name="Recordings", exact=True).first
    recordings.get_by_role("link").first.click()
    tab.get_by_role("heading", name="What to check next").wait_for()
    playwright.expect(tab.locator("figure .drawing")).to_have_count(3)


def test_times_are_shown_in_the_readers_zone(browser, served: ServedPage) -> None:
    for tab in tabs(browser, served.address, timezone_id="Asia/Tokyo"):
        tab.goto("/log")
        shown_time = tab.locator("time").first.inner_text()

        # The newest entry is minutes old, so it may be of the day before.
        now_in_tokyo = datetime.now(UTC) + timedelta(hours=9)
        days = (now_in_tokyo, now_in_tokyo - timedelta(days=1))
        assert shown_time.startswith(tuple(f"{day:%b %-d, %Y}" for day in days))


def test_a_chosen_indicator_is_drawn_with_its_baseline_and_leads_to_its_recordings(tab) -> None:
    tab.goto("/machines/pump-1")
    tab.get_by_label("Channel").select_option("y")
    tab.get_by_label("Indicator").select_option("shaft order 14")
    tab.get_by_role("button", name="Show").click()

    caption = tab.locator("[data-region=trend] figcaption")
    tab.locator("[data-region=trend] figcaption", has_text="y: shaft order 14").wait_for()
    assert "Healthy baseline ± 3 spreads" in caption.inner_text()

    # Click at the last point of the line. Its field is 1000 units wide and begins 16 pixels down.
    drawing = tab.locator("[data-region=trend] .drawing")
    drawing.scroll_into_view_if_needed()
    line = drawing.locator(".main").get_attribute("d")
    x, y = (float(number) for number in line.split("L")[-1].split())
    box = drawing.bounding_box()
    tab.mouse.click(box["x"] + box["width"] * x / 1000, box["y"] + 16 + y)

    tab.wait_for_url("**/recordings/*")


def test_a_spectrum_shows_values_zooms_by_dragging_and_goes_back(tab, served: ServedPage) -> None:
    tab.goto(served.newest_recording("pump-1"))
    drawing = tab.locator(".drawing").first
    field = tab.locator(".drawing .field").first
    drawing.scroll_into_view_if_needed()
    box = drawing.bounding_box()
    middle = box["y"] + box["height"] / 2

    # A quarter of the axis, which ends 10 % beyond order 28.
    tab.mouse.move(box["x"] + box["width"] / 4, middle)
    assert tab.locator(".tip").inner_text().startswith("7.68× (192.0 Hz): ")

    tab.mouse.down()
    tab.mouse.move(box["x"] + box["width"] / 2, middle)
    tab.mouse.up()
    left, top, width, _ = field.get_attribute("viewBox").split()
    assert [round(float(number)) for number in (left, top, width)] == [250, 0, 250]
    assert "12" in drawing.locator(".tick").all_text_contents()

    drawing.dblclick()
    assert field.get_attribute("viewBox").startswith("0 0 1000")


def test_the_map_of_orders_states_time_and_order_at_the_pointer(tab) -> None:
    tab.goto("/machines/pump-1")
    field = tab.locator('[data-region="map"] .field')
    field.scroll_into_view_if_needed()
    box = field.bounding_box()

    # Order 1 is the lowest of 40 rows.
    tab.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] * 39.5 / 40)
    assert tab.locator('[data-region="map"] .tip').inner_text().endswith(": order 1")
    tab.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] * 0.5 / 40)
    assert tab.locator('[data-region="map"] .tip').inner_text().endswith(": order 40")


def test_an_acknowledgment_is_shown_on_other_open_pages_without_a_reload(
    browser, served: ServedPage, tab
) -> None:
    for other_tab in tabs(browser, served.address):
        other_tab.goto("/alarms")
        other_tab.locator("#live.on").wait_for()
        # A reload would remove the mark.
        other_tab.evaluate("window.isSame = true")

        tab.goto("/machines/presse-4")
        tab.get_by_label("Your name").first.fill("Ada")
        tab.get_by_label("Note", exact=True).first.fill("cable replaced")
        tab.get_by_role("button", name="Acknowledge").click()
        tab.get_by_text("Acknowledged by Ada").wait_for()

        # Ada has acknowledged another alarm before, without a note.
        other_tab.get_by_text("cable replaced").wait_for()
        assert other_tab.evaluate("window.isSame")


def test_what_somebody_types_survives_a_change_of_the_history(served: ServedPage, tab) -> None:
    tab.goto("/machines/pump-1")
    tab.locator("#live.on").wait_for()
    note = tab.get_by_label("Note", exact=True).first
    note.fill("half a sentence")

    with served.history.machine("pump-1") as machine:
        machine.add_event("note", "Bob", "something happened")

    # The page replaces what changed, but not the form around it.
    tab.get_by_text("something happened").wait_for()
    assert note.input_value() == "half a sentence"


def enter(tab, address: str) -> None:
    """Open a page, and wait for what its script loads."""
    tab.goto(address)
    if tab.locator("[data-content]").count():
        tab.locator(".living-pump canvas").first.wait_for()


def test_the_pump_of_an_alarm_turns_once_it_is_computed(tab, served: ServedPage) -> None:
    pytest.importorskip("torch", reason="the twin needs torch")
    enter(tab, served.suspect_address)

    tab.get_by_role("heading", name="How such a fault acts").wait_for()
    tab.wait_for_function("document.querySelector('.living-pump').pump.frames > 2")
    assert "clearance is larger" in tab.locator(".pump-fault").inner_text()


def test_no_page_scrolls_sideways_on_a_phone(browser, served: ServedPage) -> None:
    check_phone(browser, served.address, served.all_addresses(), enter)


def test_the_keyboard_reaches_everything_from_the_top(tab) -> None:
    tab.goto("/machines/pump-1")
    focused_name = "document.activeElement.textContent.trim() || document.activeElement.name || ''"
    names = []
    for _ in range(14):
        tab.keyboard.press("Tab")
        names.append(tab.evaluate(focused_name))

    # Without the first link each page would take a walk through the menu.
    assert names[0] == "Skip to content"
    assert names[1:5] == ["swashtwin", "Machines", "Alarms", "Log"]
    assert "note" in names
    assert "Acknowledge" in names
    assert tab.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_fault_on_any_page(browser, served: ServedPage, scheme: str) -> None:
    impacts = ("minor", "moderate", "serious", "critical")
    check_access(browser, served.address, served.all_addresses(), enter, scheme, impacts)


@pytest.fixture(scope="module")
def large_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of the page of twenty machines, one in each state."""
    config = load_watch_config(write_large_plant(tmp_path_factory.mktemp("large") / "plant", 20))
    history = History.open("", config.folder)
    port = free_port()
    with serving_page(build_watch_page(config, history), "127.0.0.1", port):
        yield f"http://127.0.0.1:{port}"
    history.close()


def test_a_phone_shows_the_most_urgent_of_twenty_machines_first(
    browser, large_address: str
) -> None:
    for tab in tabs(browser, large_address, **PHONE):
        tab.goto("/")
        playwright.expect(tab.locator(".card").first).to_contain_text("P-104")
        # What to do is seen without scrolling.
        for text in ("Suspect: piston (93 %).", "What to do:"):
            assert tab.get_by_text(text).first.bounding_box()["y"] < PHONE["viewport"]["height"]

        tab.get_by_placeholder("Name or site").fill("hall 4")
        tab.get_by_role("button", name="Search").click()
        playwright.expect(tab.locator(".card")).to_have_count(5)
        assert tab.evaluate("document.documentElement.scrollWidth") <= 390


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_fault_on_cards_of_any_state(browser, large_address: str, scheme: str) -> None:
    impacts = ("minor", "moderate", "serious", "critical")
    check_access(browser, large_address, ["/", "/?state=silent"], enter, scheme, impacts)
