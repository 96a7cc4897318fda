#!/usr/bin/env bash
# pyproj leaves heights above sea level as they are where ellipsoidal ones are asked for, even with `only_best`.
#
# Library: pyproj 3.7.2 (PyPI), without its optional grids and without network, as pip installs it.
# A good guess: from the Dutch grid with heights above NAP (EPSG:7415) to WGS 84 in three dimensions (EPSG:4979), z
#   changes by some 43 m, the geoid's height there; or, without the grid of the geoid, an error or a warning.
#   `only_best=True` promises that nothing less than the best operation is used.
# What happens: z comes back as it was, and x and y are right to metres or better, so nothing looks odd. It is the same
#   for the heights of Switzerland and Great Britain, and with `only_best=True`. Only `allow_ballpark=False` raises;
#   the operation that was used tells of it in its description, and of an accuracy of -1.
# Seen:
#   pyproj 3.7.2 with PROJ 9.5.1
#   heights above sea level as ellipsoidal heights of EPSG:4979
#   expected: z that differs by the geoid's height, some 40 to 50 m, or an error
#   seen:     Amersfoort, EPSG:7415, z = 10.0: by default z = 10.0, only_best z = 10.0, no ballpark ProjError
#             warnings: 0; accuracy told: -1.0
#   seen:     Bern, EPSG:2056+5728, z = 500.0: by default z = 500.0, only_best z = 500.0, no ballpark ProjError
#             warnings: 0; accuracy told: -1.0
#   seen:     London, EPSG:27700+5701, z = 10.0: by default z = 10.0, only_best z = 10.0, no ballpark ProjError
#             warnings: 0; accuracy told: -1.0
# In jaxmm: coordinates stay in the system of the building model and of the scans, heights too; none are transformed.
set -euo pipefail
VERSION=${VERSION:-3.7.2}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "pyproj==$VERSION"
cat > check.py <<'PY'
import sys
import warnings
from importlib.metadata import version

import pyproj
from pyproj import Transformer

WAYS = {"by default": {}, "only_best": {"only_best": True}, "no ballpark": {"allow_ballpark": False}}
pyproj.network.set_network_enabled(False)
print("pyproj", version("pyproj"), "with PROJ", pyproj.proj_version_str)
print("heights above sea level as ellipsoidal heights of EPSG:4979")
print("expected: z that differs by the geoid's height, some 40 to 50 m, or an error")
stated = True
for name, system, place, degrees in (
    ("Amersfoort", "EPSG:7415", (155_000.0, 463_000.0, 10.0), (5.38720, 52.15517)),
    ("Bern", "EPSG:2056+5728", (2_600_000.0, 1_200_000.0, 500.0), (7.43863, 46.95108)),
    ("London", "EPSG:27700+5701", (530_000.0, 180_000.0, 10.0), (-0.12834, 51.50398)),
):
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        told = {}
        for how, options in WAYS.items():
            try:
                transformer = Transformer.from_crs(system, "EPSG:4979", always_xy=True, **options)
                told[how] = transformer.transform(*place)
                used = transformer.get_last_used_operation()
            except pyproj.exceptions.ProjError as error:
                told[how] = type(error).__name__
    print(f"seen:     {name}, {system}, z = {place[2]}: " + ", ".join(
        f"{how} {z if isinstance(z, str) else f'z = {z[2]}'}" for how, z in told.items()))
    print(f"          warnings: {len(warned)}; accuracy told: {used.accuracy}")
    for how in ("by default", "only_best"):
        stated &= told[how][2] == place[2] and max(abs(a - b) for a, b in zip(told[how], degrees, strict=False)) < 2e-5
    stated &= told["no ballpark"] == "ProjError" and not warned and used.accuracy == -1
    stated &= "without ellipsoid height to vertical height correction" in used.description
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
