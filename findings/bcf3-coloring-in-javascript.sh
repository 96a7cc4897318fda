#!/usr/bin/env bash
# Two JavaScript readers of BCF 3.0 stop at a file that colours an element.
#
# Libraries: @parametricos/bcf-js 0.2.6 and @thatopen/components 3.4.8 (npm).
# A good guess: both say that they read BCF 3.0. In its schema a Color holds one Components, which holds each Component;
#   in 2.1 a Color held each Component itself. So a 3.0 file with Coloring can be read.
# What happens: both look for a Component right below Color, as in 2.1. There is none, and a TypeError
#   about undefined ends the reading of the whole file. It is an ordinary exception, and the program goes on: @thatopen
#   raises it to its caller, who can catch it; bcf-js catches it itself, prints it, and returns without a topic, as if
#   all were well. The same file without its Coloring is read. The Python reader bcf-client reads both.
# Seen:
#   bcf-js 0.2.6, @thatopen/components 3.4.8
#   expected: 1 topic from either file, by either reader
#   seen:     bcf-js, plain.bcf: 1 topic
#   seen:     bcf-js, coloured.bcf: no topic; printed: TypeError: Cannot read properties of undefined (reading '@_IfcGuid')
#   seen:     @thatopen/components, plain.bcf: 1 topic
#   seen:     @thatopen/components, coloured.bcf: raised: TypeError: Cannot read properties of undefined (reading 'IfcGuid')
# In jaxmm: the writer of BCF 3.0 leaves Coloring out; the element is in the Selection, which both understand.
set -euo pipefail
VERSION=${VERSION:-0.2.6}  # of bcf-js
THATOPEN_VERSION=${THATOPEN_VERSION:-3.4.8}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
echo '{"private": true}' > package.json
npm install --silent --no-audit --no-fund "@parametricos/bcf-js@$VERSION" "@thatopen/components@$THATOPEN_VERSION"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check bcf-client==0.9.0
cat > make.py <<'PY'
"""Writes coloured.bcf and plain.bcf, and reads both by bcf-client."""
import zipfile

from bcf.bcfxml import load

TOPIC, VIEW = "0f5d1a2e-1111-4222-8333-444455556666", "0f5d1a2e-1111-4222-8333-444455556667"
ELEMENT = '<Component IfcGuid="2O2Fr$t4X7Zf8NOew3FLOH"/>'
COLORING = f'<Coloring><Color Color="FF0000"><Components>{ELEMENT}</Components></Color></Coloring>'


def xml(text: str) -> str:
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + text


def vector(tag: str, x: float, y: float, z: float) -> str:
    return f"<{tag}><X>{x}</X><Y>{y}</Y><Z>{z}</Z></{tag}>"


for name, coloring in (("coloured", COLORING), ("plain", "")):
    view = (
        f'<VisualizationInfo Guid="{VIEW}"><Components><Selection>{ELEMENT}</Selection>'
        f'<Visibility DefaultVisibility="true"/>{coloring}</Components><PerspectiveCamera>'
        + vector("CameraViewPoint", 1, 2, 3) + vector("CameraDirection", 0, 1, 0) + vector("CameraUpVector", 0, 0, 1)
        + "<FieldOfView>60.0</FieldOfView><AspectRatio>1.5</AspectRatio></PerspectiveCamera></VisualizationInfo>"
    )
    markup = (
        f'<Markup><Topic Guid="{TOPIC}" TopicType="Mismatch" TopicStatus="Open"><Title>a wall</Title>'
        "<CreationDate>2026-01-01T00:00:00Z</CreationDate><CreationAuthor>nobody</CreationAuthor>"
        f'<Viewpoints><ViewPoint Guid="{VIEW}"><Viewpoint>viewpoint.bcfv</Viewpoint></ViewPoint></Viewpoints>'
        "</Topic></Markup>"
    )
    words = (
        "<TopicTypes><TopicType>Mismatch</TopicType></TopicTypes>"
        "<TopicStatuses><TopicStatus>Open</TopicStatus></TopicStatuses>"
    )
    with zipfile.ZipFile(f"{name}.bcf", "w") as archive:
        archive.writestr("bcf.version", xml('<Version VersionId="3.0"/>'))
        archive.writestr("extensions.xml", xml(f"<Extensions>{words}</Extensions>"))
        archive.writestr(f"{TOPIC}/", "")
        archive.writestr(f"{TOPIC}/markup.bcf", xml(markup))
        archive.writestr(f"{TOPIC}/viewpoint.bcfv", xml(view))
    with load(f"{name}.bcf") as file:
        (topic,) = file.topics.values()
        (shown,) = topic.viewpoints.values()
        found = shown.visualization_info.components.coloring
        assert bool(found and found.color[0].components.component[0].ifc_guid) == bool(coloring)
PY
cat > check.mjs <<'JS'
import { createRequire } from "node:module";
import fs from "node:fs";

const require = createRequire(import.meta.url);
const version = (name) => JSON.parse(fs.readFileSync(`node_modules/${name}/package.json`)).version;
const { BcfReader } = require("@parametricos/bcf-js/dist/3.0");
globalThis.window ??= { addEventListener() {} };
const OBC = await import("@thatopen/components");
const print = console.log;

const readers = {
  "bcf-js": async (data) => {
    const reader = new BcfReader(), printed = [];
    console.log = console.error = (...words) => printed.push(...words);
    try {
      await reader.read(data);
    } finally {
      console.log = console.error = print;
    }
    const error = printed.find((word) => word instanceof Error);
    return reader.project ? `${reader.project.markups.length} topic` : `no topic; printed: ${error}`;
  },
  "@thatopen/components": async (data) => {
    const { topics } = await new OBC.Components().get(OBC.BCFTopics).load(new Uint8Array(data));
    return `${topics.length} topic`;
  },
};
console.log("bcf-js", version("@parametricos/bcf-js") + ", @thatopen/components", version("@thatopen/components"));
console.log("expected: 1 topic from either file, by either reader");
const said = { "bcf-js": "no topic; printed: TypeError", "@thatopen/components": "raised: TypeError" };
let stated = true;
for (const [name, read] of Object.entries(readers)) {
  for (const file of ["plain", "coloured"]) {
    let seen;
    try {
      seen = await read(fs.readFileSync(`${file}.bcf`));
    } catch (error) {
      seen = `raised: ${error}`;
    }
    stated &&= seen.startsWith(file === "plain" ? "1 topic" : said[name]);
    console.log(`seen:     ${name}, ${file}.bcf: ${seen}`);
  }
}
console.log(stated ? "as stated" : "NO LONGER AS STATED");
process.exit(stated ? 0 : 3);
JS
env/bin/python make.py
NODE_NO_WARNINGS=1 node check.mjs
