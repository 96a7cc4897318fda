"""Parses IFC files of any release of IFC2X3, IFC4 and IFC4X3, of which the library knows one each; tells what it loses.

Headers name many releases: IFC4X3, IFC4X3_RC2, IFC4X3_TC1, IFC4X1, IFC2X3_TC1. The library refuses all but its own,
though they differ in little. What it passes over without a word are entities of a class that its release lacks: an
element keeps its class and loses its place or its body.
"""

import re
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

# By how the name of a release begins, those to choose from, the nearest first; of several that which knows most classes
# of the file: IFC4X3 has other attributes than IFC4 in some, as in IfcGridPlacement.
_NEAREST = (
    ("IFC2X2", ("IFC2X3",)), ("IFC2X3", ("IFC2X3",)), ("IFC4X3", ("IFC4X3_ADD2", "IFC4")),
    ("IFC4", ("IFC4", "IFC4X3_ADD2")),
)  # fmt: skip
_BEGIN = b"ISO-10303-21"
_HEADER = re.compile(rb"FILE_SCHEMA\s*\(\s*\(\s*'([^']{1,60})'", re.IGNORECASE)
_ENTITY = re.compile(rb"=\s*(IFC[A-Z0-9]+)\s*\(", re.IGNORECASE)
_UNKNOWN = re.compile(r"Entity with name '(\w+)' not found in schema")
_LOST = re.compile(r"Instance reference #(\d+) used by instance #(\d+) at attribute index (\d+) not found")


class Lost(NamedTuple):
    """A reference to an entity that is not in the model."""

    user: int  # STEP id of what refers to it
    attribute: int  # by which of its attributes, from 0 on
    number: int  # STEP id of what is not there


def parse(ifcopenshell: Any, path: Path) -> tuple[Any, tuple[str, ...], list[Lost]]:
    """The model of a plain IFC file.

    Returns:
        The model; notes of what it was read as, and without; and its references to nothing.

    Raises:
        Exception: of whatever kind the library raises; the file is no IFC, or of a schema that nothing here is near to.
    """
    ifcopenshell.get_log()  # what it said of other files
    notes: tuple[str, ...] = ()
    try:
        model = ifcopenshell.open(str(path))
    except Exception:
        found = _retold(ifcopenshell, path.read_bytes())
        if found is None:
            raise
        text, named, schema = found
        with tempfile.TemporaryDirectory(prefix="ifc-") as folder:
            copy = Path(folder) / "model.ifc"
            copy.write_bytes(text)
            model = ifcopenshell.open(str(copy))
        if schema != named:
            notes = (f"the file is of schema {named}, and was read as {schema}, the nearest that is known",)
    said = ifcopenshell.get_log()
    if unknown := sorted(set(_UNKNOWN.findall(said))):
        shown = ", ".join(unknown[:5]) + (f" and {len(unknown) - 5} more" if len(unknown) > 5 else "")
        notes += (f"entities of classes that the schema lacks were left out: {shown}",)
    return model, notes, [Lost(int(user), int(place), int(lost)) for lost, user, place in _LOST.findall(said)]


def _retold(ifcopenshell: Any, text: bytes) -> tuple[bytes, str, str] | None:
    """Text that the library can read, the schema that the file names, and the one put in its place.

    None where nothing can be done: the text is as it should be, or its schema is near to none.
    """
    begin = max(text.find(_BEGIN), 0)  # behind a mark of its encoding, or whatever else stands there
    header = _HEADER.search(text)
    if header is None:
        return None
    named = schema = header[1].decode("ascii", "replace").strip().upper()
    library = ifcopenshell.ifcopenshell_wrapper
    if named not in library.schema_names():
        near = next((some for start, some in _NEAREST if named.startswith(start)), ())
        if not near:
            return None
        used = {found[1].decode().upper() for found in _ENTITY.finditer(text)}
        schema = min(near, key=lambda name: len(used - _classes(library, name)))
    elif not begin:
        return None
    return text[begin : header.start(1)] + schema.encode() + text[header.end(1) :], named, schema


def _classes(library: Any, schema: str) -> set[str]:
    return {one.name().upper() for one in library.schema_by_name(schema).declarations()}
