"""Names and groups of what the page shows, in English; the languages translate them."""

import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from swashtwin.monitoring.page.content.languages import Language

RECORDING_STATES: Mapping[str, str] = MappingProxyType(
    {"learning": "Learning", "normal": "Normal", "unusual": "Unusual", "alarm": "Alarm", "sensor": "Sensor alarm"}
)
"""What each state of a recording is called."""

REJECTION_REASONS: Mapping[str, str] = MappingProxyType(
    {
        "machine": "unknown machine",
        "double": "came twice",
        "late": "late",
        "broken": "broken file",
        "rate": "other sample rate",
        "unit": "other unit",
        "channels": "channels do not fit",
        "unfit": "unfit to be judged",
        "points": "too many operating points",
        "error": "error of the watch",
    }
)
"""Why a recording was not judged."""

VERDICT_NAMES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "capital": ("Evidence against luck", ""),
        "alarm_p": ("Chance from the healthy machine", ""),
        "probability": ("Probability of the verdict", ""),
        "confidence": ("Confidence of the verdict", ""),
        "ood_p": ("Chance among recordings of the training", ""),
        "speed": ("Speed", "rad/s"),
        "pressure": ("Discharge pressure", "Pa"),
    }
)
"""Name and unit of what is stored of each recording beside its levels."""

_DECIMAL = re.compile(r"(\d)\.(\d)")
_FREQUENCY = re.compile(r" \([^()]* Hz\)$")
_SENTENCE_WORDS = (
    (" of the envelope", " der Hüllkurve"),
    ("shaft order ", "Wellenordnung "),
    (" to ", " bis "),
    (" dB at ", " dB bei "),
    (" dB in all bands of channel ", " dB in allen Bändern von Kanal "),
    (
        ": a changed gain, sensor or mounting does that",
        ": so wirkt eine andere Verstärkung, Befestigung oder ein anderer Sensor",
    ),
    (", channel ", ", Kanal "),
    ("channel ", "Kanal "),
    (" does not move in ", " bewegt sich nicht in "),
    (" of the recording.", " der Aufnahme."),
    (" has single samples ", " hat einzelne Werte, "),
    (" times as far from the middle as the others: spikes.", "-mal so weit von der Mitte wie die anderen: Ausreißer."),
    (" stands at the end of its range in ", " steht am Ende seines Bereichs in "),
    (" of the samples.", " der Abtastwerte."),
    (" has ", " hat "),
    (
        " of its power below the speed of the shaft: a loose plug or cable?",
        " seiner Leistung unter der Drehfrequenz: loser Stecker oder loses Kabel?",
    ),
)
_GROUPS = ("Orders", "Orders of the envelope", "Bands", "Bands of the envelope", "Verdict and conditions")


def label_words(label: str | None) -> str:
    """A class as a reader should see it: ``Swash plate``; ``—`` for none."""
    return "—" if label is None else label.replace("_", " ").capitalize()


def level_name(name: str, language: Language) -> str:
    """Name of a level, or a sentence of levels and sensors, in a language: ``shaft order 9 (129 Hz)``."""
    if language.code == "de":
        for english, german in _SENTENCE_WORDS:
            name = name.replace(english, german)
        name = _DECIMAL.sub(r"\1,\2", name)
    return name


def stored_name(level: str) -> str:
    """Name under which the history keeps a level: a level that moved also says where its order is.

    Examples
    --------
    >>> stored_name("shaft order 9 of the envelope (129 Hz)")
    'shaft order 9 of the envelope'
    """
    return _FREQUENCY.sub("", level)


def grouped_levels(names: Iterable[str]) -> Sequence[tuple[str, Sequence[str]]]:
    """Names of levels by kind, orders first, in their own order."""
    groups: dict[str, list[str]] = {group: [] for group in _GROUPS}
    for name in names:
        groups[_group(name)].append(name)
    return [(group, members) for group, members in groups.items() if members]


def _group(name: str) -> str:
    if name in VERDICT_NAMES:
        return _GROUPS[4]
    is_envelope = "envelope" in name
    return _GROUPS[is_envelope if "order" in name else 2 + is_envelope]
