#!/usr/bin/env bash
# The PLY reader of VTK, and so of ParaView, leaves out all properties but colours, and rounds coordinates.
#
# Library: vtk 9.7.2 (PyPI).
# A good guess: a property of each vertex, as a distance or a probability, becomes a point array, as in other formats
#   that VTK reads; `property double x` keeps its digits, as VTK holds points of either precision.
# What happens: arrays are the colour alone; the others are gone without a warning. Points are floats: on a national
#   grid they move by centimetres. There are no cells either, so nothing is drawn of a cloud before glyphs are asked for.
# Seen:
#   vtk 9.7.2
#   three points on a grid, with colour, a distance and a number
#   expected: arrays of all of them; doubles
#   seen:     arrays RGB; float32, off by up to 8 mm; 0 cells
#   seen:     the same table as .vtp: arrays RGB, distance, scan; float64, off by 0 mm
# In jaxmm: `points.ply` and `mismatches.ply` tell by colour what their fields tell; PLY files of far coordinates have
#   a moved file of floats beside them.
set -euo pipefail
VERSION=${VERSION:-9.7.2}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "vtk==$VERSION" plyfile==1.1.5 numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from plyfile import PlyData, PlyElement
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkIOPLY import vtkPLYReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLPolyDataWriter

GRID = np.array([155_000.123, 463_000.664, 1.25])


def read(reader, name):
    """Names of the arrays, dtype of points, how far they are off [mm], and how many cells there are."""
    reader.SetFileName(name)
    reader.Update()
    found, data = reader.GetOutput(), reader.GetOutput().GetPointData()
    places = vtk_to_numpy(found.GetPoints().GetData())
    names = [data.GetArrayName(index) for index in range(data.GetNumberOfArrays())]
    return names, str(places.dtype), 1000.0 * np.abs(places - points).max(), found.GetNumberOfCells()


print("vtk", version("vtk"))
print("three points on a grid, with colour, a distance and a number")
print("expected: arrays of all of them; doubles")
points = GRID + np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [2.0, 0.25, 1.0]])
kinds = [(axis, "f8") for axis in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")]
table = np.zeros(3, [*kinds, ("distance", "f4"), ("scan", "i4")])
for index, axis in enumerate("xyz"):
    table[axis] = points[:, index]
table["red"], table["distance"], table["scan"] = 200, [0.01, -0.02, 0.03], [1, 1, 2]
PlyData([PlyElement.describe(table, "vertex")]).write("cloud.ply")
names, kind, off, cells = read(vtkPLYReader(), "cloud.ply")
print(f"seen:     arrays {', '.join(names)}; {kind}, off by up to {off:.0f} mm; {cells} cells")

cloud, places = vtkPolyData(), vtkPoints()
places.SetData(numpy_to_vtk(points, deep=True))
cloud.SetPoints(places)
columns = {"RGB": np.stack([table[name] for name in ("red", "green", "blue")], axis=1)}
for name, values in (columns | {name: table[name] for name in ("distance", "scan")}).items():
    array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    array.SetName(name)
    cloud.GetPointData().AddArray(array)
writer = vtkXMLPolyDataWriter()
writer.SetFileName("cloud.vtp")
writer.SetInputData(cloud)
writer.Write()
all_names, all_kind, all_off, _ = read(vtkXMLPolyDataReader(), "cloud.vtp")
print(f"seen:     the same table as .vtp: arrays {', '.join(all_names)}; {all_kind}, off by {all_off:.0f} mm")
stated = (names, kind, cells) == (["RGB"], "float32", 0) and 5.0 < off < 50.0
stated &= all_names == ["RGB", "distance", "scan"] and all_kind == "float64" and all_off < 1e-3
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
