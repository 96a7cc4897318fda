#!/usr/bin/env bash
# IfcOpenShell's function for the matrix of a placement shears what it places, where its own geometry does not.
#
# Library: ifcopenshell 0.9.0.post1 (PyPI).
# A good guess: `util.placement.get_local_placement` gives the matrix by which the geometry kernels place a shape. In
#   IFC the RefDirection of a placement need not be across its Axis: it only tells in which plane the x axis lies.
# What happens: the function takes RefDirection itself for the x axis. Its matrix is no rotation (determinant below 1),
#   and what stands 50 m along that axis is 5 m too high. The kernels agree with each other and with the standard. With
#   a RefDirection across the Axis the function is right, too.
# Seen:
#   ifcopenshell 0.9.0.post1
#   a column at 50, 0, 3 of a placement whose Axis is 0, 0, 1
#   expected: function and kernels place it alike, without distortion
#   seen:     RefDirection (1.0, 0.0, 0.0): get_local_placement: at [50.0, 0.0, 3.0], determinant 1.0
#   seen:     RefDirection (1.0, 0.0, 0.0): opencascade: at [50.0, 0.0, 3.0], determinant 1.0
#   seen:     RefDirection (1.0, 0.0, 0.0): cgal: at [50.0, 0.0, 3.0], determinant 1.0
#   seen:     RefDirection (1.0, 0.0, 0.1): get_local_placement: at [49.752, 0.0, 7.975], determinant 0.995
#   seen:     RefDirection (1.0, 0.0, 0.1): opencascade: at [50.0, 0.0, 3.0], determinant 1.0
#   seen:     RefDirection (1.0, 0.0, 0.1): cgal: at [50.0, 0.0, 3.0], determinant 1.0
#   errors that the validator of the library tells: 0
# In jaxmm: it lays the x axis across the z axis itself, wherever it needs the matrix of a placement.
set -euo pipefail
VERSION=${VERSION:-0.9.0.post1}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "ifcopenshell==$VERSION" numpy==2.4.6 pytest==9.2.0
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.guid
import ifcopenshell.validate
import numpy as np
from ifcopenshell.util.placement import get_local_placement

KERNELS = ("opencascade", "cgal")
model = ifcopenshell.file(schema="IFC4")
new, guid = model.create_entity, ifcopenshell.guid.new


def axes(place=(0.0, 0.0, 0.0), ways=None):
    axis, reference = (new("IfcDirection", way) for way in ways) if ways else (None, None)
    return new("IfcAxis2Placement3D", new("IfcCartesianPoint", place), axis, reference)


context = new("IfcGeometricRepresentationContext", ContextType="Model", CoordinateSpaceDimension=3, Precision=1e-5,
              WorldCoordinateSystem=axes())
units = new("IfcUnitAssignment", [new("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")])
new("IfcProject", GlobalId=guid(), Name="site", RepresentationContexts=[context], UnitsInContext=units)
profile = new("IfcRectangleProfileDef", "AREA", None, new("IfcAxis2Placement2D", new("IfcCartesianPoint", (0.0, 0.0))),
              1.0, 1.0)
solid = new("IfcExtrudedAreaSolid", profile, axes(), new("IfcDirection", (0.0, 0.0, 1.0)), 3.0)


def column(reference):
    """It stands at 50, 0, 3 of a placement with this RefDirection, and the axis 0, 0, 1."""
    ground = new("IfcLocalPlacement", None, axes(ways=((0.0, 0.0, 1.0), reference)))
    place = new("IfcLocalPlacement", ground, axes((50.0, 0.0, 3.0)))
    body = new("IfcShapeRepresentation", context, "Body", "SweptSolid", [solid])
    shape = new("IfcProductDefinitionShape", None, None, [body])
    return new("IfcColumn", GlobalId=guid(), ObjectPlacement=place, Representation=shape)


print("ifcopenshell", version("ifcopenshell"))
print("a column at 50, 0, 3 of a placement whose Axis is 0, 0, 1")
print("expected: function and kernels place it alike, without distortion")
found = {}
for reference in ((1.0, 0.0, 0.0), (1.0, 0.0, 0.1)):
    one = column(reference)
    matrices = {"get_local_placement": get_local_placement(one.ObjectPlacement)}
    for kernel in KERNELS:
        shape = ifcopenshell.geom.create_shape(ifcopenshell.geom.settings(), one, geometry_library=kernel)
        matrices[kernel] = np.array(shape.transformation.matrix).reshape(4, 4).T
    for name, matrix in matrices.items():
        place, size = matrix[:3, 3].round(3).tolist(), float(np.linalg.det(matrix[:3, :3]).round(3))
        print(f"seen:     RefDirection {reference}: {name}: at {place}, determinant {size}")
        found[reference[2], name] = place, size
log = ifcopenshell.validate.json_logger()
ifcopenshell.validate.validate(model, log, express_rules=True)
print("errors that the validator of the library tells:", len(log.statements))
right = [50.0, 0.0, 3.0], 1.0
wrong = found.pop((0.1, "get_local_placement"))
stated = not log.statements and all(one == right for one in found.values())
stated &= wrong == ([49.752, 0.0, 7.975], 0.995)
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
