"""What the name and the unit of a column say about its quantity, in English and German.

The one place that knows such words: readers, clocks and the selection of channels ask it.
"""

import re
from collections.abc import Iterable
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

from swashtwin.recordings.formats.sample_units import (
    acceleration_factor,
    normalize_unit,
    recognize_unit,
)


class Quantity(Enum):
    """What a column holds, as its name or unit says."""

    vibration = "acceleration, or vibration of any kind"
    motion = "velocity or displacement"
    electric = "the output of a sensor"
    time = "time"
    frequency = "a frequency or an order"
    spectrum = "a spectrum"
    label = "a class or a state"
    other = "another quantity"


class PlaceSupport(Enum):
    """By what the name of a quantity may be that of a sensor's place."""

    number = "a number, a letter or a side behind it, as in Position 1"
    part = "the word is also a part or a direction: a hub, lateral"
    columns = "nothing but columns that are named by places"


class Meaning(NamedTuple):
    """Quantity of a column, and the evidence for it."""

    quantity: Quantity
    reason: str
    """Words for a message, such as ``in dBm``."""
    dimension: str = ""
    """SI unit of the quantity, if the name leaves no doubt about it."""
    place: "PlaceSupport | None" = None
    """By what the name may be that of a sensor's place as well; None if it cannot."""


class TimeName(NamedTuple):
    """Name of a column with the time."""

    unit: str | None
    """Unit in the name, as `normalize_unit` writes it, or None."""


# ---- words

_WORD = re.compile(r"[A-ZÄÖÜ]+(?![a-zäöüß])|[A-ZÄÖÜ]?[a-zäöüßµμ]+|\d+|[°%]")
_BRACKETED = re.compile(r"^(.*?)\s*[\[(<]([^\])>]*(?:\([^)]*\)[^\])>]*)?)[\])>]$")
_AFTER_WORD = re.compile(r"^(.*?[^\s/])(?:\s+/\s+|/|\s+in\s+|\s+-\s+|\s*,\s+)([^\s,]+)$")


def words_of(name: str) -> list[str]:
    """Return the words and numbers of a name in small letters.

    Examples
    --------
    >>> words_of("elapsedTime_ms"), words_of("accX1"), words_of("DE_time")
    (['elapsed', 'time', 'ms'], ['acc', 'x', '1'], ['de', 'time'])
    """
    return [word.lower() for word in _WORD.findall(name)]


def name_in_group(name: str) -> str:
    """Return the name of a column without those of the groups or structures around it."""
    text = name.strip()
    bracketed = _BRACKETED.match(text)
    head = bracketed[1] if bracketed and bracketed[1] else text
    return (re.split(r"[./]", head.rstrip("."))[-1] + text[len(head) :]).strip()


def split_heading(name: str) -> tuple[str, str]:
    """Return the name of a column, and the text in brackets or behind a slash; else empty.

    Examples
    --------
    >>> split_heading("RSSI (dBm)"), split_heading("T / degF"), split_heading("H(:,1)")
    (('RSSI', 'dBm'), ('T', 'degF'), ('H(:,1)', ''))
    """
    for pattern in (_BRACKETED, _AFTER_WORD):
        match = pattern.match(name.strip())
        if match and match[1] and any(map(str.isalpha, match[2] + "a" * ("%" in match[2]))):
            return match[1], match[2].strip()
    return name.strip(), ""


# ---- times

_UNIT_WORDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden"), "s"),
    **dict.fromkeys(
        ("ms", "msec", "msecs", "millis", "millisecond", "milliseconds", "millisekunden"), "ms"
    ),
    **dict.fromkeys(
        ("us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"), "us"
    ),
    "mikrosekunden": "us",
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecond", "nanoseconds"), "ns"),
    "nanosekunden": "ns",
    **dict.fromkeys(("min", "mins", "minute", "minutes", "minuten"), "min"),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours", "std", "stunde", "stunden"), "h"),
    **dict.fromkeys(("d", "day", "days", "tag"), "d"),
}

# Units that are not also something else: a minimum, a standard deviation, a label.
_CLEAR_UNIT_WORDS = {
    word for word in _UNIT_WORDS if len(word) > 3 or _UNIT_WORDS[word] not in ("min", "h", "d")
} - {"s", "ms", "us", "µs", "μs", "ns"}

_TIME_WORDS = {
    *("time", "times", "t", "ts", "epoch", "stamp", "clock", "elapsed", "uptime", "temps"),
    *("tiempo", "tempo", "tijd", "czas", "uhr"),
}
_TIME_COMPOUND = re.compile(
    r"(?:date|sys|run|real|up|cpu|gps|unix)?times?(?:stamps?)?|\w*zeit(?:en|punkt|achse|stempel)?"
)
_TIME_QUALIFIERS = {
    *("rel", "relative", "abs", "absolute", "sample", "sampling", "measurement", "system"),
    *("experiment", "device", "sensor", "local", "utc", "gps", "unix", "since", "start", "boot"),
    *("from", "of", "in", "the", "axis", "value", "total", "host", "pc", "seit"),
}


@lru_cache(maxsize=1024)
def parse_time_name(name: str) -> TimeName | None:
    """Return what the name of a column, without its groups, says of a time; None if nothing.

    Examples
    --------
    >>> parse_time_name("time_min"), parse_time_name("Minuten"), parse_time_name("DE_time")
    (TimeName(unit='min'), TimeName(unit='min'), None)
    """
    heading, unit_text = split_heading(name_in_group(name))
    name_words = [word for word in words_of(heading) if not word.isdecimal()]
    if name_words == ["x", "value"]:
        return TimeName(None)

    # milli and seconds, epoch and ms, t and s: the unit may have been split from its prefix.
    units = [_UNIT_WORDS[word] for word in name_words if word in _UNIT_WORDS]
    rest = [word for word in name_words if word not in _UNIT_WORDS]
    has_time_word = any(
        word in _TIME_WORDS or _TIME_COMPOUND.fullmatch(word) is not None for word in rest
    )
    is_unit_alone = not rest and len(name_words) == 1 and name_words[0] in _CLEAR_UNIT_WORDS
    is_time_word = (
        word in _TIME_WORDS or word in _TIME_QUALIFIERS or _TIME_COMPOUND.fullmatch(word)
        for word in rest
    )
    if len(units) > 1 or not (has_time_word or is_unit_alone) or not all(is_time_word):
        return None

    in_brackets = _UNIT_WORDS.get(unit_text.lower())
    if unit_text and in_brackets is None and _is_other_unit(unit_text):
        return None  # "T (°F)" is a temperature
    return TimeName(units[0] if units else in_brackets)


def _is_other_unit(unit_text: str) -> bool:
    units = {unit_text.lower(), normalize_unit(unit_text).lower()}
    return not units.isdisjoint(_OTHER_UNITS)


def clock_part(name: str, unit: str | None) -> tuple[str, str] | None:
    """Return the prefix and the unit of a column that may be a part of a clock, or None.

    Examples
    --------
    >>> clock_part("tv_usec", None), clock_part("Minute", None), clock_part("acc", None)
    (('tv', 'us'), ('', 'min'), None)
    """
    name_words = words_of(split_heading(name_in_group(name))[0])
    if name_words and name_words[-1] in _UNIT_WORDS:
        return " ".join(name_words[:-1]), _UNIT_WORDS[name_words[-1]]
    if unit is None or unit not in _UNIT_WORDS.values():
        return None
    return " ".join(name_words), unit


_SENSOR_WORDS = {
    *("sensor", "sensors", "channel", "chan", "ch", "node", "device", "module", "addr", "address"),
    *("kanal", "achse", "axis", "probe", "source", "port", "board", "transducer", "messstelle"),
    *("messstellen", "station", "tag", "mote", "slave", "imu", "unit", "location", "input"),
    *("eingang", "sonde", "aufnehmer", "gerät", "knoten", "quelle"),
}
_NUMBER_WORDS = {"id", "no", "nr", "num", "number", "nummer", "index", "idx"}


def names_sensor(name: str) -> bool:
    """Return whether a name is that of a column with the number of a sensor.

    Examples
    --------
    >>> names_sensor("channel"), names_sensor("Sensor-Nr."), names_sensor("Channel 1")
    (True, True, False)
    """
    name_words = words_of(name_in_group(name))
    known = all(word in _SENSOR_WORDS or word in _NUMBER_WORDS for word in name_words)
    return known and (name_words == ["id"] or not _SENSOR_WORDS.isdisjoint(name_words))


# Headings of text tables that leave little doubt: "channel" alone may be a signal there.
_ROW_SENSOR = re.compile(
    r"(?:sensor|channel|node|device|module|ch|addr\w*)?[ _]?(?:id|no|nr)|sensor|node", re.IGNORECASE
)


def names_row_sensor(heading: str) -> bool:
    """Return whether a heading is that of a column with the sensor of each row.

    Examples
    --------
    >>> names_row_sensor("Sensor_ID"), names_row_sensor("Nr"), names_row_sensor("channel")
    (True, True, False)
    """
    return _ROW_SENSOR.fullmatch(heading) is not None


# ---- other quantities

_SOUND = r"mic(?:rophone|s)?|mikrofon|mikro|sound|audio|schall|schalldruck|spl"
_ROTATION = (
    r"gyro\w*|gyr[xyz]?|rotation|rotations?rate|angular|omega|roll|pitch|yaw|gier\w*|nick\w*|euler"
    r"|drehrate|winkelgeschwindigkeit|quat\w*|quaternion|orientation|attitude"
)
_MAGNETIC = r"mag[xyz]?|magn|magnet\w*|compass|kompass|bfield"
_PLACE = r"gps|lat|latitude|lon|lng|long|longitude|breite|breitengrad|längengrad|alt|altitude|höhe"

# Words of other quantities, the SI unit of those that have one, and what they are.
_OTHER_WORDS: tuple[tuple[str, str, str], ...] = (
    (r"temp|tmp|\w*temperatur\w*|öltemp|thermo\w*", "K", "a temperature"),
    (r"\w*pressure|\w*druck|press|baro\w*|p_?abs", "Pa", "a pressure"),
    (r"\w*drehzahl|rpm|speed|geschwindigkeit|upm|tacho?\w*|tach|keyphasor", "rad/s", "a speed"),
    (r"\w*flow|flowrate|durchfluss|volumenstrom|leckage|lecköl|leck|leakage|case_drain", "m^3/s",
     "a flow"),
    (r"\w*torque|\w*drehmoment|moment", "N*m", "a torque"),
    (r"current|\w*strom|amperage", "A", "a current"),
    (r"force|kraft|\w*kraft", "N", "a force"),
    (r"loads?|last|weight|gewicht|power|leistung", "", "a load"),
    (r"\w*batter\w*|batt?|vbat|akku\w*|soc|charge|ladung|supply|versorgung", "", "a battery"),
    (_PLACE, "", "a place"),
    (_SOUND, "Pa", "sound"),
    (_ROTATION, "", "a rotation"),
    (_MAGNETIC, "", "a magnetic field"),
    (r"humidity|\w*feuchte|light|licht|lux|illuminance|helligkeit|co2|gas", "", "the air or light"),
    (r"rssi|snr|signal_?strength|signalstärke|dbm", "", "a radio signal"),
    (r"strain|dehnung|viscosity|viskosität|density|dichte|level|füllstand", "", "another quantity"),
    (r"angle|winkel\w*|phase|phi|theta|encoder|turns?|\w*umdrehung(?:en)?|revolutions?|revs?|rev"
     r"|degrees?", "", "an angle"),
    (r"distance|weg|strecke|position|depth|tiefe|hub|stroke|heading|course", "m", "a position"),
    (r"set_?points?|\w*soll(?:wert)?|\w*vorgabe|demand|command|duty|pwm", "", "a set point"),
)  # fmt: skip
_OTHER_PATTERNS = tuple(
    (re.compile(pattern), dimension, text) for pattern, dimension, text in _OTHER_WORDS
)

# Words of quantities that are directions or parts of machines as well, in English or German.
_QUANTITIES_OR_PARTS = {"hub", "lat", "long", "höhe", "breite", "roll", "magnet"}

# Words of quantities that number places, or stand before a part: Phase A, charge pump.
_QUANTITIES_OR_PLACES = {
    *("position", "level", "phase", "charge", "power", "supply", "light", "gas", "turn", "turns"),
    *("load", "loads", "last", "moment", "pitch", "yaw", "course", "depth", "stroke", "encoder"),
    *("ladung", "leistung", "versorgung", "strecke", "tiefe", "press", *_QUANTITIES_OR_PARTS),
}

# A pressure is called "press 1" too.
_NEVER_NUMBERED = {"press"}

# Words behind which the name of another quantity is that of a place: "load side", "Druckseite".
_SIDE_WORDS = {"side", "seite", "end", "zone", "line", "plate", "port", "bearing", "lager"}

# Words of vibrations, with the SI unit of those that have one.
_VIBRATION_WORDS = (
    (
        Quantity.motion,
        "m/s",
        re.compile(r"velocity|velo|vel|schwinggeschwindigkeit|schnelle|geophone"),
    ),
    (Quantity.motion, "m", re.compile(r"displacement|disp|auslenkung")),
    (
        Quantity.vibration,
        "m/s^2",
        re.compile(r"acc[xyz]?|accel\w*|useracceleration|beschl|\w*beschleunigung\w*|gforce"),
    ),
    (
        Quantity.vibration,
        "",
        re.compile(r"vib|vibr\w*|schwing\w*|iepe|icp|piezo\w*|seismic|körperschall"),
    ),
)
_ANGULAR_WORD = re.compile(_ROTATION)
_ELECTRIC_WORD = re.compile(r"voltage|spannung|volts?")
# Axes of an accelerometer: ax, a_y, AZ, a1x, gFx.
_ACCELERATION_AXIS = re.compile(r"(?:a[_ ]?\d*[_ ]?|gF|lin_?acc_?)[xyz]\d*", re.IGNORECASE)

_G_FORCE = re.compile(r"g[_ ]?force\w*", re.IGNORECASE)

_FREQUENCY_NAME = re.compile(
    r"f|ff|freqs?|frequenc(?:y|ies)|frequenz(?:en)?|hz|khz|cpm|orders?|ordnung(?:en)?|faxis"
)
_FREQUENCY_UNITS = {"hz", "khz", "mhz", "cpm", "order", "orders", "ordnung", "x rpm", "ord"}
_FREQUENCY_QUALIFIERS = {"axis", "achse", "vector", "in", "bins", "bin", "hz", "khz", "center", "f"}
_SPECTRUM_WORD = re.compile(
    r"psd\w*|pxx|pyy|pxy|asd|\w*spectr(?:um|a|al)|\w*spektrum|\w*spektren|fft|rfft|dft"
    r"|autopower|autospectrum|cepstrum|\w*leistungsdichte|amplitudengang|frf|coherence|kohärenz"
)
_SPECTRUM_UNIT = re.compile(r".*/\s*(?:√|sqrt)?\s*\(?\s*Hz\s*\)?(?:\^?0[.,]5)?", re.IGNORECASE)

_LABEL_WORDS = {
    *("label", "labels", "class", "classid", "klasse", "klassen", "target", "activity"),
    *("aktivität", "kategorie", "category", "groundtruth", "annotation"),
}
_STATE_WORDS = {
    *("state", "status", "zustand", "fault", "fehler", "mode", "modus", "flag", "event", "marker"),
    *("alarm", "trigger", "gear", "gang", "phase", "step", "schritt", "segment", "subject"),
    *("run", "condition", "stage", "error", "quality", "regime", "valid", "cycle", "zyklus", "on"),
}

# Units of other quantities that are no units of the registry, or mean something else there.
_OTHER_UNITS = {
    *("°c", "°f", "degc", "degf", "deg c", "deg f", "celsius", "fahrenheit", "kelvin", "°", "deg"),
    *("%", "percent", "%rh", "rh", "% rh", "ppm", "ppb", "db", "dbm", "dba", "db(a)", "dbfs"),
    *("lx", "lux", "lumen", "cd", "ut", "µt", "μt", "mt", "nt", "gauss", "mgauss", "tesla"),
    *("deg/s", "°/s", "dps", "mdps", "grad/s", "rad/s", "rad", "rev", "turns", "u", "rpm", "1/min"),
    *("u/min", "min-1", "upm", "gpm", "lpm", "l/min", "l/h", "m3/h", "m³/h", "cfm", "sccm"),
    *("cst", "ph", "ntu", "ohm", "kohm", "kω", "ω", "w", "kw", "va", "kva", "var", "wh", "kwh"),
    *("mah", "ah", "mbar", "bar", "bara", "barg", "psi", "psig", "psia", "pa", "hpa", "kpa"),
    *("mpa", "torr", "mmhg", "inhg", "nm", "n*m", "n·m", "n", "kn", "lbf", "kg", "lb", "lbs"),
    *("ft-lb", "hz", "khz"),
    *("µe", "µm/m", "um/m", "ustrain", "microstrain", "km/h", "kmh", "mph", "knots", "kn/h", "v/v"),
    *("us/cm", "µs/cm", "ms/cm", "usv/h", "µsv/h", "w/m2", "w/m²", "mm/h", "°brix", "iu", "bpm"),
}  # fmt: skip

# Units that stand behind a name without brackets: T_degF, B_uT, co2 ppm.
_TRAILING_UNITS = {
    *("degc", "degf", "celsius", "fahrenheit", "percent", "ppm", "ppb", "dbm", "dba", "lux", "lx"),
    *("ut", "gauss", "dps", "rpm", "upm", "gpm", "lpm", "bar", "mbar", "psi", "kpa", "mpa", "hpa"),
    *("kw", "kwh", "nm", "rh", "mah", "ohm", "hpa", "kmh", "mph", "µt", "pct"),
}

# Texts of a unit that say nothing.
_NO_UNIT = {"", "1", "-", "--", "none", "n/a", "na", "unknown", "raw", "counts", "count", "cts"}
_NO_UNIT |= {"lsb", "digits", "digit", "arb", "a.u.", "au", "a. u.", "bits", "adc", "fs", "dimless"}

_ELECTRIC_UNIT = re.compile(r"[nmuµμ]?V|[pn]C|[muµμ]?A")
_MOTION_UNITS = {"mm/s", "m/s", "um/s", "in/s", "ips", "mm", "um", "mil", "mils", "m", "µm"}
_MOTION_UNITS |= {"cm/s", "cm"}


def meaning_of_unit(unit: str) -> Meaning | None:
    """Return the quantity that a unit says, or None if it says nothing or is unknown.

    Examples
    --------
    >>> meaning_of_unit("mg").quantity, meaning_of_unit("dBm").reason, meaning_of_unit("left")
    (<Quantity.vibration: 'acceleration, or vibration of any kind'>, 'in dBm', None)
    """
    text = unit.strip()
    normal = normalize_unit(text)
    if text.lower() in _NO_UNIT:
        return None
    if _SPECTRUM_UNIT.fullmatch(text):
        return Meaning(Quantity.spectrum, f"in {text}")
    if normal in _MOTION_UNITS:
        return Meaning(Quantity.motion, f"in {text}")
    if _ELECTRIC_UNIT.fullmatch(normal):
        return Meaning(Quantity.electric, f"in {text}")
    if text.lower() in _FREQUENCY_UNITS:
        return Meaning(Quantity.frequency, f"in {text}")
    if text.lower() in _OTHER_UNITS or normal.lower() in _OTHER_UNITS:
        return Meaning(Quantity.other, f"in {text}")
    if text.lower() in _UNIT_WORDS or normal in ("us", "ms"):
        return Meaning(Quantity.time, f"in {text}")

    if recognize_unit(text) is None:
        return None
    if acceleration_factor(text) is not None:
        return Meaning(Quantity.vibration, f"in {text}")
    return Meaning(Quantity.other, f"in {text}")


_VIBRATING = (Quantity.vibration, Quantity.motion)
_SENSOR_QUANTITIES = (*_VIBRATING, Quantity.electric)


def is_sensor_unit(text: str) -> bool:
    """Return whether a sensor of vibration, or the converter behind it, has a unit.

    Examples
    --------
    >>> is_sensor_unit("m/s²"), is_sensor_unit("mV"), is_sensor_unit("LSB"), is_sensor_unit("°C")
    (True, True, True, False)
    """
    meaning = meaning_of_unit(text)
    if meaning is None:
        return text.lower() in _NO_UNIT
    return meaning.quantity in _SENSOR_QUANTITIES


@lru_cache(maxsize=1024)
def unknown_unit(name: str) -> str:
    """Return the text in the brackets of a name that is neither a known unit nor nothing.

    Examples
    --------
    >>> unknown_unit("q (foo)"), unknown_unit("q (dBm)"), unknown_unit("q [counts]")
    ('foo', '', '')
    """
    heading, text = split_heading(name_in_group(name))
    is_known = text.lower() in _NO_UNIT or _meaning_in_brackets(heading, text) is not None
    return "" if is_known else text


@lru_cache(maxsize=1024)
def meaning_of_name(name: str) -> Meaning | None:
    """Return the quantity that the name of a column says, or None.

    A unit of another quantity in brackets or at the end of the name counts first. If the name is
    that of an axis or says nothing, that of its group or structure counts.

    Examples
    --------
    >>> meaning_of_name("acc_x").quantity, meaning_of_name("oil temp").reason
    (<Quantity.vibration: 'acceleration, or vibration of any kind'>, 'a temperature')
    >>> meaning_of_name("T_degF").reason, meaning_of_name("Motor (DE)"), meaning_of_name("X")
    ('in degF', None, None)
    >>> meaning_of_name("gyro.x").reason, meaning_of_name("speed_860/x")
    ('a rotation', None)
    """
    heading, unit_text = split_heading(name_in_group(name))
    in_brackets = _meaning_in_brackets(heading, unit_text)
    if in_brackets is not None and in_brackets.quantity not in _SENSOR_QUANTITIES:
        return in_brackets

    in_name = _meaning_of_heading(heading)
    if in_name is None and _says_nothing(heading):
        in_name = _meaning_of_groups(name)
    if in_name is not None and in_name.quantity not in _SENSOR_QUANTITIES:
        return in_name  # a position in mm is not a vibration
    return in_brackets or in_name


def names_other(name: str) -> bool:
    """Return whether a name is that of a quantity that neither vibrates nor is the time."""
    meaning = meaning_of_name(name)
    return meaning is not None and meaning.quantity in (Quantity.other, Quantity.label)


def may_name_signal(name: str) -> bool:
    """Return whether a name, with its unit, may be that of a sensor of vibration.

    Examples
    --------
    >>> may_name_signal("CH1"), may_name_signal("time [s]"), may_name_signal("battery")
    (True, False, False)
    """
    meaning = meaning_of_name(name)
    return meaning is None or meaning.quantity in _SENSOR_QUANTITIES


def names_signal(name: str, unit: str) -> bool:
    """Return whether a name, or a unit that stands elsewhere, is clearly that of a vibration.

    Examples
    --------
    >>> names_signal("acc_x", ""), names_signal("CH1", "g"), names_signal("CH1", "V")
    (True, True, False)
    """
    if not may_name_signal(name):
        return False
    meanings = (meaning_of_name(name), meaning_of_unit(unit))
    is_vibrating = any(meaning and meaning.quantity in _VIBRATING for meaning in meanings)
    return is_vibrating or axis_stem(name) is not None


def is_foreign_unit(text: str) -> bool:
    """Return whether the text of a unit is not a unit known here, and says something.

    Examples
    --------
    >>> is_foreign_unit("dBspl"), is_foreign_unit("g"), is_foreign_unit("counts")
    (True, False, False)
    """
    unit = text.strip()
    return unit.lower() not in _NO_UNIT and recognize_unit(unit) is None


def _meaning_in_brackets(heading: str, text: str) -> Meaning | None:
    """Return what a text in brackets says; a word or a letter may be the place of a sensor."""
    may_be_word = re.fullmatch(r"[A-Za-z]\w*", text) is not None
    is_listed = text.lower() in _OTHER_UNITS | _FREQUENCY_UNITS | _MOTION_UNITS
    is_sample_unit = normalize_unit(text) in ("g", "mg", "m/s^2", "mm/s^2", "V", "mV", "uV")
    is_time = text.lower() in _UNIT_WORDS and (text != "d" or parse_time_name(heading) is not None)
    if may_be_word and not (is_listed or is_sample_unit or is_time):
        return None
    return meaning_of_unit(text)


def _meaning_of_groups(name: str) -> Meaning | None:
    """Return what the nearest group or structure that says anything says of its columns."""
    groups = [words_of(part) for part in re.split(r"[./]", name)[:-1]]
    for name_words in reversed(groups):
        if not name_words or any(map(str.isdecimal, name_words)):
            continue  # speed_860 is the condition of a measurement
        meaning = _meaning_of_heading(" ".join(name_words))
        if meaning is not None:
            return meaning
    return None


def _meaning_of_heading(heading: str) -> Meaning | None:
    """Return the quantity that a name says without its groups and brackets, or None."""
    name_words = [word for word in words_of(heading) if not word.isdecimal()]
    if not name_words:
        return None
    if _has_word(name_words, _SPECTRUM_WORD):
        return Meaning(Quantity.spectrum, Quantity.spectrum.value)
    if parse_time_name(heading):
        return Meaning(Quantity.time, Quantity.time.value)
    if _names_frequency(name_words):
        return Meaning(Quantity.frequency, Quantity.frequency.value)

    return (
        _meaning_of_motion(heading, name_words)
        or _other_meaning(words_of(heading))
        or _meaning_of_last_part(heading)
        or _meaning_of_output(name_words)
    )


def _has_word(name_words: list[str], pattern: re.Pattern[str]) -> bool:
    return any(pattern.fullmatch(word) for word in name_words)


def _meaning_of_motion(heading: str, name_words: list[str]) -> Meaning | None:
    """Return that the words name a velocity, a displacement or a vibration, or None."""
    if _ACCELERATION_AXIS.fullmatch(heading) or _G_FORCE.fullmatch(heading):
        return Meaning(Quantity.vibration, "an axis of acceleration")
    if _has_word(name_words, _ANGULAR_WORD):
        return None
    for quantity, dimension, pattern in _VIBRATION_WORDS:
        if _has_word(name_words, pattern):
            return Meaning(quantity, quantity.value, dimension)
    return None


def _meaning_of_last_part(heading: str) -> Meaning | None:
    """Return what a unit at the end of a name says, as in ``T_degF``, or None."""
    parts = re.split(r"[\s_]+", heading)
    if len(parts) > 1 and parts[-1].lower() in _TRAILING_UNITS:
        return Meaning(Quantity.other, f"in {parts[-1]}")
    return None


def _meaning_of_output(name_words: list[str]) -> Meaning | None:
    """Return that the words name the voltage of a sensor, or a class, or None."""
    if _has_word(name_words, _ELECTRIC_WORD):
        return Meaning(Quantity.electric, "a voltage")
    if not _LABEL_WORDS.isdisjoint(name_words):
        return Meaning(Quantity.label, Quantity.label.value)
    return None


def _names_frequency(name_words: list[str]) -> bool:
    if _FREQUENCY_NAME.fullmatch(name_words[0]) is None:
        return False
    return all(
        _FREQUENCY_NAME.fullmatch(word) or word in _FREQUENCY_QUALIFIERS for word in name_words
    )


def _other_meaning(name_words: list[str]) -> Meaning | None:
    """Return the other quantity that the words say, but for the name of a sensor's place."""
    for pattern, dimension, text in _OTHER_PATTERNS:
        for number, word in enumerate(name_words):
            following = name_words[number + 1 :]
            pair = "_".join(name_words[number : number + 2])
            if pattern.fullmatch(word) and _SIDE_WORDS.isdisjoint(following):
                if word not in _QUANTITIES_OR_PLACES:
                    return Meaning(Quantity.other, text, dimension)
                if not _names_part(following):
                    return Meaning(Quantity.other, text, dimension, _place_support(word, following))
            if pattern.fullmatch(pair) and _SIDE_WORDS.isdisjoint(following[1:]):
                return Meaning(Quantity.other, text, dimension)
    return None


def _place_support(word: str, following: list[str]) -> PlaceSupport:
    """Return by what a word of a quantity, and what follows it, may name a place."""
    for later in following:
        is_letter = len(later) == 1 and later not in _AXIS_WORDS
        is_number = later.isdecimal() or is_letter or later in _DIRECTION_WORDS
        if is_number and word not in _NEVER_NUMBERED:
            return PlaceSupport.number
    return PlaceSupport.part if word in _QUANTITIES_OR_PARTS else PlaceSupport.columns


def _names_part(name_words: Iterable[str]) -> bool:
    return any(
        word in _PART_WORDS
        or word.removesuffix("s") in _PART_WORDS
        or _PART_COMPOUND.fullmatch(word)
        for word in name_words
    )


def names_state(name: str) -> bool:
    """Return whether the name of a column may be that of a state, as of a signal."""
    return not _STATE_WORDS.isdisjoint(words_of(name_in_group(name)))


# Words of a column that say nothing of what it holds.
_EMPTY_WORDS = {
    *("column", "col", "spalte", "data", "daten", "var", "variable", "value", "values", "wert"),
    *("channel", "chan", "ch", "kanal", "field", "series", "vector", "array", "matrix", "unnamed"),
    *("abscissa", "axis", "achse", "tick", "ticks", "signal", "sample", "samples", "index", "idx"),
}

# Words of the direction or side of a sensor.
_DIRECTION_WORDS = {
    *("de", "nde", "fe", "ba", "ds", "os", "front", "rear", "left", "right", "top", "bottom", "up"),
    *("down", "inner", "outer", "inlet", "outlet", "side", "end", "drive", "nondrive", "axial"),
    *("radial", "tangential", "horizontal", "vertical", "hor", "ver", "vert", "ax", "rad", "tan"),
    *("lateral", "longitudinal", "transverse", "trans", "vorne", "hinten", "links", "rechts"),
    *("oben", "unten", "innen", "außen", "aussen", "seite", "quer", "längs", "seitlich", "mitte"),
    *("north", "south", "east", "west", "middle", "center", "upper", "lower", "hss"),
    *("lss", "ims", "vertikal", "tangentiell", "near", "far", "out"),
}

# Words of parts of machines, and of their sensors.
_PART_WORDS = {
    *("motor", "pump", "gear", "gearbox", "bearing", "shaft", "housing", "case", "casing", "base"),
    *("plate", "valve", "swash", "swashplate", "frame", "flange", "cover", "foundation", "table"),
    *("fan", "blower", "rotor", "stator", "wheel", "compressor", "turbine", "impeller", "coupling"),
    *("spindle", "roller", "blade", "tower", "nacelle", "hub", "generator", "exciter", "engine"),
    *("cylinder", "piston", "rod", "crank", "crankshaft", "camshaft", "cam", "head", "block"),
    *("pinion", "planet", "sun", "ring", "carrier", "stage", "tooth", "belt", "pulley", "chain"),
    *("sprocket", "conveyor", "drum", "mill", "crusher", "screen", "mixer", "agitator", "extruder"),
    *("screw", "nut", "chuck", "tailstock", "tool", "hammer", "anvil", "barrel", "nozzle", "seal"),
    *("cage", "race", "raceway", "ball", "journal", "pad", "axle", "bogie", "wheelset", "rail"),
    *("wall", "floor", "roof", "pipe", "tube", "beam", "bed", "pedestal", "skid", "slipper"),
    *("mount", "mounting", "bracket", "foot", "arm", "joint", "link", "winding", "core", "yoke"),
    *("transformer", "machine", "unit", "load", "brake", "clutch", "retainer"),
    *("pumpe", "getriebe", "lager", "welle", "gehäuse", "gehaeuse", "flansch", "deckel", "platte"),
    *("saugseite", "druckseite", "antrieb", "abtrieb", "fundament", "sensor", "sensors", "imu"),
    *("kupplung", "lüfter", "verdichter", "ventilator", "gebläse", "läufer", "ständer", "rad"),
    *("laufrad", "tragrolle", "spindel", "walze", "rolle", "zylinder", "kolben", "ventil"),
    *(
        "ritzel",
        "stirnrad",
        "kegelrad",
        "rotorblatt",
        "schaufel",
        "schwungrad",
        "schlitten",
        "tisch",
    ),
    *("zahnrad", "riemen", "kette", "trommel", "mühle", "brecher", "turm", "gondel", "nabe"),
    *("flügel", "schnecke", "mutter", "düse", "dach", "wand", "decke", "boden", "rohr", "rahmen"),
    *("träger", "bett", "sockel", "fuß", "fuss", "halter", "gelenk", "wicklung", "kern"),
    *("maschine", "aggregat", "bremse", "dichtung", "käfig", "innenring", "außenring", "kurbel"),
    *("aufnehmer", "messstelle", "point", "punkt", "location", "input", "output", "mp", "pos"),
}

# German compounds that end with a part or a side, such as Antriebsseite or Kegelrad.
_PART_COMPOUND = re.compile(
    r"\w+(?:seite|lager|welle|pumpe|motor|getriebe|gehäuse|flansch|deckel|platte|walze|kupplung"
    r"|zylinder|kolben|ventil|block|bock|tisch|stütze|schlitten|stück|scheibe|spindel|(?<!g)rad"
    r"|bearing|shaft|wheel|pump|gear|plate)"
)

# Words of the axes of a sensor, which say nothing of its place.
_AXIS_WORDS = {"x", "y", "z", "magnitude", "norm", "total", "abs", "sum"}


def names_place(name: str) -> bool:
    """Return whether a name, or the text in its brackets, holds the place of a sensor.

    Examples
    --------
    >>> names_place("Motor (DE)"), names_place("Lager_2"), names_place("quality")
    (True, True, False)
    """
    name_words = words_of(name_in_group(name))
    is_direction = not (_DIRECTION_WORDS | _AXIS_WORDS | {"position"}).isdisjoint(name_words)
    return is_direction or _names_part(name_words)


def names_machine_place(name: str) -> bool:
    """Return whether a name holds a part of a machine, a side or a direction, but no mere axis.

    Examples
    --------
    >>> names_machine_place("Rotor"), names_machine_place("vert"), names_machine_place("X")
    (True, True, False)
    """
    name_words = words_of(name_in_group(name))
    return not _DIRECTION_WORDS.isdisjoint(name_words) or _names_part(name_words)


# Single letters that stand for another quantity than the time.
_TELLING_LETTERS = {"f", "p", "n", "w", "phi", "rad", "deg", "rpm", "hz"}


def is_name_empty(name: str) -> bool:
    """Return whether the name of a column says nothing, so that its numbers may be the time.

    Examples
    --------
    >>> is_name_empty("column_0"), is_name_empty("H(:,1)"), is_name_empty("pressure")
    (True, True, False)
    """
    if unknown_unit(name) or meaning_of_name(name) is not None:
        return False
    return _says_nothing(split_heading(name_in_group(name))[0])


def _says_nothing(heading: str) -> bool:
    return all(
        word in _EMPTY_WORDS or (len(word) < 3 and word not in _TELLING_LETTERS) or word.isdecimal()
        for word in words_of(heading)
    )


def axis_stem(name: str) -> str | None:
    """Return the name of a sensor without the letter of its axis, or None if it has none.

    Examples
    --------
    >>> axis_stem("gx"), axis_stem("mag_Y"), axis_stem("X"), axis_stem("max")
    ('g', 'mag', '', None)
    """
    heading, _ = split_heading(name)
    match = _AXIS_END.fullmatch(heading)
    if match is None:
        return None

    stem, separator, axis, number = match.groups()
    is_capital = stem[-1:].islower() and axis.isupper()
    is_known = _AXIS_STEM.fullmatch(stem) is not None
    if not (separator or is_capital or is_known or len(stem) < 2):
        return None
    return (stem + number).lower()


_AXIS_STEM = re.compile(r"acc|accel|acceleration|vib|gyr|gyro|mag|rot|vel|disp", re.IGNORECASE)
_AXIS_END = re.compile(r"(.*?)([_ .\-/]*)([xyzXYZ])(\d*)")


def family_of(name: str) -> str:
    """Return the name of a column without the number or letter that tells it from its like.

    Examples
    --------
    >>> family_of("ai0"), family_of("Kanal B"), family_of("X"), family_of("battery")
    ('ai', 'kanal', '', 'battery')
    """
    stem = axis_stem(name)
    if stem is not None:
        return stem
    heading, _ = split_heading(name)
    return re.sub(r"[_ .-]*\d+$|[_ .-]+[a-zA-Z]$|^[a-zA-Z]$", "", heading).lower()
