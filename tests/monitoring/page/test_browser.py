"""The page in a real Chromium: scripts, live changes, phone, dark mode, keyboard and
accessibility.
"""

import shutil
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from chromium import MARKS, check_access, check_phone, playwright, started_browser, tabs  # noqa: F401
from mqtt_broker import free_port

from swashtwin.monitoring.config.config_file import load_watch_config
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.page.server import serving_page
from swashtwin.monitoring.page.watch_page import build_watch_page

pytestmark = MARKS


@pytest.fixture(scope="module")
def served(
    filled_folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[str, History]]:
    """Address of a page that is served, and its history."""
    folder = tmp_path_factory.mktemp("served") / "plant"
    shutil.copytree(filled_folder, folder)
    config = load_watch_config(folder / "watch.toml")
    history = History.open("", config.folder)
    port = free_port()
    with serving_page(build_watch_page(config, history), "127.0.0.1", port):
        yield f"http://127.0.0.1:{port}", history
    history.close()


@pytest.fixture
def tab(browser, served) -> Iterator[object]:
    """A tab of a wide screen."""
    yield from tabs(browser, served[0])


def _newest(served, machine: str) -> int:
    return served[1].reader.recordings(machine, limit=1)[0].id


def _addresses(served) -> list[str]:
    recordings = [f"/recordings/{_newest(served, name)}" for name in ("pump-1", "presse-4")]
    return [
        "/",
        "/machines/pump-1",
        "/machines/pump-2",
        *recordings,
        "/alarms",
        "/alarms/1",
        "/log",
        "/login",
    ]


def test_the_overview_leads_to_a_machine_and_its_newest_recording(tab) -> None:
    tab.goto("/")
    tab.get_by_role("link", name="pump-1").click()
    playwright.expect(tab.locator("figure .drawing")).to_have_count(2)
    tab.get_by_role("region", name="Recordings", exact=True).first.get_by_role("link").first.click()
    tab.get_by_role("heading", name="What to check next").wait_for()
    playwright.expect(tab.locator("figure .drawing")).to_have_count(3)


def test_times_are_shown_in_the_readers_zone(browser, served) -> None:
    for tab in tabs(browser, served[0], timezone_id="Asia/Tokyo"):
        tab.goto("/log")
        utc = datetime.now(UTC)
        shown = tab.locator("time").first.inner_text()
        days = {(utc + timedelta(hours=9, days=back)).strftime("%b %-d, %Y") for back in (0, -1)}
        assert any(shown.startswith(day) for day in days)


def test_another_level_is_chosen_drawn_with_its_band_and_leads_to_its_recordings(tab) -> None:
    tab.goto("/machines/pump-1")
    tab.get_by_label("Channel").select_option("y")
    tab.get_by_label("Indicator").select_option("shaft order 14")
    tab.get_by_role("button", name="Show").click()
    tab.locator("#trend figcaption", has_text="y: shaft order 14").wait_for()
    assert "Healthy baseline ± 3 spreads" in tab.locator("#trend figcaption").inner_text()
    drawing = tab.locator("#trend .drawing")
    drawing.scroll_into_view_if_needed()
    last = drawing.locator(".main").get_attribute("d").split("L")[-1].split()
    box = drawing.bounding_box()
    tab.mouse.click(box["x"] + box["width"] * float(last[0]) / 1000, box["y"] + 16 + float(last[1]))
    tab.wait_for_url("**/recordings/*")


def test_a_spectrum_tells_values_zooms_by_dragging_and_goes_back(tab, served) -> None:
    tab.goto(f"/recordings/{_newest(served, 'pump-1')}")
    drawing, field = tab.locator(".drawing").first, tab.locator(".drawing .field").first
    drawing.scroll_into_view_if_needed()
    box = drawing.bounding_box()
    middle = box["y"] + box["height"] / 2
    tab.mouse.move(box["x"] + box["width"] / 4, middle)
    assert "800 Hz (32" in tab.locator(".tip").inner_text()
    tab.mouse.down()
    tab.mouse.move(box["x"] + box["width"] / 2, middle)
    tab.mouse.up()
    assert [round(float(part)) for part in field.get_attribute("viewBox").split()[:3]] == [
        250,
        0,
        250,
    ]
    assert "1000" in drawing.locator(".tick").all_text_contents()
    drawing.dblclick()
    assert field.get_attribute("viewBox").startswith("0 0 1000")


def test_an_alarm_is_acknowledged_and_other_open_pages_show_it_without_a_reload(
    browser, served, tab
) -> None:
    for other in tabs(browser, served[0]):
        other.goto("/alarms")
        other.locator("#live.on").wait_for()
        other.evaluate("window.isSame = true")
        tab.goto("/machines/presse-4")
        tab.get_by_label("Your name").first.fill("Ada")
        tab.get_by_label("Note", exact=True).first.fill("cable replaced")
        tab.get_by_role("button", name="Acknowledge").click()
        tab.get_by_text("Acknowledged by Ada").wait_for()
        other.get_by_text("Acknowledged by Ada").wait_for()
        assert other.evaluate("window.isSame")


def test_what_somebody_types_survives_a_change_of_the_history(served, tab) -> None:
    tab.goto("/machines/pump-1")
    tab.locator("#live.on").wait_for()
    note = tab.get_by_label("Note", exact=True).first
    note.fill("half a sentence")
    with served[1].machine("pump-1") as machine:
        machine.add_event("note", "Bob", "something happened")
    tab.get_by_text("something happened").wait_for()
    assert note.input_value() == "half a sentence"


def test_no_page_scrolls_sideways_on_a_phone(browser, served) -> None:
    check_phone(browser, served[0], _addresses(served), lambda tab, address: tab.goto(address))


def test_the_keyboard_reaches_everything_from_the_top(tab) -> None:
    tab.goto("/machines/pump-1")
    focused = "document.activeElement.textContent.trim() || document.activeElement.name || ''"
    names = []
    for _ in range(14):
        tab.keyboard.press("Tab")
        names.append(tab.evaluate(focused))
    assert names[0] == "Skip to content"
    assert names[1:5] == ["swashtwin", "Machines", "Alarms", "Log"]
    assert "note" in names
    assert "Acknowledge" in names
    assert tab.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_fault_on_any_page(browser, served, scheme: str) -> None:
    check_access(
        browser, served[0], _addresses(served), lambda tab, address: tab.goto(address), scheme
    )
