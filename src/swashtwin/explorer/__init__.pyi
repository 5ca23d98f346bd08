"""Names that other rooms import, and where each lives."""

from .application import build_explorer as build_explorer
from .application import run_explorer as run_explorer
from .workspace import Workspace as Workspace
