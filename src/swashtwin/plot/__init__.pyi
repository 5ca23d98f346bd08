"""Names that other rooms import, and where each lives: two figures, then what all figures share."""

from .figures import confusion as confusion
from .figures import spectrum as spectrum
from .figures import unit_words as unit_words
from .style import CALIBRATED as CALIBRATED
from .style import INTERFACE_COLORS as INTERFACE_COLORS
from .style import LIGHT as LIGHT
from .style import MEASURED as MEASURED
from .style import NOMINAL as NOMINAL
from .style import ON_DARK as ON_DARK
from .style import ON_SHADE as ON_SHADE
from .style import figure_style as figure_style
from .style import log_axis as log_axis
from .style import panels as panels
from .style import series_colors as series_colors
from .style import words as words
