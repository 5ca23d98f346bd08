"""Figures of an identifiability report: posterior against prior, correlations, profiles, further measurements."""

import numpy as np
from matplotlib.axes import Axes

from swashtwin.calibration import THRESHOLD, IdentifiabilityReport, Profile
from swashtwin.pump import LETTERS
from swashtwin.report.drawing import Drawing, drawn, panels, table
from swashtwin.report.style import CALIBRATED, INTERFACE_COLORS, LIGHT, MEASURED, styled
from swashtwin.report.wording import words

_COLOR_OF = {letter: INTERFACE_COLORS[name.split(".")[0]] for name, letter in LETTERS.items()}


def identifiability_drawings(report: IdentifiabilityReport, key: str) -> list[Drawing]:
    """Every figure of a report, in the order of the page.

    Parameters
    ----------
    key : how file names begin.
    """
    figures = [shares(report, key), correlations(report, key)]
    if report.profiles:
        figures.append(profile_curves(report, key))
    if report.gains:
        figures.append(gains(report, key))
    return figures


def coordinate_words(name: str) -> str:
    """Name of a coordinate in words; letters of the six values as they are."""
    return name if name in _COLOR_OF else words(name)


@styled()
def shares(report: IdentifiabilityReport, key: str) -> Drawing:
    """Width of each coordinate's posterior over that of its prior, with its standing."""
    rows = [
        {"coordinate": name, "posterior_std": post, "prior_std": prior, "share": post / prior, "standing": word}
        for name, post, prior, word in zip(report.names, report.std, report.prior_std, report.standing, strict=True)
    ]
    figure, axes = panels(1, 1, 1.0 + 0.28 * len(rows))
    place = axes[0, 0]
    for height, row in enumerate(reversed(rows)):
        color = _COLOR_OF.get(str(row["coordinate"]), MEASURED)
        place.barh(height, 1.0, height=0.6, color="#efefef")
        place.barh(height, float(row["share"]), height=0.6, color=color)
        place.annotate(
            str(row["standing"]), (1.01, height), xycoords=("axes fraction", "data"), va="center", fontsize=9
        )
    place.set(
        xlim=(0, 1), ylim=(-0.6, len(rows) - 0.4), yticks=range(len(rows)), xlabel="posterior over prior width [1]"
    )
    place.set_yticklabels([coordinate_words(name) for name in reversed(report.names)])
    place.grid(axis="y", visible=False)
    caption = (
        "Standard deviation after the measurement (color) over that before (gray). A full bar: nothing was learnt. "
        "Traded off: the lines change with it, but in the way they change with others."
    )
    return drawn(f"{key}_shares", figure, table(rows), title="What the measurement tells of each", caption=caption)


@styled()
def correlations(report: IdentifiabilityReport, key: str) -> Drawing:
    """Posterior correlation of all coordinates."""
    count = len(report.names)
    rows = [
        {"first": first, "second": second, "correlation": report.correlation[i, j]}
        for i, first in enumerate(report.names)
        for j, second in enumerate(report.names)
    ]
    figure, axes = panels(1, 1, min(8.5, 2.0 + 0.36 * count))
    place = axes[0, 0]
    image = place.imshow(report.correlation, cmap="RdBu_r", vmin=-1, vmax=1)
    place.set(xticks=range(count), yticks=range(count))
    place.set_xticklabels([coordinate_words(name) for name in report.names], rotation=90)
    place.set_yticklabels([coordinate_words(name) for name in report.names])
    place.grid(False)
    if count <= 12:
        for i, j in np.ndindex(count, count):
            value = report.correlation[i, j]
            color = "white" if abs(value) > 0.6 else "black"
            place.text(j, i, f"{value:.1f}".replace("-0.0", "0.0"), ha="center", va="center", fontsize=8, color=color)
    figure.colorbar(image, ax=place, label="correlation [1]")
    caption = (
        "Correlation of the logarithms found. Near 1: only the ratio of the two is known well; near −1: only their "
        "product."
    )
    return drawn(f"{key}_correlations", figure, table(rows), title="What can be traded for what", caption=caption)


@styled()
def profile_curves(report: IdentifiabilityReport, key: str) -> Drawing:
    """Profile likelihoods, a panel each."""
    rows = [
        {"coordinate": one.name, "logarithm": x, "rise": y}
        for one in report.profiles
        for x, y in zip(one.coordinate, one.rise, strict=True)
    ]
    columns = min(3, len(report.profiles))
    lines = -(-len(report.profiles) // columns)
    figure, axes = panels(lines, columns, 0.6 + 2.2 * lines, sharey=True)
    for place, one in zip(axes.flat, report.profiles, strict=False):
        _profile(place, one)
    for place in axes.flat[len(report.profiles) :]:
        place.set_visible(False)
    for place in axes[:, 0]:
        place.set_ylabel("rise [1]")
    caption = (
        "How much worse the best fit becomes where one value is held (horizontal: its logarithm relative to the best) "
        "and all others are fitted again. The value lies where the curve is below the gray line (90 %); a curve that "
        "stays below it up to a bound shows that the measurement sets no limit there."
    )
    return drawn(f"{key}_profiles", figure, table(rows), title="Profile likelihoods", caption=caption)


def _profile(place: Axes, one: Profile) -> None:
    place.axhline(THRESHOLD, color=LIGHT, linewidth=2)
    place.plot(one.coordinate - one.best, one.rise, ".-", color=_COLOR_OF.get(one.name, CALIBRATED), markersize=4)
    low, high = (bound - one.best for bound in one.bounds)
    reach = np.abs(one.coordinate - one.best).max() * 1.1
    for bound in (low, high):
        if abs(bound) <= reach:
            place.axvline(bound, color=MEASURED, linestyle=":", linewidth=1)
    place.set(title=one.words, ylim=(-0.15, 2 * THRESHOLD), xlim=(-reach, reach), xlabel=f"ln {one.name} − best")


@styled()
def gains(report: IdentifiabilityReport, key: str) -> Drawing:
    """What further measurements would tell, the best on top."""
    rows = [
        {"measurement": one.name, "nats": one.nats, **{f"narrower_{name}": factor for name, factor in one.narrower}}
        for one in report.gains
    ]
    figure, axes = panels(1, 1, 1.0 + 0.3 * len(rows))
    place = axes[0, 0]
    for height, one in enumerate(reversed(report.gains)):
        letter, factor = max(one.narrower, key=lambda pair: pair[1])
        place.barh(height, one.nats, height=0.6, color=CALIBRATED)
        told = f"{letter}: {factor:.2g} times narrower"
        place.annotate(told, (1.01, height), xycoords=("axes fraction", "data"), va="center", fontsize=9)
    place.set(ylim=(-0.6, len(rows) - 0.4), yticks=range(len(rows)), xlabel="expected information gain [nat]")
    place.set_yticklabels([one.name for one in reversed(report.gains)])
    place.grid(axis="y", visible=False)
    caption = (
        "How much each further measurement would tell of the six values together: 0.69 nat halve the interval of one "
        "of them. Beside it the value that gains most. Films are taken to stay as they are at other conditions."
    )
    return drawn(f"{key}_gains", figure, table(rows), title="What to measure next", caption=caption)
