"""What a detection's drawn points show: which mismatch, and how far off the model each lies.

N points of the robot's scans, M of the prior's, as in `report.Drawing`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.classes.unexplained import Unexplained
from jaxmm.learning.boxes import Box
from jaxmm.learning.prediction import Side
from jaxmm.rays.evidence import BLOCKED, SUPPORT, THROUGH
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.vectors import by_blocks, lengths
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.results import Detection, Drawing, Key, Mismatch
from warp_scanner.scenes.building import Building, Triangles, Twin
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import Pinhole
from warp_scanner.sensors.triangles import cast_triangles, clearance, prepare

MOST_DRAWN = 500_000  # points of either side that are drawn: of more, as many as any screen tells apart
CHANGED = 0.5  # probability from which a point has probably changed: of those all are drawn
MARGIN = 0.1  # [m] about a box: points are thinned to about this, and a box need not hold the noise
FARTHEST = 100.0  # [m] off the model's surface, beyond which no distance is told


class MismatchPoints(NamedTuple):
    """What each point shows."""

    robot: np.ndarray  # (N,) int32 index of the added mismatch; -1 for points that show none
    prior: np.ndarray  # (M,) int32 index of the removed mismatch; -1
    unexplained: np.ndarray  # (N,) bool: of no mismatch, but of something else that is not in the model


def mismatch_points(detection: Detection) -> MismatchPoints:
    """Find the points of every mismatch.

    A removed element owns all its points. Otherwise points belong to the box that they lie in, but for those of other
    things that stand in it: of an added object those on a surface of the prior, of a removed one those that no ray went
    through. A box that is not finite holds nothing.
    """
    drawing = detection.drawing
    robot, prior = (np.full(len(points), -1, np.int32) for points in (drawing.robot, drawing.prior))
    for index, one in enumerate(detection.mismatches):
        if one.mismatch_type == "added":
            robot[inside(one, drawing.robot, drawing.origin) & (drawing.robot_evidence != SUPPORT)] = index
        elif rows := drawing.rows_of(one.key):
            prior[np.isin(drawing.prior_element, rows)] = index
        else:
            prior[inside(one, drawing.prior, drawing.origin) & (drawing.prior_evidence == THROUGH)] = index
    unexplained = np.zeros(len(robot), bool)
    for thing in detection.unexplained:
        unexplained |= inside(thing, drawing.robot, drawing.origin)
    unexplained &= (robot < 0) & (drawing.robot_evidence == BLOCKED)
    return MismatchPoints(robot, prior, unexplained)


def inside(mismatch: Mismatch | Box | Unexplained, offsets: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Which points (N,) lie in a box, as of a mismatch, or within MARGIN of it.

    Args:
        mismatch: its box is in the world frame.
        offsets: (N, 3) [m] from `origin`.
        origin: (3,) float64 [m] world.
    """
    if not np.isfinite(mismatch.rotation):
        return np.zeros(len(offsets), bool)
    # The centre loses its large part first: offsets are exact only because they are small.
    center, yaw = np.asarray(mismatch.center, np.float64) - origin, np.radians(mismatch.rotation)
    reach = np.asarray(mismatch.dimensions, np.float64) / 2 + MARGIN

    def within(some: np.ndarray) -> np.ndarray:
        away = some - center
        along = away[:, 0] * np.cos(yaw) + away[:, 1] * np.sin(yaw)
        across = away[:, 1] * np.cos(yaw) - away[:, 0] * np.sin(yaw)
        return (np.abs(np.column_stack([along, across, away[:, 2]])) <= reach).all(axis=1)

    return by_blocks(within, offsets)


def signed_distances(detection: Detection, rows: np.ndarray | None = None) -> np.ndarray | None:
    """How far each of the robot's points lies off the model's surface, (N,) float32 [m]; None where it has none.

    Positive before the surface, as seen from where the point was measured, negative behind it; NaN beyond FARTHEST.
    `rows` are those that are asked for, in that order; None asks for all.
    """
    drawing = detection.drawing
    if drawing.faces is None or not len(drawing.faces):
        return None
    nothing = np.zeros(len(drawing.guid), np.uint8)
    scene = prepare(Triangles(drawing.vertices, drawing.faces, drawing.face_element, nothing))
    rows = np.arange(len(drawing.robot)) if rows is None else rows
    points, number_of = drawing.robot[rows], drawing.robot_scan[rows]
    distance = clearance(scene, points, FARTHEST)
    distance[distance >= FARTHEST] = np.nan
    for number, scan in enumerate(detection.scans):
        own = np.flatnonzero(number_of == number)
        sensor = np.array(scan.pose[:3], np.float64) - drawing.origin
        way = points[own] - sensor
        reach = lengths(way)
        own, way, reach = own[reach > 0.0], way[reach > 0.0], reach[reach > 0.0]
        if len(own):
            rays = Rays(sensor[None], (way / reach[:, None]).astype(np.float32))
            behind = reach > cast_triangles(scene, rays).distance[0]
            distance[own[behind]] *= -1.0
    return distance


def drawing_of(prior: Prior, drawn: Sequence[tuple[Side, Side]], scans: Sequence[PosedScan]) -> Drawing:
    """The points and surfaces behind a detection.

    Args:
        prior: as the model has it.
        drawn: of each scan both sides, the robot's and the prior's, one scan after another.
        scans: where each was taken from; their points are not asked for.
    """
    robot, old, number = [], [], []
    share = MOST_DRAWN // max(1, len(drawn))
    for scan, (added, removed) in enumerate(drawn):
        one, other = _told_points(added, share), _told_points(removed, share)
        robot.append(one[:3])
        old.append(other)
        number.append(np.full(len(one[0]), scan, np.int32))
    triangles, table = (prior.building.triangles, prior.building.elements) if prior.has_elements else (None, None)
    points, probability, evidence, element = (np.concatenate(one) for one in zip(*old, strict=True))
    return Drawing(
        prior.origin, *(np.concatenate(one) for one in zip(*robot, strict=True)), np.concatenate(number),
        points, probability, evidence, element.astype(np.int32),
        table.guid if table else (),
        *((triangles.vertices, triangles.faces, triangles.element) if triangles is not None else (None, None, None)),
        tuple(_corners(one) for one in scans),
        *((table.file, tuple(map(_keys, table.twins)), _pieced(prior.building)) if table else ()),
    )  # fmt: skip


def _keys(elements: Sequence[Twin]) -> tuple[Key, ...]:
    return tuple((one.file, one.guid) for one in elements)


def _pieced(building: Building) -> tuple[tuple[tuple[Key, ...], tuple[Key, ...]], ...]:
    return tuple((_keys((one.element, *one.twins)), one.pieces) for one in building.pieced)


def _told_points(side: Side, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points, probability, evidence and element of a side; of one that has more than so many, those of a share."""
    fields = side.view.points, side.probability, side.evidence, side.view.element
    count = len(fields[0])
    if count <= most:
        return fields
    chosen = (np.arange(count) % -(-count // most) == 0) | (fields[1] >= CHANGED)
    return tuple(field[chosen] for field in fields)


def _corners(scan: PosedScan) -> np.ndarray:
    """Unit vectors (4, 3) to the corners of a camera's picture, in order around it; (0, 3) of any other sensor."""
    if not isinstance(scan.sensor, Pinhole):
        return np.zeros((0, 3), np.float32)
    wide, high = (np.tan(np.radians(fov) / 2) for fov in (scan.sensor.horizontal_fov, scan.sensor.vertical_fov))
    corners = np.array([[1.0, y, z] for y, z in ((wide, high), (-wide, high), (-wide, -high), (wide, -high))])
    return (corners / np.linalg.norm(corners, axis=1, keepdims=True) @ scan.rotation.T).astype(np.float32)
