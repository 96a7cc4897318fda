"""A scene and a sensor in, scans and their truth out: NumPy arrays at the border, Warp kernels inside."""

import os
from pathlib import Path


def _cache_folder() -> Path:
    """Where compiled kernels live: beside the source tree when there is one, else with the user's caches."""
    root = Path(__file__).resolve().parent.parent
    if (root / "pyproject.toml").is_file() and os.access(root, os.W_OK):
        return root / ".cache" / "warp"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "jaxmm" / "warp"


# Warp reads the variable when it is first imported, so it has to be set here, before any module of the package.
os.environ.setdefault("WARP_CACHE_PATH", str(_cache_folder()))
