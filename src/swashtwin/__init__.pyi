"""Public names, and where each lives."""

from . import plot as plot
from . import presets as presets
from .calibration import Calibration as Calibration
from .calibration import calibrate as calibrate
from .calibration import estimate_severity as estimate_severity
from .calibration import identifiability as identifiability
from .calibration import load_calibration as load_calibration
from .diagnosis import AnomalyDetector as AnomalyDetector
from .diagnosis import Diagnosis as Diagnosis
from .diagnosis import FaultClassifier as FaultClassifier
from .diagnosis import PriorClassifier as PriorClassifier
from .diagnosis import export_onnx as export_onnx
from .diagnosis import load_model as load_model
from .foundation import LeakError as LeakError
from .foundation import MPa as MPa
from .foundation import SwashTwinError as SwashTwinError
from .foundation import __version__ as __version__
from .foundation import bar as bar
from .foundation import celsius as celsius
from .foundation import deg as deg
from .foundation import mm as mm
from .foundation import rpm as rpm
from .foundation import um as um
from .learning import Scores as Scores
from .learning import WindowSet as WindowSet
from .learning import cut_windows as cut_windows
from .learning import register_network as register_network
from .physics import Twin as Twin
from .pump import BoreDefect as BoreDefect
from .pump import DamScratch as DamScratch
from .pump import GrooveErosion as GrooveErosion
from .pump import LooseSlipper as LooseSlipper
from .pump import OperatingCondition as OperatingCondition
from .pump import PistonWear as PistonWear
from .pump import Pump as Pump
from .pump import SealingLandScratch as SealingLandScratch
from .pump import SwashPlateDefect as SwashPlateDefect
from .pump import TiltedBlockFace as TiltedBlockFace
from .pump import ValvePlateWear as ValvePlateWear
from .pump import load_pump as load_pump
from .pump import register_fault as register_fault
from .recordings import Recording as Recording
from .recordings import Recordings as Recordings
from .recordings import inspect_recordings as inspect_recordings
from .recordings import load_recording as load_recording
from .recordings import load_recordings as load_recordings
from .recordings import register_format as register_format
from .report import write_report as write_report
from .synthesis import register_filler as register_filler
from .synthesis import synthesize as synthesize

__all__ = [
    "AnomalyDetector",
    "BoreDefect",
    "Calibration",
    "DamScratch",
    "Diagnosis",
    "FaultClassifier",
    "GrooveErosion",
    "LeakError",
    "LooseSlipper",
    "MPa",
    "OperatingCondition",
    "PistonWear",
    "PriorClassifier",
    "Pump",
    "Recording",
    "Recordings",
    "Scores",
    "SealingLandScratch",
    "SwashPlateDefect",
    "SwashTwinError",
    "TiltedBlockFace",
    "Twin",
    "ValvePlateWear",
    "WindowSet",
    "__version__",
    "bar",
    "calibrate",
    "celsius",
    "cut_windows",
    "deg",
    "estimate_severity",
    "export_onnx",
    "identifiability",
    "inspect_recordings",
    "load_calibration",
    "load_model",
    "load_pump",
    "load_recording",
    "load_recordings",
    "mm",
    "plot",
    "presets",
    "register_fault",
    "register_filler",
    "register_format",
    "register_network",
    "rpm",
    "synthesize",
    "um",
    "write_report",
]
