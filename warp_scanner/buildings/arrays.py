"""A building as arrays and JSON, which carry no code: how one process hands it to another.

E elements, S storeys, V vertices, T triangles, as in buildings.py.
"""

import numpy as np

from warp_scanner.guarded import Plain
from warp_scanner.scenes.building import Building, Elements, Failure, Pieced, Source, Storeys, Triangles, Twin, Whole


def packed(building: Building) -> Plain:
    """All of a building; `unpacked` gives it back, equal to the last bit."""
    elements, triangles, storeys = building.elements, building.triangles, building.storeys
    words = {
        "guid": elements.guid, "ifc_class": elements.ifc_class, "name": elements.name,
        "file": elements.file, "twins": elements.twins,
        "storey_guid": storeys.guid, "storey_name": storeys.name,
        "failures": building.failures, "flaws": building.flaws,
        "zero_area": building.zero_area, "notes": building.notes, "unit": building.unit, "project": building.project,
        "sources": [one[:-1] for one in building.sources],
        "wholes": building.wholes, "pieced": building.pieced,
    }  # fmt: skip
    arrays = {
        "storey": elements.storey, "semantic": elements.semantic,
        "vertices": triangles.vertices, "faces": triangles.faces, "element": triangles.element,
        "origin": building.origin, "elevation": storeys.elevation,
    }  # fmt: skip
    arrays |= {name: given for name in ("to_map", "clear") if (given := getattr(building, name)) is not None}
    if building.sources:
        arrays["to_world"] = np.array([one.to_world for one in building.sources])
    return Plain(words, arrays)


def unpacked(plain: Plain) -> Building:
    """The building that `packed` was given.

    Raises:
        KeyError, TypeError: something is missing, or not what it should be.
    """
    words, arrays = plain
    storeys = Storeys(tuple(words["storey_guid"]), tuple(words["storey_name"]), arrays["elevation"])
    return Building(
        Elements(
            *(tuple(words[name]) for name in ("guid", "ifc_class", "name")), arrays["storey"], arrays["semantic"],
            tuple(words["file"]), tuple(tuple(Twin(*one) for one in twins) for twins in words["twins"]),
        ),
        Triangles(*(arrays[name] for name in ("vertices", "faces", "element", "semantic"))),
        arrays["origin"],
        storeys,
        tuple(Failure(*one) for one in words["failures"]),
        words["zero_area"],
        tuple(words["notes"]),
        arrays.get("to_map"),
        tuple(Failure(*one) for one in words["flaws"]),
        words["unit"],
        words["project"],
        tuple(Source(*one, way) for one, way in zip(words["sources"], arrays.get("to_world", ()), strict=True)),
        tuple(Whole(*one[:4], tuple(one[4]), one[5]) for one in words["wholes"]),
        arrays.get("clear"),
        tuple(map(_pieced, words["pieced"])),
    )  # fmt: skip


def _pieced(words: list) -> Pieced:
    element, twins, pieces, center, size, yaw = words
    return Pieced(
        Twin(*element), tuple(Twin(*one) for one in twins), tuple((file, guid) for file, guid in pieces), tuple(center),
        tuple(size), yaw,
    )  # fmt: skip
