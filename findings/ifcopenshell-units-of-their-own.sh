#!/usr/bin/env bash
# IfcOpenShell's conversion to another unit also converts what has a unit of its own, and what units are defined by.
#
# Library: ifcopenshell 0.9.0.post1 (PyPI); `util.unit.convert_file_length_units`, which ifcpatch's ConvertLengthUnit
#   calls.
# A good guess: from a file in millimetres comes the same building in metres. A property or quantity that names its own
#   unit does not depend on the project's, and an inch stays 25.4 mm.
# What happens: every number that is a length is divided by 1000. A width of 2.5 with the unit metre becomes 0.0025,
#   still in metres, and the inch becomes 25.4 micrometres. What is in the project's unit is right. The new file is
#   valid.
# Seen:
#   ifcopenshell 0.9.0.post1
#   a file in millimetres that becomes one in metres; in metres, by their units:
#   expected: {'project': [2.5, 2.5], 'metre': [2.5, 2.5], 'inch': [2.54, 2.54]}
#   seen:     {'project': [2.5, 2.5], 'metre': [0.0025, 0.0025], 'inch': [2.54e-06, 2.54e-06]}
#   an inch afterwards: 2.54e-05 m
#   errors that the validator of the library tells before and after: 0 0
# In jaxmm: files keep their unit; it converts the numbers that it reads and writes, and edits nothing else.
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
import ifcopenshell.guid
import ifcopenshell.validate
from ifcopenshell.util.unit import calculate_unit_scale, convert_file_length_units, get_unit_scale

model = ifcopenshell.file(schema="IFC4")
new, guid = model.create_entity, ifcopenshell.guid.new
millimetre = new("IfcSIUnit", UnitType="LENGTHUNIT", Prefix="MILLI", Name="METRE")
metre = new("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")
exponents = new("IfcDimensionalExponents", 1, 0, 0, 0, 0, 0, 0)
size = new("IfcMeasureWithUnit", new("IfcLengthMeasure", 0.0254), metre)
inch = new("IfcConversionBasedUnit", exponents, "LENGTHUNIT", "INCH", size)
axes = new("IfcAxis2Placement3D", new("IfcCartesianPoint", (0.0, 0.0, 0.0)))
context = new("IfcGeometricRepresentationContext", ContextType="Model", CoordinateSpaceDimension=3, Precision=0.01,
              WorldCoordinateSystem=axes)
new("IfcProject", GlobalId=guid(), Name="site", RepresentationContexts=[context],
    UnitsInContext=new("IfcUnitAssignment", [millimetre]))
wall = new("IfcWall", GlobalId=guid(), ObjectPlacement=new("IfcLocalPlacement", None, axes))
UNITS = {"project": None, "metre": metre, "inch": inch}
VALUES = {"project": 2500.0, "metre": 2.5, "inch": 100.0}  # 2.5 m each; the inches 2.54 m
lengths = {name: new("IfcLengthMeasure", value) for name, value in VALUES.items()}
properties = [new("IfcPropertySingleValue", name, None, lengths[name], unit) for name, unit in UNITS.items()]
quantities = [new("IfcQuantityLength", name, None, unit, VALUES[name]) for name, unit in UNITS.items()]
for one in (new("IfcPropertySet", GlobalId=guid(), Name="Own", HasProperties=properties),
            new("IfcElementQuantity", GlobalId=guid(), Name="Sizes", Quantities=quantities)):
    new("IfcRelDefinesByProperties", GlobalId=guid(), RelatedObjects=[wall], RelatingPropertyDefinition=one)


def in_metres(file) -> dict[str, list[float]]:
    """By name of the unit: the property and the quantity."""
    own, found = calculate_unit_scale(file), {}
    for one in (*file.by_type("IfcPropertySingleValue"), *file.by_type("IfcQuantityLength")):
        value = one.NominalValue.wrappedValue if one.is_a("IfcPropertySingleValue") else one.LengthValue
        scale = get_unit_scale(one.Unit) if one.Unit else own
        found.setdefault(one.Name, []).append(float(f"{value * scale:.6g}"))
    return found


def errors(file) -> int:
    log = ifcopenshell.validate.json_logger()
    ifcopenshell.validate.validate(file, log, express_rules=True)
    return len(log.statements)


print("ifcopenshell", version("ifcopenshell"))
changed = convert_file_length_units(model, "METRE")
before, after = in_metres(model), in_metres(changed)
print("a file in millimetres that becomes one in metres; in metres, by their units:")
print(f"expected: {before}")
print(f"seen:     {after}")
print("an inch afterwards:", changed.by_type("IfcMeasureWithUnit")[0].ValueComponent.wrappedValue, "m")
print("errors that the validator of the library tells before and after:", errors(model), errors(changed))
stated = before == {"project": [2.5, 2.5], "metre": [2.5, 2.5], "inch": [2.54, 2.54]}
stated &= after == {"project": [2.5, 2.5], "metre": [0.0025, 0.0025], "inch": [2.54e-06, 2.54e-06]}
stated &= errors(model) == errors(changed) == 0 and abs(calculate_unit_scale(changed) - 1.0) < 1e-12
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
