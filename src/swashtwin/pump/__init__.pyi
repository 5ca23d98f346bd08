"""Names that other rooms import, and where each lives."""

from .catalog import SECTIONS as SECTIONS
from .catalog import available_pumps as available_pumps
from .catalog import load_pump as load_pump
from .catalog import new_pump as new_pump
from .condition import PRESSURE_TOLERANCE as PRESSURE_TOLERANCE
from .condition import SPEED_TOLERANCE as SPEED_TOLERANCE
from .condition import OperatingCondition as OperatingCondition
from .condition import group_by_condition as group_by_condition
from .condition import merge_close_values as merge_close_values
from .condition import values_match as values_match
from .faults import CLASSES as CLASSES
from .faults import FAULT_KINDS as FAULT_KINDS
from .faults import BoreDefect as BoreDefect
from .faults import DamScratch as DamScratch
from .faults import Fault as Fault
from .faults import GrooveErosion as GrooveErosion
from .faults import LooseSlipper as LooseSlipper
from .faults import PistonWear as PistonWear
from .faults import SealingLandScratch as SealingLandScratch
from .faults import SwashPlateDefect as SwashPlateDefect
from .faults import TiltedBlockFace as TiltedBlockFace
from .faults import ValvePlateWear as ValvePlateWear
from .faults import canonical_label as canonical_label
from .faults import fault_type as fault_type
from .faults import is_healthy as is_healthy
from .faults import is_same_class as is_same_class
from .faults import register_fault as register_fault
from .geometry import stroke_of as stroke_of
from .numbers import pump_numbers as pump_numbers
from .numbers import with_number as with_number
from .parameters import LETTERS as LETTERS
from .parameters import PARAMETERS as PARAMETERS
from .parameters import Bearings as Bearings
from .parameters import Interface as Interface
from .parameters import Interfaces as Interfaces
from .parameters import InterfaceValue as InterfaceValue
from .parameters import Pump as Pump
from .parameters import Rated as Rated
from .parameters import Sensor as Sensor
from .parsing import read_condition as read_condition
from .parsing import read_fault as read_fault
from .scaling import Nameplate as Nameplate
from .scaling import read_nameplate as read_nameplate
from .scaling import scaled_pump as scaled_pump
from .writing import in_trade_units as in_trade_units

__all__ = [
    "CLASSES",
    "FAULT_KINDS",
    "LETTERS",
    "PARAMETERS",
    "PRESSURE_TOLERANCE",
    "SECTIONS",
    "SPEED_TOLERANCE",
    "Bearings",
    "BoreDefect",
    "DamScratch",
    "Fault",
    "GrooveErosion",
    "Interface",
    "InterfaceValue",
    "Interfaces",
    "LooseSlipper",
    "Nameplate",
    "OperatingCondition",
    "PistonWear",
    "Pump",
    "Rated",
    "SealingLandScratch",
    "Sensor",
    "SwashPlateDefect",
    "TiltedBlockFace",
    "ValvePlateWear",
    "available_pumps",
    "canonical_label",
    "fault_type",
    "group_by_condition",
    "in_trade_units",
    "is_healthy",
    "is_same_class",
    "load_pump",
    "merge_close_values",
    "new_pump",
    "pump_numbers",
    "read_condition",
    "read_fault",
    "read_nameplate",
    "register_fault",
    "scaled_pump",
    "stroke_of",
    "values_match",
    "with_number",
]
