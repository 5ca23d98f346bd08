"""Names that other rooms import, and where each lives: two figures, then what all figures share."""

from .figures import confusion as confusion
from .figures import format_unit as format_unit
from .figures import spectrum as spectrum
from .labels import format_label as format_label
from .phone import fit_to_phone as fit_to_phone
from .style import CALIBRATED as CALIBRATED
from .style import INTERFACE_COLORS as INTERFACE_COLORS
from .style import LIGHT as LIGHT
from .style import MEASURED as MEASURED
from .style import NOMINAL as NOMINAL
from .style import ON_DARK as ON_DARK
from .style import ON_SHADE as ON_SHADE
from .style import create_panels as create_panels
from .style import figure_style as figure_style
from .style import label_log_axis as label_log_axis
from .style import series_colors as series_colors
