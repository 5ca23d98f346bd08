"""A report is one self-contained page, states bad results as well as good ones, and is complete."""

import csv
import json
import math
import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from stub_runs import ORIGIN, run, scored

from swashtwin.calibration import Calibration, FaultLaw, GaussNewton, Nuisances, calibrate
from swashtwin.diagnosis import Diagnosis
from swashtwin.foundation import InputError, MPa, mm, rpm
from swashtwin.learning import SPLITS
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.report import render_page, write_report
from swashtwin.report.calibration_part import directions_table, summarize_calibration
from swashtwin.report.writing import build_part
from swashtwin_bench import StudyResult, build_plan, rig_recordings, write_study_report
from swashtwin_bench.rigs.writing import RigSize
from swashtwin_bench.studies.runner import build_study


@pytest.fixture(scope="module")
def calibration(pump, at_15) -> Calibration:
    twin = Twin(pump, at_15, SwashPlateDefect(depth=mm(0.08), length=mm(30), width=mm(24)))
    recordings = [r for r, _ in rig_recordings(0, RigSize(1, 1, 1.5), labels=["swash_plate"])]
    method = GaussNewton(starts=1, max_iterations=8)
    return calibrate(
        twin, recordings, method=method, nuisances=Nuisances(), phases=False, explain_misfit=False
    )


@pytest.fixture(scope="module")
def study(calibration) -> StudyResult:
    skills = {"measured": 0.5, "nominal": 0.6, "calibrated": 0.9}
    at_10 = replace(
        calibration,
        twin=calibration.twin.at(OperatingCondition(speed=rpm(860), discharge_pressure=MPa(10))),
    )
    runs = [run(name, seed, skill) for name, skill in skills.items() for seed in (0, 1)]
    runs += [run(name, seed, 0.8, "extra_trees", ("L2",)) for name in skills for seed in (0, 1)]
    return build_study(build_plan("case1"), runs, calibrations=(calibration, at_10))


@pytest.fixture(scope="module")
def diagnosis() -> Diagnosis:
    return Diagnosis(
        recording_id='<b>pump</b> & "7" $x$ 振动',
        label="piston",
        probabilities={"normal": 0.1, "piston": 0.9},
        window_labels=("piston", "piston", "normal", "piston"),
        notes=("<script>alert(1)</script>",),
    )


@pytest.fixture(scope="module")
def folder(study, tmp_path_factory) -> Path:
    return write_study_report(study, folder=tmp_path_factory.mktemp("report")).parent


@pytest.fixture(scope="module")
def page(folder) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the figures of calibrations, which take most of the time of a page."""
    monkeypatch.setattr(
        "swashtwin.report.calibration_part.calibration_drawings", lambda *_arguments: []
    )


def plain(page: str) -> str:
    """Return the page without the buttons that explain terms."""
    return re.sub(r'<button class="term"[^>]*>(.*?)</button>', r"\1", page)


def columns(path: Path) -> dict[str, list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def numbers(path: Path, name: str) -> np.ndarray:
    return np.array([float(text) for text in columns(path)[name]])


def test_the_page_requests_no_other_file_and_no_network(page):
    assert not any(markup in page for markup in ("<script", "<link", "@import", "<img"))
    assert re.findall(r'href="(?!#|data:text/csv;)[^"]*"', page) == []

    page = re.sub(r'href="data:text/csv;charset=utf-8;base64,[A-Za-z0-9+/=]*"', "", page)
    references = re.findall(r'(?:src|href|data|action)="([^"]*)"', page)
    references += re.findall(r"url\(([^)]*)\)", page)
    assert references
    assert all(reference.startswith("#") for reference in references)


def test_every_reference_within_the_page_has_one_target(page):
    ids = Counter(re.findall(r'\bid="([^"]+)"', page))
    assert [name for name, count in ids.items() if count > 1] == []

    references = re.findall(r'href="#([^"]+)"', page) + re.findall(r"url\(#([^)]+)\)", page)
    assert [name for name in references if name not in ids] == []


def test_every_figure_is_on_the_page_and_in_the_folder_with_its_data(folder, page):
    names = json.loads((folder / "results.json").read_text())["figures"]

    assert len(names) == len(set(names)) == page.count("<figure>")
    # each is drawn for a screen and for a phone
    assert page.count("</svg>") == 2 * len(names)
    names_on_disk = {path.name for path in (folder / "figures").iterdir()}
    assert names_on_disk == {f"{name}.csv" for name in names} | {f"{name}.svg" for name in names}

    kinds = {name.rsplit("_", 1)[-1] for name in names}
    calibration_and_training = {
        "excitation",
        "waveforms",
        "spectra",
        "estimates",
        "search",
        "confusion",
        "tsne",
        "training",
    }
    assert kinds == calibration_and_training | {"rows", "summary"}


def test_the_data_of_a_figure_are_the_values_bit_for_bit(folder, study, calibration):
    def calibration_numbers(figure: str, column: str) -> np.ndarray:
        return numbers(folder / "figures" / f"study_calibration_1_{figure}.csv", column)

    spectra = calibration.fits[0].spectra
    for name in ("measured", "deviation", "nominal", "calibrated"):
        np.testing.assert_array_equal(
            calibration_numbers("spectra", name), getattr(spectra, name).ravel()
        )

    waveform = calibration_numbers("waveforms", f"{spectra.channels[1]}_calibrated")
    np.testing.assert_array_equal(waveform, calibration.fits[0].waveforms.calibrated[1])

    values = calibration_numbers("estimates", "value")
    np.testing.assert_array_equal(values, [estimate.value for estimate in calibration.estimates])

    history = calibration.history
    np.testing.assert_array_equal(calibration_numbers("search", "spectrum"), history.spectrum_loss)
    np.testing.assert_array_equal(calibration_numbers("search", "K_v"), history.values[:, 3])

    total = calibration_numbers("excitation", "total_m")
    sum_of_slippers = sum(
        calibration_numbers("excitation", f"slipper_{slipper}_m") for slipper in range(1, 8)
    )
    np.testing.assert_allclose(total, sum_of_slippers, atol=1e-15)

    bars = columns(folder / "figures" / "study_rows.csv")
    accuracies = [
        float(value)
        for metric, value in zip(bars["metric"], bars["value"], strict=True)
        if metric == "accuracy"
    ]
    assert sorted(accuracies) == sorted(row["accuracy"] for _, row in study.tests())


def test_the_same_results_give_the_same_figures_bit_for_bit(folder, study, tmp_path):

    write_study_report(replace(study, calibrations=study.calibrations[:1]), folder=tmp_path)
    for path in (tmp_path / "figures").iterdir():
        # a study of one calibration does not number it
        name = path.name.replace("study_calibration_", "study_calibration_1_")
        assert path.read_bytes() == (folder / "figures" / name).read_bytes(), path.name


def test_the_summary_of_a_calibration_names_each_operating_point_and_what_became_worse(calibration):
    fit = calibration.fits[0]
    at_10 = replace(fit, condition=OperatingCondition(speed=rpm(860), discharge_pressure=MPa(10)))
    summary = " ".join(summarize_calibration(replace(calibration, fits=(at_10, fit))))
    assert "(860 rev/min, 10 and 15 MPa, " in summary

    nominal = calibration.nominal_agreement
    worse = replace(nominal, rmse=2 * nominal.rmse)
    worse_fit = replace(fit, nominal_agreement=nominal, calibrated_agreement=worse)
    summary = " ".join(summarize_calibration(replace(calibration, fits=(worse_fit,))))
    assert "(RMSE) ROSE from" in summary
    assert "(SVE) stayed" in summary
    assert "neither number is a test" in summary


@pytest.mark.usefixtures("without_figures")
def test_a_calibration_that_identified_nothing_is_not_praised(calibration):
    (fit,) = calibration.fits
    nominal = replace(calibration.nominal_agreement, spectrum_value_error=1.42)
    calibrated = replace(nominal, spectrum_value_error=0.0111)
    fit = replace(fit, nominal_agreement=nominal, calibrated_agreement=calibrated)
    estimates = tuple(replace(member, verdict="weak") for member in calibration.estimates)
    unidentified = replace(calibration, estimates=estimates, fits=(fit,))

    part = build_part(unidentified, key="twin")
    assert part.verdict == "None of the 6 values identified"
    assert part.tone == "bad"
    assert part.actions[-1] == unidentified.doubt
    assert not any(action.startswith("Synthesize") for action in part.actions)
    assert "(SVE) fell from 142 % to 1.11 % of the measured amplitudes" in part.answer[0]

    identified = tuple(replace(member, verdict="identified") for member in calibration.estimates)
    part = build_part(replace(unidentified, estimates=identified), key="twin")
    assert part.verdict.startswith("6 of 6 values identified; spectrum error fell")
    assert part.tone == "good"


def test_a_fit_of_few_lines_is_no_evidence(calibration):
    (fit,) = calibration.fits
    spectra = fit.spectra
    four_lines = replace(
        spectra,
        channels=spectra.channels[:1],
        orders=spectra.orders[:4],
        frequency=spectra.frequency[:4],
        measured=spectra.measured[:1, :4],
        deviation=spectra.deviation[:1, :4],
        nominal=spectra.nominal[:1, :4],
        calibrated=spectra.calibrated[:1, :4],
        low=spectra.low[:1, :4],
        high=spectra.high[:1, :4],
    )
    few_lines = replace(calibration, fits=(replace(fit, spectra=four_lines),))
    remark = "6 unknowns were fitted to 4 lines, so a small error is no evidence for the twin."

    assert any(remark in text for text in summarize_calibration(few_lines))
    assert not any("no evidence" in text for text in summarize_calibration(calibration))


def test_each_combination_of_values_has_the_sign_of_its_greatest_weight(calibration):
    for _, *weights in directions_table(calibration).rows:
        assert max(map(float, weights), key=abs) > 0


@pytest.mark.usefixtures("without_figures")
def test_the_page_of_a_calibration_states_which_recordings_it_used(calibration):
    samples = np.random.default_rng(0).normal(size=(1, 64))
    recording = Recording(samples, 10.0, "a", attributes={"file": "a.h5"})
    page = render_page(calibration, recordings=[recording])
    assert "<dt>File</dt> <dd>a.h5</dd>" in page
    assert "they stand in for a machine" in page
    assert not build_part(replace(calibration, origin=""), key="twin").notice


def test_what_a_user_wrote_is_text_and_never_markup(diagnosis, calibration, tmp_path):
    channels = ("<i>cover</i>", *calibration.fits[0].spectra.channels[1:])
    spectra = replace(calibration.fits[0].spectra, channels=channels)
    hostile_calibration = replace(
        calibration, fits=(replace(calibration.fits[0], spectra=spectra),)
    )
    page_file = write_report(diagnosis, hostile_calibration, folder=tmp_path)
    page = page_file.read_text(encoding="utf-8")

    for markup in ("<b>pump", "<script>alert", "<i>cover"):
        assert markup not in page
    assert "&lt;b&gt;pump&lt;/b&gt; &amp; &#34;7&#34; $x$ 振动" in page
    assert "&lt;i&gt;cover&lt;/i&gt; [m/s²]" in page


def test_a_report_of_control_characters_is_well_formed(diagnosis, tmp_path):
    hostile = "a\x00\x1b]0;x\x07\x9b\u202e\ud800\uffff\nb"

    probabilities = {"normal": 0.1, hostile: 0.9}
    hostile_diagnosis = replace(
        diagnosis,
        recording_id=hostile,
        label=hostile,
        probabilities=probabilities,
        window_labels=(hostile, "normal"),
    )

    page = write_report(hostile_diagnosis, folder=tmp_path).read_text(encoding="utf-8")
    for figure in (tmp_path / "figures").glob("*.svg"):
        ElementTree.fromstring(figure.read_bytes())
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\ufffe\uffff]", page)
    assert r"a\x00\x1b]0;x\x07" in page


def test_a_diagnosis_alone_makes_a_report(diagnosis, tmp_path):
    page = write_report(diagnosis, folder=tmp_path / "deep" / "report").read_text(encoding="utf-8")
    assert "taken alone, 3 of 4 windows give this class (75 %)" in plain(page)
    assert "Of 2 classes this one has a score of 90 %" in plain(page)
    assert "What was not checked" in page
    assert "Suspected fault: piston" in page

    results = json.loads((tmp_path / "deep" / "report" / "results.json").read_text())
    assert results["diagnoses"] == json.loads(json.dumps([diagnosis.to_dict()]))


def test_an_undefined_number_is_a_dash_with_its_reason(tmp_path):
    scores = scored(0.7, labels=("normal", "piston"), split=None)
    page = write_report(scores, folder=tmp_path).read_text(encoding="utf-8")
    reason = "no test window of swash plate, cylinder block, valve plate"
    assert f'<td title="{reason}">—</td>' in page
    assert f"<li>G-mean (of all declared classes): {reason}</li>" in plain(page)
    assert re.search(rf'<td title="{reason}">0\.\d+ \*</td>', page)

    text = re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL).lower()
    assert "nan" not in text.replace("nano", "")
    assert json.loads((tmp_path / "results.json").read_text())["scores"][0]["g_mean"] is None


def test_a_missing_scarce_cell_is_reported_with_its_reason(study, tmp_path):
    runs = []
    for study_run in study.runs[:4]:
        rows = [{**row, "scarce_recall": math.nan} for row in study_run["rows"]]
        runs.append({**study_run, "rows": rows})
    study_without_scarce_cell = build_study(build_plan("case1"), runs)
    page_file = write_study_report(study_without_scarce_cell, folder=tmp_path)
    page = page_file.read_text(encoding="utf-8")
    assert '<td title="no test window in the scarce cell" data-name="recall in the scarce' in page
    assert "L4, recall in the scarce cell: no test window in the scarce cell" in page


def test_results_are_standard_json_without_nan_or_infinity(folder):
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    results = json.loads((folder / "results.json").read_text(), parse_constant=refuse)
    assert results["studies"][0]["settings"]["models"]["spectral_bitcn"] == {"limit": None}
    assert len(results["calibrations"]) == 2


def test_the_page_of_a_study_states_the_origin_of_its_recordings_and_explains_its_splits(page):
    assert page.index('class="notice"') < page.index(ORIGIN) < page.index("<h2>")
    for split in ("L2", "L4"):
        assert re.search(rf'<th scope="row">{split}</th>\s*<td>{SPLITS[split]}</td>', page)
    assert SPLITS["L0"] not in page
    assert page.count("was calibrated at 10 MPa and simulated at 15 MPa") == 1


def test_the_papers_figures_are_compared_with_the_networks_l2_rows_only(page):
    rows = re.findall(r'<th scope="row">(L\d, [^<]*)</th>(.*?)</tr>', page, flags=re.DOTALL)
    compared_rows = {
        name for name, cells in rows if "accuracy 0.812" in cells or "G-mean 0.9748" in cells
    }
    assert compared_rows == {
        "L2, BiTCN on spectra (ours), measured windows only",
        "L2, BiTCN on spectra (ours), with calibrated twin",
    }

    compared_cells = [cells for name, cells in rows if name in compared_rows]
    assert all("the paper&#39;s BiTCN: accuracy" in cells for cells in compared_cells)
    assert "G-means have another definition" in page


def test_items_of_one_kind_do_not_overwrite_each_other(diagnosis, tmp_path):
    normal = replace(diagnosis, label="normal", probabilities={"normal": 0.8, "piston": 0.2})
    write_report(diagnosis, normal, folder=tmp_path)

    assert numbers(tmp_path / "figures" / "diagnosis_1_scores.csv", "score").tolist() == [0.1, 0.9]
    assert numbers(tmp_path / "figures" / "diagnosis_2_scores.csv", "score").tolist() == [0.8, 0.2]


def test_an_unknown_recording_has_no_shares_of_trained_classes(diagnosis, tmp_path):
    unknown = replace(
        diagnosis,
        unknown=True,
        error_rate=0.1,
        p_value=0.01,
        score=9.0,
        threshold=2.0,
        probabilities={"normal": 0.01, "piston": 0.99},
        basis="cross-validation",
        n_basis=100,
    )
    page = write_report(unknown, folder=tmp_path).read_text(encoding="utf-8")
    assert "Unknown: differs from every trained class" in page
    assert "more than 90 % of the training recordings do (n = 100)" in plain(page)
    assert "99 %" not in page
    assert not list(tmp_path.glob("figures/*_scores.*"))


def test_a_full_disk_leaves_the_old_report_and_no_temporary_files(
    diagnosis, study, tmp_path, monkeypatch
):
    write_report(diagnosis, folder=tmp_path)
    original_files = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    write = Path.write_text
    remaining_writes = iter(range(3))

    def write_until_full(path: Path, text: str, **options: str) -> int:
        if next(remaining_writes, None) is None:
            raise OSError(28, "No space left on device")
        return write(path, text, **options)

    monkeypatch.setattr(Path, "write_text", write_until_full)
    with pytest.raises(OSError, match="No space left"):
        write_report(replace(diagnosis, label="normal"), folder=tmp_path)

    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == original_files


def test_a_users_own_figure_settings_neither_leak_in_nor_out(diagnosis, tmp_path):
    default_page = write_report(diagnosis, folder=tmp_path / "plain").read_bytes()

    with mpl.rc_context({"font.size": 31.0, "axes.grid": False, "svg.fonttype": "path"}):
        assert write_report(diagnosis, folder=tmp_path / "loud").read_bytes() == default_page
        assert mpl.rcParams["font.size"] == 31.0
        assert mpl.rcParams["svg.fonttype"] == "path"


def test_an_object_without_a_report_or_a_file_instead_of_a_folder_is_refused(diagnosis, tmp_path):

    with pytest.raises(InputError, match=r"No report can be made of a str: give"):
        build_part("report", key="report")
    with pytest.raises(InputError, match=r"No report can be made of a FaultLaw: give"):
        build_part(FaultLaw(SwashPlateDefect(depth=1e-4), (), {}, 1.0, ()), key="law")
    with pytest.raises(InputError, match="at least one"):
        write_report(folder=tmp_path)

    (tmp_path / "taken").write_text("mine")
    with pytest.raises(InputError, match="is a file; name a folder"):
        write_report(diagnosis, folder=tmp_path / "taken")
    assert (tmp_path / "taken").read_text() == "mine"
