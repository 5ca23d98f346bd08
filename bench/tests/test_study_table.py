"""A study in the form of a table tells each row's spread over its trials, in JSON and on a page."""

import csv
import json
import math
import re

import numpy as np
import pytest

from swashtwin.recordings import Recording
from swashtwin_bench import StudyTable, write_study_report
from swashtwin_bench.results.table import Trial, describe_origin, paired_interval, spread


@pytest.fixture
def study() -> StudyTable:
    trials = [
        Trial(
            {"twin": twin, "test": "held out"}, seed, {"rmse": base + 0.1 * seed, "sve": math.nan}
        )
        for twin, base in (("nominal", 0.7), ("calibrated", 0.4))
        for seed in (0, 1)
    ]
    return StudyTable(
        study="calibration",
        title="Nearer to the machine?",
        metrics={"rmse": "RMSE [m/s²]", "sve": "SVE"},
        trials=tuple(trials),
        answer=("The calibrated twin is nearer.",),
        settings={"band": [0, 2500]},
        origin="Recordings of a stand-in for a machine.",
        wall_s=1.234,
        version="0",
        command="swashtwin bench calibration",
        notes=("Nothing was held back.",),
    )


def test_a_row_holds_mean_deviation_and_values_of_its_trials(study):
    nominal, calibrated = study.rows()
    assert nominal["twin"] == "nominal"
    assert calibrated["test"] == "held out"
    assert nominal["rmse"]["mean"] == pytest.approx(0.75)
    assert nominal["rmse"]["std"] == pytest.approx(np.std([0.7, 0.8], ddof=1))
    assert calibrated["rmse"]["values"] == pytest.approx([0.4, 0.5])


def test_a_metric_without_a_number_is_none_in_json(study):
    table = json.loads(json.dumps(study.to_dict(), allow_nan=False))
    assert table["rows"][0]["sve"] == {"mean": None, "std": None, "values": [None, None]}
    assert table["seeds"] == [0, 1]
    assert table["wall_s"] == 1.23


def test_the_page_shows_the_answer_and_every_trial(study, tmp_path):
    page = write_study_report(study, folder=tmp_path).read_text(encoding="utf-8")
    assert "The calibrated twin is nearer." in re.sub(r"</?button[^>]*>", "", page)
    assert "stand-in for a machine" in page
    assert "0.750 ± 0.0707" in page
    assert "swashtwin bench calibration" in page
    rows = list(
        csv.DictReader(
            (tmp_path / "figures" / "study_rows.csv").read_text(encoding="utf-8").splitlines()
        )
    )
    assert len(rows) == 8
    assert {row["metric"] for row in rows} == {"rmse", "sve"}


def test_recordings_of_the_rig_are_called_a_stand_in():
    recording = Recording(
        np.zeros((1, 8)), 10.0, "one", attributes={"origin": "swashtwin virtual rig, version 1"}
    )
    assert "stand-in for a machine" in describe_origin([recording])
    assert (
        describe_origin([Recording(np.zeros((1, 8)), 10.0, "two")])
        == "Recordings from files of the user."
    )


def test_the_corrected_interval_is_wider_than_students():
    points = [0.02, 0.03, 0.01, 0.04]
    plain, corrected = paired_interval(points), paired_interval(points, test_share=0.5)
    assert corrected[0] < plain[0] < 0.025 < plain[1] < corrected[1]
    assert (corrected[1] - corrected[0]) / (plain[1] - plain[0]) == pytest.approx(
        math.sqrt(0.75 / 0.25)
    )
    assert math.isnan(paired_interval([0.1])[0])


def test_a_spread_of_one_value_has_no_deviation():
    assert spread([0.5]) == {"mean": 0.5, "std": None, "values": [0.5]}
    assert spread([float("nan")]) == {"mean": None, "std": None, "values": [None]}
    assert spread([0.25, 0.75])["std"] == pytest.approx(np.std([0.25, 0.75], ddof=1))
