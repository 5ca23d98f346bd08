"""Axes of figures: their range and their round values."""

import math
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

MARGIN = 0.05
"""Space at each end of an axis, as a share of the values' range."""
MIN_RELATIVE_MARGIN = 1e-12
"""Smallest space at each end, as a share of the largest value. Below about 1e-16 the space would
vanish in rounding, and values would lie on the end of the axis.
"""
MAX_TICKS = 6
"""Round values on an axis, apart from those at its ends."""
_MINUTE_S = 60
_DAY_S = 86_400

# Distances of marked times.
_TIME_STEPS_S = (
    *(minutes * _MINUTE_S for minutes in (1, 5, 15, 60, 180, 360, 720)),
    *(days * _DAY_S for days in (1, 2, 7, 14, 30, 91, 365)),
)

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PLAIN_POWERS = {-1: "0.1", 0: "1", 1: "10", 2: "100"}


class Axis(NamedTuple):
    """Range of an axis: numbers, their logarithms to base 10, or seconds since 1970."""

    low: float
    """Lower end."""
    high: float
    """Upper end."""
    kind: str = ""
    """Empty, ``log`` or ``time``."""

    @classmethod
    def around(cls, *values: Iterable[float], kind: str = "") -> "Axis":
        """Return an axis that holds all finite values, with some space at each end."""
        numbers = np.concatenate([np.asarray(tuple(part), np.float64) for part in values])
        if kind == "log":
            with np.errstate(divide="ignore", invalid="ignore"):
                numbers = np.log10(numbers)

        numbers = numbers[np.isfinite(numbers)]
        if not numbers.size:
            numbers = np.array([0.0, 1.0])
        low = float(numbers.min())
        high = float(numbers.max())

        margin = MARGIN * (high - low)
        if margin == 0 and kind == "time":
            margin = _DAY_S
        elif margin == 0:
            margin = 0.5
        margin = max(margin, MIN_RELATIVE_MARGIN * max(abs(low), abs(high)))
        return cls(low - margin, high + margin, kind)

    def share(self, values: Float[np.ndarray, "*point"] | float) -> Float[np.ndarray, "*point"]:
        """Return the positions of values as shares of the range, 0 at the low and 1 at the high
        end.

        The logarithm of a value that is not positive is NaN.
        """
        numbers = np.asarray(values, np.float64)
        if self.kind == "log":
            numbers = np.log10(np.where(numbers > 0, numbers, np.nan))
        return np.asarray((numbers - self.low) / (self.high - self.low))

    def ticks(self) -> list[tuple[float, str]]:
        """Return the positions of round values as shares of the range, each with its text."""
        step = self._step()
        first = math.ceil(self.low / step)
        final = math.floor(self.high / step)
        numbers = np.arange(first, final + 1) * step

        # A value at an end of the axis may come to lie just outside by rounding.
        shares = np.clip((numbers - self.low) / (self.high - self.low), 0, 1)
        return [
            (float(share), self._text(float(number), step))
            for share, number in zip(shares, numbers, strict=True)
        ]

    def _step(self) -> float:
        """Return the distance of round values."""
        span = self.high - self.low
        if self.kind == "log":
            return max(1, math.ceil(span / MAX_TICKS))

        if self.kind == "time":
            year = _TIME_STEPS_S[-1]
            years = year * math.ceil(span / year / MAX_TICKS)
            steps: Iterable[float] = (*_TIME_STEPS_S, years)
        else:
            power = 10.0 ** math.floor(math.log10(span / MAX_TICKS))
            steps = (power * factor for factor in (1, 2, 5, 10, 20))
        return next(step for step in steps if span / step <= MAX_TICKS)

    def _text(self, number: float, step: float) -> str:
        if self.kind == "time":
            pattern = "%Y-%m-%d"
            if step < _DAY_S:
                pattern = "%H:%M"
            return datetime.fromtimestamp(number, UTC).strftime(pattern)

        if self.kind == "log":
            exponent = round(number)
            power = f"10{str(exponent).translate(_SUPERSCRIPTS)}"
            return _PLAIN_POWERS.get(exponent, power)

        return f"{number:.4g}".replace("-", "−")
