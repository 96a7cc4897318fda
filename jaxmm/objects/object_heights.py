"""How far up and down an object goes: to ceiling and floor, unless one sees that it ends before.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

import numpy as np

from jaxmm.objects.patches import LEAST_RAYS, Patch, Sight, crossings
from jaxmm.objects.pieces import PieceSettings
from jaxmm.objects.walls import Solid

WITHIN = 0.7  # of a front's width: rays past its edges tell nothing
ENDS = 0.5  # share of the rays past an object's end which meet something else there or go on


def levels_of(sight: Sight, solid: Solid, settings: PieceSettings) -> tuple[float, float, bool]:
    """Lowest and highest level [m], and whether both are seen, not assumed.

    Args:
        sight: of all points.
        solid: the object.
        settings: what counts as a gap.
    """
    z = sight.points[solid.members, 2]
    low, high = float(z.min()), float(z.max())
    start, end = _front(sight, solid)
    levels, measured = [], True
    for surface, seen, bottom, top in (
        (sight.floor, low, sight.floor, low),
        (sight.ceiling, high, high, sight.ceiling),
    ):
        patch = Patch(start, end, bottom + settings.rim, top - settings.rim)
        found = crossings(sight, patch, settings.tolerance)
        ends = top - bottom > settings.in_line and found.total >= LEAST_RAYS
        ends &= found.on + found.beyond > ENDS * found.total
        levels.append(seen if ends else surface)
        measured &= ends or top - bottom <= settings.in_line
    return levels[0], levels[1], measured


def _front(sight: Sight, solid: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Both ends (2,) [m] of the middle of the side that faces the sensor."""
    toward = np.median(sight.origin[solid.members, :2], axis=0) - solid.center
    along = toward / max(float(np.linalg.norm(toward)), 1e-6) if solid.shape == "round" else solid.along
    axes = np.stack([along, [-along[1], along[0]]])
    ahead = axes @ toward / np.maximum(solid.edges, 1e-3)
    # A wall's side, however slantwise it is seen; a pillar's face that is turned to the sensor most.
    front = int(np.argmin(solid.edges)) if solid.object_type == "wall" else int(np.argmax(np.abs(ahead)))
    middle = solid.center + axes[front] * np.sign(ahead[front]) * solid.edges[front] / 2
    half = axes[1 - front] * solid.edges[1 - front] / 2 * WITHIN
    return middle - half, middle + half
