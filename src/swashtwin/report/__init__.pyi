"""Names that other rooms import, and where each lives."""

from .calibration_part import calibration_blocks as calibration_blocks
from .calibration_part import comparison_table as comparison_table
from .calibration_part import verdict_counts as verdict_counts
from .confusion import confusion_drawing as confusion_drawing
from .drawing import Drawing as Drawing
from .drawing import apart as apart
from .drawing import drawn as drawn
from .drawing import name_decades as name_decades
from .drawing import panels as panels
from .drawing import ratio_axis as ratio_axis
from .drawing import table as table
from .indicator_figures import spectrum_drawing as spectrum_drawing
from .indicator_figures import trend_drawing as trend_drawing
from .page import CALIBRATION as CALIBRATION
from .page import PROVENANCE as PROVENANCE
from .page import SCORES as SCORES
from .page import TRAINING as TRAINING
from .page import Bullets as Bullets
from .page import Cell as Cell
from .page import Group as Group
from .page import Paragraph as Paragraph
from .page import Part as Part
from .page import Picture as Picture
from .page import Section as Section
from .page import Table as Table
from .scores_part import levels_table as levels_table
from .style import CALIBRATED as CALIBRATED
from .style import LEVEL_MARKERS as LEVEL_MARKERS
from .style import LIGHT as LIGHT
from .style import MEASURED as MEASURED
from .style import class_colors as class_colors
from .style import series_colors as series_colors
from .style import styled as styled
from .style import training_set_colors as training_set_colors
from .wording import facts as facts
from .wording import flattened as flattened
from .wording import number as number
from .wording import plural as plural
from .wording import score as score
from .wording import words as words
from .writing import write_report as write_report

__all__ = [
    "CALIBRATED",
    "CALIBRATION",
    "LEVEL_MARKERS",
    "LIGHT",
    "MEASURED",
    "PROVENANCE",
    "SCORES",
    "TRAINING",
    "Bullets",
    "Cell",
    "Drawing",
    "Group",
    "Paragraph",
    "Part",
    "Picture",
    "Section",
    "Table",
    "apart",
    "calibration_blocks",
    "class_colors",
    "comparison_table",
    "confusion_drawing",
    "drawn",
    "facts",
    "flattened",
    "levels_table",
    "name_decades",
    "number",
    "panels",
    "plural",
    "ratio_axis",
    "score",
    "series_colors",
    "spectrum_drawing",
    "styled",
    "table",
    "training_set_colors",
    "trend_drawing",
    "verdict_counts",
    "words",
    "write_report",
]
