"""Where the source tree is, and where compiled code is kept between runs."""

import os
from pathlib import Path

TREE = Path(__file__).resolve().parents[1]  # of the sources; where jaxmm is installed, its site-packages


def cache_folder(name: str) -> Path:
    """Folder for one compiler's cache: `.cache/<name>` of the source tree, or the user's cache when installed."""
    if (TREE / "pyproject.toml").is_file() and os.access(TREE, os.W_OK):
        return TREE / ".cache" / name
    user = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(user) / "jaxmm" / name
