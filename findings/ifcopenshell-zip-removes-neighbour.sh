#!/usr/bin/env bash
# IfcOpenShell removes model.ifc when it writes model.ifczip beside it.
#
# Library: ifcopenshell 0.9.0.post1 (PyPI).
# A good guess: `write("model.ifczip")` makes one file and touches no other.
# What happens: the text is first written to model.ifc in the same folder, then zipped, then model.ifc is unlinked. A
#   model.ifc that was there before is overwritten and gone, without a word. Who keeps a model beside its zipped copy
#   loses the model.
# Seen:
#   ifcopenshell 0.9.0.post1
#   in the folder before: ['model.ifc']; then write('model.ifczip')
#   expected: ['model.ifc', 'model.ifczip']
#   seen:     ['model.ifczip']
# In jaxmm: the writers of IFC write to a temporary name and move the file when it is whole; none writes .ifczip.
set -euo pipefail
VERSION=${VERSION:-0.9.0.post1}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "ifcopenshell==$VERSION"
cat > check.py <<'PY'
import sys
from pathlib import Path

import ifcopenshell
import ifcopenshell.guid

print("ifcopenshell", ifcopenshell.version)
model = ifcopenshell.file(schema="IFC4")
model.create_entity("IfcProject", GlobalId=ifcopenshell.guid.new(), Name="zipped")
folder = Path("models")
folder.mkdir()
(folder / "model.ifc").write_text("another model, that nobody asked to change")
model.write(str(folder / "model.ifczip"))
found = sorted(path.name for path in folder.iterdir())
print("in the folder before: ['model.ifc']; then write('model.ifczip')")
print("expected: ['model.ifc', 'model.ifczip']")
print("seen:    ", found)
stated = found == ["model.ifczip"]
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
