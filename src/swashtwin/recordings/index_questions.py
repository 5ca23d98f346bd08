"""Questions about facts that neither files nor settings state, for a proposed index."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Question:
    """How a missing fact is asked for."""

    setting: str
    """Setting that answers it, with an example, in braces (`foundation.render_settings`)."""
    text: str
    """Question, without its question mark."""


QUESTIONS = {
    "sample_rate": Question(
        "{sample_rate='25.6 kHz'}",
        "How many samples per second and channel do they have, with the unit",
    ),
    "unit": Question(
        "{unit='g'} (or 'V', '1')",
        'In which unit are their samples: g, m/s^2, V, or "1" if it is unknown',
    ),
    "sensitivity": Question(
        "{sensitivity='50 m/s^2'} (value of full scale), or {unit='1'} if it is unknown",
        "Which quantity is the full scale of their integers, such as 50 m/s^2",
    ),
    "pressure_unit": Question(
        "{pressure_unit='bar'}",
        "Their pressures have no unit: is it MPa, bar, kPa or psi",
    ),
    "label": Question(
        "{label_pattern}",
        "Which regular expression finds the class in their paths, as (?P<label>...)",
    ),
}
"""Question for each fact that may be missing."""
