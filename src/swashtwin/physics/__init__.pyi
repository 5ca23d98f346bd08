"""Names that other rooms import, and where each lives."""

from .contacts.check import ContactCheck as ContactCheck
from .contacts.loose_slipper import contact_lines as contact_lines
from .contacts.settings import SlipperContact as SlipperContact
from .dynamics import Structure as Structure
from .dynamics import Topology as Topology
from .dynamics import assemble as assemble
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
from .loads import ChamberPressures as ChamberPressures
from .loads import LoadCase as LoadCase
from .loads import chamber_pressures as chamber_pressures
from .loads import force_lines as force_lines
from .recess import recess_of as recess_of
from .solvers.periodic import PeriodicTerm as PeriodicTerm
from .solvers.periodic import periodic_steady_state as periodic_steady_state
from .solvers.steady import RK4 as RK4
from .solvers.steady import HarmonicBalance as HarmonicBalance
from .solvers.steady import SteadySolver as SteadySolver
from .twin.batch import OrderLines as OrderLines
from .twin.batch import accelerations as accelerations
from .twin.batch import prepare as prepare
from .twin.film import SlipperFilm as SlipperFilm
from .twin.film import carry_over as carry_over
from .twin.film import film_of as film_of
from .twin.film import film_values as film_values
from .twin.film import with_film as with_film
from .twin.model import Twin as Twin
from .twin.operating_profile import OperatingProfile as OperatingProfile
from .twin.path import SensorPath as SensorPath
from .twin.path import path_response as path_response
from .twin.scales import Scales as Scales
from .twin.sensitivity import Sensitivity as Sensitivity
from .twin.sensitivity import sensitivities as sensitivities
from .twin.steady import steady_blocks as steady_blocks
from .twin.steady import whole_revolutions as whole_revolutions
from .twin.transient import profile_blocks as profile_blocks
from .twin.transient import simulate_profile as simulate_profile

__all__ = [
    "RK4",
    "AddedLeakage",
    "ChamberPressures",
    "ContactCheck",
    "FaultAction",
    "HarmonicBalance",
    "LoadCase",
    "OperatingProfile",
    "OrderLines",
    "PeriodicTerm",
    "PortChange",
    "Scales",
    "Sensitivity",
    "SensorPath",
    "SlipperContact",
    "SlipperFilm",
    "SteadySolver",
    "Structure",
    "Topology",
    "Twin",
    "accelerations",
    "added_leakage",
    "assemble",
    "carry_over",
    "chamber_pressures",
    "contact_lines",
    "excitation_lines",
    "fault_action",
    "fault_forces",
    "film_of",
    "film_values",
    "force_lines",
    "interface_factors",
    "motion_lines",
    "no_action",
    "path_response",
    "periodic_steady_state",
    "port_change",
    "prepare",
    "profile_blocks",
    "recess_of",
    "sensitivities",
    "simulate_profile",
    "slipper_displacements",
    "steady_blocks",
    "turning_terms",
    "whole_revolutions",
    "with_film",
    "worn_values",
]
