"""Public sets of real recordings, each asked what an honest split leaves of the usual score."""

from swashtwin.studies.public.running import ASKED, METRICS, run_public
from swashtwin.studies.public.scarce import run_scarce

__all__ = ["ASKED", "METRICS", "run_public", "run_scarce"]
