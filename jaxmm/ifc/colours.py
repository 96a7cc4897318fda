"""Colours of elements of an IFC model, as surface styles on their bodies, which viewers show without being asked.

Bodies that other elements share through a map are copied for the one that is painted, item by item; what the items
themselves refer to (profiles, shells, points) stays shared.
"""

from typing import Any

from jaxmm.ifc.draft import Draft
from jaxmm.ifc.removal import belongings

REMOVED, ADDED = "jaxmm removed", "jaxmm added"  # names of the styles
COLOURS = {REMOVED: (213, 94, 0), ADDED: (0, 114, 178)}  # vermillion and blue, as in all our reports
BODY = ("Body", "", None)  # identifiers of representations that are painted
MOST_NESTED = 16  # maps within maps


class Painter:
    """Paints elements of one draft; each style is made once."""

    def __init__(self, draft: Draft):
        self.draft = draft
        self._styles: dict[str, Any] = {}

    def paint(self, element: Any, name: str) -> bool:
        """Give the bodies of an element, and of its parts, the style of that name.

        Returns:
            Whether all of it could be painted: not what shares its representation itself with other elements.
        """
        done = True
        for one in belongings([element]):
            shape = None if one.is_a("IfcFeatureElement") else getattr(one, "Representation", None)
            for body in shape.Representations if shape else ():
                if body.RepresentationIdentifier in BODY:
                    done &= self._paint_body(body, name)
        return done

    def _paint_body(self, body: Any, name: str) -> bool:
        if sum(one.is_a("IfcProductRepresentation") for one in self.draft.model.get_inverse(body)) != 1:
            return False
        if any(len(one.ShapeOfProduct) > 1 for one in body.OfProductRepresentation):
            return False
        items = [self._own(item, name) if item.is_a("IfcMappedItem") else item for item in body.Items]
        if items != list(body.Items):
            old = body.Items
            self.draft.put(body, "Items", items)
            for item in old:
                if item not in items and not self.draft.model.get_total_inverses(item):
                    self.draft.remove(item)
        for item in items:
            self._style(item, name)
        return True

    def _own(self, item: Any, name: str, depth: int = 0) -> Any:
        """A copy of a mapped item whose map has styled copies of what the other's has."""
        old = item.MappingSource
        items = []
        for one in old.MappedRepresentation.Items:
            nested = one.is_a("IfcMappedItem") and depth < MOST_NESTED
            made = self._own(one, name, depth + 1) if nested else self._copy(one)
            self._style(made, name)
            items.append(made)
        body = self._copy(old.MappedRepresentation)
        self.draft.put(body, "Items", items)
        return self.draft.create(
            "IfcMappedItem", self.draft.create("IfcRepresentationMap", old.MappingOrigin, body), item.MappingTarget
        )

    def _copy(self, entity: Any) -> Any:
        """A new entity with the same attributes, which it shares."""
        return self.draft.create(entity.is_a(), *entity)

    def _style(self, item: Any, name: str) -> None:
        """One style an item is all that the schema allows, so one that is there is taken over."""
        chosen = [self._chosen(name)]
        styled = next((one for one in self.draft.model.get_inverse(item) if one.is_a("IfcStyledItem")), None)
        if styled is None:
            self.draft.create("IfcStyledItem", Item=item, Styles=chosen)
        elif list(styled.Styles) != chosen:
            self.draft.put(styled, "Styles", chosen)

    def _chosen(self, name: str) -> Any:
        """The style of that name, in IFC2X3 within the assignment that styled items there need."""
        if name not in self._styles:
            create = self.draft.create
            colour = create("IfcColourRgb", None, *(round(value / 255.0, 6) for value in COLOURS[name]))
            rendering = create(
                "IfcSurfaceStyleRendering", SurfaceColour=colour, Transparency=0.0, ReflectanceMethod="NOTDEFINED"
            )
            style = create("IfcSurfaceStyle", name, "BOTH", [rendering])
            old = self.draft.model.schema == "IFC2X3"
            self._styles[name] = create("IfcPresentationStyleAssignment", [style]) if old else style
        return self._styles[name]
