"""Text from files and people, made safe to show: no control character leaves as it came."""

import re

from swashtwin.foundation.texts import CONTROLS

_NO_XML = "\ud800-\udfff\ufffe\uffff"
_HIDDEN = re.compile(f"[{CONTROLS}{_NO_XML}]")


def escape_controls(text: str, *, keep: str = "") -> str:
    r"""The text with every character that steers a terminal, or that XML does not allow, written as its code.

    These are the C0 and C1 control characters, those that change the direction of writing or take no room, lone
    surrogates and non-characters.

    Parameters
    ----------
    keep : control characters that stay, such as line ends.

    Examples
    --------
    >>> escape_controls("pump\x1b[2J A\n")
    'pump\\x1b[2J A\\n'
    >>> escape_controls("two\nlines", keep="\n")
    'two\nlines'
    """
    return _HIDDEN.sub(lambda match: match[0] if match[0] in keep else _code(match[0]), text)


def _code(character: str) -> str:
    """Its escape sequence; from 127 on one that JSON knows as well, whose writers leave these as they are."""
    number = ord(character)
    return character.encode("unicode_escape").decode("ascii") if number < 0x7F else f"\\u{number:04x}"
