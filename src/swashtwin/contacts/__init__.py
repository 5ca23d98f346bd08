"""Where a pump leaves linearity: slippers that lift off or differ, a loose slipper that rattles in its joint."""

from swashtwin.contacts.check import ContactCheck, check_contact, slipper_forces
from swashtwin.contacts.loose_slipper import LooseMotion, loose_motion, loose_slipper_lines
from swashtwin.contacts.periodic import PeriodicFilms, periodic_films
from swashtwin.contacts.settings import SlipperContact, slipper_weight
from swashtwin.contacts.slippers import slipper_lines
from swashtwin.contacts.steady import Marching, slipper_steady_state

__all__ = [
    "ContactCheck",
    "LooseMotion",
    "Marching",
    "PeriodicFilms",
    "SlipperContact",
    "check_contact",
    "loose_motion",
    "loose_slipper_lines",
    "periodic_films",
    "slipper_forces",
    "slipper_lines",
    "slipper_steady_state",
    "slipper_weight",
]
