"""As-built places: how far off its place in the model each element stands, with intervals.

E elements, S scans. Positions are offsets from the prior's origin, world axes: metres, z up.

Each face that rays end on is fitted (`fits`), the pose of each scan is told by all of its faces together
(`pose_errors`), and what is left moves the element: a shift and a turn about its middle, by least squares over all its
faces in all scans. Directions that no face fixes, as along a wall, stay open. Intervals of 95 % hold the rays' errors,
how much faces in their place scatter (which holds the sensor's own bias), and the pose's, as the level of detection of
M3C2 does (Lague et al. 2013, equation 1: both surfaces' errors and the registration's).
"""

from typing import NamedTuple

import numpy as np

from jaxmm.deviations.fits import CELL, CUT, Fit, cells_of, fit_of, fits_of_curved
from jaxmm.deviations.meetings import Meetings, groups_of, meetings_of
from jaxmm.deviations.pose_errors import EXACTLY, PoseError, pose_errors, rows_of, scatter
from jaxmm.deviations.shifted_columns import Shift, columns_of, part_of
from jaxmm.deviations.tolerances import din_of, loa_of
from jaxmm.rays.scan_rays import ScanRays
from warp_scanner.scenes.building import element_bounds
from warp_scanner.sensors.triangles import TriangleScene, clearance

FREE = (1.0, 1.0, 1.0, 0.1, 0.1, 0.1)  # [m, rad] standard deviations of an element off its place, before it is seen
FIXED = 0.05  # [m] of a direction of the shift, up to which faces fix it
FIXED_TURN = np.radians(0.5)  # of a turn
NORMAL = 1.96  # standard deviations to either side hold 95 %
ROUND = 4  # ways that faces of a slender body look, that one place shows: no box has so many
ANOTHER, ASKED = 0.015, 200  # [m] off its place, from which a face may be another's; and rays that are asked
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
    turned: tuple[float, float, float] = (
        0.0,
        0.0,
        0.0,
    )  # [rad] rotation vector about its middle, of what faces fix; not in report.json
    half: float = 0.0  # half the width of the interval of `distance`; not in report.json
    stands: float = 1.0  # share of the rays that could reach it, that end on it; not in report.json
    scans: tuple[int, ...] = ()  # numbers of those that show it; not in report.json


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
        classes=one.classes | {"loa": loa_of(distance + one.flatness)},
    )  # fmt: skip


def is_told(one: Deviation) -> bool:
    """Whether anything is known of its place; not where all that is off may be the pose."""
    return any(both is not None for both in one.interval)


class _Seen(NamedTuple):
    """One face of an element in one scan."""

    fit: Fit
    rays: Meetings  # of its group
    scan: int


def deviations_of(
    scene: TriangleScene, rays: list[ScanRays], trust: list[str], tolerance: np.ndarray
) -> dict[int, Deviation]:
    """The deviation of every element that some scan tells of, by its row.

    Where the pose alone may be what is off, intervals are None along all axes: then its offset is as the pose has it.

    Args:
        scene: the model.
        rays: of each scan, where it was placed.
        trust: in the pose of each scan, one of pose_errors.TRUSTS.
        tolerance: (E,) [m] of each element, for its coverage.
    """
    faces: dict[int, list[_Seen]] = {}
    poses: list[list[PoseError]] = []
    slender = columns_of(scene)
    for number, (one, trusted) in enumerate(zip(rays, trust, strict=True)):
        found = [_Seen(fit, group, number) for group, fit in _fits(scene, meetings_of(scene, one), slender)]
        for each in found:
            faces.setdefault(int(each.rays.element[0]), []).append(each)
        poses.append(pose_errors([each.fit for each in found], one.position, trusted))
    sensors = [one.position for one in rays]
    low, high = (bound.astype(np.float64) for bound in element_bounds(scene.triangles))
    area = _areas(scene)
    return {
        row: _deviation(seen, poses, sensors, (low[row], high[row], float(area[row])), float(tolerance[row]))
        for row, seen in faces.items()
    }


def _fits(scene: TriangleScene, met: Meetings, slender: np.ndarray) -> list[tuple[Meetings, Fit]]:
    """What one scan shows of each face, or round body, with the rays that should meet it."""
    groups = [met.of(part) for part in groups_of(met)]
    ways = np.bincount([int(group.element[0]) for group in groups], minlength=len(scene.triangles.semantic))
    rounds = np.isin(np.arange(len(ways)), slender) & (ways >= ROUND)
    flat = [group.thinned() for group in groups if not rounds[group.element[0]]]
    found = [(group, fit_of(group)) for group in flat]
    for row in np.flatnonzero(rounds):
        body = met.of(met.element == row).thinned()
        found += [(body, fit) for fit in fits_of_curved(body)]
    return [(group, fit) for group, fit in found if fit is not None and not _is_of_another(scene, group, fit)]


def _is_of_another(scene: TriangleScene, group: Meetings, fit: Fit) -> bool:
    """Whether the rays end on something else of the model: then the element is gone, and not off its place."""
    if abs(fit.level) < ANOTHER:
        return False
    ends = group.end[np.flatnonzero(fit.on)[:: max(1, int(fit.on.sum()) // ASKED)]].astype(np.float32)
    reach = max(ANOTHER, CUT * fit.sigma)
    low, high = element_bounds(scene.triangles)
    near = np.all((high > ends.min(axis=0) - reach) & (low < ends.max(axis=0) + reach), axis=1)
    near[group.element[0]] = False
    others = part_of(scene.triangles, near[scene.triangles.element])
    return others is not None and float(np.median(clearance(others, ends, 2.0 * reach))) < reach


class _Moved(NamedTuple):
    """How an element stands after all scans' poses were corrected."""

    step: np.ndarray  # (6,) [m, rad] about its middle
    covariance: np.ndarray  # (6, 6)


def _deviation(
    seen: list[_Seen],
    poses: list[list[PoseError]],
    sensors: list[np.ndarray],
    body: tuple[np.ndarray, np.ndarray, float],
    tolerance: float,
) -> Deviation:
    low, high, area = body
    middle = (low + high) / 2.0
    likely = [one[0] for one in poses]
    best = _moved(seen, likely, sensors, middle)
    axes, fixed = _fixed(best.covariance[:3, :3])
    told = bool(fixed.any())
    if not told:  # whatever its pose, it stands about there: it is neither gone nor new
        best = _moved(seen, [EXACTLY] * len(poses), sensors, middle)
        axes, fixed = _fixed(best.covariance[:3, :3])
    # Other poses that explain a scan as well widen what is told.
    others = [
        _moved(seen, [*likely[:scan], other, *likely[scan + 1 :]], sensors, middle)
        for scan in sorted({one.scan for one in seen})
        for other in poses[scan][1:]
    ]
    keep = axes[:, fixed] @ axes[:, fixed].T
    offset = keep @ best.step[:3]
    normals = sum(np.outer(one.fit.normal, one.fit.normal) * one.fit.rays for one in seen)
    direction = _toward(np.linalg.eigh(keep @ normals @ keep)[1][:, -1], seen)
    ways = [*np.eye(3), direction]
    spans = [_span(way, keep, [best, *others]) for way in ways]
    open_axis = [np.linalg.norm(keep @ way) < np.sin(np.radians(3.0)) for way in np.eye(3)]
    turned = _turned(best)
    turn, lean = _angles(best, turned)
    flatness, covered = _surface(seen, likely, sensors, tolerance)
    half = (spans[3][1] - spans[3][0]) / 2.0
    distance = float(offset @ direction)
    on = sum(one.fit.rays for one in seen)
    could = on + sum(one.fit.through for one in seen)
    size = float(np.max((high - low)[:2]))
    slope = None if lean is None else float(np.tan(np.radians(lean)))
    din = din_of(distance, half, size, slope, float(high[2] - low[2]))
    return Deviation(
        _plain(offset),
        tuple(
            None if no or not told else (float(a), float(b)) for no, (a, b) in zip(open_axis, spans[:3], strict=True)
        ),
        distance, _plain(direction), turn, lean, flatness,
        float(min(1.0, covered / max(area, 1e-9))), on,
        {"loa": loa_of(abs(distance) + flatness), "din18202": din},
        _plain(turned), half, float(on / max(could, 1)),
        tuple(sorted({one.scan for one in seen})),
    )  # fmt: skip


def _moved(seen: list[_Seen], poses: list[PoseError], sensors: list[np.ndarray], middle: np.ndarray) -> _Moved:
    """Least squares over all faces, with what the poses leave open."""
    told, right = np.diag(1.0 / np.square(FREE)), np.zeros(6)
    left: list[tuple[np.ndarray, np.ndarray]] = []
    for scan in sorted({one.scan for one in seen}):
        own, pose, sensor = [one.fit for one in seen if one.scan == scan], poses[scan], sensors[scan]
        correction, how = pose.correction, np.zeros((6, 6))
        for fit in own:
            off, arms = rows_of(fit, sensor)
            # A body that moves by a step moves its face as far toward the sensor.
            rows, sigma = rows_of(fit, middle)[1], scatter(fit, pose.place)
            scaled = rows / sigma[:, None]
            told += scaled.T @ scaled
            right += scaled.T @ ((off + arms @ correction) / sigma)
            how += scaled.T @ (arms / sigma[:, None])
        left.append((how, pose.without(own, sensor)))
    own = np.linalg.inv(told)
    return _Moved(own @ right, own + sum(own @ how @ covariance @ how.T @ own for how, covariance in left))


def _fixed(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (3, 3), as columns, and which (3,) of them the faces fix."""
    square, axes = np.linalg.eigh(covariance)
    return axes, square < FIXED**2


def _toward(axis: np.ndarray, seen: list[_Seen]) -> np.ndarray:
    """An axis with the sign that looks toward the sensors."""
    looks = sum(float(one.fit.normal @ axis) * one.fit.rays for one in seen)
    return axis if looks >= 0.0 else -axis


def _span(way: np.ndarray, keep: np.ndarray, found: list[_Moved]) -> Interval:
    """The 95 % interval of what moved along a way, by all that explain it."""
    along = keep @ way
    middle = [float(along @ one.step[:3]) for one in found]
    half = [NORMAL * float(np.sqrt(along @ one.covariance[:3, :3] @ along)) for one in found]
    return min(m - h for m, h in zip(middle, half, strict=True)), max(m + h for m, h in zip(middle, half, strict=True))


def _turned(best: _Moved) -> np.ndarray:
    """(3,) [rad] rotation vector of what the faces fix."""
    square, axes = np.linalg.eigh(best.covariance[3:, 3:])
    fixed = square < FIXED_TURN**2
    return axes[:, fixed] @ axes[:, fixed].T @ best.step[3:]


def _angles(best: _Moved, turned: np.ndarray) -> tuple[float | None, float | None]:
    """Turn about the vertical, and lean [deg]; None where no face fixes it."""
    spread = best.covariance[3:, 3:]
    turn = float(np.degrees(turned[2])) if spread[2, 2] < FIXED_TURN**2 else None
    leans = np.linalg.eigvalsh(spread[:2, :2])[0] < FIXED_TURN**2
    return turn, float(np.degrees(np.linalg.norm(turned[:2]))) if leans else None


def _surface(
    seen: list[_Seen], poses: list[PoseError], sensors: list[np.ndarray], tolerance: float
) -> tuple[float, float]:
    """Flatness [m], and the area [m2] that was seen and lies within the tolerance of the model."""
    apart, cells = [], []
    for one in seen:
        fit, on = one.fit, one.fit.on
        ends = one.rays.end[on]
        cell, number, count = np.unique(cells_of(ends @ fit.axes.T), return_inverse=True, return_counts=True)
        apart.append(np.abs(np.bincount(number, fit.left[on]) / count))
        step = poses[one.scan].correction
        off = one.rays.off[on] + (step[:3] + np.cross(step[3:], ends - sensors[one.scan])) @ fit.normal
        within = np.abs(np.bincount(number, off) / count) <= tolerance
        cells.append(np.column_stack([np.full(within.sum(), one.rays.group[0]), cell[within]]))
    covered = len(np.unique(np.concatenate(cells), axis=0)) * CELL**2
    return float(np.percentile(np.concatenate(apart), 95.0)), covered


def _plain(vector: np.ndarray) -> tuple[float, float, float]:
    """A vector (3,) to a billionth, without the sign of what is zero."""
    x, y, z = (round(float(value), 9) + 0.0 for value in vector)
    return x, y, z


def _areas(scene: TriangleScene) -> np.ndarray:
    """(E,) [m2] of the surface of each element."""
    triangles = scene.triangles
    a, b, c = (triangles.vertices[corner].astype(np.float64) for corner in triangles.faces.T)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0
    return np.bincount(triangles.element, area, len(triangles.semantic))
