#!/usr/bin/env bash
# web-ifc passes over PnIndex: faces of a set that count in it get other corners.
#
# Library: web-ifc 0.0.78 (npm); the models are written by ifcopenshell 0.9.0.post1.
# A good guess: where an IfcTriangulatedFaceSet or IfcPolygonalFaceSet has a PnIndex, the corners of its faces count in
#   that list, which leads to the points. So several sets can share one list of points, each with a part of it.
# What happens: PnIndex is passed over, of triangulated sets without a word, of polygonal ones with one on the console.
#   The faces have other corners: a tetrahedron of 1 x 2 x 4 m whose points are the second to the fifth of the list
#   gets a corner at the first one, 9 m away.
# Seen:
#   web-ifc 0.0.78
#   a tetrahedron of 1 x 2 x 4 m, by all points of its list, and by the second to the fifth of one
#   expected: 1 x 2 x 4 m, all of them
#   seen:     IfcTriangulatedFaceSet: all 1 x 2 x 4, by PnIndex 9 x 9 x 9
#   [WEB-IFC][error][GetMesh()] Unsupported IFCPOLYGONALFACESET with PnIndex 12
#   seen:     IfcPolygonalFaceSet: all 1 x 2 x 4, by PnIndex 9 x 9 x 9
# In jaxmm: what it writes into models is extruded, and has no PnIndex.
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
"""Writes KIND_all.ifc and KIND_picked.ifc: a tetrahedron by four points, and by four of five."""
import ifcopenshell
import ifcopenshell.guid

POINTS = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 4.0))
FACES = ((1, 3, 2), (1, 2, 4), (2, 3, 4), (3, 1, 4))
for kind in ("IfcTriangulatedFaceSet", "IfcPolygonalFaceSet"):
    for name, points, picked in (("all", POINTS, None), ("picked", ((9.0, 9.0, 9.0), *POINTS), (2, 3, 4, 5))):
        model = ifcopenshell.file(schema="IFC4")
        new, guid = model.create_entity, ifcopenshell.guid.new

        def origin():
            return new("IfcAxis2Placement3D", new("IfcCartesianPoint", (0.0, 0.0, 0.0)))

        context = new("IfcGeometricRepresentationContext", ContextType="Model", CoordinateSpaceDimension=3,
                      Precision=1e-5, WorldCoordinateSystem=origin())
        unit = new("IfcUnitAssignment", [new("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")])
        new("IfcProject", GlobalId=guid(), Name=name, RepresentationContexts=[context], UnitsInContext=unit)
        table = new("IfcCartesianPointList3D", points)
        faces = FACES if "Tri" in kind else [new("IfcIndexedPolygonalFace", face) for face in FACES]
        named = {"CoordIndex" if "Tri" in kind else "Faces": faces}
        item = new(kind, Coordinates=table, Closed=True, PnIndex=picked, **named)
        body = new("IfcShapeRepresentation", context, "Body", "Tessellation", [item])
        new("IfcWall", GlobalId=guid(), Name=name, ObjectPlacement=new("IfcLocalPlacement", None, origin()),
            Representation=new("IfcProductDefinitionShape", None, None, [body]))
        model.write(f"{kind}_{name}.ifc")
PY
cat > check.mjs <<'JS'
import { createRequire } from "node:module";
import fs from "node:fs";

const { IfcAPI } = createRequire(import.meta.url)("web-ifc");
const api = new IfcAPI();
await api.Init();

/** What the corners of all triangles of a file span, along x, y and z of the file. */
function spans(file) {
  const model = api.OpenModel(new Uint8Array(fs.readFileSync(file)));
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  api.StreamAllMeshes(model, (mesh) => {
    for (let i = 0; i < mesh.geometries.size(); i++) {
      const { geometryExpressID, flatTransformation: m } = mesh.geometries.get(i);
      const shape = api.GetGeometry(model, geometryExpressID);
      const values = api.GetVertexArray(shape.GetVertexData(), shape.GetVertexDataSize());  // x y z and the normal
      for (const corner of api.GetIndexArray(shape.GetIndexData(), shape.GetIndexDataSize())) {
        for (let k = 0; k < 3; k++) {
          const v = 6 * corner;
          const at = m[k] * values[v] + m[4 + k] * values[v + 1] + m[8 + k] * values[v + 2] + m[12 + k];
          low[k] = Math.min(low[k], at);
          high[k] = Math.max(high[k], at);
        }
      }
    }
  });
  api.CloseModel(model);
  const [x, z, y] = high.map((value, k) => Math.round((value - low[k]) * 1000) / 1000);  // its y is up
  return `${x} x ${y} x ${z}`;
}

console.log("web-ifc", JSON.parse(fs.readFileSync("node_modules/web-ifc/package.json")).version);
console.log("a tetrahedron of 1 x 2 x 4 m, by all points of its list, and by the second to the fifth of one");
console.log("expected: 1 x 2 x 4 m, all of them");
let stated = true;
for (const kind of ["IfcTriangulatedFaceSet", "IfcPolygonalFaceSet"]) {
  const [all, picked] = ["all", "picked"].map((name) => spans(`${kind}_${name}.ifc`));
  console.log(`seen:     ${kind}: all ${all}, by PnIndex ${picked}`);
  stated &&= all === "1 x 2 x 4" && picked === "9 x 9 x 9";
}
console.log(stated ? "as stated" : "NO LONGER AS STATED");
process.exit(stated ? 0 : 3);
JS
env/bin/python make.py
node check.mjs
