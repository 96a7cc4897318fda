"""As-built places: how far off its place in the model each element stands, with intervals.

E elements, S scans. Positions are offsets from the prior's origin, world axes: metres, z up.

Each face that rays end on is fitted (`fits`), the pose of each scan is told by all of its faces together
(`pose_errors`), and what is left moves the element: a shift and a turn about its middle, by least squares over all its
faces in all scans. Directions that no face fixes, as along a wall, stay open. Intervals of 95 % hold the rays' errors,
how much faces in their place scatter (which holds the sensor's own bias), and the pose's, as the level of detection of
M3C2 does (Lague et al. 2013, equation 1: both surfaces' errors and the registration's).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxmm.deviations.agreed_poses import agreed
from jaxmm.deviations.curved_fits import fits_of_curved
from jaxmm.deviations.element_motion import Motion, Seen, motion_of, telling, told_by_others
from jaxmm.deviations.fits import CUT, Fit, cells_of, fit_of
from jaxmm.deviations.heights import heights_of
from jaxmm.deviations.meetings import STEEP, Meetings, groups_of, meetings_of
from jaxmm.deviations.pose_errors import EXACTLY, PoseError, likely_poses, pose_errors
from jaxmm.deviations.seen_surfaces import Faces, ends_of, surface_of
from jaxmm.deviations.shifted_columns import Shift, columns_of, met_at_ends
from jaxmm.deviations.tolerances import Slope, din_of, loa_of
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.vectors import lengths
from warp_scanner.scenes.building import element_bounds, faces_by_element
from warp_scanner.sensors.triangles import TriangleScene, clearance, prepare_part

AXIS = np.radians(3.0)  # between a direction and what faces fix, up to which they do, or do not
ROUND = 4  # ways that faces of a slender body look, that one place shows: no box has so many
SURE = 0.02  # [m] by which an offset may be wrong, for scans to be judged by it, and not by what their poses have
ANOTHER, ASKED = 0.015, 200  # [m] off its place, from which a face may be another's; and rays that are asked
NO_RAYS, NO_CELL = np.zeros(0), np.zeros(0, np.int64)
Interval = tuple[float, float]


class Deviation(NamedTuple):
    """Where one element stands, less where the model has it. World axes, metres and degrees."""

    offset: tuple[float, float, float]  # of its middle; 0 along what no face fixes
    interval: tuple[Interval | None, Interval | None, Interval | None]  # 95 %; None along an axis that no face fixes
    distance: float  # along `direction`
    direction: tuple[float, float, float]  # the normal of the faces seen, toward the sensor
    turn: float | None  # about the vertical, counter-clockwise; None where no face tells
    lean: float | None  # from plumb, or of what lies from level
    flatness: float  # 95 % of the places of 0.1 m are so near to the fitted faces
    coverage: float  # share of its surface that was seen, and lies within the tolerance
    rays: int  # that end on it
    classes: dict[str, str]  # by standard
    # What follows is not in report.json.
    turned: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [rad] rotation vector about its middle, of what faces fix
    half: float = 0.0  # [m] that the interval of `distance` reaches to either side, at most
    stands: float = 1.0  # share of the rays that could reach it, that end on it
    scans: tuple[int, ...] = ()  # numbers of those that show it
    worst: float = 0.0  # [m] where it is turned or leans, its ends are off by more than this less `half`
    # Offset that scans are judged by, and [m] by which it may be wrong: where it is open what moved, it is as the pose
    # has it, though that may be off.
    step: tuple[float, float, float] = (0.0, 0.0, 0.0)
    step_half: float = 0.0
    long: float = 1.0  # [m] its length
    slopes: tuple[Slope, ...] = ()  # by its turn and its lean, of what faces fix
    before: bool = False  # it may be the front of what stands before it that was measured

    @property
    def most(self) -> float:
        """[m] by which its middle is off, or a twentieth of what was seen of it, as it is turned or leans."""
        return max(abs(self.distance), self.worst)

    @property
    def surely(self) -> float:
        """[m] by which it is off at least; 0 where its interval holds its place."""
        return max(0.0, self.most - self.half)


def shifted(one: Deviation, shift: Shift) -> Deviation:
    """The deviation of a column that was found beside its place, from what it is off there."""
    offset = np.array(one.offset) + shift.step
    interval = [
        (shift.step[axis] - shift.half[axis], shift.step[axis] + shift.half[axis]) if axis < 2 and known is None
        else known and (known[0] + shift.step[axis], known[1] + shift.step[axis])
        for axis, known in enumerate(one.interval)
    ]  # fmt: skip
    distance = float(np.linalg.norm(offset))
    # No face looks the way it went: what tells is where the whole of it stands.
    way = offset / max(distance, 1e-9)
    half = float(sum(abs(way[axis]) * (both[1] - both[0]) / 2.0 for axis, both in enumerate(interval) if both))
    return one._replace(
        offset=_plain(offset),
        interval=tuple(both and (float(both[0]), float(both[1])) for both in interval),
        distance=distance, direction=_plain(way), half=half, coverage=0.0,
        classes={"loa": loa_of(distance + one.flatness), "din18202": din_of(distance, half, one.long, one.slopes)},
        # Its ends are off by what it is turned or leans, whatever its middle is off there.
        worst=distance + max(0.0, one.worst - one.half - abs(one.distance)), step=_plain(offset), step_half=half,
    )  # fmt: skip


# Fields that are not in report.json.
PRIVATE = ("turned", "half", "stands", "scans", "worst", "step", "step_half", "long", "slopes", "before")


def is_told(one: Deviation) -> bool:
    """Whether anything is known of its place; not where all that is off may be the pose."""
    return any(both is not None for both in one.interval)


class Body(NamedTuple):
    """An element as the model has it, or several."""

    low: np.ndarray  # (3,) [m]
    high: np.ndarray  # (3,) [m]
    area: float  # [m2]
    corners: np.ndarray  # (V, 3) [m]

    @property
    def middle(self) -> np.ndarray:
        """(3,) [m]."""
        return (self.low + self.high) / 2.0


def deviations_of(
    scene: TriangleScene, rays: list[ScanRays], trust: list[str], tolerance: np.ndarray
) -> dict[int, Deviation]:
    """The deviation of every element that some scan tells of, by its row, as `deviations_by` has it.

    Args:
        scene: the model.
        rays: of each scan, where it was placed.
        trust: in the pose of each scan, one of pose_errors.TRUSTS.
        tolerance: (E,) [m] of each element, for its coverage.
    """
    shown = [faces_of(scene, *one) for one in zip(rays, trust, strict=True)]
    return deviations_by(scene, agreed(shown), tolerance)


def faces_of(
    scene: TriangleScene,
    rays: ScanRays,
    trust: str,
    own: np.ndarray | None = None,
    clear: np.ndarray | None = None,
) -> Faces:
    """What one scan shows: its faces, and what all of them tell of its pose.

    Args:
        scene: the model.
        rays: of the scan, where it was placed.
        trust: in its pose, one of pose_errors.TRUSTS.
        own: as of `meetings_of`,
        clear: and this too.
    """
    met = meetings_of(scene, rays, own, clear)
    found = fits_of(scene, met, columns_of(scene))
    found = [(group, fit._replace(number=number)) for number, (group, fit) in enumerate(found)]
    poses, unlikely = likely_poses(pose_errors([fit for _, fit in found], rays.position, trust))
    seen = seen_of_each(found, poses, rays.position)
    heights, ends = heights_of(scene.triangles, met), met_at_ends(scene, met)
    return Faces(rays.position, poses, seen, heights, ends, unlikely)


def deviations_by(scene: TriangleScene, shown: list[Faces], tolerance: np.ndarray) -> dict[int, Deviation]:
    """The deviation of every element that some scan tells of, by its row.

    Where the pose alone may be what is off, intervals are None along all axes: then its offset is as the pose has it.

    Args:
        scene: the model.
        shown: by each scan.
        tolerance: (E,) [m] of each element, for its coverage.
    """
    faces, bodies = by_element(shown), bodies_of(scene)
    return {row: deviation_of(seen, shown, bodies(row), float(tolerance[row])) for row, seen in faces.items()}


def by_element(shown: list[Faces]) -> dict[int, list[Seen]]:
    """By its row the faces of each element, with the number of the scan that shows them."""
    faces: dict[int, list[Seen]] = {}
    for number, one in enumerate(shown):
        for each in one.seen:
            faces.setdefault(each.element, []).append(each._replace(scan=number))
    return faces


def seen_of_each(found: list[tuple[Meetings, Fit]], poses: list[PoseError], sensor: np.ndarray) -> list[Seen]:
    """Fitted faces of one scan, their rays summed up; each where the faces of all other elements have the pose."""
    own: dict[int, list[Fit]] = {}
    for group, fit in found:
        own.setdefault(int(group.element[0]), []).append(fit)
    by = {element: told_by_others(fits, poses, sensor)[0][0] for element, fits in own.items()}
    return [_seen_of(group, fit, by[int(group.element[0])], sensor) for group, fit in found]


def _seen_of(group: Meetings, fit: Fit, correction: np.ndarray, sensor: np.ndarray) -> Seen:
    element, way, bare = int(group.element[0]), int(group.group[0]), fit._replace(on=NO_RAYS, left=NO_RAYS)
    if not fit.first:
        return Seen(element, way, bare, fit.rays, np.zeros(3), NO_CELL, NO_RAYS, *np.zeros((2, 2, 0)), np.zeros((0, 3)))
    on, ends, normal = fit.on, group.end[fit.on], group.normal[fit.on]
    cell, number, count = np.unique(cells_of(ends @ fit.axes.T), return_inverse=True, return_counts=True)
    offs = []
    left = np.bincount(number, fit.left[on]) / count
    for step in (correction, np.zeros(6)):
        moved = step[:3] + np.cross(step[3:], ends - sensor)
        off = group.off[on] + np.einsum("kc,kc->k", moved, normal)
        offs.append(np.bincount(number, off) / count)
    offs, place = np.stack(offs), np.stack([np.bincount(number, one) / count for one in ends.T], axis=1)
    return Seen(element, way, bare, fit.rays, normal.sum(axis=0), cell, np.abs(left), offs, offs - left, place)


def bodies_of(scene: TriangleScene) -> Callable[[int], Body]:
    """What gives the bodies of some elements, by their rows, as one."""
    triangles = scene.triangles
    low, high = (bound.astype(np.float64) for bound in element_bounds(triangles))
    a, b, c = (triangles.vertices[corner].astype(np.float64) for corner in triangles.faces.T)
    area = lengths(np.cross(b - a, c - a)) / 2.0
    area = np.bincount(triangles.element, area, len(triangles.semantic))
    order, starts = faces_by_element(triangles)

    def body(*rows: int) -> Body:
        chosen = list(rows)
        own = np.concatenate([order[starts[row] : starts[row + 1]] for row in rows])
        corners = triangles.vertices[np.unique(triangles.faces[own])].astype(np.float64)
        return Body(low[chosen].min(axis=0), high[chosen].max(axis=0), float(area[chosen].sum()), corners)

    return body


def fits_of(scene: TriangleScene, met: Meetings, slender: np.ndarray) -> list[tuple[Meetings, Fit]]:
    """What one scan shows of each face, or round body, with the rays that should meet it."""
    groups = [met.of(part) for part in groups_of(met)]
    ways = np.bincount([int(group.element[0]) for group in groups], minlength=len(scene.triangles.semantic))
    rounds = np.isin(np.arange(len(ways)), slender) & (ways >= ROUND)
    flat = [group.thinned() for group in groups if not rounds[group.element[0]]]
    low, high = (bound[:, 2].astype(np.float64) for bound in element_bounds(scene.triangles))
    found = [(group, [fit_of(group, low[group.element[0]], high[group.element[0]])]) for group in flat]
    for row in np.flatnonzero(rounds):
        body = met.of(met.element == row).thinned()
        found.append((body, fits_of_curved(body)))
    bounds, fits = element_bounds(scene.triangles), []
    for group, ways in found:
        own = [fit for fit in ways if fit is not None]
        # A round body is another's by whichever way it is so: all its fits are of the same rays.
        if not any(_is_of_another(scene, bounds, group, fit) for fit in own):
            fits += [(group, fit) for fit in own]
    return fits


def _is_of_another(scene: TriangleScene, bounds: tuple[np.ndarray, np.ndarray], group: Meetings, fit: Fit) -> bool:
    """Whether the rays end on something else of the model: then the element is gone, and not off its place."""
    if abs(fit.level) < ANOTHER:
        return False
    ends = group.end[np.flatnonzero(fit.on)[:: max(1, int(fit.on.sum()) // ASKED)]].astype(np.float32)
    reach = max(ANOTHER, CUT * fit.sigma)
    low, high = bounds
    near = np.all((high > ends.min(axis=0) - reach) & (low < ends.max(axis=0) + reach), axis=1)
    near[group.element[0]] = False
    if not (others := near[scene.triangles.element]).any():
        return False
    return float(np.median(clearance(prepare_part(scene.triangles, others), ends, 2.0 * reach))) < reach


def deviation_of(seen: list[Seen], shown: list[Faces], body: Body, tolerance: float) -> Deviation:
    """The deviation of what moved as one, by faces of `by_element`."""
    poses, sensors, middle = [one.poses for one in shown], [one.sensor for one in shown], body.middle
    seen = telling(seen, poses, sensors, middle)
    motion = motion_of(seen, poses, sensors, middle)
    told = bool(np.any(motion.keep))
    # Whatever its pose, it stands about where the pose as it is has it: it is neither gone nor new.
    judged = motion if told else motion_of(seen, [[EXACTLY] for _ in poses], sensors, middle)
    step = judged.keep @ judged.step[:3]
    direction = _direction(seen, judged, step)
    *halves, half = (judged.half(way) for way in (*np.eye(3), direction))
    is_sure = not told or half <= SURE
    there = judged if is_sure else motion_of(seen, [[EXACTLY] for _ in poses], sensors, middle)
    opened = [not told or np.linalg.norm(judged.keep @ way) < np.sin(AXIS) for way in np.eye(3)]
    spans = zip(step - halves, step + halves, strict=True)
    flatness, worst, covered = surface_of(seen, 0 if told else 1, tolerance)
    distance = float(step @ direction)
    on = sum(one.rays for one in seen)
    could = on + sum(one.fit.through for one in seen if one.fit.first)
    turn, lean = judged.angles
    long, high = _sizes(body, seen)
    slopes = judged.slopes(long, high)
    classes = {"loa": loa_of(worst), "din18202": din_of(distance, half, long, slopes)}
    offset, distance = (step, distance) if told else (np.zeros(3), 0.0)
    return Deviation(
        _plain(offset),
        tuple(None if no else (float(a), float(b)) for no, (a, b) in zip(opened, spans, strict=True)),
        distance, _plain(direction), turn, lean, flatness, float(min(1.0, covered / max(body.area, 1e-9))), on, classes,
        _plain(judged.turned), half, float(on / max(could, 1)), tuple(sorted({one.scan for one in seen})),
        ends_of(seen, judged, middle, 0 if told else 1, half), _plain(there.keep @ there.step[:3]),
        there.half(direction), long, slopes, any(one.fit.before for one in seen),
    )  # fmt: skip


def _direction(seen: list[Seen], motion: Motion, step: np.ndarray) -> np.ndarray:
    """The normal of the face that is most surely off its place, or else of that which most rays end on.

    Of a round body it is the way it went, if that is sure, or else to where most of its faces look.
    """
    if all(one.fit.first for one in seen):
        ways = [one.fit.normal for one in seen if np.linalg.norm(motion.keep @ one.fit.normal) > np.cos(AXIS)]
        usual = max(seen, key=lambda one: one.rays).fit.normal
    else:
        looks = sum(one.looks for one in seen if one.fit.first)
        usual = looks / np.linalg.norm(looks)
        gone = step if step @ usual >= 0.0 else -step
        ways = [gone / np.linalg.norm(gone)] if np.any(gone) else []

    def surely(way: np.ndarray) -> float:
        return max(0.0, abs(float(way @ motion.keep @ motion.step[:3])) - motion.half(way))

    best = max([usual, *ways], key=surely)  # of equals the first
    return best if surely(best) > 0.0 else usual


def _sizes(body: Body, seen: list[Seen]) -> tuple[float, float]:
    """Length along its longest face, and the length over which it leans [m]: its height, or what lies its length."""
    level = max(seen, key=lambda one: one.rays).fit.axes[0, :2]
    across = np.array([-level[1], level[0]])
    long = float(max(np.ptp(body.corners[:, :2] @ level), np.ptp(body.corners[:, :2] @ across)))
    high = float(body.high[2] - body.low[2])
    return long, high if all(abs(one.fit.normal[2]) < STEEP for one in seen) else long


def _plain(vector: np.ndarray) -> tuple[float, float, float]:
    """A vector (3,) to a billionth, without the sign of what is zero."""
    x, y, z = (round(float(value), 9) + 0.0 for value in vector)
    return x, y, z
