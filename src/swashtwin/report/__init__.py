"""Results as one HTML page, with every figure and its data beside it. The only room that draws."""

from swashtwin.report.writing import write_report

__all__ = ["write_report"]
