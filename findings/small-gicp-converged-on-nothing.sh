#!/usr/bin/env bash
# small_gicp says that it converged, with an error of 0, when no point has a partner.
#
# Library: small_gicp 1.0.1 (PyPI: small-gicp).
# A good guess: `converged` is false, or the error is large, when the clouds have nothing to do with each other.
# What happens: without one pair there is no error and no step, and a step of nothing counts as convergence. `converged`
#   is true and `error` is 0, better than of any true fit. Only `num_inliers` tells.
# Seen:
#   small_gicp 1.0.1
#   two clouds of 1 m, 100 m apart; pairs of up to 0.1 m
#   expected: converged False, or an error that is not 0
#   seen:     ICP: converged True, error 0.0, num_inliers 0
#   seen:     PLANE_ICP: converged True, error 0.0, num_inliers 0
#   seen:     GICP: converged True, error 0.0, num_inliers 0
#   the same cloud with 1 mm of noise, 1 cm away:
#   ICP: converged True, error above 0, over 900 inliers
#   PLANE_ICP: converged True, error above 0, over 900 inliers
#   GICP: converged True, error above 0, over 900 inliers
# In jaxmm: registration does not ask `converged`; it counts the points that match, and a start that matches nothing
#   stays as it is.
set -euo pipefail
VERSION=${VERSION:-1.0.1}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "small-gicp==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import small_gicp

print("small_gicp", version("small-gicp"))
rng = np.random.default_rng(0)
here = rng.uniform(0.0, 1.0, (1000, 3))
print("two clouds of 1 m, 100 m apart; pairs of up to 0.1 m")
print("expected: converged False, or an error that is not 0")
KINDS = ("ICP", "PLANE_ICP", "GICP")


def align(kind: str, other: np.ndarray):
    return small_gicp.align(here, other, registration_type=kind, downsampling_resolution=0.01,
                            max_correspondence_distance=0.1)


stated = True
for kind in KINDS:
    found = align(kind, here + [100.0, 0.0, 0.0])
    print(f"seen:     {kind}: converged {found.converged}, error {found.error}, num_inliers {found.num_inliers}")
    stated &= found.converged and found.error == 0.0 and found.num_inliers == 0
print("the same cloud with 1 mm of noise, 1 cm away:")
for kind in KINDS:
    found = align(kind, here + [0.01, 0.0, 0.0] + rng.normal(0.0, 0.001, here.shape))
    error, many = "above 0" if found.error > 0.0 else found.error, found.num_inliers > 900
    print(f"{kind}: converged {found.converged}, error {error}, {'over' if many else 'not'} 900 inliers")
    stated &= found.converged and found.error > 0.0 and many
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
