"""Version of the software, which every saved result names."""

from importlib.metadata import PackageNotFoundError, version

try:
    VERSION = version("swashtwin")
except PackageNotFoundError:  # run from a source tree that was never installed
    VERSION = "0+unknown"
__version__ = VERSION
"""The same, by the name that other packages give it."""
