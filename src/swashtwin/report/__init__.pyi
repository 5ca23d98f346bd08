"""Names that other rooms import, and where each lives."""

from .calibration_part import build_calibration_blocks as build_calibration_blocks
from .calibration_part import describe_verdicts as describe_verdicts
from .drawing import Drawing as Drawing
from .drawing import render_cutaway as render_cutaway
from .drawing import render_drawing as render_drawing
from .drawing import tabulate as tabulate
from .indicator_figures import draw_spectrum as draw_spectrum
from .indicator_figures import draw_trend as draw_trend
from .living_pump import LivingPump as LivingPump
from .living_pump import describe_turn as describe_turn
from .model_part import draw_confusion as draw_confusion
from .page import Bullets as Bullets
from .page import Cell as Cell
from .page import Group as Group
from .page import Part as Part
from .page import Section as Section
from .page import SectionOrder as SectionOrder
from .page import Table as Table
from .page import iterate_drawings as iterate_drawings
from .wording import build_facts_table as build_facts_table
from .wording import flatten_settings as flatten_settings
from .wording import format_number as format_number
from .wording import format_percent as format_percent
from .writing import build_part as build_part
from .writing import render_page as render_page
from .writing import write_report as write_report
