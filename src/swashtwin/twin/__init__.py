"""A pump, under a condition, with a fault: what its accelerometers would read."""

from swashtwin.twin.batch import OrderLines, accelerations, prepare
from swashtwin.twin.course import Course
from swashtwin.twin.film import SlipperFilm, carry_over, film_of, film_values, with_film
from swashtwin.twin.model import Scales, Twin
from swashtwin.twin.path import SensorPath, path_response
from swashtwin.twin.steady import steady_blocks, whole_revolutions
from swashtwin.twin.transient import course_blocks, simulate_course

__all__ = [
    "Course",
    "OrderLines",
    "Scales",
    "SensorPath",
    "SlipperFilm",
    "Twin",
    "accelerations",
    "carry_over",
    "course_blocks",
    "film_of",
    "film_values",
    "path_response",
    "prepare",
    "simulate_course",
    "steady_blocks",
    "whole_revolutions",
    "with_film",
]
