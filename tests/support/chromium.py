"""A real Chromium for tests of pages; a module that imports this is skipped without one."""

from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
PROGRAM = "/usr/bin/chromium"
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--autoplay-policy=no-user-gesture-required",
]
PATIENCE = 90_000
"""Time [ms] that a slow machine may take."""
MARKS = [
    pytest.mark.nightly,
    pytest.mark.skipif(not Path(PROGRAM).exists(), reason=f"there is no {PROGRAM}"),
]
PHONE = {
    "viewport": {"width": 390, "height": 844},
    "is_mobile": True,
    "has_touch": True,
}


@pytest.fixture(scope="module", name="browser")
def started_browser() -> Iterator[Any]:
    """A Chromium."""
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=PROGRAM, args=ARGUMENTS)
        yield chromium
        chromium.close()


def tabs(browser: Any, address: str, **settings: Any) -> Iterator[Any]:
    """A tab whose scripts raise no error."""
    wide = {
        "viewport": {"width": 1280, "height": 900},
        "permissions": ["clipboard-read", "clipboard-write"],
    }
    context = browser.new_context(base_url=address, locale="en-US", **{**wide, **settings})
    context.set_default_timeout(PATIENCE)
    page = context.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on(
        "console",
        lambda message: errors.append(message.text) if _is_error(message) else None,
    )
    yield page
    context.close()

    assert errors == []


def _is_error(message: Any) -> bool:
    return message.type == "error" and "the server responded with a status of" not in message.text


def check_phone(
    browser: Any,
    address: str,
    addresses: Iterable[str],
    enter: Callable[[Any, str], None],
) -> None:
    """No place scrolls sideways on a phone."""
    for tab in tabs(browser, address, **PHONE):
        for page_address in addresses:
            enter(tab, page_address)
            assert tab.evaluate("document.documentElement.scrollWidth") <= 390, page_address


def check_access(
    browser: Any,
    address: str,
    addresses: Iterable[str],
    enter: Callable[[Any, str], None],
    scheme: str,
    impacts: Collection[str] = ("serious", "critical"),
) -> None:
    """Axe finds no fault of these impacts at any place."""
    axe = pytest.importorskip(
        "axe_playwright_python.sync_playwright", reason="axe is not installed"
    ).Axe()

    for tab in tabs(browser, address, color_scheme=scheme):
        for page_address in addresses:
            enter(tab, page_address)
            faults = {}
            for violation in axe.run(tab).response["violations"]:
                if violation["impact"] in impacts:
                    nodes = [node["html"][:200] for node in violation["nodes"]]
                    faults[violation["id"]] = nodes
            assert faults == {}, page_address
