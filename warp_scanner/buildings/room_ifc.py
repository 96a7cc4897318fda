"""Writes a generated room as an IFC4 file: the reverse of ifc_files.py.

Every element becomes one product with its primitives as extruded solids, placed on the one storey that contains it;
metres, and the room's own frame as the file's.
"""

import os
import uuid
from pathlib import Path
from typing import Any

import numpy as np

from warp_scanner.buildings.ifc_model import import_ifcopenshell
from warp_scanner.scenes.scenes import (
    BOX,
    CABINET,
    CARTON,
    CEILING,
    CHAIR,
    DOOR,
    FLOOR,
    FURNITURE,
    GAP,
    PERSON,
    PILLAR,
    TABLE,
    WALL,
    WINDOW,
    Primitives,
)

_FAMILY = uuid.UUID("6a1f4a52-64a5-5a66-9c39-1f0c2f8f3c57")  # GlobalIds are names in this family
# IFC class, predefined type and word of what each semantic class becomes; anything else is a proxy.
_PRODUCTS = {
    FLOOR: ("IfcSlab", "FLOOR", "floor"),
    CEILING: ("IfcSlab", "ROOF", "ceiling"),
    WALL: ("IfcWall", "SOLIDWALL", "wall"),
    PILLAR: ("IfcColumn", "COLUMN", "pillar"),
    DOOR: ("IfcDoor", "DOOR", "door"),
    WINDOW: ("IfcWindow", "WINDOW", "window"),
    TABLE: ("IfcFurniture", "TABLE", "table"),
    CHAIR: ("IfcFurniture", "CHAIR", "chair"),
    FURNITURE: ("IfcFurniture", "USERDEFINED", "furniture"),
    # Furniture is what nothing stands on when the file is read back; the schema has no class for people.
    CABINET: ("IfcFurniture", "USERDEFINED", "cabinet"),
    CARTON: ("IfcFurniture", "USERDEFINED", "carton"),
    PERSON: ("IfcFurniture", "USERDEFINED", "person"),
}


def write_room(path: Path | str, primitives: Primitives, room: int, name: str = "room") -> dict[int, str]:
    """Write one room as an IFC4 file, whole or not at all.

    Args:
        path: the file.
        primitives: the table.
        room: its row.
        name: of the project; with the element id it fixes every GlobalId, so the same room gives the same file.

    Returns:
        The GlobalId of every element id.

    Raises:
        ValueError: the room holds nothing.
        ImportError: ifcopenshell is not installed.
        OSError: it cannot be written; the path stays as it was.
    """
    slots = np.flatnonzero(primitives.kind[room] != GAP)
    if not len(slots):
        raise ValueError(f"room {room} must hold at least one primitive, got none")
    writer = _Writer(import_ifcopenshell(), name)
    floors = slots[primitives.semantic[room, slots] == FLOOR]
    center, half_size = primitives.center[room].astype(float), primitives.half_size[room].astype(float)
    ground = (center + half_size)[floors, 2].max() if len(floors) else (center - half_size)[slots, 2].min()
    storey = writer.storey(float(ground))
    element = primitives.element[room, slots]
    products = {
        int(number): writer.product(storey, primitives, room, slots[element == number]) for number in np.unique(element)
    }
    writer.contain(storey, list(products.values()))
    _write(Path(path), writer.model)
    return {number: product.GlobalId for number, product in products.items()}


def _write(path: Path, model: Any) -> None:
    """Through a temporary file beside the path: readers see the old file or the new one."""
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_text(model.to_string(), encoding="utf-8")
        os.replace(temporary, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


class _Writer:
    """One IFC model with a project, a site and a building, waiting for a storey and its products."""

    def __init__(self, ifcopenshell: Any, name: str):
        self.compress = ifcopenshell.guid.compress
        self.name = name
        self.model = model = ifcopenshell.file(schema="IFC4")
        model.header.file_name.name = f"{name}.ifc"
        model.header.file_name.time_stamp = "2000-01-01T00:00:00"  # the same room gives the same bytes
        units = [("LENGTHUNIT", "METRE"), ("AREAUNIT", "SQUARE_METRE"), ("VOLUMEUNIT", "CUBIC_METRE"),
                 ("PLANEANGLEUNIT", "RADIAN")]  # fmt: skip
        si = [model.create_entity("IfcSIUnit", UnitType=kind, Name=unit) for kind, unit in units]
        context = model.create_entity(
            "IfcGeometricRepresentationContext", None, "Model", 3, 1e-5, self.axes([0.0, 0.0, 0.0])
        )
        self.body = model.create_entity(
            "IfcGeometricRepresentationSubContext",
            ContextIdentifier="Body", ContextType="Model", ParentContext=context, TargetView="MODEL_VIEW",
        )  # fmt: skip
        project = self.root(
            "IfcProject", "project",
            RepresentationContexts=[context], UnitsInContext=model.create_entity("IfcUnitAssignment", si),
        )  # fmt: skip
        site = self.root("IfcSite", "site", ObjectPlacement=self.placement(None, [0.0, 0.0, 0.0]))
        building = self.root(
            "IfcBuilding", "building", ObjectPlacement=self.placement(site.ObjectPlacement, [0.0, 0.0, 0.0])
        )
        self.building = building
        self.root("IfcRelAggregates", "site of project", RelatingObject=project, RelatedObjects=[site])
        self.root("IfcRelAggregates", "building of site", RelatingObject=site, RelatedObjects=[building])

    def root(self, kind: str, word: str, **values: Any) -> Any:
        """An entity with a GlobalId that only its name and the project's decide."""
        guid = self.compress(uuid.uuid5(_FAMILY, f"{self.name}/{word}").hex)
        return self.model.create_entity(kind, GlobalId=guid, Name=word, **values)

    def axes(self, place: list[float], yaw: float = 0.0) -> Any:
        point = self.model.create_entity("IfcCartesianPoint", [float(value) for value in place])
        up = self.model.create_entity("IfcDirection", [0.0, 0.0, 1.0])
        ahead = self.model.create_entity("IfcDirection", [float(np.cos(yaw)), float(np.sin(yaw)), 0.0])
        return self.model.create_entity("IfcAxis2Placement3D", point, up, ahead)

    def placement(self, within: Any, place: list[float], yaw: float = 0.0) -> Any:
        return self.model.create_entity("IfcLocalPlacement", within, self.axes(place, yaw))

    def storey(self, elevation: float) -> Any:
        storey = self.root(
            "IfcBuildingStorey", "storey", Elevation=elevation,
            ObjectPlacement=self.placement(self.building.ObjectPlacement, [0.0, 0.0, elevation]),
        )  # fmt: skip
        self.root("IfcRelAggregates", "storey of building", RelatingObject=self.building, RelatedObjects=[storey])
        return storey

    def product(self, storey: Any, primitives: Primitives, room: int, slots: np.ndarray) -> Any:
        """One element of the primitives in these slots, placed where the first of them stands."""
        center, half_size, yaw = (
            field[room, slots].astype(float) for field in (primitives.center, primitives.half_size, primitives.yaw)
        )
        foot = center - half_size * [0.0, 0.0, 1.0]
        cosine, sine = np.cos(yaw[0]), np.sin(yaw[0])
        offset = foot - foot[0]
        local = np.column_stack(
            [cosine * offset[:, 0] + sine * offset[:, 1], cosine * offset[:, 1] - sine * offset[:, 0], offset[:, 2]]
        )
        kinds = primitives.kind[room, slots]
        solids = [
            self.solid(kind == BOX, half, self.axes(list(place), turn))
            for kind, half, place, turn in zip(kinds, half_size, local, yaw - yaw[0], strict=True)
        ]
        shape = self.model.create_entity("IfcShapeRepresentation", self.body, "Body", "SweptSolid", solids)
        semantic, number = int(primitives.semantic[room, slots[0]]), int(primitives.element[room, slots[0]])
        ifc_class, kind, word = _PRODUCTS.get(semantic, ("IfcBuildingElementProxy", "ELEMENT", "object"))
        more = {"ObjectType": word} if kind == "USERDEFINED" else {}
        elevation = storey.Elevation
        return self.root(
            ifc_class, f"{word} {number}", PredefinedType=kind, **more,
            ObjectPlacement=self.placement(storey.ObjectPlacement, list(foot[0] - [0.0, 0.0, elevation]), yaw[0]),
            Representation=self.model.create_entity("IfcProductDefinitionShape", Representations=[shape]),
        )  # fmt: skip

    def solid(self, box: bool, half_size: np.ndarray, axes: Any) -> Any:
        x, y, z = (2.0 * float(value) for value in half_size)
        # The schema lets a profile leave its place out, web-ifc does not.
        middle = self.model.create_entity(
            "IfcAxis2Placement2D", self.model.create_entity("IfcCartesianPoint", [0.0, 0.0])
        )
        if box:
            profile = self.model.create_entity("IfcRectangleProfileDef", "AREA", None, middle, x, y)
        else:
            profile = self.model.create_entity("IfcCircleProfileDef", "AREA", None, middle, x / 2.0)
        up = self.model.create_entity("IfcDirection", [0.0, 0.0, 1.0])
        return self.model.create_entity("IfcExtrudedAreaSolid", profile, axes, up, z)

    def contain(self, storey: Any, products: list[Any]) -> None:
        self.root(
            "IfcRelContainedInSpatialStructure", "contents of storey",
            RelatingStructure=storey, RelatedElements=products,
        )  # fmt: skip
