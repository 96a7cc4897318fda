#!/usr/bin/env bash
# IfcOpenShell removes model.ifc when it writes model.ifczip beside it.
#
# Library: ifcopenshell 0.9.0.post1 (PyPI).
# A good guess: `write("model.ifczip")` makes one file and touches no other.
# What happens: the text is first written to model.ifc in the same folder, then zipped, then model.ifc is unlinked. A
#   model.ifc that was there before is overwritten and gone, without a word. Who keeps a model beside its zipped copy
#   loses the model. Beside a file of another name the same model is zipped, and all is well.
# Seen:
#   ifcopenshell 0.9.0.post1
#   in the folder before: ['model.ifc']; then write('model.ifczip')
#   expected: ['model.ifc', 'model.ifczip']
#   seen:     ['model.ifczip']
#   in the folder before: ['old.ifc']; then write('model.ifczip')
#   seen:     ['model.ifczip', 'old.ifc'], and old.ifc as it was
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


def project(name: str):
    model = ifcopenshell.file(schema="IFC4")
    model.create_entity("IfcProject", GlobalId=ifcopenshell.guid.new(), Name=name)
    return model


def zipped_beside(name: str) -> tuple[list[str], bool]:
    """What is in a folder with that model when another is written as model.ifczip; whether the first is as it was."""
    folder = Path(name).with_suffix("")
    folder.mkdir()
    other, zipped = folder / name, folder / "model.ifczip"
    project("not to be changed").write(str(other))
    before = other.read_bytes()
    project("zipped").write(str(zipped))
    assert ifcopenshell.open(str(zipped)).by_type("IfcProject")[0].Name == "zipped"
    return sorted(path.name for path in folder.iterdir()), other.exists() and other.read_bytes() == before


print("in the folder before: ['model.ifc']; then write('model.ifczip')")
print("expected: ['model.ifc', 'model.ifczip']")
found, kept = zipped_beside("model.ifc")
print("seen:    ", found)
print("in the folder before: ['old.ifc']; then write('model.ifczip')")
elsewhere, unchanged = zipped_beside("old.ifc")
print("seen:    ", str(elsewhere) + ",", "and old.ifc as it was" if unchanged else "and old.ifc is another")
stated = found == ["model.ifczip"] and not kept and elsewhere == ["model.ifczip", "old.ifc"] and unchanged
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
