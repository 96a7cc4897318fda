#!/usr/bin/env bash
# IfcOpenShell's CGAL kernels pass over the operator of a derived profile, and its OpenCASCADE kernel applies it twice.
#
# Library: ifcopenshell 0.9.0.post1 (PyPI).
# A good guess: an IfcDerivedProfileDef is its parent profile moved, mirrored or scaled by its operator, whatever kernel
#   makes the solid: a profile from 0 to 1 m, shifted by 5 m, reaches from 5 to 6 m.
# What happens: the kernels on CGAL give the parent as it is. OpenCASCADE shifts it by 10 m and so, it seems, mirrors it
#   twice, which is as it was; what is scaled by 2 becomes 3.175 times as wide. Nothing is said.
# Seen:
#   ifcopenshell 0.9.0.post1
#   a column from x = 0 to 1 m, its profile derived from that of a square from 0 to 1 m in x and y
#   expected: shifted by 5 m from 5 to 6, scaled by 2 from 0 to 2, mirrored in x from -1 to 0
#   seen:     opencascade {'shifted': (10.0, 11.0), 'scaled': (0.0, 3.175), 'mirrored': (0.0, 1.0)}
#   seen:     cgal-simple {'shifted': (0.0, 1.0), 'scaled': (0.0, 1.0), 'mirrored': (0.0, 1.0)}
#   seen:     hybrid-cgal-simple-opencascade {'shifted': (0.0, 1.0), 'scaled': (0.0, 1.0), 'mirrored': (0.0, 1.0)}
# In jaxmm: an element with such a profile is named as one whose shape cannot be made.
set -euo pipefail
VERSION=${VERSION:-0.9.0.post1}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "ifcopenshell==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.guid
import numpy as np

model = ifcopenshell.file(schema="IFC4")
new, guid = model.create_entity, ifcopenshell.guid.new


def placement(*at):
    return new("IfcAxis2Placement3D", new("IfcCartesianPoint", tuple(map(float, at or (0, 0, 0)))))


context = new("IfcGeometricRepresentationContext", ContextType="Model", CoordinateSpaceDimension=3, Precision=1e-5,
              WorldCoordinateSystem=placement())
metres = new("IfcUnitAssignment", [new("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")])
new("IfcProject", GlobalId=guid(), Name="site", RepresentationContexts=[context], UnitsInContext=metres)


def product(name, kind, item):
    shape = new("IfcShapeRepresentation", context, "Body", kind, [item])
    new("IfcColumn", GlobalId=guid(), Name=name, ObjectPlacement=new("IfcLocalPlacement", None, placement()),
        Representation=new("IfcProductDefinitionShape", None, None, [shape]))


def direction(*to):
    return new("IfcDirection", tuple(map(float, to)))


X, Y = (1, 0), (0, 1)
OPERATORS = {"shifted": (X, Y, 5.0, 1.0), "scaled": (X, Y, 0.0, 2.0), "mirrored": ((-1, 0), Y, 0.0, 1.0)}
for name, (x, y, shift, scale) in OPERATORS.items():
    middle = new("IfcAxis2Placement2D", new("IfcCartesianPoint", (0.5, 0.5)))
    parent = new("IfcRectangleProfileDef", "AREA", None, middle, 1.0, 1.0)
    origin = new("IfcCartesianPoint", (shift, 0.0))
    operator = new("IfcCartesianTransformationOperator2D", direction(*x), direction(*y), origin, scale)
    profile = new("IfcDerivedProfileDef", "AREA", None, parent, operator)
    product(name, "SweptSolid", new("IfcExtrudedAreaSolid", profile, placement(), direction(0, 0, 1), 3.0))

print("ifcopenshell", ifcopenshell.version)
print("a column from x = 0 to 1 m, its profile derived from that of a square from 0 to 1 m in x and y")
print("expected: shifted by 5 m from 5 to 6, scaled by 2 from 0 to 2, mirrored in x from -1 to 0")
seen = {}
for kernel in ("opencascade", "cgal-simple", "hybrid-cgal-simple-opencascade"):
    seen[kernel] = {}
    for column in model.by_type("IfcColumn"):
        made = ifcopenshell.geom.create_shape(ifcopenshell.geom.settings(), column, geometry_library=kernel)
        x = np.array(made.geometry.verts).reshape(-1, 3)[:, 0].round(3) + 0.0
        seen[kernel][column.Name] = (float(x.min()), float(x.max()))
    print("seen:    ", kernel, seen[kernel])
stated = seen.pop("opencascade") == {"shifted": (10.0, 11.0), "scaled": (0.0, 3.175), "mirrored": (0.0, 1.0)}
stated &= all(set(spans.values()) == {(0.0, 1.0)} for spans in seen.values())
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
