#!/usr/bin/env bash
# IfcOpenShell empties a reference to an entity of an unknown class without a word: a column stands at the origin.
#
# Library: ifcopenshell 0.9.0.post1 (PyPI).
# A good guess: an entity of a class that the schema lacks, or one that is missing, is an error of the file, so that
#   opening it fails, as making such an entity does; or a warning is given, or the check of the model finds it.
# What happens: `open` passes over the entity, and whatever refers to it gets an empty value, as if the file had `$`. A
#   column whose placement is of class IfcLinearPlacement, in a file that calls itself IFC4, stands at the origin;
#   written anew, the file has no trace of it. `validate` of the opened model finds no fault. Only `get_log()` tells,
#   and `validate` of the file by its name.
# Seen:
#   ifcopenshell 0.9.0.post1
#   two columns, at x = 5 and 9 m; in some files the entity that places the second is of an unknown class, or is missing
#   expected: an error, a warning, or a fault that the check of the model finds; none for the whole file
#   seen:     whole: columns at [5.0, 9.0], 0 warnings, faults of the model 0, of the file 0, 0 lines in the log
#   seen:     of another schema: columns at [5.0, 0.0], 0 warnings, faults of the model 0, of the file 2, 2 lines in the log
#   seen:     missing: columns at [5.0, 0.0], 0 warnings, faults of the model 0, of the file 1, 1 lines in the log
#   seen:     create_entity: RuntimeError
# In jaxmm: reads the log of the parser, and names an element whose place or body has lost a part as one without a shape.
set -euo pipefail
VERSION=${VERSION:-0.9.0.post1}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "ifcopenshell==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import os
import re
import sys
import tempfile
import warnings

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.guid
import ifcopenshell.validate

model = ifcopenshell.file(schema="IFC4")
new, guid = model.create_entity, ifcopenshell.guid.new


def placement(*at):
    return new("IfcAxis2Placement3D", new("IfcCartesianPoint", tuple(map(float, at or (0, 0, 0)))))


context = new("IfcGeometricRepresentationContext", ContextType="Model", CoordinateSpaceDimension=3, Precision=1e-5,
              WorldCoordinateSystem=placement())
metres = new("IfcUnitAssignment", [new("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")])
new("IfcProject", GlobalId=guid(), Name="site", RepresentationContexts=[context], UnitsInContext=metres)
middle = new("IfcAxis2Placement2D", new("IfcCartesianPoint", (0.0, 0.0)))
profile = new("IfcRectangleProfileDef", "AREA", None, middle, 1.0, 1.0)
solid = new("IfcExtrudedAreaSolid", profile, placement(), new("IfcDirection", (0.0, 0.0, 1.0)), 3.0)
for name, x in (("first", 5), ("second", 9)):
    shape = new("IfcShapeRepresentation", context, "Body", "SweptSolid", [solid])
    new("IfcColumn", GlobalId=guid(), Name=name, ObjectPlacement=new("IfcLocalPlacement", None, placement(x, 0, 0)),
        Representation=new("IfcProductDefinitionShape", None, None, [shape]))
text = model.to_string()
last = list(re.finditer(r"(#\d+)=IFCLOCALPLACEMENT\([^;]*\);", text))[-1]


def faults(of) -> int:
    told = ifcopenshell.validate.json_logger()
    ifcopenshell.validate.validate(of, told)
    return len(told.statements)


def opened(path):
    """The model, and what was said on standard output and standard error, or by warnings, while it was opened."""
    with tempfile.TemporaryFile() as said, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        kept = [os.dup(1), os.dup(2)]
        sys.stdout.flush()
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
        try:
            found = ifcopenshell.open(path)
        finally:
            for number, one in zip((1, 2), kept):
                os.dup2(one, number)
                os.close(one)
        said.seek(0)
        return found, len(caught) + len(said.read().splitlines())


print("ifcopenshell", ifcopenshell.version)
print("two columns, at x = 5 and 9 m; in some files the entity that places the second is of an unknown class, or is "
      "missing")
print("expected: an error, a warning, or a fault that the check of the model finds; none for the whole file")
stated = True
for name, instead, x, lines in (
    ("whole", last[0], 9.0, 0),
    ("of another schema", f"{last[1]}=IFCLINEARPLACEMENT($,$,$);", 0.0, 2),
    ("missing", "", 0.0, 1),
):
    with open("model.ifc", "w") as file:
        file.write(text[: last.start()] + instead + text[last.end() :])
    ifcopenshell.get_log()  # forgets what it told so far
    try:
        found, warned = opened("model.ifc")
    except Exception as error:
        print(f"seen:     {name}: {type(error).__name__}: {error}")
        stated = False
        continue
    log = len(ifcopenshell.get_log().splitlines())
    shapes = ifcopenshell.geom.iterator(ifcopenshell.geom.settings(), found, 1)
    at = {shape.name: float(shape.transformation.matrix[12]) for shape in shapes}
    places = [at["first"], at["second"]]
    inside, file = faults(found), faults("model.ifc")
    print(f"seen:     {name}: columns at {places}, {warned} warnings, faults of the model {inside}, of the file {file}, "
          f"{log} lines in the log")
    stated &= places == [5.0, x] and (warned, inside, file, log) == (0, 0, lines, lines)
    written = re.search(r"IFCCOLUMN\([^;]*'second',\$,\$,([^,]*),", found.to_string())[1]
    stated &= (written == "$") == (name != "whole")
try:
    new("IfcLinearPlacement")
    refused = "made"
except Exception as error:
    refused = type(error).__name__
print("seen:     create_entity:", refused)
stated &= refused == "RuntimeError"
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
