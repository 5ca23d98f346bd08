"""Import every module as the nightly tests do, with each annotation checked at run time.

An annotation that mypy accepts and the run-time checker refuses would stop the nightly tests at
their first import.
"""

import importlib
import pkgutil
import sys
from pathlib import Path

from jaxtyping import install_import_hook

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))
install_import_hook(["swashtwin", "swashtwin_bench"], "typechecking.tower")

for package_name in ("swashtwin", "swashtwin_bench"):
    package = importlib.import_module(package_name)
    for module in pkgutil.walk_packages(package.__path__, f"{package_name}."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
