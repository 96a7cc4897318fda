#!/usr/bin/env bash
# In Warp `clamp`, `min` and `max` turn NaN into an ordinary number.
#
# Library: warp-lang 1.19.0 (PyPI), CPU.
# A good guess: NaN stays NaN, as in numpy.clip, jax.numpy.clip and torch.clamp.
# What happens: `min(nan, 1)` is 1, and `clamp(nan, 0, 1)` is 0. A depth that no sensor measured becomes the nearest
#   depth that there is, and no later test for NaN finds it.
# Seen:
#   warp-lang 1.19.0
#   expected: nan from each; numpy.clip(nan, 0, 1) is nan
#   seen:     min(nan, 1) = 1.0, max(nan, 1) = 1.0, clamp(nan, 0, 1) = 0.0
#   of 0.5:   min(0.5, 1) = 0.5, max(0.5, 1) = 1.0, clamp(0.5, 0, 1) = 0.5
#   nan + 1 in the same kernel: nan
# In jaxmm: kernels ask `isfinite` of a distance before they compute with it.
set -euo pipefail
VERSION=${VERSION:-1.19.0}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "warp-lang==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import warp as wp

wp.config.log_level = 30  # warnings and worse


@wp.kernel
def bound(value: wp.array(dtype=wp.float32), out: wp.array(dtype=wp.float32)):
    out[0] = wp.min(value[0], 1.0)
    out[1] = wp.max(value[0], 1.0)
    out[2] = wp.clamp(value[0], 0.0, 1.0)
    out[3] = value[0] + 1.0


def bounded(value: float) -> list[float]:
    given = wp.array([value], dtype=wp.float32, device="cpu")
    out = wp.zeros(4, dtype=wp.float32, device="cpu")
    wp.launch(bound, dim=1, inputs=[given], outputs=[out], device="cpu")
    return out.numpy().tolist()


def told(value: float, found: list[float]) -> str:
    names = f"min({value}, 1)", f"max({value}, 1)", f"clamp({value}, 0, 1)"
    return ", ".join(f"{name} = {one}" for name, one in zip(names, found))


print("warp-lang", version("warp-lang"))
print("expected: nan from each; numpy.clip(nan, 0, 1) is", np.clip(np.nan, 0.0, 1.0))
*of_nan, added = bounded(np.nan)
*of_half, _ = bounded(0.5)
print("seen:    ", told(np.nan, of_nan))
print("of 0.5:  ", told(0.5, of_half))
print("nan + 1 in the same kernel:", added)
stated = of_nan == [1.0, 1.0, 0.0] and of_half == [0.5, 1.0, 0.5] and np.isnan(added)
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
WARP_CACHE_PATH=$work/cache env/bin/python check.py
