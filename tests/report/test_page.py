"""A page opens with what it is about and what came out, on a screen, a phone and paper, and for a
screen reader.
"""

import base64
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from stub_runs import scored

from swashtwin.diagnosis import AlarmScores, Diagnosis, HealthySpectrum
from swashtwin.diagnosis.alarm_scores import ClassAlarms
from swashtwin.physics import Twin
from swashtwin.plot import create_panels
from swashtwin.pump import CLASSES, FAULT_KINDS, is_healthy
from swashtwin.recordings import Recording, RecordingSummary, summarize_recordings
from swashtwin.report import render_drawing, render_page, write_report
from swashtwin.report.drawing import build_cutaways, render_cutaway
from swashtwin.report.wording import Glossary, list_facts

CHROMIUM = "/usr/bin/chromium"
RIG = "swashtwin virtual rig, version 1"


def spectrum(level: float = 3.0) -> HealthySpectrum:
    """Two channels of three bands; the second band of the first is `level` above the range."""
    healthy = np.zeros((5, 2, 3)) + np.linspace(-1, 1, 5)[:, None, None]
    recording = np.zeros((2, 3))
    recording[0, 1] = 1 + level
    low = np.array([10.0, 20.0, 40.0])
    return HealthySpectrum(
        ("x", "y"), "m/s^2", low, 2 * low, recording, healthy, "the 5 healthy recordings"
    )


def diagnosis(name: str = "a", label: str = "piston", **changes: object) -> Diagnosis:
    facts = RecordingSummary(
        "pump 3", "2026-03-01", "860 rev/min, 15 MPa", "line/a.h5", "", 14.3, 7
    )
    probabilities = {"normal": 0.1, "piston": 0.9}
    verdict = Diagnosis(
        name,
        label=label,
        probabilities=probabilities,
        window_labels=("piston",) * 4,
        facts=facts,
        spectrum=spectrum(),
    )
    return replace(verdict, **changes)  # type: ignore[arg-type]


def test_a_page_states_machine_date_condition_model_and_file_below_its_title() -> None:
    page = render_page(diagnosis(), about={"Model": "model.safetensors"})
    names, values = zip(*re.findall(r"<dt>(.*?)</dt> <dd>(.*?)</dd>", page), strict=True)
    assert names == ("Machine", "Recorded", "Condition", "File", "Model")
    point = "860 rev/min, 15 MPa (150 bar absolute)"
    assert values == ("pump 3", "2026-03-01", point, "line/a.h5", "model.safetensors")
    assert f"<title>{' · '.join(('Diagnosis of a', *values))}" in page


def test_the_answer_stands_before_every_section_with_how_sure_and_what_to_do() -> None:
    page = render_page(diagnosis())
    order = [
        page.index(text)
        for text in ("Suspected fault: piston", "How sure", "What to do", "<figure>", "part-1")
    ]
    assert order == sorted(order)
    assert "17 % of the bands lie outside the range of the 5 healthy recordings." in page
    assert "20 to 40 Hz, channel x" in page
    assert "narrow range" not in page
    few = replace(spectrum(), healthy=spectrum().healthy[:2])
    assert "2 healthy recordings span a narrow range" in render_page(diagnosis(spectrum=few))


def test_a_healthy_or_uncertain_recording_has_no_part_marked() -> None:
    assert "Where to look" in render_page(diagnosis())
    healthy = render_page(diagnosis(label="normal"))
    assert "No fault found" in healthy
    assert "Where to look" not in healthy
    silent = render_page(
        diagnosis(label=None, no_verdict="channel x is dead.", probabilities={}, spectrum=None)
    )
    assert ("No verdict" in silent, "Channel x is dead." in silent) == (True, True)


def test_only_recordings_of_the_virtual_rig_are_called_no_real_pump() -> None:
    assert "Not a real pump" not in render_page(diagnosis())
    facts = replace(diagnosis().facts, origin=RIG)
    assert "Not a real pump" in render_page(diagnosis(facts=facts))
    samples = np.random.default_rng(0).normal(size=(1, 64))
    rig = Recording(samples, 10.0, "a", attributes={"origin": RIG})
    assert "Not a real pump" not in render_page(
        scored(0.7), recordings=[rig.replace(attributes={"origin": "bench 3"})]
    )
    assert "Not a real pump" in render_page(scored(0.7), recordings=[rig])


def test_many_recordings_are_a_table_and_each_is_folded_away() -> None:
    page = render_page(*(diagnosis(name) for name in "abcd"))
    assert page.count('<th scope="row">') >= 4
    assert page.count("<details><summary>") == 4
    assert 'class="card' not in page[: page.index("<details>")]
    assert "<summary>b: Suspected fault: piston</summary>" in page


def test_every_figure_has_words_for_screen_readers_and_its_data(tmp_path: Path) -> None:
    page = write_report(diagnosis(), folder=tmp_path).read_text(encoding="utf-8")
    figures = re.findall(r'<div class="drawing" role="img" aria-label="([^"]+)">', page)
    assert len(figures) == 2
    assert figures[0].startswith("Spectrum over the healthy recordings. 17 % of the bands")
    for name, link in re.findall(
        r'<a download="(\w+)\.csv" href="data:text/csv;charset=utf-8;base64,([^"]+)">', page
    ):
        assert base64.b64decode(link) == (tmp_path / "figures" / f"{name}.csv").read_bytes()
    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page


def test_colors_of_a_figure_follow_the_page_and_stay_in_its_file() -> None:
    figure, axes = create_panels(1, 1, 2.0)
    axes[0, 0].plot([0, 1], [0, 1], color="#0072b2")
    drawing = render_drawing("f", figure, {"x": [0.0]}, title="", caption="")
    assert "var(--blue)" not in drawing.svg
    assert "stroke: var(--blue)" in drawing.within_page
    assert "#0072b2" not in drawing.within_page


def test_a_word_is_explained_where_it_stands_first_and_only_there() -> None:
    glossary = Glossary()
    first, second = glossary.mark("6 dB <b>above</b> the baseline"), glossary.mark("3 dB")
    assert first.count("<button") == 2
    assert "&lt;b&gt;above" in first
    assert second == "3 dB"
    assert list(glossary.used) == ["dB", "baseline"]
    kept = r'<span class="option">\(<button class="term"[^>]*>RMS</button>\),</span> of'
    assert re.search(kept, Glossary().mark("level (RMS), of windows"))
    assert '<span class="option">--group</span> specimen' in Glossary().mark(
        "train --group specimen"
    )
    assert re.search(
        r'<th scope="row"><button class="term"[^>]*>macro recall</button>', render_page(scored(0.7))
    )


@pytest.mark.parametrize("name", [name for name in CLASSES if not is_healthy(name)])
def test_the_orders_beside_the_drawing_are_those_of_the_twin(name: str, pump, at_15) -> None:
    (cutaway,) = build_cutaways(name, pump.rotating_group.piston_count)
    fault = FAULT_KINDS[name]
    turns, per_turn = 10, 1024
    rate = at_15.shaft_frequency * per_turn
    order = np.arange(1, 36)
    share = {}
    for label, twin in (("healthy", Twin(pump, at_15)), ("faulty", Twin(pump, at_15, fault))):
        signal = twin.simulate(turns * at_15.period, sample_rate=rate).signal[:, : turns * per_turn]
        lines = np.abs(np.fft.rfft(signal, axis=1))[:, turns * order].max(axis=0)
        share[label] = (
            math.hypot(*lines[order % pump.rotating_group.piston_count != 0]) / lines.max()
        )
    assert share["healthy"] < 1e-3
    assert cutaway.family == ("shaft" if share["faulty"] > 0.01 else "pistons")


def test_the_strip_of_orders_names_multiples_of_the_pistons_or_of_their_unknown_number() -> None:
    def strip(label: str, pistons: int | None) -> tuple[list[str], list[int]]:
        html = render_cutaway(label, pistons, 14.3)
        bars = re.findall(r'class="(excited|calm)"', html)
        return re.findall(r">(\w+×)<", html), [
            order for order, kind in enumerate(bars, 1) if kind == "excited"
        ]

    names, orders = strip("piston", 9)
    assert names == ["1×", "9×", "18×", "27×"]
    assert {9, 18, 27}.isdisjoint(orders)
    assert strip("valve_plate", None) == (["1×", "z×", "2z×", "3z×"], [7, 14, 21])
    assert build_cutaways("normal") == build_cutaways("bearing") == ()


def test_facts_of_several_recordings_are_listed_or_counted() -> None:
    samples = np.random.default_rng(0).normal(size=(1, 64))
    recordings = [
        Recording(samples, 10.0, f"r{i}", specimen=f"P{i}", attributes={"date": f"2026-01-0{i}", "file": f"{i}.h5",
                  "speed": "900 rpm", "discharge_pressure": f"{5 * i} MPa", "pistons": "9"})
        for i in range(1, 5)
    ]  # fmt: skip
    facts = summarize_recordings(recordings)
    assert (facts.machine, facts.file, facts.date) == (
        "4 machines",
        "4 files",
        "2026-01-01 to 2026-01-04",
    )
    assert facts.condition == "900 rev/min, 5 to 20 MPa"
    assert summarize_recordings(recordings[:2]).condition == "900 rev/min, 5 / 10 MPa"
    assert (facts.shaft, facts.pistons) == (pytest.approx(15), 9)
    assert summarize_recordings([]) == RecordingSummary()
    shown = list_facts(RecordingSummary(machine="A, B", file="60 files"))
    assert shown == (("Machines", "A, B"), ("Files", "60"))


@pytest.mark.skipif(not shutil.which(CHROMIUM), reason=f"no {CHROMIUM}")
def test_a_diagnosis_prints_on_at_most_four_pages(tmp_path: Path) -> None:
    page, paper = write_report(diagnosis(), folder=tmp_path), tmp_path / "page.pdf"
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={tmp_path / 'profile'}",
    ]
    command += [f"--print-to-pdf={paper}", page.as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", paper.read_bytes())) <= 4


def test_a_test_without_healthy_recordings_counts_every_class_as_faulty() -> None:
    faulty = ClassAlarms("piston", False, 12, 0, 9, None, 0.75, (0.5, 0.9), None)
    page = render_page(AlarmScores(0.05, (faulty,)))
    assert "9 of 12 faulty recordings raised an alarm" in page
    assert "No healthy recording was tested" in page
    healthy = replace(faulty, label="normal", is_healthy=True, n_alarms=1)
    assert "Of 12 healthy recordings, 1 raised a false alarm." in render_page(
        AlarmScores(0.05, (healthy, faulty))
    )


@pytest.mark.nightly
@pytest.mark.skipif(not Path(CHROMIUM).exists(), reason=f"there is no {CHROMIUM}")
def test_a_page_on_a_phone_does_not_scroll_sideways(tmp_path: Path) -> None:
    api = pytest.importorskip("playwright.sync_api")
    page = tmp_path / "page.html"
    page.write_text(render_page(diagnosis(notes=("a note",) * 4), scored(0.7)), encoding="utf-8")
    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        phone = browser.new_page(viewport={"width": 390, "height": 800})
        phone.goto(page.as_uri())
        assert phone.evaluate("document.documentElement.scrollWidth") == 390
        browser.close()
