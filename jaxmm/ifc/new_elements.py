"""Added walls and columns as elements of an IFC model: placed, on their storey, with an extruded body.

World frame: that of the file, metres, z up; what a reader with world coordinates gives back. Placements in the file are
in its own unit, relative to the storey.
"""

from typing import Any, NamedTuple

import numpy as np

from jaxmm.ifc.draft import Draft
from jaxmm.ifc.placements import new_axes, rounded
from jaxmm.verdicts.results import Mismatch
from warp_scanner.buildings.ifc_model import identity_of, world_matrix

FOOT_SLACK = 0.1  # [m] a measured foot this far below a storey's elevation still stands on it
_CLASSES = {"wall": ("IfcWall", "SOLIDWALL"), "pillar": ("IfcColumn", "COLUMN")}


class Ground(NamedTuple):
    """Where new elements of a model go."""

    unit: float  # [m] length of the file's unit
    containers: tuple[Any, ...]  # storeys from the lowest up; without any a building or a site; may be empty
    elevation: np.ndarray  # (S,) float64 [m] world z of each
    body: Any  # the representation context of bodies; None where the file has none


def ground_of(model: Any) -> Ground:
    """What `add_object` has to know of a model."""
    from ifcopenshell.util.unit import calculate_unit_scale

    unit = float(calculate_unit_scale(model))
    containers: list[Any] = []
    for kind in ("IfcBuildingStorey", "IfcBuilding", "IfcSite"):
        containers = containers or list(model.by_type(kind))
    heights = [_height(one, unit) for one in containers]
    order = np.argsort(heights, kind="stable")
    return Ground(
        unit, tuple(containers[row] for row in order), np.array(heights, np.float64)[order], _body_context(model)
    )


def storey_at(ground: Ground, foot: float) -> Any:
    """The container whose elevation is the nearest at or below a foot at this height [m]; else the lowest; or None."""
    if not ground.containers:
        return None
    row = int(np.searchsorted(ground.elevation, foot + FOOT_SLACK, side="right")) - 1
    # Of several on one level, the first in the file.
    return ground.containers[int(np.searchsorted(ground.elevation, ground.elevation[max(row, 0)] - 1e-6))]


def flaw_of(mismatch: Mismatch, ground: Ground) -> str | None:
    """Why an added mismatch cannot be written, in words; None when it can."""
    numbers = np.array([*mismatch.center, *mismatch.dimensions, mismatch.rotation], np.float64)
    if not np.isfinite(numbers).all() or not (np.asarray(mismatch.dimensions) > 0.0).all():
        return "its box has no size"
    return "the file has no context for shapes" if ground.body is None else None


def add_object(draft: Draft, ground: Ground, mismatch: Mismatch, name: str, description: str) -> tuple[Any, Any]:
    """Write an added mismatch as IfcWall or IfcColumn.

    Args:
        draft: the model.
        ground: of the model.
        mismatch: one without a flaw.
        name: of the element; with the file it fixes the GlobalId.
        description: of the element.

    Returns:
        The element, and the storey that is to contain it or None.
    """
    size = np.asarray(mismatch.dimensions, np.float64)
    yaw = float(mismatch.rotation)
    if mismatch.object_type == "wall" and size[1] > size[0]:
        size, yaw = size[[1, 0, 2]], yaw + 90.0  # a wall's own x runs along it
    foot = np.asarray(mismatch.center, np.float64) - [0.0, 0.0, size[2] / 2.0]
    storey = storey_at(ground, float(foot[2]))
    ifc_class, predefined = _CLASSES[mismatch.object_type]
    named = {} if draft.model.schema == "IFC2X3" else {"PredefinedType": predefined}
    body = draft.create(
        "IfcShapeRepresentation", ground.body, "Body", "SweptSolid",
        [_solid(draft, size / ground.unit, mismatch.shape == "round")],
    )  # fmt: skip
    element = draft.root(
        ifc_class, name, Name=name, Description=description,
        ObjectPlacement=_placement(draft, storey, _pose(foot, yaw, ground.unit)),
        Representation=draft.create("IfcProductDefinitionShape", Representations=[body]), **named,
    )  # fmt: skip
    return element, storey


def contain(draft: Draft, storey: Any, elements: list[Any]) -> None:
    """Put new elements on a storey, by a relation of their own: what the storey has already keeps its text."""
    draft.root(
        "IfcRelContainedInSpatialStructure", f"added to {identity_of(storey)}",
        RelatedElements=elements, RelatingStructure=storey,
    )  # fmt: skip


def _height(container: Any, unit: float) -> float:
    # As for readers: the placement is where things really stand, the attribute a remark that may be wrong.
    if container.ObjectPlacement:
        return float(world_matrix(container.ObjectPlacement)[2, 3]) * unit
    return float(getattr(container, "Elevation", None) or 0.0) * unit


def _body_context(model: Any) -> Any:
    """The context in which the file itself keeps bodies, or else its first one for models."""
    contexts = model.by_type("IfcGeometricRepresentationContext")
    parts = [one for one in contexts if one.is_a("IfcGeometricRepresentationSubContext")]
    wholes = [one for one in contexts if one not in parts]
    named = [one for one in parts if one.ContextIdentifier == "Body"]
    used = (one.ContextOfItems for one in model.by_type("IfcShapeRepresentation")
            if one.RepresentationIdentifier == "Body")  # fmt: skip
    candidates = (
        [one for one in named if one.TargetView == "MODEL_VIEW"], named, used,
        [one for one in wholes if one.ContextType == "Model"], wholes,
    )  # fmt: skip
    return next((one for group in candidates for one in group), None)


def _pose(foot: np.ndarray, yaw: float, unit: float) -> np.ndarray:
    """(4, 4) float64 of something upright that stands there, in the file's unit."""
    pose, angle = np.eye(4), np.radians(yaw)
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose[:3, 3] = foot / unit
    return pose


def _placement(draft: Draft, storey: Any, pose: np.ndarray) -> Any:
    within = storey.ObjectPlacement if storey else None
    own = np.linalg.solve(world_matrix(within), pose) if within else pose
    return draft.create("IfcLocalPlacement", within, new_axes(draft, own))


def _solid(draft: Draft, size: np.ndarray, is_round: bool) -> Any:
    """Upright on the placement's origin; `size` (3,) in the file's unit."""
    x, y, z = rounded(size)
    middle = draft.create("IfcAxis2Placement2D", draft.create("IfcCartesianPoint", [0.0, 0.0]))
    if is_round:
        profile = draft.create("IfcCircleProfileDef", "AREA", None, middle, (x + y) / 4.0)
    else:
        profile = draft.create("IfcRectangleProfileDef", "AREA", None, middle, x, y)
    axes = draft.create("IfcAxis2Placement3D", draft.create("IfcCartesianPoint", [0.0, 0.0, 0.0]))
    return draft.create("IfcExtrudedAreaSolid", profile, axes, draft.create("IfcDirection", [0.0, 0.0, 1.0]), z)
