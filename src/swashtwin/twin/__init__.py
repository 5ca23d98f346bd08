"""A pump, under a condition, with a fault: what its accelerometers would read."""

from swashtwin.twin.batch import OrderLines, accelerations, prepare
from swashtwin.twin.film import SlipperFilm, carry_over, film_of, film_values, with_film
from swashtwin.twin.model import Scales, Twin

__all__ = [
    "OrderLines",
    "Scales",
    "SlipperFilm",
    "Twin",
    "accelerations",
    "carry_over",
    "film_of",
    "film_values",
    "prepare",
    "with_film",
]
