"""The comparison of two groups of recordings: what differs most, and with which sign."""

from pathlib import Path

import numpy as np
import pytest
from explored import HEALTHY, WORN, open_explorer, read_workspace
from starlette.testclient import TestClient

from swashtwin.recordings import Recording, write_recording

HEALTHY_PAIR = [HEALTHY, HEALTHY.replace("_1.h5", "_2.h5")]
WORN_PAIR = [WORN, WORN.replace("_1.h5", "_2.h5")]


def test_the_features_that_differ_most_between_two_classes_come_first(client: TestClient) -> None:
    classes = {"first": HEALTHY_PAIR, "second": WORN_PAIR}

    rows = client.get("/api/comparison", params=classes).json()["rows"]

    spreads = [abs(row["spreads"]) for row in rows]
    assert spreads == sorted(spreads, reverse=True)
    # a difference of three standard deviations is no chance
    assert spreads[0] > 3


def test_the_order_of_the_classes_decides_the_sign_of_a_change(client: TestClient) -> None:
    classes = {"first": HEALTHY_PAIR, "second": WORN_PAIR}
    swapped_classes = {"first": WORN_PAIR, "second": HEALTHY_PAIR}

    change = client.get("/api/comparison", params=classes).json()["rows"][0]["change"]
    swapped = client.get("/api/comparison", params=swapped_classes).json()["rows"][0]["change"]

    assert swapped == pytest.approx(-change)


def test_a_class_without_recordings_cannot_be_compared(client: TestClient) -> None:
    classes = {"first": HEALTHY_PAIR, "second": []}
    assert client.get("/api/comparison", params=classes).status_code == 422


@pytest.fixture
def raised_line(tmp_path: Path) -> TestClient:
    """An explorer of two recordings: of a line in noise, and of the same line 15 dB higher."""
    random = np.random.default_rng(0)
    # 175 Hz is order 7 at 1500 rpm; two seconds resolve it
    time = np.arange(51_200) / 25_600
    line = 0.1 * np.sin(2 * np.pi * 175 * time)
    for name, label, decibels in (("sound", "gut", 0), ("worn", "defekt", 15)):
        signal = random.normal(0, 0.3, time.size) + 10 ** (decibels / 20) * line
        recording = Recording(signal[None], 25_600.0, name, label=label)
        write_recording(recording, tmp_path / f"{name}.h5")
    return open_explorer(read_workspace(tmp_path))


@pytest.mark.parametrize(
    ("first", "second", "change"), [("sound", "worn", 15), ("worn", "sound", -15)]
)
def test_a_line_that_is_higher_in_the_second_group_has_a_positive_change(
    raised_line: TestClient, first: str, second: str, change: int
) -> None:
    groups = {"first": f"{first}.h5", "second": f"{second}.h5"}

    row = raised_line.get("/api/comparison", params=groups).json()["rows"][0]

    low, high = row["edges"]
    assert low < 175 < high
    # the noise in the band adds to the lower line
    assert row["change"] == pytest.approx(change, abs=1)


def test_the_table_states_which_class_is_healthy_in_any_language(raised_line: TestClient) -> None:
    rows = raised_line.get("/api/rows").json()["rows"]
    assert {row["name"]: row["healthy"] for row in rows} == {"sound.h5": True, "worn.h5": False}
