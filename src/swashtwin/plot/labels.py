"""Labels, which pages without a figure of matplotlib need too."""

from swashtwin.foundation import escape_controls


def format_label(label: str) -> str:
    """Return the name of a class, a sensor or a setting in words, without control characters."""
    return escape_controls(label.replace("_", " "))
