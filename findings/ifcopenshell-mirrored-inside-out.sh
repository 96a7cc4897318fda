#!/usr/bin/env bash
# IfcOpenShell gives the body of a mirrored mapped item inside out.
#
# Library: ifcopenshell 0.9.0.post1 (PyPI).
# A good guess: triangles of a solid face outward, so the sum of the signed volumes below them is the solid's volume.
#   IFC lets an item be mapped by an operator whose axes mirror it: every second door of a corridor is such an item.
# What happens: the corners are mirrored, the order of the corners of each triangle stays. All faces look inward, and
#   the volume comes out below zero. Of the kernels tried only "manifold" turns the faces round.
# Seen:
#   ifcopenshell 0.9.0.post1
#   a column of 1 x 0.5 x 2 m, mapped as it is and mirrored in x
#   expected: a volume of 1.0 m3 from both, from every kernel
#   seen:     opencascade {'mirrored': -1.0, 'plain': 1.0}
#   seen:     cgal {'mirrored': -1.0, 'plain': 1.0}
#   seen:     cgal-simple {'mirrored': -1.0, 'plain': 1.0}
#   seen:     manifold {'mirrored': 1.0, 'plain': 1.0}
# In jaxmm: rays meet a surface from either side, and the inside of a solid is told by the size of its winding number,
#   not by its sign.
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


def point(*at):
    return new("IfcCartesianPoint", tuple(map(float, at)))


def direction(*to):
    return new("IfcDirection", tuple(map(float, to)))


def placement():
    return new("IfcAxis2Placement3D", point(0, 0, 0))


context = new("IfcGeometricRepresentationContext", ContextType="Model", CoordinateSpaceDimension=3, Precision=1e-5,
              WorldCoordinateSystem=placement())
metres = new("IfcUnitAssignment", [new("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")])
new("IfcProject", GlobalId=guid(), Name="mirrored", RepresentationContexts=[context], UnitsInContext=metres)
profile = new("IfcRectangleProfileDef", "AREA", None, new("IfcAxis2Placement2D", point(0, 0)), 1.0, 0.5)
solid = new("IfcExtrudedAreaSolid", profile, placement(), direction(0, 0, 1), 2.0)
shape = new("IfcRepresentationMap", placement(), new("IfcShapeRepresentation", context, "Body", "SweptSolid", [solid]))
for name, x in (("plain", 1.0), ("mirrored", -1.0)):
    operator = new("IfcCartesianTransformationOperator3D", direction(x, 0, 0), direction(0, 1, 0), point(0, 0, 0), 1.0,
                   direction(0, 0, 1))
    mapped = new("IfcMappedItem", shape, operator)
    item = new("IfcShapeRepresentation", context, "Body", "MappedRepresentation", [mapped])
    new("IfcColumn", GlobalId=guid(), Name=name, ObjectPlacement=new("IfcLocalPlacement", None, placement()),
        Representation=new("IfcProductDefinitionShape", None, None, [item]))


def volume(geometry) -> float:
    corners = np.array(geometry.verts).reshape(-1, 3)[np.array(geometry.faces).reshape(-1, 3)]
    return float(np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6.0


print("ifcopenshell", ifcopenshell.version)
print("a column of 1 x 0.5 x 2 m, mapped as it is and mirrored in x")
print("expected: a volume of 1.0 m3 from both, from every kernel")
seen = {}
for kernel in ("opencascade", "cgal", "cgal-simple", "manifold"):
    settings = ifcopenshell.geom.settings()
    shapes = ifcopenshell.geom.iterator(settings, model, 1, geometry_library=kernel)
    seen[kernel] = {shape.name: round(volume(shape.geometry), 6) for shape in shapes}
    print("seen:    ", kernel, dict(sorted(seen[kernel].items())))
stated = seen.pop("manifold") == {"plain": 1.0, "mirrored": 1.0}
stated &= all(volumes == {"plain": 1.0, "mirrored": -1.0} for volumes in seen.values())
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
