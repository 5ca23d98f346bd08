"""Texts, numbers and times of the page in English and German."""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from importlib import resources
from types import MappingProxyType

LANGUAGES = MappingProxyType({"en": "English", "de": "Deutsch"})
"""Languages of the page, each by its own name."""


@dataclass(frozen=True)
class Language:
    """One language; what has no translation stays in English."""

    code: str
    """``en`` or ``de``."""

    def __call__(self, text: str, **values: object) -> str:
        """`text` in this language, with `values` in its braces."""
        translation = _german().get(text, text) if self.code == "de" else text
        return translation.format(**values) if values else translation

    def number(self, value: float | None, digits: int = 3) -> str:
        """So many significant digits, ``—`` for None and what is not finite."""
        if value is None or not math.isfinite(value):
            return "—"
        if value != 0 and not 1e-3 <= abs(value) < 1e5:
            text = f"{value:.{digits - 1}e}"
        else:
            magnitude = 0 if value == 0 else math.floor(math.log10(abs(value)))
            text = f"{value:.{max(0, digits - 1 - magnitude)}f}"
        return self._decimal(text)

    def percent(self, share: float | None) -> str:
        """A share in percent, never rounded up to all or down to nothing."""
        if share is None or not math.isfinite(share):
            return "—"
        if share > 0.995 and share < 1:
            return "> 99 %"
        return "< 1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"

    def change(self, value: float) -> str:
        """A change with its sign and one decimal."""
        return self._decimal(f"{value:+.1f}").replace("-", "−")

    def moment(self, time: datetime | None) -> str:
        """A time to the second in UTC; the browser shows it in its own zone."""
        if time is None:
            return "—"
        pattern = "%d.%m.%Y %H:%M:%S UTC" if self.code == "de" else "%Y-%m-%d %H:%M:%S UTC"
        return time.astimezone(UTC).strftime(pattern)

    def ago(self, time: datetime, now: datetime) -> str:
        """How long ago a time was, in its largest unit."""
        seconds = max(0.0, (now - time).total_seconds())
        for length, text in (
            (86400, "{count} d ago"),
            (3600, "{count} h ago"),
            (60, "{count} min ago"),
        ):
            if seconds >= length:
                return self(text, count=int(seconds // length))
        return self("just now")

    def _decimal(self, text: str) -> str:
        return text.replace(".", ",") if self.code == "de" else text


def language_of(code: str | None, default: str) -> Language:
    """The language a visitor chose, or the page's own."""
    return Language(code if code is not None and code in LANGUAGES else default)


@cache
def _german() -> Mapping[str, str]:
    return tomllib.loads(resources.files(__package__).joinpath("german.toml").read_text(encoding="utf-8"))
