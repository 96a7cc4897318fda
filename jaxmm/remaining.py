"""What is new before what remains of a building: behind a wall that is gone, everything passed for old.

N points of the robot, P rays, E elements. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

import numpy as np

from jaxmm.building_sighting import sight
from jaxmm.evidence import SUPPORT, View
from jaxmm.hanging import FILLINGS, scene_of
from jaxmm.hindsight import APART
from jaxmm.judging import Judges, judge
from jaxmm.mismatches import KINDS, Looked
from jaxmm.object_clues import ONTO
from jaxmm.outdoors import indoors
from jaxmm.priors import Prior
from jaxmm.verdicts import REMOVED, Verdict
from warp_scanner.buildings import Building, element_bounds
from warp_scanner.scan import Rays
from warp_scanner.scenes import WALL
from warp_scanner.triangles import TriangleScene, cast_triangles, clearance

FRAME = 0.1  # [m] by which a door or a window may stand out of its wall


def compared_with_what_remains(
    prior: Prior, looked: list[Looked], verdicts: list[Verdict], judges: Judges
) -> list[Looked] | None:
    """The scans, those of the robot's points judged anew that are seen past what is gone.

    What stands behind a wall that is gone is beyond what its rays should have met, as old things there are; it is
    before what remains, as new things are. Points on what is called gone, as on a part of it that still stands, or a
    door that does, keep what was said of them, and so do those outside of the building, where nobody knows what is old.

    Args:
        prior: a building.
        looked: each scan.
        verdicts: (E,) of the elements; walls and columns are gone with the doors and windows in them.
        judges: the models.

    Returns:
        The scans; None where no wall is gone, or everything is: of what is new there only walls count.
    """
    triangles, elements = prior.scene.triangles, _gone(prior.building, verdicts)
    gone = elements[triangles.element]
    if not np.any(triangles.semantic[elements] == WALL) or gone.all():
        return None
    rest = prior._replace(scene=scene_of(triangles, ~gone))
    # A frame has sides that its wall used to hide.
    filling = gone & np.isin(triangles.semantic[triangles.element], FILLINGS)
    fillings = scene_of(triangles, filling) if filling.any() else None
    return [_anew(prior, (rest, fillings), one, judges) for one in looked]


def _gone(building: Building, verdicts: list[Verdict]) -> np.ndarray:
    """(E,) bool: walls and columns that are removed, and what fills their openings."""
    semantic = building.triangles.semantic
    gone = np.array([one.verdict == REMOVED for one in verdicts]) & np.isin(semantic, list(KINDS))
    low, high = element_bounds(building.triangles)
    for row in np.flatnonzero(np.isin(semantic, FILLINGS)):
        gone[row] = np.any(gone & np.all((low <= low[row] + FRAME) & (high >= high[row] - FRAME), axis=1))
    return gone


def _anew(prior: Prior, left: tuple[Prior, TriangleScene | None], one: Looked, judges: Judges) -> Looked:
    """One scan compared with what is left: a prior without what is gone, and its doors and windows, which may hang."""
    rest, fillings = left
    seen, rays, old = sight(rest, one.rays), one.rays, one.added.view
    fresh = (seen.robot.count != old.count).any(axis=1) & (old.count[:, SUPPORT] == 0)
    fresh[fresh] = _indoors(prior, old.points[fresh], rays.position) & ~_is_on(fillings, old.points[fresh])
    if not fresh.any():
        return one
    view = View(*(None if a is None else _chosen(fresh, a, b) for a, b in zip(seen.robot, old, strict=True)))
    side = judge(judges, view, seen.frame, "added")
    pillar, wall = (_chosen(fresh, a, b) for a, b in zip(side[1:], one.added[1:], strict=True))
    expected, new = one.expected.copy(), seen.expected.distance
    differs = np.flatnonzero((new != expected) & np.isfinite(rays.distance))
    past = differs[np.abs(rays.distance[differs] - expected[differs]) > APART]
    ends = rays.position + rays.direction[past] * rays.distance[past, None].astype(np.float64)
    past = past[_indoors(prior, ends, rays.position) & ~_is_on(fillings, ends)]
    expected[past] = new[past]
    return one._replace(expected=expected, added=side._replace(pillar=pillar, wall=wall))


def _indoors(prior: Prior, points: np.ndarray, sensor: np.ndarray) -> np.ndarray:
    """(N,) bool: inside the building, and under something of it where the sensor is, too: terrain reaches farther."""
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    covered = np.isfinite(cast_triangles(prior.scene, Rays(np.vstack([sensor, points]), up)).distance[:, 0])
    return indoors(prior, points) & (covered[1:] | ~covered[0])


def _is_on(scene: TriangleScene | None, points: np.ndarray) -> np.ndarray:
    """(N,) bool: on the surface of something."""
    if scene is None:
        return np.zeros(len(points), bool)
    return clearance(scene, points, ONTO) < ONTO


def _chosen(fresh: np.ndarray, new: np.ndarray, old: np.ndarray) -> np.ndarray:
    """Rows (N, ...) of `new` where fresh, else of `old`."""
    return np.where(fresh.reshape(-1, *(1,) * (new.ndim - 1)), new, old)
