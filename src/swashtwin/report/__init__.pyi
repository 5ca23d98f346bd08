"""Names that other rooms import, and where each lives."""

from .calibration_part import calibration_blocks as calibration_blocks
from .calibration_part import verdict_counts as verdict_counts
from .drawing import Drawing as Drawing
from .drawing import cutaway_html as cutaway_html
from .drawing import render_drawing as render_drawing
from .drawing import tabulate as tabulate
from .indicator_figures import spectrum_drawing as spectrum_drawing
from .indicator_figures import trend_drawing as trend_drawing
from .model_part import confusion_drawing as confusion_drawing
from .page import Bullets as Bullets
from .page import Cell as Cell
from .page import Group as Group
from .page import Part as Part
from .page import Section as Section
from .page import SectionOrder as SectionOrder
from .page import Table as Table
from .page import drawings as drawings
from .wording import facts_table as facts_table
from .wording import flatten_settings as flatten_settings
from .wording import number as number
from .wording import percent as percent
from .writing import page_text as page_text
from .writing import part_of as part_of
from .writing import write_report as write_report
