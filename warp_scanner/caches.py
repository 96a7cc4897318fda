"""Where things are kept between runs. Imports nothing slow: `import jaxmm` asks."""

import os
from pathlib import Path


def cache_folder(name: str) -> Path:
    """Where things of a kind live: below JAXMM_CACHE, or else `.cache` of the source tree, or the user's caches."""
    if asked := os.environ.get("JAXMM_CACHE"):
        return Path(asked) / name
    root = Path(__file__).resolve().parent.parent
    if (root / "pyproject.toml").is_file() and os.access(root, os.W_OK):
        return root / ".cache" / name
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxmm" / name
