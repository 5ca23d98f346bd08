"""Names that other rooms import, and where each lives."""

from .explorer_page import build_explorer as build_explorer
from .explorer_page import run_explorer as run_explorer
from .workspace import Workspace as Workspace
