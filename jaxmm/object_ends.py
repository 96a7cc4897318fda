"""Both ends of a face: how far it may go on there, how deep the thing behind it may be, and what is in view.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.object_pieces import Piece
from jaxmm.object_sight import Patch, Sight, crossings, crossings_along
from jaxmm.object_view import View, edge_beyond
from jaxmm.object_walls import WallSettings, reach

FAR = 3.0  # [m] that a face may go on for, or a thing be deep; more tells no more
STEP, STEPS = 0.1, 20  # [m] in which one looks for the back of a thing, from STEP behind its face on
BACKS = (0.2, 0.4, 0.6, 0.8, 1.0, 1.3)  # [m] behind the face, where one looks along it
THROUGH = 0.3  # share of the rays, from which on one looks through
NEAR = 0.2  # [m] of an end a point is at it


class End(NamedTuple):
    """One end of a face."""

    goes_on: float  # [m] most that the face may go on unseen; FAR at most
    deep: float  # [m] behind the face, beside this end, one looks through from here on; FAR where nowhere
    in_view: float  # [m] to the edge of the view, on in the line of the face; FAR at most
    apart: float  # [m] of its points to the surface of the other side, least of all; 1 at most


def ends_of(
    sight: Sight, piece: Piece, members: np.ndarray, apart: np.ndarray, view: View | None, settings: WallSettings
) -> tuple[End, End]:
    """The end of a face that is nearer to the sensor, and the other one.

    Args:
        sight: of all points.
        piece: with the face.
        members: (n,) int of the points of all that the face is part of.
        apart: (N,) [m] from the surface of the other side.
        view: of the scan that saw it; None where that looks all around.
        settings: how far is looked.
    """
    heights = np.quantile(sight.points[members, 2], (0.1, 0.3, 0.5, 0.7, 0.9))

    def end_at(way: float) -> End:
        face, end = piece.face, piece.face.ends[0 if way < 0 else 1]
        patch = Patch(end - STEP * piece.toward, end - (STEPS + 1) * STEP * piece.toward, *_heights(sight, settings))
        found = crossings_along(sight, patch, settings.tolerance, STEPS)
        through = (STEP * (number + 1) for number, one in enumerate(found) if one.free > THROUGH)
        near = np.linalg.norm(sight.points[members, :2] - end, axis=1) < NEAR
        return End(
            min(reach(sight, piece, way, settings), FAR),
            next(through, FAR),
            edge_beyond(view, end, way * face.along, heights, FAR),
            float(np.min(apart[members[near]], initial=1.0)),
        )

    nearer = 1.0 if (piece.origin[:2] - piece.face.center) @ piece.face.along > 0.0 else -1.0
    return end_at(nearer), end_at(-nearer)


def back_of(sight: Sight, piece: Piece, settings: WallSettings) -> float:
    """How far [m] behind a face rays pass along its back: no thing behind it is deeper. FAR where none do."""
    heights = _heights(sight, settings)
    for back in BACKS:
        start, end = piece.face.ends - back * piece.toward
        if crossings(sight, Patch(start, end, *heights), settings.tolerance).free > THROUGH:
            return back
    return FAR


def _heights(sight: Sight, settings: WallSettings) -> tuple[float, float]:
    return sight.floor + settings.rim, sight.ceiling - settings.rim
