#!/usr/bin/env bash
# web-ifc moves every model by a shift of its own, so two models of one site land on each other.
#
# Library: web-ifc 0.0.78 (npm); the models are written by ifcopenshell 0.9.0.post1.
# A good guess: COORDINATE_TO_ORIGIN takes far coordinates nearer to the origin, by one shift for all models of an API
#   object, so that models of one site still fit together.
# What happens: each model is moved until a corner of it is at the origin. Two walls 40 m apart, a file each, are at the
#   same place afterwards. The shift is told by `GetCoordinationMatrix`, of each model apart. Whatever the
#   unit of the file, it is metres, and y is up (x, z, -y of the file).
# Seen:
#   web-ifc 0.0.78
#   two walls, a file each: x from 10 to 11 m and from 50 to 51 m; y 20 to 22, z 3 to 7
#   expected: 40 m apart, with and without COORDINATE_TO_ORIGIN
#   seen:     without: 40.0 m apart
#             west from (10, 3, -22) to (11, 7, -20), shifted by (0, 0, 0)
#             east from (50, 3, -22) to (51, 7, -20), shifted by (0, 0, 0)
#   seen:     with: 0.0 m apart
#             west from (0, -4, -2) to (1, 0, 0), shifted by (-10, -7, 20)
#             east from (0, -4, -2) to (1, 0, 0), shifted by (-50, -7, 20)
# In jaxmm: cameras and coordinates that it writes are those of the model file. A viewer that shifts the model has to
#   shift them as well; nothing in the files can do it for the viewer.
set -euo pipefail
VERSION=${VERSION:-0.0.78}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
echo '{"private": true}' > package.json
npm install --silent --no-audit --no-fund "web-ifc@$VERSION"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check ifcopenshell==0.9.0.post1
cat > make.py <<'PY'
"""Writes west.ifc and east.ifc, in millimetres: a wall of 1 x 2 x 4 m at x = 10 m, and one at x = 50 m."""
import ifcopenshell
import ifcopenshell.guid

for name, x in (("west", 10_000.0), ("east", 50_000.0)):
    model = ifcopenshell.file(schema="IFC4")
    new, guid = model.create_entity, ifcopenshell.guid.new

    def at(*place):
        return new("IfcAxis2Placement3D", new("IfcCartesianPoint", place))

    context = new("IfcGeometricRepresentationContext", ContextType="Model", CoordinateSpaceDimension=3, Precision=1e-5,
                  WorldCoordinateSystem=at(0.0, 0.0, 0.0))
    unit = new("IfcUnitAssignment", [new("IfcSIUnit", UnitType="LENGTHUNIT", Prefix="MILLI", Name="METRE")])
    new("IfcProject", GlobalId=guid(), Name=name, RepresentationContexts=[context], UnitsInContext=unit)
    middle = new("IfcAxis2Placement2D", new("IfcCartesianPoint", (500.0, 1000.0)))
    profile = new("IfcRectangleProfileDef", "AREA", None, middle, 1000.0, 2000.0)
    solid = new("IfcExtrudedAreaSolid", profile, at(0.0, 0.0, 0.0), new("IfcDirection", (0.0, 0.0, 1.0)), 4000.0)
    body = new("IfcShapeRepresentation", context, "Body", "SweptSolid", [solid])
    new("IfcWall", GlobalId=guid(), Name=name, ObjectPlacement=new("IfcLocalPlacement", None, at(x, 20_000.0, 3000.0)),
        Representation=new("IfcProductDefinitionShape", None, None, [body]))
    model.write(f"{name}.ifc")
PY
cat > check.mjs <<'JS'
import { createRequire } from "node:module";
import fs from "node:fs";

const { IfcAPI } = createRequire(import.meta.url)("web-ifc");
const api = new IfcAPI();
await api.Init();

/** Least and greatest corner of a file's shapes, as a viewer would place them. */
function extent(file, toOrigin) {
  const model = api.OpenModel(new Uint8Array(fs.readFileSync(file)), { COORDINATE_TO_ORIGIN: toOrigin });
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  api.StreamAllMeshes(model, (mesh) => {
    for (let i = 0; i < mesh.geometries.size(); i++) {
      const { geometryExpressID, flatTransformation: m } = mesh.geometries.get(i);
      const shape = api.GetGeometry(model, geometryExpressID);
      const values = api.GetVertexArray(shape.GetVertexData(), shape.GetVertexDataSize());  // x y z and the normal
      for (let v = 0; v < values.length; v += 6) {
        for (let k = 0; k < 3; k++) {
          const at = m[k] * values[v] + m[4 + k] * values[v + 1] + m[8 + k] * values[v + 2] + m[12 + k];
          low[k] = Math.min(low[k], at);
          high[k] = Math.max(high[k], at);
        }
      }
    }
  });
  const shift = Array.from(api.GetCoordinationMatrix(model).slice(12, 15));
  api.CloseModel(model);
  return { low, high, shift };
}

const round = (values) => `(${values.map((value) => (Math.round(value * 1000) / 1000 + 0).toString()).join(", ")})`;
console.log("web-ifc", JSON.parse(fs.readFileSync("node_modules/web-ifc/package.json")).version);
console.log("two walls, a file each: x from 10 to 11 m and from 50 to 51 m; y 20 to 22, z 3 to 7");
console.log("expected: 40 m apart, with and without COORDINATE_TO_ORIGIN");
const apart = {}, shifts = {};
let inMetres = false;  // and y up
for (const toOrigin of [false, true]) {
  const [west, east] = ["west.ifc", "east.ifc"].map((file) => extent(file, toOrigin));
  apart[toOrigin] = east.low[0] - west.low[0];
  shifts[toOrigin] = [west.shift, east.shift].map(round).join(" ");
  if (!toOrigin) inMetres = round(west.low) === "(10, 3, -22)" && round(west.high) === "(11, 7, -20)";
  console.log(`seen:     ${toOrigin ? "with" : "without"}: ${apart[toOrigin].toFixed(1)} m apart`);
  for (const [name, { low, high, shift }] of Object.entries({ west, east })) {
    console.log(`          ${name} from ${round(low)} to ${round(high)}, shifted by ${round(shift)}`);
  }
}
const stated = inMetres && Math.abs(apart[false] - 40) < 0.01 && Math.abs(apart[true]) < 0.01 &&
  shifts[false] === "(0, 0, 0) (0, 0, 0)" && shifts[true] === "(-10, -7, 20) (-50, -7, 20)";
console.log(stated ? "as stated" : "NO LONGER AS STATED");
process.exit(stated ? 0 : 3);
JS
env/bin/python make.py
node check.mjs
