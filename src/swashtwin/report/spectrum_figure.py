"""Figure of a recording's spectrum over those of healthy recordings."""

import numpy as np
from matplotlib.ticker import FuncFormatter

from swashtwin.diagnosis import HealthySpectrum
from swashtwin.foundation import plural
from swashtwin.plot import CALIBRATED, LIGHT, MEASURED, figure_style, panels, unit_words, words
from swashtwin.recordings import RecordingFacts
from swashtwin.report.drawing import Drawing, render_drawing

_MARKS = 4
"""Multiples of the piston-pass line that are marked."""
_LOWEST = 5.0
"""Frequency from which the axis begins at least [Hz]."""


_FEW_HEALTHY = 5
"""Healthy recordings below which their range is too narrow to judge by."""


def spectrum_sentences(spectrum: HealthySpectrum | None) -> tuple[str, ...]:
    """How a recording differs from healthy ones, and that few of them span a narrow range."""
    if spectrum is None:
        return ()
    if (count := len(spectrum.healthy)) >= _FEW_HEALTHY:
        return (spectrum.sentence(),)
    return (
        f"{spectrum.sentence()} {plural(count, 'healthy recording')} {'spans' if count == 1 else 'span'} a narrow "
        "range: bands outside it are no sign of a fault by themselves.",
    )


@figure_style()
def spectrum_over_healthy(spectrum: HealthySpectrum, facts: RecordingFacts, key: str) -> Drawing:
    """Levels of a recording, channel by channel, over the range and the median of healthy ones."""
    count, first = len(spectrum.channels), max(float(spectrum.low[0]), 1e-3)
    edges = np.append(np.maximum(spectrum.low, first), spectrum.high[-1])
    figure, axes = panels(count, 1, 1.1 + 1.25 * count, sharex=True)
    healthy = spectrum.healthy
    least, median, greatest = healthy.min(axis=0), np.median(healthy, axis=0), healthy.max(axis=0)
    for row, (panel, name) in enumerate(zip(axes[:, 0], spectrum.channels, strict=True)):
        for line in _marked_lines(facts):
            panel.axvline(line, color=LIGHT, linewidth=0.8, linestyle=":", zorder=0)
        panel.stairs(greatest[row], edges, baseline=least[row], fill=True, color=LIGHT, label="range of healthy ones")
        panel.stairs(median[row], edges, color=MEASURED, linewidth=0.9, baseline=None, label="their median")
        panel.stairs(spectrum.level[row], edges, color=CALIBRATED, linewidth=1.5, baseline=None, label="this recording")
        panel.set_title(words(name), loc="left")
    lowest = min(max(_LOWEST, 0.7 * (facts.shaft or 0.0)), edges[-2])
    axes[0, 0].set(xscale="log", xlim=(max(edges[0], lowest), edges[-1]))
    for panel in axes[:, 0]:
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    unit = unit_words(spectrum.unit)
    axes[count // 2, 0].set_ylabel(f"level [dB re 1 ({unit})²/Hz]")
    axes[-1, 0].set_xlabel("frequency [Hz]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    marked = " Dotted: the piston-pass line and its multiples." if _marked_lines(facts) else ""
    caption = (
        f"Blue: this recording. Gray: {spectrum.basis}; the line is their median, the band reaches from the least to "
        f"the greatest.{marked} 6 dB are twice the amplitude."
    )
    columns = {
        "channel": np.repeat(spectrum.channels, len(spectrum.low)),
        "low_hz": np.tile(spectrum.low, count),
        "high_hz": np.tile(spectrum.high, count),
        "level_db": spectrum.level.ravel(),
        "healthy_least_db": least.ravel(),
        "healthy_median_db": median.ravel(),
        "healthy_greatest_db": greatest.ravel(),
    }
    return render_drawing(
        f"{key}_spectrum",
        figure,
        columns,
        title="Spectrum over the healthy recordings",
        caption=caption,
        description=spectrum.sentence(),
    )


def _marked_lines(facts: RecordingFacts) -> list[float]:
    """Frequencies [Hz]; none where the speed or the number of pistons is not stated."""
    if facts.pistons is None or facts.shaft is None:
        return []
    return [facts.shaft * facts.pistons * multiple for multiple in range(1, _MARKS + 1)]
