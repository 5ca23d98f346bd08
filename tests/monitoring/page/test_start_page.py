"""The start page of a plant with many machines: what is urgent, why, and what to do."""

import re
import shutil
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from build_once import built_once
from judgments import judgment
from large_plant import NOW, write_large_plant
from sqlalchemy import Engine, event
from starlette.testclient import TestClient

from swashtwin.monitoring.config.config_file import load_watch_config
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.page.cards import Standing
from swashtwin.monitoring.page.pages import CARDS_PER_PAGE, N_SPARK_RECORDINGS
from swashtwin.monitoring.page.watch_page import build_watch_page

N_MACHINES = CARDS_PER_PAGE + 1
MAX_PAGE_BYTES = 80_000


def plant_client(config_path: Path) -> TestClient:
    """A browser without scripts on the plant's computer."""
    config = load_watch_config(config_path)
    history = History.open("", config.folder)
    return TestClient(build_watch_page(config, history), base_url="http://127.0.0.1:8642")


@pytest.fixture(scope="module")
def plant_config(shared_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Configuration of a plant with more machines than one page shows; no test changes it."""
    built = built_once(
        shared_folder / "large_plant",
        lambda folder: write_large_plant(folder, N_MACHINES, N_SPARK_RECORDINGS),
    )
    folder = tmp_path_factory.mktemp("large") / "plant"
    shutil.copytree(built, folder)
    return folder / "watch.toml"


@pytest.fixture(scope="module")
def client(plant_config: Path) -> TestClient:
    """A browser on the computer of the large plant."""
    return plant_client(plant_config)


@pytest.fixture
def statements() -> Iterator[list[str]]:
    """Every statement that any database executes."""
    executed: list[str] = []

    def note(_connection, _cursor, statement: str, *_: object) -> None:
        executed.append(statement)

    event.listen(Engine, "before_cursor_execute", note)
    yield executed
    event.remove(Engine, "before_cursor_execute", note)


def cards(text: str) -> dict[str, str]:
    """Return the text of each card by the name of its machine, in the order of the page."""
    text_by_machine = {}
    for card in re.findall(r'<li class="card.*?</li>\s*(?=<li class="card|</ul>)', text, re.S):
        words = " ".join(re.sub(r"<[^>]+>", " ", card).split())
        text_by_machine[words.split()[0]] = words
    return text_by_machine


def test_machines_that_need_attention_come_first_whatever_their_site(client: TestClient) -> None:
    text = client.get("/").text

    assert list(cards(text))[:7] == [f"P-{number}" for number in range(104, 118, 2)]
    assert "7 of 61 machines need attention." in text
    headings = re.findall(r"<h2>(.*?) <small>(\d+)", text)
    assert headings == [
        ("Needs attention", "7"),
        ("hall 1", "9"),
        ("hall 2", "15"),
        ("hall 3", "15"),
        ("hall 4", "15"),
    ]


@pytest.mark.parametrize(
    ("machine", "sentences"),
    [
        pytest.param(
            "P-104",
            (
                "Alarm for 1 day",
                "Suspect: piston (93 %).",
                "Severity: clearance 24 µm (18 to 31), detected, on",
                "Why: +13.7 dB at shaft order 9 (225 Hz), channel x",
                "Measure the case drain flow",
                "now 14 times the healthy spread",
                "Last recording",
            ),
            id="alarm with a suspect and its severity",
        ),
        pytest.param(
            "P-106",
            ("Suspect, unsure: valve plate (47 %), or cylinder block (29 %).", "pressure ripple"),
            id="alarm with two candidates",
        ),
        pytest.param(
            "P-108",
            ("Sensor alarm for", "Why: channel y does not move", "Check the sensor"),
            id="sensor",
        ),
        pytest.param(
            "P-110", ("Deliveries not usable", "4 deliveries in a row", "logger"), id="deliveries"
        ),
        pytest.param(
            "P-112", ("Alarm acknowledged for", "Ada is on it: spare part ordered"), id="in hand"
        ),
        pytest.param("P-114", ("Unusual for", "Record it again"), id="unusual"),
        pytest.param("P-116", ("No recording for 4 days", "Check the logger"), id="silent"),
        pytest.param("P-118", ("Learning 20 of 20 recordings",), id="learning"),
        pytest.param("P-101", ("Normal no alarm for 13 days",), id="normal"),
    ],
)
def test_a_card_states_since_when_why_and_what_to_do(
    client: TestClient, machine: str, sentences: tuple[str, ...]
) -> None:
    card = cards(client.get("/").text)[machine]

    for sentence in sentences:
        assert sentence in card


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("state=silent", ["P-116"]),
        ("state=alarm", ["P-104", "P-106"]),
        ("text=HALL%204&state=normal&page=1", [f"P-{number}" for number in range(147, 162)]),
        ("text=p-161", ["P-161"]),
        ("page=2", ["P-161"]),
        ("page=99", ["P-161"]),
    ],
)
def test_machines_are_found_by_state_name_and_site_on_all_pages(
    client: TestClient, query: str, expected: list[str]
) -> None:
    assert list(cards(client.get(f"/?{query}").text)) == expected


def test_the_states_of_machines_that_a_search_found_are_counted_and_filtered(
    client: TestClient,
) -> None:
    text = client.get("/?text=hall+4").text

    assert 'href="/?state=normal&amp;text=hall+4"' in text
    assert re.findall(r"</span> (\d+) Normal</a>", text) == ["15"]
    assert 'class="badge alarm"' not in text


def test_a_start_page_takes_few_bytes_and_as_many_queries_for_any_number_of_machines(
    client: TestClient, tmp_path: Path, statements: list[str]
) -> None:
    page = client.get("/").content
    n_queries = len(statements)
    assert len(cards(page.decode())) == CARDS_PER_PAGE
    assert len(page) < MAX_PAGE_BYTES

    small_client = plant_client(write_large_plant(tmp_path / "small", 2, 3))
    statements.clear()
    small_client.get("/")
    assert len(statements) == n_queries


@pytest.mark.parametrize(
    ("interval_days", "age_days", "is_silent"),
    [
        pytest.param(0.1, 0.9, False, id="less than a day"),
        pytest.param(0.1, 1.1, True, id="more than a day"),
        # A technician records the machine once a week.
        pytest.param(7, 15, False, id="two of its intervals"),
        pytest.param(7, 22, True, id="more than three of its intervals"),
    ],
)
def test_a_machine_is_silent_after_a_day_and_three_of_its_intervals(
    interval_days: float, age_days: float, *, is_silent: bool
) -> None:
    newest = judgment(0, time=NOW - timedelta(days=age_days))
    oldest_time = newest.time - 10 * timedelta(days=interval_days)
    machine = MachineOverview("pump-1", recordings=11, last=newest, first=oldest_time)

    standing = Standing.of(machine, "", NOW)

    assert standing.is_silent is is_silent
    assert standing.needs_attention is is_silent


def test_a_card_of_an_alarm_whose_cause_is_gone_asks_to_acknowledge_it(tmp_path: Path) -> None:
    config = load_watch_config(write_large_plant(tmp_path / "plant", 4, 9))
    history = History.open("", config.folder)
    with history.machine("P-104") as machine:
        machine.clear_alarm(machine.alarms()[0].id, NOW)
    history.close()

    card = cards(plant_client(config.path).get("/").text)["P-104"]

    assert "What to do: Acknowledge the alarm: its cause is gone." in card
    assert "case drain" not in card


def test_columns_without_a_value_leave_the_table_of_recordings(client: TestClient) -> None:
    text = client.get("/machines/P-101").text

    headings = re.findall(r'<th scope="col"[^>]*>(.*?)</th>', text)
    assert headings == ["Time", "State", "Deviation", "Evidence", "Operating point"]
    # None of the newest recordings of a machine that still learns was compared.
    assert "Deviation</th>" not in client.get("/machines/P-118").text
