"""Which representations of an IFC product are its body: the solid that rays meet, and nothing else that is drawn of it.

A product may be represented many times: by its axis, its footprint, its bounding box, the space that it needs to open
(Clearance), a coarse sketch. Identifiers are those of the schema's IfcShapeRepresentation.
"""

from typing import Any

# The schema's other identifiers; what a file calls anything else, or nothing, is taken for a body.
_NO_BODY = frozenset((
    "annotation", "axis", "box", "clearance", "cog", "footprint", "lighting", "plan", "profile", "reference", "surface",
))  # fmt: skip
_NO_SOLID = frozenset((
    "annotation2d", "boundingbox", "curve", "curve2d", "curve3d", "geometriccurveset", "lightsource", "point",
    "pointcloud",
))  # fmt: skip
_DRAWINGS = (
    "SKETCH_VIEW", "GRAPH_VIEW", "PLAN_VIEW", "REFLECTED_PLAN_VIEW", "SECTION_VIEW", "ELEVATION_VIEW",
)  # fmt: skip


def keep_bodies(model: Any, products: list[Any]) -> dict[int, str]:
    """Leave each product one representation, its body, in the model as it is in memory.

    The library makes a shape of every representation, and two of one product are two shapes under one number.

    Args:
        model: the parsed file.
        products: with a Representation.

    Returns:
        For each product without a body, by STEP id, the reason; these are left as they are.
    """
    reasons = {}
    for product in products:
        shown = product.Representation
        every = [one for one in shown.Representations or () if one.Items]
        bodies = _bodies(every)
        if not bodies:
            names = ", ".join(sorted({_told(one) for one in every}))
            reasons[product.id()] = f"it has no body, only {names}" if every else "it has no body"
        elif len(shown.Representations) > 1:
            shown.Representations = [bodies[0] if len(bodies) == 1 else _joined(model, bodies)]
    return reasons


def _bodies(every: list[Any]) -> list[Any]:
    """Those called Body; where none is, those that nothing tells to be something else."""
    shown = [one for one in every if may_be_body(one)]
    return [one for one in shown if _is_called_body(one)] or shown


def may_be_body(one: Any) -> bool:
    """Whether nothing tells that an IfcShapeRepresentation is something else of its product."""
    if getattr(one.ContextOfItems, "TargetView", None) in _DRAWINGS:
        return False
    kind = (one.RepresentationType or "").strip().casefold()
    return _is_called_body(one) or (_name(one).casefold() not in _NO_BODY and kind not in _NO_SOLID)


def _is_called_body(one: Any) -> bool:
    return _name(one).casefold() == "body"


def _name(one: Any) -> str:
    return (one.RepresentationIdentifier or getattr(one.ContextOfItems, "ContextIdentifier", None) or "").strip()


def _told(one: Any) -> str:
    view = getattr(one.ContextOfItems, "TargetView", None)
    return (_name(one) or "what is without a name") + (f" ({view})" if view in _DRAWINGS else "")


def _joined(model: Any, bodies: list[Any]) -> Any:
    """One representation with the items of all."""
    first = bodies[0]
    items = [item for one in bodies for item in one.Items]
    return model.create_entity("IfcShapeRepresentation", first.ContextOfItems, "Body", first.RepresentationType, items)
