"""Configuration of a watch: a TOML file with machines, sources of recordings, alarms, channels and the page."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
