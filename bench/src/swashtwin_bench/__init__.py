"""Everything that answers "does it work?": virtual rigs, studies, public sets, rivals, and their
figures.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
