"""Names that other rooms import, and where each lives."""

from .dynamics import Structure as Structure
from .dynamics import Topology as Topology
from .dynamics import assemble as assemble
from .excitation import recess_of as recess_of
from .excitation import slipper_displacements as slipper_displacements
from .fault_forcing import FaultAction as FaultAction
from .fault_forcing import excitation_lines as excitation_lines
from .fault_forcing import fault_action as fault_action
from .fault_forcing import fault_forces as fault_forces
from .fault_forcing import interface_factors as interface_factors
from .fault_forcing import motion_lines as motion_lines
from .fault_forcing import no_action as no_action
from .fault_forcing import turning_terms as turning_terms
from .fault_forcing import worn_values as worn_values
from .fault_leakage import AddedLeakage as AddedLeakage
from .fault_leakage import PortChange as PortChange
from .fault_leakage import added_leakage as added_leakage
from .fault_leakage import port_change as port_change
from .films import film_factors as film_factors
from .loads import ChamberPressures as ChamberPressures
from .loads import LoadCase as LoadCase
from .loads import chamber_pressures as chamber_pressures
from .loads import force_lines as force_lines
from .loose_slipper import contact_lines as contact_lines
from .solvers.periodic import PeriodicTerm as PeriodicTerm
from .solvers.periodic import periodic_steady_state as periodic_steady_state
from .solvers.steady import RK4 as RK4
from .solvers.steady import HarmonicBalance as HarmonicBalance
from .solvers.steady import SteadySolver as SteadySolver
from .twin.batch import OrderLines as OrderLines
from .twin.batch import accelerations as accelerations
from .twin.batch import prepare as prepare
from .twin.model import Twin as Twin
from .twin.path import SensorPath as SensorPath
from .twin.path import path_response as path_response
from .twin.scales import Scales as Scales
from .twin.sensitivity import Sensitivity as Sensitivity
from .twin.sensitivity import sensitivities as sensitivities

__all__ = [
    "RK4",
    "AddedLeakage",
    "ChamberPressures",
    "FaultAction",
    "HarmonicBalance",
    "LoadCase",
    "OrderLines",
    "PeriodicTerm",
    "PortChange",
    "Scales",
    "Sensitivity",
    "SensorPath",
    "SteadySolver",
    "Structure",
    "Topology",
    "Twin",
    "accelerations",
    "added_leakage",
    "assemble",
    "chamber_pressures",
    "contact_lines",
    "excitation_lines",
    "fault_action",
    "fault_forces",
    "film_factors",
    "force_lines",
    "interface_factors",
    "motion_lines",
    "no_action",
    "path_response",
    "periodic_steady_state",
    "port_change",
    "prepare",
    "recess_of",
    "sensitivities",
    "slipper_displacements",
    "turning_terms",
    "worn_values",
]
