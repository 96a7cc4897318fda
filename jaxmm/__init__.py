"""What one robot scan says about a building model: added, removed, or simply not seen."""

import importlib
import os
from typing import Any

from jaxmm.caches import cache_folder

# JAX reads this when it is first imported, so it must stand before any other import of the package.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_folder("jax")))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.5")


def __getattr__(name: str) -> Any:
    """`from jaxmm import detect`; found when asked for, for it loads JAX and Warp."""
    if name == "detect":
        return importlib.import_module("jaxmm.detect_files").detect
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
