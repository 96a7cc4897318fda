#!/usr/bin/env bash
# py4dgeo tells of a wall that moved 5 cm that half of it moved 5 cm forward and half of it 5 cm back.
#
# Library: py4dgeo 1.2.0 (PyPI).
# A good guess: M3C2 tells signed distances along normals; of a plane that moved as a whole the distances are equal,
#   and their mean is how far it moved.
# What happens: unless `orientation_vector` is given, normals are turned to where z is positive. Those of an upright
#   wall have no z but noise, so neighbours look to opposite sides, distances are +5 and -5 cm, and their mean tells of
#   no change. The uncertainty is as small as ever. Floors are right, and walls with a vector across them.
# Seen:
#   py4dgeo 1.2.0
#   a wall, and a floor, 5 cm further in the second scan; distances at 400 places
#   expected: 400 of one sign
#   seen:     floor: 400 of +5 cm, 0 of -5 cm; mean +5.0 cm, level of detection 0.06 cm
#   seen:     wall: 214 of +5 cm, 186 of -5 cm; mean +0.3 cm, level of detection 0.06 cm
#   seen:     wall, with a vector: 400 of +5 cm, 0 of -5 cm; mean +5.0 cm, level of detection 0.06 cm
# In jaxmm: distances are along the outward normals of the model's own faces; its benchmark of M3C2 gives the normals.
set -euo pipefail
VERSION=${VERSION:-1.2.0}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "py4dgeo==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import py4dgeo

print("py4dgeo", version("py4dgeo"))
rng = np.random.default_rng(0)


def surface(upright: bool, moved: float) -> np.ndarray:
    """20,000 points with 2 mm of noise on 10 x 3 m, moved across."""
    along, across = rng.uniform(0.0, (10.0, 3.0), (20_000, 2)).T, rng.normal(moved, 0.002, 20_000)
    return np.column_stack([along[0], across, along[1]] if upright else [*along, across])


CORE = np.column_stack([part.ravel() for part in np.meshgrid(np.linspace(1, 9, 40), np.linspace(0.5, 2.5, 10))])
print("a wall, and a floor, 5 cm further in the second scan; distances at 400 places")
print("expected: 400 of one sign")
seen = {}
for name, upright, vector in (
    ("floor", False, None), ("wall", True, None), ("wall, with a vector", True, [0.0, 1.0, 0.0]),
):  # fmt: skip
    core = np.insert(CORE, 1 if upright else 2, 0.0, axis=1)
    epochs = [py4dgeo.Epoch(surface(upright, moved)) for moved in (0.0, 0.05)]
    given = {} if vector is None else {"orientation_vector": np.array(vector)}
    search = py4dgeo.M3C2(epochs=epochs, corepoints=core, cyl_radius=0.2, normal_radii=[0.3], max_distance=0.5, **given)
    distances, uncertainties = search.run()
    near = np.abs(np.abs(distances) - 0.05) < 0.005
    seen[name] = int((near & (distances > 0)).sum()), int((near & (distances < 0)).sum())
    level, mean = np.median(uncertainties["lodetection"]), np.nanmean(distances)
    print(f"seen:     {name}: {seen[name][0]} of +5 cm, {seen[name][1]} of -5 cm; mean {100 * mean:+.1f} cm, "
          f"level of detection {100 * level:.2f} cm")
stated = seen["floor"] == seen["wall, with a vector"] == (400, 0)
stated &= min(seen["wall"]) > 100 and sum(seen["wall"]) == 400
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
