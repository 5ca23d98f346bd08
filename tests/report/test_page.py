"""A page opens with its subject and its answer, on a screen, a phone, paper and a screen reader."""

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
from swashtwin.pump import CLASSES, FAULT_KINDS, Fault, OperatingCondition, Pump, is_healthy
from swashtwin.recordings import Recording, RecordingSummary, summarize_recordings
from swashtwin.report import render_drawing, render_page, write_report
from swashtwin.report.drawing import build_cutaways, render_cutaway
from swashtwin.report.wording import Glossary, list_facts

CHROMIUM = "/usr/bin/chromium"
VIRTUAL_RIG = "swashtwin virtual rig, version 1"


def spectrum(excess: float = 3.0) -> HealthySpectrum:
    """Two channels of three bands; one band exceeds the highest healthy one by `excess` dB."""
    # five recordings from -1 to 1 dB in each band
    healthy = np.zeros((5, 2, 3)) + np.linspace(-1, 1, 5)[:, None, None]
    recording = np.zeros((2, 3))
    recording[0, 1] = 1 + excess
    lower_edges = np.array([10.0, 20.0, 40.0])

    return HealthySpectrum(
        channels=("x", "y"),
        unit="m/s^2",
        low=lower_edges,
        high=2 * lower_edges,
        level=recording,
        healthy=healthy,
        basis="the 5 healthy recordings",
    )


def diagnosis(name: str = "a", label: str = "piston", **changes: object) -> Diagnosis:
    facts = RecordingSummary(
        machine="pump 3",
        date="2026-03-01",
        condition="860 rev/min, 15 MPa",
        file="line/a.h5",
        origin="",
        shaft=14.3,
        pistons=7,
    )
    piston_worn = Diagnosis(
        name,
        label=label,
        probabilities={"normal": 0.1, "piston": 0.9},
        window_labels=("piston",) * 4,
        facts=facts,
        spectrum=spectrum(),
    )
    return replace(piston_worn, **changes)  # type: ignore[arg-type]


def test_a_page_states_machine_date_condition_file_and_model_below_its_title() -> None:
    page = render_page(diagnosis(), about={"Model": "model.safetensors"})

    facts = dict(re.findall(r"<dt>(.*?)</dt> <dd>(.*?)</dd>", page))
    assert list(facts.items()) == [
        ("Machine", "pump 3"),
        ("Recorded", "2026-03-01"),
        ("Condition", "860 rev/min, 15 MPa (150 bar absolute)"),
        ("File", "line/a.h5"),
        ("Model", "model.safetensors"),
    ]
    # a browser's tab and its bookmark state them too
    title = " · ".join(("Diagnosis of a", *facts.values()))
    assert f"<title>{title}" in page


def test_the_answer_comes_first_then_its_certainty_and_what_to_do() -> None:
    page = render_page(diagnosis())

    parts = ("Suspected fault: piston", "How sure", "What to do", "<figure>", "part-1")
    positions = [page.index(part) for part in parts]
    assert positions == sorted(positions)


def test_a_page_states_which_bands_exceed_the_healthy_range() -> None:
    page = render_page(diagnosis())

    # one of six
    assert "17 % of the bands lie outside the range of the 5 healthy recordings." in page
    assert "20 to 40 Hz, channel x" in page


def test_a_page_warns_of_a_healthy_range_of_few_recordings() -> None:
    few = replace(spectrum(), healthy=spectrum().healthy[:2])

    assert "2 healthy recordings span a narrow range" in render_page(diagnosis(spectrum=few))
    assert "narrow range" not in render_page(diagnosis())


def test_a_suspected_fault_is_marked_in_a_drawing() -> None:
    assert "Where to look" in render_page(diagnosis())


def test_a_suspected_fault_turns_in_a_pump_that_is_stated_not_to_be_the_machine() -> None:
    page = render_page(diagnosis())

    assert page.count('class="living-pump"') == 1
    assert "Oil leaks past piston 1" in page
    assert "Not this machine, but a pump like 25scy14-1b with 7 pistons" in page
    assert "class LivingPump" in page


def test_a_pump_that_turns_replaces_the_drawing_unless_scripts_are_off() -> None:
    page = render_page(diagnosis())
    drawing = 'viewBox="-40 0 476 262"'

    assert page.count(drawing) == 1
    assert page.index("<noscript>") < page.index(drawing) < page.index("</noscript>")
    # of many recordings no pump turns
    assert render_page(*(diagnosis(name) for name in "abc")).count(f"<figure><svg {drawing}") == 3


@pytest.mark.parametrize(
    ("verdict", "urgency"),
    [
        pytest.param(diagnosis(label="normal"), "Nothing is urgent.", id="healthy"),
        pytest.param(diagnosis(), "Check soon: the severity was not estimated.", id="fault"),
        pytest.param(
            diagnosis(label="loose_slipper", probabilities={"loose_slipper": 1.0}),
            "Urgent: stop the pump and look",
            id="slipper",
        ),
        pytest.param(
            diagnosis(label=None, no_verdict="channel x is dead.", probabilities={}),
            "How urgent: not known",
            id="no verdict",
        ),
    ],
)
def test_a_page_states_how_urgent_it_is(verdict: Diagnosis, urgency: str) -> None:
    assert f'<p class="urgency">{urgency}' in render_page(verdict)


def test_a_page_states_that_the_machine_is_not_specified() -> None:
    page = render_page(diagnosis(facts=replace(diagnosis().facts, machine="")))

    assert "<dt>Machine</dt> <dd>not specified</dd>" in page
    assert "not specified" not in page[: page.index("</title>")]


@pytest.mark.parametrize(
    "verdicts",
    [
        pytest.param([diagnosis(label="normal")], id="healthy"),
        pytest.param(
            [diagnosis(label="coupling", probabilities={"coupling": 1.0})],
            id="no fault of the pump",
        ),
        pytest.param([diagnosis(name) for name in "abc"], id="many recordings"),
    ],
)
def test_no_pump_turns_without_one_suspected_fault(verdicts: list[Diagnosis]) -> None:
    assert "living-pump" not in render_page(*verdicts)


def test_a_healthy_recording_has_no_part_marked() -> None:
    page = render_page(diagnosis(label="normal"))

    assert "No fault found" in page
    assert "Where to look" not in page


def test_a_page_states_why_there_is_no_verdict() -> None:
    without_verdict = diagnosis(
        label=None, no_verdict="channel x is dead.", probabilities={}, spectrum=None
    )

    page = render_page(without_verdict)

    assert "No verdict" in page
    assert "Channel x is dead." in page


def test_a_diagnosis_of_the_virtual_rig_is_marked_as_no_real_pump() -> None:
    virtual_facts = replace(diagnosis().facts, origin=VIRTUAL_RIG)

    assert "Not a real pump" in render_page(diagnosis(facts=virtual_facts))
    assert "Not a real pump" not in render_page(diagnosis())


@pytest.mark.parametrize(
    ("origin", "is_marked"),
    [
        pytest.param(VIRTUAL_RIG, True, id="virtual rig"),
        pytest.param("bench 3", False, id="test bench"),
    ],
)
def test_scores_on_the_virtual_rig_are_marked_as_no_real_pump(origin: str, is_marked: bool) -> None:
    samples = np.random.default_rng(0).normal(size=(1, 64))
    recording = Recording(samples, 10.0, "a", attributes={"origin": origin})

    page = render_page(scored(0.7), recordings=[recording])

    assert ("Not a real pump" in page) == is_marked


def test_many_recordings_are_a_table_and_each_is_folded_away() -> None:
    page = render_page(*(diagnosis(name) for name in "abcd"))

    assert page.count('<th scope="row">') >= 4
    assert page.count("<details><summary>") == 4
    # the cards of single recordings come after the table
    assert 'class="card' not in page[: page.index("<details>")]
    assert "<summary>b: Suspected fault: piston</summary>" in page


def test_every_figure_has_a_text_for_screen_readers(tmp_path: Path) -> None:
    page = write_report(diagnosis(), folder=tmp_path).read_text(encoding="utf-8")

    labels = re.findall(r'<div class="drawing" role="img" aria-label="([^"]+)">', page)
    assert len(labels) == 2
    assert labels[0].startswith("Spectrum over the healthy recordings. 17 % of the bands")


def test_the_data_of_a_figure_can_be_downloaded_from_the_page(tmp_path: Path) -> None:
    page = write_report(diagnosis(), folder=tmp_path).read_text(encoding="utf-8")

    link = r'<a download="(\w+)\.csv" href="data:text/csv;charset=utf-8;base64,([^"]+)">'
    for name, data in re.findall(link, page):
        file = tmp_path / "figures" / f"{name}.csv"
        assert base64.b64decode(data) == file.read_bytes()


def test_a_page_has_a_dark_scheme_and_a_style_for_paper() -> None:
    page = render_page(diagnosis())

    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page


def test_colors_of_a_figure_follow_the_page_and_stay_in_its_file() -> None:
    figure, axes = create_panels(1, 1, 2.0)
    # the palette's blue
    axes[0, 0].plot([0, 1], [0, 1], color="#0072b2")

    drawing = render_drawing("f", figure, {"x": [0.0]}, title="", caption="")

    assert "stroke: var(--blue)" in drawing.within_page
    assert "#0072b2" not in drawing.within_page
    # a program that shows the file alone knows no variables of the page
    assert "var(--blue)" not in drawing.svg


def test_a_term_is_explained_only_at_its_first_occurrence() -> None:
    glossary = Glossary()

    first = glossary.mark("6 dB above the baseline")
    second = glossary.mark("3 dB")

    # dB and baseline
    assert first.count("<button") == 2
    assert second == "3 dB"
    assert list(glossary.used) == ["dB", "baseline"]


def test_markup_in_an_explained_text_is_escaped() -> None:
    assert "&lt;b&gt;above" in Glossary().mark("6 dB <b>above</b> the baseline")


def test_punctuation_stays_on_the_line_of_its_term() -> None:
    unbroken = r'<span class="option">\(<button class="term"[^>]*>RMS</button>\),</span> of'
    assert re.search(unbroken, Glossary().mark("level (RMS), of windows"))


def test_an_option_is_not_broken_over_two_lines() -> None:
    marked = Glossary().mark("train --group specimen")
    assert '<span class="option">--group</span> specimen' in marked


def test_the_metrics_of_a_table_are_explained() -> None:
    row = r'<th scope="row"><button class="term"[^>]*>macro recall</button>'
    assert re.search(row, render_page(scored(0.7)))


def share_between_piston_lines(
    pump: Pump, condition: OperatingCondition, fault: Fault | None
) -> float:
    """Return the lines that are no multiple of the pistons, relative to the largest line."""
    turns = 10
    samples_per_turn = 1024
    sample_rate = condition.shaft_frequency * samples_per_turn
    recording = Twin(pump, condition, fault).simulate(
        turns * condition.period, sample_rate=sample_rate
    )

    # whole turns, so that each order is one line of the spectrum
    signal = recording.signal[:, : turns * samples_per_turn]
    orders = np.arange(1, 36)
    lines = np.abs(np.fft.rfft(signal, axis=1))[:, turns * orders].max(axis=0)
    is_between = orders % pump.rotating_group.piston_count != 0
    return math.hypot(*lines[is_between]) / lines.max()


@pytest.mark.parametrize("name", [name for name in CLASSES if not is_healthy(name)])
def test_the_orders_beside_the_drawing_are_those_of_the_twin(
    name: str, pump: Pump, at_15: OperatingCondition
) -> None:
    (cutaway,) = build_cutaways(name, pump.rotating_group.piston_count)

    # equal pistons excite only multiples of their number
    assert share_between_piston_lines(pump, at_15, None) < 1e-3
    if share_between_piston_lines(pump, at_15, FAULT_KINDS[name]) > 0.01:
        assert cutaway.family == "shaft"
    else:
        assert cutaway.family == "pistons"


def read_strip(label: str, piston_count: int | None) -> tuple[list[str], list[int]]:
    """Return the names and the excited orders of the strip below a drawing."""
    html = render_cutaway(label, piston_count, 14.3)
    names = re.findall(r">(\w+×)<", html)
    bars = re.findall(r'class="(excited|calm)"', html)
    excited_orders = [order for order, kind in enumerate(bars, 1) if kind == "excited"]
    return names, excited_orders


def test_a_fault_of_one_piston_excites_the_orders_between_those_of_the_pistons() -> None:
    names, excited_orders = read_strip("piston", 9)

    assert names == ["1×", "9×", "18×", "27×"]
    assert {9, 18, 27}.isdisjoint(excited_orders)


def test_an_unknown_number_of_pistons_is_written_as_z() -> None:
    names, excited_orders = read_strip("valve_plate", None)

    assert names == ["1×", "z×", "2z×", "3z×"]
    # drawn as if there were seven
    assert excited_orders == [7, 14, 21]


@pytest.mark.parametrize("label", ["normal", "bearing"])
def test_a_class_without_a_known_part_has_no_drawing(label: str) -> None:
    assert build_cutaways(label) == ()


def numbered_recording(number: int) -> Recording:
    """A recording whose machine, date, file and pressure follow from its number."""
    samples = np.random.default_rng(0).normal(size=(1, 64))
    attributes = {
        "date": f"2026-01-0{number}",
        "file": f"{number}.h5",
        "speed": "900 rpm",
        "discharge_pressure": f"{5 * number} MPa",
        "pistons": "9",
    }
    return Recording(samples, 10.0, f"r{number}", specimen=f"P{number}", attributes=attributes)


def test_facts_of_many_recordings_are_counted_and_their_range_is_stated() -> None:
    facts = summarize_recordings([numbered_recording(number) for number in (1, 2, 3, 4)])

    assert facts.machine == "4 machines"
    assert facts.file == "4 files"
    assert facts.date == "2026-01-01 to 2026-01-04"
    assert facts.condition == "900 rev/min, 5 to 20 MPa"
    assert facts.shaft == pytest.approx(15)
    assert facts.pistons == 9


def test_facts_of_two_recordings_are_listed() -> None:
    facts = summarize_recordings([numbered_recording(number) for number in (1, 2)])
    assert facts.condition == "900 rev/min, 5 / 10 MPa"


def test_no_recordings_have_no_facts() -> None:
    assert summarize_recordings([]) == RecordingSummary()


def test_facts_of_several_machines_and_files_have_headings_in_the_plural() -> None:
    facts = list_facts(RecordingSummary(machine="A, B", file="60 files"))
    assert facts == (("Machines", "A, B"), ("Files", "60"))


@pytest.mark.skipif(not shutil.which(CHROMIUM), reason=f"no {CHROMIUM}")
def test_a_diagnosis_prints_on_at_most_four_pages(tmp_path: Path) -> None:
    page = write_report(diagnosis(), folder=tmp_path)
    paper = tmp_path / "page.pdf"
    options = ("--headless", "--no-sandbox", "--disable-gpu")
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    command = [CHROMIUM, *options, profile, f"--print-to-pdf={paper}", page.as_uri()]

    subprocess.run(command, check=True, capture_output=True, timeout=120)

    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", paper.read_bytes())) <= 4


PISTON_ALARMS = ClassAlarms(
    label="piston",
    is_healthy=False,
    n_recordings=12,
    n_no_verdict=0,
    n_alarms=9,
    n_correct=None,
    alarm_rate=0.75,
    interval=(0.5, 0.9),
    auroc=None,
)


def test_alarm_scores_state_the_false_alarms_of_healthy_recordings() -> None:
    healthy_alarms = replace(PISTON_ALARMS, label="normal", is_healthy=True, n_alarms=1)

    page = render_page(AlarmScores(0.05, (healthy_alarms, PISTON_ALARMS)))

    assert "Of 12 healthy recordings, 1 raised a false alarm." in page


def test_alarm_scores_without_healthy_recordings_state_that_none_was_tested() -> None:
    page = render_page(AlarmScores(0.05, (PISTON_ALARMS,)))

    assert "9 of 12 faulty recordings raised an alarm" in page
    assert "No healthy recording was tested" in page


@pytest.mark.nightly
@pytest.mark.skipif(not Path(CHROMIUM).exists(), reason=f"there is no {CHROMIUM}")
@pytest.mark.parametrize(
    "look",
    [
        pytest.param({"viewport": {"width": 390, "height": 800}}, id="phone"),
        pytest.param({"color_scheme": "dark"}, id="dark"),
        pytest.param({}, id="light"),
    ],
)
def test_a_page_fits_its_screen_and_axe_reports_no_defect(
    tmp_path: Path, look: dict[str, object]
) -> None:
    api = pytest.importorskip("playwright.sync_api")
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page = tmp_path / "page.html"
    content = render_page(diagnosis(notes=("a note",) * 4), scored(0.7))
    page.write_text(content, encoding="utf-8")

    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        tab = browser.new_page(**look)
        errors: list[str] = []
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(page.as_uri())
        tab.wait_for_function("document.querySelector('.living-pump').pump.frames > 0")
        width = tab.viewport_size["width"]
        assert tab.evaluate("document.documentElement.scrollWidth") == width
        # figures and tables fit, too
        assert (
            tab.evaluate(
                "Math.max(...Array.from(document.querySelectorAll('svg, td'), "
                "(part) => part.getBoundingClientRect().right))"
            )
            <= width
        )
        assert axe.run(tab).response["violations"] == []
        assert errors == []
        browser.close()
