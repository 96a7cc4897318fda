#!/usr/bin/env bash
# IfcOpenShell's CGAL kernels multiply the depth of an extrusion by the length of its direction.
#
# Library: ifcopenshell 0.9.0.post1 (PyPI).
# A good guess: the ratios of an IfcDirection tell a direction and nothing else ("does not imply a vector length", says
#   the standard), so 4 m along (0, 0, 2) are 4 m, whatever makes the shape.
# What happens: OpenCASCADE makes it 4 m high, the kernels on CGAL 8 m, and so does the one that tries CGAL first and
#   OpenCASCADE for what that cannot do. Along (0, 3, 4) a column of 5 m becomes one of 25 m. Nothing is said.
# Seen:
#   ifcopenshell 0.9.0.post1
#   columns of 1 x 2 m, extruded by 4 m along (0, 0, 1) and (0, 0, 2), and by 5 m along (0, 3, 4)
#   expected: 4.0 m high, all of them
#   seen:     opencascade {'unit': 4.0, 'long': 4.0, 'oblique': 4.0}
#   seen:     cgal {'unit': 4.0, 'long': 8.0, 'oblique': 20.0}
#   seen:     cgal-simple {'unit': 4.0, 'long': 8.0, 'oblique': 20.0}
#   seen:     hybrid-cgal-simple-opencascade {'unit': 4.0, 'long': 8.0, 'oblique': 20.0}
# In jaxmm: directions along which something is extruded are made as long as 1 before shapes are made.
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


ALONG = {"unit": ((0.0, 0.0, 1.0), 4.0), "long": ((0.0, 0.0, 2.0), 4.0), "oblique": ((0.0, 3.0, 4.0), 5.0)}
for name, (ratios, depth) in ALONG.items():
    middle = new("IfcAxis2Placement2D", new("IfcCartesianPoint", (0.0, 0.0)))
    profile = new("IfcRectangleProfileDef", "AREA", None, middle, 1.0, 2.0)
    solid = new("IfcExtrudedAreaSolid", profile, placement(), new("IfcDirection", ratios), depth)
    product(name, "SweptSolid", solid)

print("ifcopenshell", ifcopenshell.version)
print("columns of 1 x 2 m, extruded by 4 m along (0, 0, 1) and (0, 0, 2), and by 5 m along (0, 3, 4)")
print("expected: 4.0 m high, all of them")
seen = {}
for kernel in ("opencascade", "cgal", "cgal-simple", "hybrid-cgal-simple-opencascade"):
    seen[kernel] = {}
    for column in model.by_type("IfcColumn"):
        made = ifcopenshell.geom.create_shape(ifcopenshell.geom.settings(), column, geometry_library=kernel)
        seen[kernel][column.Name] = round(float(np.ptp(np.array(made.geometry.verts).reshape(-1, 3)[:, 2])), 6)
    print("seen:    ", kernel, seen[kernel])
stated = seen.pop("opencascade") == {"unit": 4.0, "long": 4.0, "oblique": 4.0}
stated &= all(heights == {"unit": 4.0, "long": 8.0, "oblique": 20.0} for heights in seen.values())
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
