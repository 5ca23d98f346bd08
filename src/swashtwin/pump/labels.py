"""Fault classes: what a classifier names, and the words in which people write them."""

import difflib
import re
import unicodedata

from swashtwin.foundation import InputError, plain_text

CLASSES = ("normal", "swash_plate", "cylinder_block", "piston", "valve_plate")
"""The paper's five classes, in its order."""

# What people call the class of a machine that nothing is wrong with.
_HEALTHY = (
    "healthy", "ok", "okay", "good", "baseline", "intact", "undamaged", "faultless", "fault_free", "no_fault",
    "no_defect", "gesund", "gut", "in_ordnung", "io", "i_o", "fehlerfrei", "unbeschädigt", "intakt", "sain", "bon",
    "sans_défaut", "sano", "bueno", "sin_fallo", "正常", "健康", "完好",
)  # fmt: skip

ALIASES = {
    **dict.fromkeys(_HEALTHY, CLASSES[0]),
    **dict.fromkeys(("swashplate", "swash"), "swash_plate"),
    **dict.fromkeys(("cylinder", "block", "rotor"), "cylinder_block"),
    **dict.fromkeys(("valve", "port_plate"), "valve_plate"),
    "plunger": "piston",
    "slipper": "loose_slipper",
}
"""Other names in use for the classes; read, never written."""

# Words for a part in English, German, French, Spanish and Chinese, without accents; the first class
# that fits is meant, so that a `Kolbentrommel` is no piston.
_PARTS = {
    "cylinder_block": ("cylinder_block", "cylinder_barrel", "zylinderblock", "zylindertrommel", "kolbentrommel",
                       "bloc_cylindre", "barillet", "bloque_de_cilindro", "barrilete", "缸体"),
    "loose_slipper": ("slipper", "piston_shoe", "kolbenschuh", "gleitschuh", "patin", "zapata", "滑靴"),
    "swash_plate": ("swash", "schragscheibe", "schraegscheibe", "schwenkscheibe", "taumelscheibe", "plateau_incline",
                    "plateau_oscillant", "plato_inclinado", "plato_oscilante", "斜盘"),
    "valve_plate": ("valve_plate", "valveplate", "port_plate", "steuerplatte", "steuerscheibe", "steuerspiegel",
                    "glace_de_distribution", "plaque_de_distribution", "placa_de_valvula", "placa_de_distribucion",
                    "配流盘", "配油盘"),
    "piston": ("piston", "plunger", "kolben", "embolo", "柱塞", "活塞"),
}  # fmt: skip

# Words for the whole machine, which name no part of it.
_MACHINES = re.compile(
    r"(axial|radial)?_?(piston_pump|pump_piston|kolbenpumpe\w*|kolbenmaschine\w*|pompe_a_pistons?|bomba_de_pistones)"
    r"|柱塞泵|活塞泵"
)

# Words by which a label may say that its part is sound; a person must decide.
_SOUND = re.compile(
    r"(^|_)(no|non|not|ohne|kein\w*|sans|sin|without|new|neu\w*|ok|okay|good|gut\w*|healthy|intact|intakt)(_|$)|无|正常|新"
)


def canonical_label(text: str, classes: tuple[str, ...] = CLASSES) -> str:
    """Class name that `text` stands for.

    Raises
    ------
    InputError
        It stands for none; the nearest is offered.

    Examples
    --------
    >>> canonical_label("Plunger fault")
    'piston'
    """
    if not isinstance(text, str):
        raise InputError(f"{text!r} is no class; the classes are {', '.join(classes)}.")
    if is_healthy(text) and CLASSES[0] in classes:
        return CLASSES[0]
    word = _word(text).removesuffix("fault").removesuffix("_")
    if word in classes:
        return word
    if ALIASES.get(word) in classes:
        return ALIASES[word]
    if (proposed := propose_class(text)) in classes:
        return str(proposed)
    names = [*classes, *(alias for alias, target in ALIASES.items() if target in classes)]
    near = difflib.get_close_matches(word, names, n=1, cutoff=0.55)
    hint = f" Did you mean {ALIASES.get(near[0], near[0])!r}?" if near else ""
    raise InputError(f"unknown class {text!r}; the classes are {', '.join(classes)}.{hint}")


def propose_class(label: str) -> str | None:
    """Class that a label's words suggest, in English, German, French, Spanish or Chinese; None
    where they do not, or say that the part is sound.

    Examples
    --------
    >>> propose_class("Kolbenverschleiß"), propose_class("plateau incliné usé"), propose_class("配流盘磨损")
    ('piston', 'swash_plate', 'valve_plate')
    """
    if is_healthy(label):
        return CLASSES[0]
    plain = "".join(
        char
        for char in unicodedata.normalize("NFKD", _word(label))
        if not unicodedata.combining(char)
    )
    part = _MACHINES.sub("", plain)
    if _SOUND.search(part):
        return None
    patterns = {
        name: "|".join(
            rf"(^|_|\d){word}" if word.isascii() else word for word in words
        )  # Chinese has no gaps
        for name, words in _PARTS.items()
    }
    return next((name for name, pattern in patterns.items() if re.search(pattern, part)), None)


def is_healthy(label: str | None) -> bool:
    """Whether a label says that nothing is wrong: ``"normal"``, ``"healthy"``, ``"ok"``, ``"gut"``
    and their like.

    Examples
    --------
    >>> is_healthy("In Ordnung"), is_healthy("piston"), is_healthy(None)
    (True, False, False)
    """
    word = "" if label is None else _word(label)
    return ALIASES.get(word, word) == CLASSES[0]


def _word(label: str) -> str:
    """A label in small letters and one Unicode form, an underscore for each gap, point and
    hyphen.
    """
    text = unicodedata.normalize("NFKC", label).casefold()
    return re.sub(r"[\s._-]+", "_", text).strip("_")


def is_same_class(first: str | None, second: str | None) -> bool:
    """Whether two labels are equal, or both healthy."""
    if first is None or second is None:
        return first == second
    return plain_text(first) == plain_text(second) or (is_healthy(first) and is_healthy(second))
