"""Where compiled code is kept between runs."""

import os
from pathlib import Path


def cache_folder(name: str) -> Path:
    """Folder for one compiler's cache: `.cache/<name>` of the source tree, or the user's cache when installed."""
    tree = Path(__file__).resolve().parents[1]
    if (tree / "pyproject.toml").is_file() and os.access(tree, os.W_OK):
        return tree / ".cache" / name
    user = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(user) / "jaxmm" / name
