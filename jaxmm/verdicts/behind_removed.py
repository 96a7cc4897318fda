"""What scans tell of a building without its removed elements: which elements behind them show, and what is new there.

N points of one side, P rays, E elements. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxmm.learning.boxes import Box
from jaxmm.learning.prediction import Judges, Side, judge
from jaxmm.objects.clues import ONTO
from jaxmm.rays.evidence import SUPPORT, Frame, View
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.verdicts import standing_alone
from jaxmm.verdicts.building_evidence import sight
from jaxmm.verdicts.hanging_openings import FILLINGS
from jaxmm.verdicts.mismatch_points import inside
from jaxmm.verdicts.mismatches import KINDS
from jaxmm.verdicts.outdoors import indoors
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.scan_fusion import Looked, place_of
from jaxmm.verdicts.standing_alone import APART
from jaxmm.verdicts.verdicts import REMOVED, STANDS, Told, Verdict, VerdictSettings, is_seen, told_of, verdicts_of
from warp_scanner.buildings.changes import of_element
from warp_scanner.scenes.building import Building, element_bounds
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles, clearance, prepare_part

FRAME = 0.1  # [m] by which a door or a window may stand out of its wall, or be smaller than its opening
HID = 2  # times as many points of an element as before, from which it is asked for again


class Again(NamedTuple):
    """One scan compared with what remains."""

    robot: View
    frame: Frame
    expected: np.ndarray  # (P,) float32 [m] what its rays should then have met


class Past(NamedTuple):
    """One scan, and what it tells of elements past those that it shows to be gone."""

    told: Told
    removed: Side  # with points of what was hidden
    gone: np.ndarray  # (E,) bool, with the doors and windows in them
    seen: Again | None = None  # None where nothing is gone


class Says(NamedTuple):
    """What one scan tells of elements, and what of it does not hang on how well its pose is known."""

    told: Told
    sure: Told


def past_nothing(one: Looked, told: Told) -> Past:
    """A scan of which nothing is known to be gone yet."""
    return Past(told, one.removed, np.zeros(len(told.scanned), bool))


def look_past_what_is_gone(
    building: Building,
    says: list[Says],
    limits: VerdictSettings,
    again: Callable[[np.ndarray], list[Says | None]],
) -> list[Says]:
    """What scans tell of elements, compared again without what is gone, of whatever class it is.

    What stands behind a wall that is gone is beyond what its rays should have met, as old things there are; it is
    before what remains, as new things are. Points on what is called gone, as on a part of it that still stands, or a
    door that does, keep what was said of them, and so do those outside of the building, where nobody knows what is old.
    Elements that too few rays told of, or of which what is gone hid more than it left, are asked for again: of a wall
    of several layers, of which each is an element, of two in one place, and of whole rooms that are not built yet, all
    but the first. What that shows to be gone is taken away in turn, of each scan what it has seen itself.

    Args:
        building: the prior's.
        says: what each scan tells; nothing but what is sure makes an element count as gone.
        limits: when elements are gone.
        again: asks each scan once more, by `ask_again`, without what is gone (E,) bool; of those that show nothing more
            to be gone it is None.
    """
    while True:
        new = again(gone_of(building, verdicts_of([one.sure for one in says], limits)))
        if all(one is None for one in new):
            return says
        says = [old if one is None else one for old, one in zip(says, new, strict=True)]


def gone_of(building: Building, verdicts: list[Verdict]) -> np.ndarray:
    """(E,) bool: what is removed and hides nothing any more, of whatever class: linings, ceilings and furniture, too.

    Doors and windows are not among them: those that open are where they were, and go with their wall.
    """
    opens = np.isin(building.triangles.semantic, FILLINGS)
    return np.array([one.verdict == REMOVED for one in verdicts]) & ~opens


def holders(building: Building, gone: np.ndarray) -> np.ndarray:
    """(E,) bool: of what is gone (E,), walls and columns: doors and windows in them are gone with them."""
    return gone & np.isin(building.triangles.semantic, list(KINDS))


def filling(building: Building, chosen: np.ndarray) -> np.ndarray:
    """(E,) bool: doors and windows whose middle is in the box of a chosen (E,) element, and that touch it."""
    triangles, found = building.triangles, np.zeros(len(chosen), bool)
    low, high = element_bounds(triangles)
    rows = np.flatnonzero(np.isin(triangles.semantic, FILLINGS) & np.isfinite(low).all(axis=1))
    middle = (low[rows] + high[rows]).astype(np.float64) / 2
    for wall in np.flatnonzero(chosen):
        one = of_element(building, int(wall))
        within = rows[inside(Box("wall", one.center, one.size, float(one.yaw)), middle, np.zeros(3))]
        surface = prepare_part(triangles, triangles.element == wall) if len(within) else None
        for row in within:
            corners = triangles.vertices[np.unique(triangles.faces[triangles.element == row])]
            found[row] |= bool(np.any(clearance(surface, corners, FRAME) < FRAME))
    return found


def remains_of(prior: Prior, gone: np.ndarray) -> Prior:
    """The prior whose surface lacks some (E,) bool of the elements, not all."""
    triangles = prior.scene.triangles
    return prior._replace(scene=prepare_part(triangles, ~gone[triangles.element]))


def ask_again(prior: Prior, one: Looked, view: Past, gone: np.ndarray, judges: Judges, limits: VerdictSettings) -> Past:
    """The same view where the scan shows nothing more to be gone (E,); else what it tells without all that."""
    fresh = gone & is_seen(view.told.rays, limits) & ~view.gone
    if not fresh.any():
        return view
    now = view.gone | (fresh & ~_wait(prior, one.rays, fresh))
    now |= filling(prior.building, holders(prior.building, now))
    if now[prior.scene.triangles.element].all():
        return view
    seen = sight(remains_of(prior, now), one.rays)
    shown = np.bincount(seen.prior.element, minlength=len(now))
    hidden = (~is_seen(view.told.rays, limits) | (shown > HID * view.told.points)) & (shown > 0) & ~now
    side = view.removed
    if hidden.any():
        new = judge(judges, seen.prior, seen.frame, "removed")
        side = _joined(_some(side, ~hidden[side.view.element]), _some(new, hidden[seen.prior.element]))
    reached = view.told.scanned | seen.reached
    told = told_of(reached, side.view.element, side.view.count, side.probability)
    return Past(told, side, now, Again(seen.robot, seen.frame, seen.expected.distance))


def _wait(prior: Prior, rays: ScanRays, fresh: np.ndarray) -> np.ndarray:
    """(E,) bool: of what is gone, that of which a part may stand; where that is all, none, so that rounds end.

    By the edge of a wall that shows beside another nobody knows whether the rest, behind that, stands.
    """
    waits = np.zeros(len(fresh), bool)
    if fresh.sum() > 1:
        rows = np.flatnonzero(fresh)
        waits[rows] = [standing_alone.of_element(prior.scene, int(row), rays).standing >= STANDS for row in rows]
    return waits & (fresh & ~waits).any()


def _some(side: Side, chosen: np.ndarray) -> Side:
    return Side(side.view.at(chosen), side.pillar[chosen], side.wall[chosen])


def _joined(one: Side, other: Side) -> Side:
    view = View(*(None if a is None else np.concatenate([a, b]) for a, b in zip(one.view, other.view, strict=True)))
    return Side(view, *(np.concatenate(both) for both in zip(one[1:], other[1:], strict=True)))


def judged_anew(prior: Prior, one: Looked, view: Past, judges: Judges) -> Looked:
    """One scan, the robot's points past what is gone compared with what remains."""
    return one if view.seen is None else _judged_anew(prior, one, view, judges)._replace(removed=view.removed)


def _judged_anew(prior: Prior, one: Looked, view: Past, judges: Judges) -> Looked:
    rays, old, seen = one.rays, one.added.view, view.seen
    fresh = (seen.robot.count != old.count).any(axis=1) & (old.count[:, SUPPORT] == 0)
    if not fresh.any():
        return one
    stands = _standing_still(prior, view.gone, rays)
    fresh[fresh] = _indoors(prior, old.points[fresh], rays.position) & ~_is_on(stands, old.points[fresh])
    if not fresh.any():
        return one
    mixed = View(*(None if a is None else _chosen(fresh, a, b) for a, b in zip(seen.robot, old, strict=True)))
    side = judge(judges, mixed, seen.frame, "added")
    pillar, wall = (_chosen(fresh, a, b) for a, b in zip(side[1:], one.added[1:], strict=True))
    expected, new = one.expected.copy(), seen.expected
    differs = np.flatnonzero((new != expected) & np.isfinite(rays.distance))
    past = differs[np.abs(rays.distance[differs] - expected[differs]) > APART]
    ends = rays.position + rays.direction[past] * rays.distance[past, None].astype(np.float64)
    past = past[_indoors(prior, ends, rays.position) & ~_is_on(stands, ends)]
    expected[past] = new[past]
    return one._replace(expected=expected, added=side._replace(pillar=pillar, wall=wall))


def _standing_still(prior: Prior, gone: np.ndarray, rays: ScanRays) -> TriangleScene | None:
    """Of what is gone: what stands in part, and doors and windows, whose frames have sides that walls used to hide."""
    triangles = prior.scene.triangles
    chosen = gone & np.isin(triangles.semantic, FILLINGS)
    for row in np.flatnonzero(gone & ~chosen):
        chosen[row] = standing_alone.of_element(prior.scene, int(row), rays).standing >= STANDS
    return prepare_part(triangles, chosen[triangles.element]) if chosen[triangles.element].any() else None


def _indoors(prior: Prior, points: np.ndarray, sensor: np.ndarray) -> np.ndarray:
    """(N,) bool: inside the building, and under something of it where the sensor is, too: terrain reaches farther.

    One point tells of all in its place of 0.1 m, for many rays end on one wall.
    """
    if not len(points):
        return np.zeros(0, bool)
    place = place_of(points)
    points = points[np.unique(place, return_index=True)[1]]
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    covered = np.isfinite(cast_triangles(prior.scene, Rays(np.vstack([sensor, points]), up)).distance[:, 0])
    return (indoors(prior, points) & (covered[1:] | ~covered[0]))[place]


def _is_on(scene: TriangleScene | None, points: np.ndarray) -> np.ndarray:
    """(N,) bool: on the surface of something."""
    if scene is None:
        return np.zeros(len(points), bool)
    return clearance(scene, points, ONTO) < ONTO


def _chosen(fresh: np.ndarray, new: np.ndarray, old: np.ndarray) -> np.ndarray:
    """Rows (N, ...) of `new` where fresh, else of `old`."""
    return np.where(fresh.reshape(-1, *(1,) * (new.ndim - 1)), new, old)
