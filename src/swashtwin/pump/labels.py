"""Fault classes of the classifiers, and the words that people write for them."""

import re
import unicodedata

from swashtwin.foundation import InputError, closest_name, plain_text

CLASSES = ("normal", "swash_plate", "cylinder_block", "piston", "valve_plate")
"""The paper's five classes, in its order."""

# Words for a healthy machine. Labels come from users' files, in the languages of `propose_class`.
_HEALTHY = (
    "healthy",
    "ok",
    "okay",
    "good",
    "baseline",
    "intact",
    "undamaged",
    "faultless",
    "fault_free",
    "no_fault",
    "no_defect",
    "gesund",
    "gut",
    "in_ordnung",
    "io",
    "i_o",
    "fehlerfrei",
    "unbeschädigt",
    "intakt",
    "sain",
    "bon",
    "sans_défaut",
    "sano",
    "bueno",
    "sin_fallo",
    "正常",
    "健康",
    "完好",
)

ALIASES = {
    **dict.fromkeys(_HEALTHY, CLASSES[0]),
    **dict.fromkeys(("swashplate", "swash"), "swash_plate"),
    **dict.fromkeys(("cylinder", "block", "rotor"), "cylinder_block"),
    **dict.fromkeys(("valve", "port_plate"), "valve_plate"),
    "plunger": "piston",
    "slipper": "loose_slipper",
}
"""Other names of the classes, which are read but never written."""


# Words for a part in English, German, French, Spanish and Chinese, without accents. The first class
# that matches counts, so that a `Kolbentrommel` (cylinder block) does not match `kolben` (piston).
_PARTS = {
    "cylinder_block": (
        "cylinder_block",
        "cylinder_barrel",
        "zylinderblock",
        "zylindertrommel",
        "kolbentrommel",
        "bloc_cylindre",
        "barillet",
        "bloque_de_cilindro",
        "barrilete",
        "缸体",
    ),
    "loose_slipper": (
        "slipper",
        "piston_shoe",
        "kolbenschuh",
        "gleitschuh",
        "patin",
        "zapata",
        "滑靴",
    ),
    "swash_plate": (
        "swash",
        "schragscheibe",
        "schraegscheibe",
        "schwenkscheibe",
        "taumelscheibe",
        "plateau_incline",
        "plateau_oscillant",
        "plato_inclinado",
        "plato_oscilante",
        "斜盘",
    ),
    "valve_plate": (
        "valve_plate",
        "valveplate",
        "port_plate",
        "steuerplatte",
        "steuerscheibe",
        "steuerspiegel",
        "glace_de_distribution",
        "plaque_de_distribution",
        "placa_de_valvula",
        "placa_de_distribucion",
        "配流盘",
        "配油盘",
    ),
    "piston": ("piston", "plunger", "kolben", "embolo", "柱塞", "活塞"),
}

# Words for the whole machine, taken out first: a `piston pump` does not name its piston.
_MACHINES = re.compile(
    r"(axial|radial)?_?(piston_pump|pump_piston|kolbenpumpe\w*|kolbenmaschine\w*|pompe_a_pistons?|bomba_de_pistones)"
    r"|柱塞泵|活塞泵"
)

# Words by which a label may state that its part is healthy (`new piston`, `piston ok`): no class is
# proposed, and a person decides.
_SOUND = re.compile(
    r"(^|_)(no|non|not|ohne|kein\w*|sans|sin|without|new|neu\w*|ok|okay|good|gut\w*|healthy|intact|intakt)(_|$)|无|正常|新"
)


def canonical_label(text: str, classes: tuple[str, ...] = CLASSES, *, noun: str = "class") -> str:
    """Return the class that `text` names.

    Parameters
    ----------
    noun : what the classes are, for messages.

    Raises
    ------
    InputError
        It names no class; the nearest is offered.

    Examples
    --------
    >>> canonical_label("Plunger fault")
    'piston'
    """
    if not isinstance(text, str):
        raise InputError(f"Invalid {noun} {text!r}: must be one of {', '.join(classes)}.")
    if is_healthy(text) and CLASSES[0] in classes:
        return CLASSES[0]

    word = _normalize(text).removesuffix("fault").removesuffix("_")
    for candidate in (word, ALIASES.get(word), propose_class(text)):
        if candidate in classes:
            return str(candidate)

    names = [*classes, *(alias for alias, target in ALIASES.items() if target in classes)]
    suggestion = closest_name(word, names)
    hint = f" Did you mean {ALIASES.get(suggestion, suggestion)!r}?" if suggestion else ""
    raise InputError(f"Invalid {noun} {text!r}: must be one of {', '.join(classes)}.{hint}")


def propose_class(label: str) -> str | None:
    """Return the class that a label's words suggest.

    The words may be English, German, French, Spanish or Chinese. None if they suggest no class, or
    state that the part is healthy.

    Examples
    --------
    >>> propose_class("Kolbenverschleiß"), propose_class("plateau incliné usé")
    ('piston', 'swash_plate')
    >>> propose_class("配流盘磨损")
    'valve_plate'
    """
    if is_healthy(label):
        return CLASSES[0]

    decomposed = unicodedata.normalize("NFKD", _normalize(label))
    without_accents = "".join(char for char in decomposed if not unicodedata.combining(char))
    text = _MACHINES.sub("", without_accents)
    if _SOUND.search(text):
        return None
    for name, part_names in _PARTS.items():
        if any(_names_part(text, part_name) for part_name in part_names):
            return name
    return None


def _names_part(text: str, part_name: str) -> bool:
    """Return whether a word of `text` begins with `part_name`."""
    # Chinese has no gaps between words.
    pattern = rf"(^|_|\d){part_name}" if part_name.isascii() else part_name
    return re.search(pattern, text) is not None


def is_healthy(label: str | None) -> bool:
    """Return whether a label states that nothing is wrong, such as ``"normal"`` or ``"gut"``.

    Examples
    --------
    >>> is_healthy("In Ordnung"), is_healthy("piston"), is_healthy(None)
    (True, False, False)
    """
    word = "" if label is None else _normalize(label)
    return ALIASES.get(word, word) == CLASSES[0]


def _normalize(label: str) -> str:
    """Return a label in lower case and one Unicode form, with underscores as separators.

    An underscore replaces each run of spaces, periods and hyphens.
    """
    text = unicodedata.normalize("NFKC", label).casefold()
    return re.sub(r"[\s._-]+", "_", text).strip("_")


def is_same_class(first: str | None, second: str | None) -> bool:
    """Return whether two labels are equal, or both healthy."""
    if first is None or second is None:
        return first == second
    return plain_text(first) == plain_text(second) or (is_healthy(first) and is_healthy(second))
