"""Windows that nobody measured: made with a twin, or from measured windows alone."""

from swashtwin.augmentation.synthesis import synthesize
from swashtwin.augmentation.variation import DEFAULT_VARIATION, Variation, drawn

__all__ = ["DEFAULT_VARIATION", "Variation", "drawn", "synthesize"]
