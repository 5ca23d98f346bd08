"""A study in the form of a table has the spread of each row over its trials, in JSON and on a
page.
"""

import csv
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from swashtwin.recordings import Recording
from swashtwin_bench import StudyTable, write_study_report
from swashtwin_bench.results.table import Trial, describe_origin, paired_interval, spread


@pytest.fixture
def study() -> StudyTable:
    """A nominal and a calibrated twin under two seeds, of which SVE is not defined."""
    trials = []
    for twin, rmse in (("nominal", 0.7), ("calibrated", 0.4)):
        for seed in (0, 1):
            values = {"rmse": rmse + 0.1 * seed, "sve": math.nan}
            trials.append(Trial({"twin": twin, "test": "held out"}, seed, values))

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


def test_the_headline_gives_the_range_of_the_first_metric_that_differs(study):
    assert study.headline == "RMSE [m/s²]: 0.75 (nominal) to 0.45 (calibrated)"

    alike = [replace(trial, values={**trial.values, "n": 3.0}) for trial in study.trials]
    metrics = {"n": "recordings", **study.metrics}
    assert replace(study, metrics=metrics, trials=tuple(alike)).headline == study.headline


def test_a_study_without_values_has_no_headline(study):
    assert replace(study, metrics={"sve": "SVE"}).headline == ""


def test_the_page_begins_with_headline_and_chart(study, tmp_path):
    page = write_study_report(study, folder=tmp_path).read_text(encoding="utf-8")

    text = re.sub(r"<[^>]*>", "", page)
    positions = [text.index(part) for part in (study.headline, "Bars: mean", "In words")]
    assert positions == sorted(positions)
    assert (tmp_path / "figures" / "study_summary.csv").is_file()


def test_an_undefined_metric_is_null_in_json(study):
    # JSON has no NaN, and many readers refuse it
    table = json.loads(json.dumps(study.to_dict(), allow_nan=False))
    assert table["rows"][0]["sve"] == {"mean": None, "std": None, "values": [None, None]}
    assert table["seeds"] == [0, 1]
    assert table["wall_s"] == 1.23


def test_the_page_shows_the_answer_and_every_trial(study, tmp_path):
    page = write_study_report(study, folder=tmp_path).read_text(encoding="utf-8")
    # a term of the answer may be a button that explains it
    assert "The calibrated twin is nearer." in re.sub(r"</?button[^>]*>", "", page)
    assert "stand-in for a machine" in page
    assert "0.750 ± 0.0707" in page
    assert "swashtwin bench calibration" in page

    table = (tmp_path / "figures" / "study_rows.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(table.splitlines()))
    # four trials of two metrics
    assert len(rows) == 8
    assert {row["metric"] for row in rows} == {"rmse", "sve"}


def test_recordings_of_the_rig_are_called_a_stand_in():
    origin = {"origin": "swashtwin virtual rig, version 1"}
    of_rig = Recording(np.zeros((1, 8)), 10.0, "one", attributes=origin)
    assert "stand-in for a machine" in describe_origin([of_rig])

    of_user = Recording(np.zeros((1, 8)), 10.0, "two")
    assert describe_origin([of_user]) == "Recordings from files of the user."


def test_the_corrected_interval_is_wider_than_students():
    differences = [0.02, 0.03, 0.01, 0.04]
    low, high = paired_interval(differences)
    corrected_low, corrected_high = paired_interval(differences, test_share=0.5)
    assert corrected_low < low < 0.025 < high < corrected_high

    # the variance of the mean of four, 1/4, grows by the ratio of test to training recordings
    ratio = (corrected_high - corrected_low) / (high - low)
    assert ratio == pytest.approx(math.sqrt(0.75 / 0.25))


def test_a_single_difference_has_no_interval():
    assert math.isnan(paired_interval([0.1])[0])


def test_a_spread_of_one_value_has_no_deviation():
    assert spread([0.5]) == {"mean": 0.5, "std": None, "values": [0.5]}
    assert spread([float("nan")]) == {"mean": None, "std": None, "values": [None]}
    assert spread([0.25, 0.75])["std"] == pytest.approx(np.std([0.25, 0.75], ddof=1))
