"""What scans tell past what is gone: there, all that is new passes for old, and what is old for out of reach.

N points of one side, P rays, E elements. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.building_sighting import Sighting, sight
from jaxmm.evidence import SUPPORT, View
from jaxmm.hanging import FILLINGS, scene_of
from jaxmm.hindsight import APART
from jaxmm.judging import Judges, Side, judge
from jaxmm.mismatches import KINDS, Looked
from jaxmm.object_clues import ONTO
from jaxmm.outdoors import indoors
from jaxmm.priors import Prior
from jaxmm.verdicts import REMOVED, Told, Verdict, VerdictSettings, is_seen, told_of, verdicts_of
from warp_scanner.buildings import Building, element_bounds
from warp_scanner.scan import Rays
from warp_scanner.triangles import TriangleScene, cast_triangles, clearance

FRAME = 0.1  # [m] by which a door or a window may stand out of its wall


class Remains(NamedTuple):
    """A building without what is gone."""

    prior: Prior
    fillings: TriangleScene | None  # doors and windows that are gone: of their frames one sees what walls used to hide


def compared_with_what_remains(
    prior: Prior,
    scans: tuple[list[Looked], list[Told]],
    judges: Judges,
    asked: tuple[list[int], VerdictSettings],
) -> tuple[list[Looked], list[Told]]:
    """The scans, and what they tell of elements, with a second look past walls and columns that are gone.

    What stands behind a wall that is gone is beyond what its rays should have met, as old things there are; it is
    before what remains, as new things are. Points on what is called gone, as on a part of it that still stands, or a
    door that does, keep what was said of them, and so do those outside of the building, where nobody knows what is old.
    Elements that too few rays told of are asked for again: of a wall of several layers, of which each is an element, of
    two in one place, and of whole rooms that are not built yet, what is gone hid all but the first. What that shows to
    be gone is taken away in turn.

    Args:
        prior: a building.
        scans: each as it was looked at, and what it tells.
        judges: the models.
        asked: semantic classes whose elements may be gone, and when they are.

    Returns:
        Both, as they were where nothing is gone, or everything.
    """
    looked, told = scans
    classes, limits = asked
    triangles = prior.scene.triangles
    gone = np.zeros(len(triangles.semantic), bool)
    past, says = looked, told
    while True:
        now = gone | _gone(prior.building, verdicts_of(says, limits), classes)
        if np.array_equal(now, gone) or now[triangles.element].all():
            return past, says
        gone = now
        remains = _without(prior, gone)
        seen = [sight(remains.prior, one.rays) for one in looked]
        hidden = [~is_seen(one.rays, limits) & ~gone for one in says]
        removed = [_asked_again(*each, judges) for each in zip(past, seen, hidden, strict=True)]
        says = [
            told_of(one.scanned | new.reached, side.view.element, side.view.count, side.probability)
            for one, new, side in zip(says, seen, removed, strict=True)
        ]
        past = [
            _judged_anew(prior, remains, one, new, judges)._replace(removed=side)
            for one, new, side in zip(looked, seen, removed, strict=True)
        ]


def _without(prior: Prior, gone: np.ndarray) -> Remains:
    triangles = prior.scene.triangles
    is_gone = gone[triangles.element]
    filled = is_gone & np.isin(triangles.semantic[triangles.element], FILLINGS)
    fillings = scene_of(triangles, filled) if filled.any() else None
    return Remains(prior._replace(scene=scene_of(triangles, ~is_gone)), fillings)


def _gone(building: Building, verdicts: list[Verdict], classes: list[int]) -> np.ndarray:
    """(E,) bool: walls and columns that are removed, and what fills their openings."""
    wanted = np.isin(building.triangles.semantic, list(KINDS)) & np.isin(building.triangles.semantic, classes)
    gone = np.array([one.verdict == REMOVED for one in verdicts]) & wanted
    return gone | filling(building, gone)


def filling(building: Building, chosen: np.ndarray) -> np.ndarray:
    """(E,) bool: doors and windows in the box of any of the chosen (E,) elements."""
    low, high = element_bounds(building.triangles)
    found = np.zeros(len(chosen), bool)
    for row in np.flatnonzero(np.isin(building.triangles.semantic, FILLINGS)):
        found[row] = np.any(chosen & np.all((low <= low[row] + FRAME) & (high >= high[row] - FRAME), axis=1))
    return found


def _asked_again(one: Looked, seen: Sighting, hidden: np.ndarray, judges: Judges) -> Side:
    """The prior's side of one scan, with points of `hidden` (E,) elements as far as what remains shows them."""
    again = hidden[seen.prior.element]
    if not again.any():
        return one.removed
    new, stays = judge(judges, seen.prior, seen.frame, "removed"), ~hidden[one.removed.view.element]
    return _joined(_some(one.removed, stays), _some(new, again))


def _some(side: Side, chosen: np.ndarray) -> Side:
    return Side(side.view.at(chosen), side.pillar[chosen], side.wall[chosen])


def _joined(one: Side, other: Side) -> Side:
    view = View(*(None if a is None else np.concatenate([a, b]) for a, b in zip(one.view, other.view, strict=True)))
    return Side(view, *(np.concatenate(both) for both in zip(one[1:], other[1:], strict=True)))


def _judged_anew(prior: Prior, remains: Remains, one: Looked, seen: Sighting, judges: Judges) -> Looked:
    """One scan, the robot's points past what is gone compared with what remains."""
    rays, old = one.rays, one.added.view
    fresh = (seen.robot.count != old.count).any(axis=1) & (old.count[:, SUPPORT] == 0)
    fresh[fresh] = _indoors(prior, old.points[fresh], rays.position) & ~_is_on(remains.fillings, old.points[fresh])
    if not fresh.any():
        return one
    view = View(*(None if a is None else _chosen(fresh, a, b) for a, b in zip(seen.robot, old, strict=True)))
    side = judge(judges, view, seen.frame, "added")
    pillar, wall = (_chosen(fresh, a, b) for a, b in zip(side[1:], one.added[1:], strict=True))
    expected, new = one.expected.copy(), seen.expected.distance
    differs = np.flatnonzero((new != expected) & np.isfinite(rays.distance))
    past = differs[np.abs(rays.distance[differs] - expected[differs]) > APART]
    ends = rays.position + rays.direction[past] * rays.distance[past, None].astype(np.float64)
    past = past[_indoors(prior, ends, rays.position) & ~_is_on(remains.fillings, ends)]
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
