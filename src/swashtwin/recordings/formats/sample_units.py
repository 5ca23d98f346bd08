"""Units of samples and times as files and people write them."""

from swashtwin.foundation import UnitError, is_unit, parse_quantity

# m/s^2 per common unit: most files are read without loading the registry of units (0.3 s).
_COMMON_FACTORS = {"m/s^2": 1.0, "g": 9.80665}

# Spelling used here of units as people write them, in small letters.
_SPELLINGS = {
    "g's": "g",
    "gs": "g",
    "g_n": "g",
    "gn": "g",
    "volts": "V",
    "volt": "V",
    "amps": "A",
    "amp": "A",
    "ms-2": "m/s^2",
    "m/s2": "m/s^2",
    "m/s/s": "m/s^2",
    "m/sec^2": "m/s^2",
    "m/sec2": "m/s^2",
    "m*s^-2": "m/s^2",
    "m s-2": "m/s^2",
    "m.s-2": "m/s^2",
    "m/(s^2)": "m/s^2",
    "ms^-2": "m/s^2",
    "m/s**2": "m/s^2",
    "mm/s2": "mm/s^2",
    "deg c": "degC",
    "°c": "degC",
    "celsius": "degC",
    "1/min": "rpm",
    "u/min": "rpm",
    "min-1": "rpm",
    "r/min": "rpm",
    "rev/min": "rpm",
    "upm": "rpm",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "sek": "s",
    "msec": "ms",
    "millis": "ms",
    "milliseconds": "ms",
    "usec": "us",
    "micros": "us",
    "microseconds": "us",
    "nsec": "ns",
    "nanos": "ns",
    "nanoseconds": "ns",
    "hours": "h",
    "minutes": "min",
    "days": "d",
    "s/s": "Hz",
    "sa/s": "Hz",
    "sps": "Hz",
    "samples/s": "Hz",
    "samples/second": "Hz",
    "1/s": "Hz",
    "hertz": "Hz",
    "ks/s": "kHz",
    "ksa/s": "kHz",
    "ksps": "kHz",
    "ms/s": "MHz",
    "msa/s": "MHz",
} | {
    unit.lower(): unit
    for unit in (
        "g",
        "s",
        "ms",
        "us",
        "ns",
        "m/s^2",
        "mm/s^2",
        "V",
        "mV",
        "bar",
        "Hz",
        "kHz",
        "rpm",
    )
}

SAMPLE_UNITS = (
    "m/s^2",
    "g",
    "mg",
    "mm/s^2",
    "m/s",
    "mm/s",
    "um/s",
    "mm",
    "um",
    "Pa",
    "hPa",
    "kPa",
    "MPa",
    "mbar",
    "bar",
    "psi",
    "V",
    "mV",
    "A",
    "mA",
    "N",
    "kN",
    "N*m",
    "rpm",
    "Hz",
    "degC",
    "1",
)
"""Units that an option may name for samples; 1 is a plain number."""


def normalize_unit(text: str) -> str:
    """Return a unit in the spelling used here; what follows the word "since" is dropped.

    Examples
    --------
    >>> normalize_unit("g's"), normalize_unit("ms-2"), normalize_unit("\u03bcs")
    ('g', 'm/s^2', 'us')
    >>> normalize_unit("M/S²"), normalize_unit("ms since 1970")
    ('m/s^2', 'ms')
    """
    unit = text.partition(" since ")[0].strip()
    unit = unit.replace("\u03bc", "u").replace("\u00b5", "u")  # Greek mu, and the micro sign
    unit = unit.replace("²", "^2").replace("⁻", "-")
    return _SPELLINGS.get(unit.lower(), unit)


def acceleration_factor(unit: str) -> float | None:
    """Return the m/s^2 per `unit`, or None if it is a unit of another quantity.

    ``g`` is the acceleration of gravity here, not the gram.

    Raises
    ------
    UnitError
        The unit is unknown.

    Examples
    --------
    >>> acceleration_factor("g"), acceleration_factor("mm/s^2"), acceleration_factor("Pa")
    (9.80665, 0.001, None)
    """
    unit = normalize_unit(unit)
    if unit in _COMMON_FACTORS:
        return _COMMON_FACTORS[unit]
    if unit.strip() == "1":
        return None

    try:
        return parse_quantity(f"1 {unit}", "m/s^2")
    except UnitError as cause:
        if is_unit(unit.strip()):
            return None
        raise UnitError(
            f'Unknown unit = "{unit}": use for example "g", "m/s^2", "Pa", or "1" for a plain '
            "number."
        ) from cause


def has_dimension(unit: str, si_unit: str) -> bool:
    """Return whether a unit is one of the quantity that `si_unit` is for.

    Examples
    --------
    >>> has_dimension("mm/s", "m/s"), has_dimension("degC", "K"), has_dimension("mm", "m/s")
    (True, True, False)
    """
    try:
        parse_quantity(f"1 {normalize_unit(unit)}", si_unit)
    except UnitError:
        return False
    return True


def recognize_unit(text: object) -> str | None:
    """Return the unit that a file names, or None if the text is not a unit."""
    unit = normalize_unit(str(text))
    if not unit or unit.upper() in ("NONE", "N/A", "UNKNOWN"):
        return None

    try:
        acceleration_factor(unit)
    except UnitError:
        return None
    return unit


def require_sample_unit(text: str) -> None:
    """Require a unit that a machine's sensors have, before any file is read.

    A furlong is a unit, but a slip: nothing measures it.

    Raises
    ------
    UnitError
        The unit is not one of `SAMPLE_UNITS`, in any of their spellings.
    """
    unit = normalize_unit(text).casefold()
    if unit not in [name.casefold() for name in SAMPLE_UNITS]:
        raise UnitError(
            f"unit = {text!r} must be one of {', '.join(SAMPLE_UNITS)} (1 is a plain number)."
        )
