"""A scene and a sensor in, scans and their truth out: NumPy arrays at the border, Warp kernels inside."""

import os

from warp_scanner.caches import cache_folder

# Warp reads the variable when it is first imported, so it has to be set here, before any module of the package.
os.environ.setdefault("WARP_CACHE_PATH", str(cache_folder("warp")))
