#!/usr/bin/env bash
# IfcOpenShell's iterator yields the clearance of a door, and the hole that it fills, as shapes like any other.
#
# Library: ifcopenshell 0.9.0.post1 (PyPI).
# A good guess: by default the geometry iterator yields one shape per element: its body.
# What happens: it yields one shape per product and representation context. The space that a door needs to open
#   ("Clearance") is a solid of its own under the GlobalId of the door, and an opening is a solid as well. A dictionary
#   by GlobalId keeps whichever comes last. `create_shape` of the same door gives the body alone.
# Seen:
#   ifcopenshell 0.9.0.post1
#   a wall with an opening, and a door in it that has a body of 0.1 m3 and a clearance of 4 m3
#   expected: a shape each of the wall (2.0 m3: with its hole) and the door (0.1 m3)
#   seen:     door, Body, 0.1 m3
#   seen:     door, Clearance, 4.0 m3
#   seen:     opening, Body, 0.4 m3
#   seen:     wall, Body, 2.0 m3
#   create_shape of the door: Body, 0.1 m3
# In jaxmm: the IFC reader asks for elements with matter only, so openings stay out, and leaves of what represents them
#   only their bodies, all of them joined, before it asks.
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


def placement():
    return new("IfcAxis2Placement3D", point(0, 0, 0))


context = new("IfcGeometricRepresentationContext", ContextType="Model", CoordinateSpaceDimension=3, Precision=1e-5,
              WorldCoordinateSystem=placement())
body, clearance = (
    new("IfcGeometricRepresentationSubContext", ContextIdentifier=name, ContextType="Model", ParentContext=context,
        TargetView="MODEL_VIEW")
    for name in ("Body", "Clearance")
)
metres = new("IfcUnitAssignment", [new("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")])
new("IfcProject", GlobalId=guid(), Name="door", RepresentationContexts=[context], UnitsInContext=metres)


def box(where, x, y, z):
    profile = new("IfcRectangleProfileDef", "AREA", None, new("IfcAxis2Placement2D", point(0, 0)), x, y)
    solid = new("IfcExtrudedAreaSolid", profile, placement(), new("IfcDirection", (0.0, 0.0, 1.0)), z)
    return new("IfcShapeRepresentation", where, where.ContextIdentifier, "SweptSolid", [solid])


def product(kind, name, *shapes):
    return new(kind, GlobalId=guid(), Name=name, ObjectPlacement=new("IfcLocalPlacement", None, placement()),
               Representation=new("IfcProductDefinitionShape", None, None, list(shapes)))


wall = product("IfcWall", "wall", box(body, 4.0, 0.2, 3.0))
opening = product("IfcOpeningElement", "opening", box(body, 1.0, 0.2, 2.0))
door = product("IfcDoor", "door", box(body, 1.0, 0.05, 2.0), box(clearance, 1.0, 2.0, 2.0))
new("IfcRelVoidsElement", GlobalId=guid(), RelatingBuildingElement=wall, RelatedOpeningElement=opening)
new("IfcRelFillsElement", GlobalId=guid(), RelatingOpeningElement=opening, RelatedBuildingElement=door)


def told(shape) -> tuple[str, str, float]:
    geometry = shape.geometry
    corners = np.array(geometry.verts).reshape(-1, 3)[np.array(geometry.faces).reshape(-1, 3)]
    volume = np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    return shape.name, shape.context, round(float(volume), 3)


print("ifcopenshell", ifcopenshell.version)
print("a wall with an opening, and a door in it that has a body of 0.1 m3 and a clearance of 4 m3")
print("expected: a shape each of the wall (2.0 m3: with its hole) and the door (0.1 m3)")
settings = ifcopenshell.geom.settings()
shapes = sorted(told(shape) for shape in ifcopenshell.geom.iterator(settings, model, 1))
for name, where, volume in shapes:
    print("seen:    ", f"{name}, {where}, {volume} m3")
single = told(ifcopenshell.geom.create_shape(settings, door))
print(f"create_shape of the door: {single[1]}, {single[2]} m3")
right = [("door", "Body", 0.1), ("wall", "Body", 2.0)]
besides = [("door", "Clearance", 4.0), ("opening", "Body", 0.4)]
stated = shapes == sorted(right + besides) and single == right[0]
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
