"""Part of the page about a calibration."""

import math
from collections import Counter
from dataclasses import asdict
from types import MappingProxyType

from swashtwin.calibration import Calibration, Estimate
from swashtwin.foundation import plural
from swashtwin.plot import words
from swashtwin.recordings import RecordingFacts
from swashtwin.report.calibration_figures import calibration_drawings
from swashtwin.report.page import Bullets, Group, Part, Section, SectionOrder, Table
from swashtwin.report.wording import (
    also_in_bar,
    facts_table,
    flatten_settings,
    number,
    number_cell,
    parameter_words,
    percent,
    rig_notice,
    sentence,
)

FIGURES = MappingProxyType(
    {
        "rmse": "RMSE of the waveforms [m/s²]",
        "relative_rmse": "RMSE over the RMS of the measured waveform",
        "peak_error": "PE, peak error",
        "spectrum_value_error": "SVE, spectrum value error",
        "spectral_correlation": "correlation of the lines' levels in dB",
    }
)
"""How well a twin fits its recordings, by name: in words."""


def calibration_part(calibration: Calibration, key: str) -> Part:
    """Part of the page about one calibration."""
    counts = Counter(estimate.verdict for estimate in calibration.estimates)
    change = _change(calibration, "spectrum_value_error")
    has_improved = calibration.fit_after.spectrum_value_error < calibration.fit_before.spectrum_value_error
    more = Bullets("More to know", tuple(map(sentence, calibration.notes[_MOST_NOTES:])))
    return Part(
        title=f"Calibration of {calibration.twin.pump.name}",
        answer=calibration_answer(calibration)[:1],
        notice=rig_notice(RecordingFacts(origin=calibration.origin)),
        sections=(
            Section(SectionOrder.CALIBRATION, "Calibration", (more, *calibration_blocks(calibration, key)[1:])),
            Section(SectionOrder.PROVENANCE, "Where the calibration comes from", (_provenance(calibration),)),
        ),
        results={"calibrations": [calibration.to_dict()]},
        verdict=f"Spectrum error {change}; {counts['identified']} of 6 values identified",
        tone="bad" if not has_improved else "good" if counts["identified"] >= _ENOUGH else "unsure",
        certainty=(*calibration_answer(calibration)[:0:-1], *map(sentence, calibration.notes[:_MOST_NOTES])),
        actions=_actions(calibration, has_improved),
        facts=(
            ("Pump", calibration.twin.pump.name),
            ("Condition", also_in_bar(condition_words(calibration))),
            ("Method", calibration.method),
            ("Recordings", str(len(calibration.recording_ids))),
        ),
    )


_ENOUGH, _MOST_NOTES = 3, 3


def _actions(calibration: Calibration, has_improved: bool) -> tuple[str, ...]:
    """What to do with the result."""
    if not has_improved:
        return ("Do not use this twin: check speed, pressure, units and the pump's parameters first.",)
    weak = [estimate.letter for estimate in calibration.estimates if estimate.verdict != "identified"]
    caution = (f"Do not read {', '.join(weak)} as measured values of the pump.",) if weak else ()
    if len(weak) == len(calibration.estimates):
        return (*caution, "Do not synthesize with this twin before its misfit is explained: see the notes.")
    return (*caution, "Use the twin for recordings nobody has: swashtwin synthesize.")


def calibration_answer(calibration: Calibration) -> tuple[str, ...]:
    """What came out, in plain words."""
    spectrum, waveform = (_change(calibration, name) for name in ("spectrum_value_error", "rmse"))
    return (
        f"The twin of {calibration.twin.pump.name} ({condition_words(calibration)}, {words(calibration.twin.label)}) "
        f"was calibrated with {calibration.method} on {plural(len(calibration.recording_ids), 'recording')}. The error "
        f"of its spectrum (SVE) {spectrum}; that of its waveform (RMSE) {waveform} m/s².",
        "These are the recordings it was calibrated on, so neither number is a test.",
        f"Of the six values {verdict_counts(calibration)}.",
    )


def _change(calibration: Calibration, name: str) -> str:
    before, after = (getattr(fit, name) for fit in (calibration.fit_before, calibration.fit_after))
    verb = "fell" if after < before else "ROSE" if after > before else "stayed"
    return f"{verb} from {number(before)} to {number(after)}"


def verdict_counts(calibration: Calibration) -> str:
    """How many values have which verdict, such as ``"4 are identified, 2 are weak"``."""
    counts = Counter(estimate.verdict for estimate in calibration.estimates)
    named = [
        f"{count} {'is' if count == 1 else 'are'} {verdict.replace('at bound', 'at a bound')}"
        for verdict, count in counts.most_common()
    ]
    return ", ".join(named)


def condition_words(calibration: Calibration) -> str:
    """Speed and pressure of the twin, or of every operating point where several were fitted together."""
    several = len(calibration.fits) > 1
    points: dict[str, list[str]] = {}
    for condition in [fit.condition for fit in calibration.fits] if several else [calibration.twin.condition]:
        speed = f"{condition.speed * 30 / math.pi:.4g} rev/min"
        points.setdefault(speed, []).append(f"{condition.discharge_pressure / 1e6:.3g}")
    return "; ".join(f"{speed}, {' and '.join(pressures)} MPa" for speed, pressures in points.items())


def calibration_blocks(calibration: Calibration, key: str) -> tuple:
    """Notes, tables and figures of one calibration."""
    pictures = calibration_drawings(calibration, key)
    left_out = tuple(f"{name}: {reason}" for name, reason in calibration.left_out)
    title = f"Recordings: {len(calibration.recording_ids)} used, {len(left_out)} left out"
    recordings = (Bullets("Used", calibration.recording_ids), Bullets("Left out", left_out))
    tables = fit_table(calibration), estimates_table(calibration)
    notes = Bullets("Look at this first", calibration.notes)
    return (notes, *tables, *pictures, Group(title, recordings, is_open=False))


def fit_table(calibration: Calibration) -> Table:
    """RMSE, PE and SVE before and after."""
    before, after = asdict(calibration.fit_before), asdict(calibration.fit_after)
    rows = []
    for name, label in FIGURES.items():
        share = calibration.improvement.get(name, math.nan) if before[name] else math.nan
        change = f"{'−' if share > 0 else '+'}{percent(abs(share))}" if math.isfinite(share) else "—"
        rows.append((label, number_cell(before[name]), number_cell(after[name]), change))
    return Table(
        "Difference between the twin and the recordings it was calibrated on. Errors: smaller is better. Correlation: "
        "1 is a spectrum of the same shape, whatever its level.",
        ("", "before (nominal)", "after (calibrated)", "change"),
        tuple(rows),
    )


def estimates_table(calibration: Calibration) -> Table:
    """The six values with intervals and verdicts."""
    rows = []
    for estimate in calibration.estimates:
        traded = f", traded with {estimate.traded_with}" if estimate.traded_with else ""
        unit = estimate.unit.replace("*", "·")
        name = f"{estimate.letter}, {parameter_words(estimate.name)} [{unit}]"
        values = number_cell(estimate.nominal), number_cell(estimate.value)
        rows.append((name, *values, interval_words(estimate), f"{estimate.verdict}{traded}"))
    return Table(
        "The six values. Identified: 90 % within a factor of 1.5. Weak: less certain. Not identified: the measurement "
        "adds little to the bounds. At bound: a bound stopped the search, often because a constant is wrong. "
        "Traded: the two can change together at almost the same spectrum.",
        ("value", "nominal", "calibrated", "90 % interval", "verdict"),
        tuple(rows),
    )


def interval_words(estimate: Estimate) -> str:
    """The interval in words; an end set by the bound alone is no limit."""
    low, high = (number(end) for end in estimate.interval)
    sentences = {
        (False, False): f"{low} to {high}",
        (True, False): f"at most {high}",
        (False, True): f"at least {low}",
        (True, True): "no limits within the bounds",
    }
    return sentences[estimate.open_sides]


def _provenance(calibration: Calibration) -> Table:
    """Settings and recordings needed to repeat the calibration."""
    entries = [
        ("method", calibration.method),
        *flatten_settings(calibration.settings),
        ("condition", condition_words(calibration)),
        ("simulations", calibration.simulations),
        ("time taken", f"{number(calibration.wall_s)} s"),
        ("swashtwin version", calibration.version),
        ("calibration recordings", list(calibration.recording_ids)),
    ]
    return facts_table("How the calibration was made.", entries)
