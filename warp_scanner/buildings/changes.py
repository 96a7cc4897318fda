"""What can change in a building: walls and columns to take out, to copy or to put in, and furniture to stand around.

Whatever is put in stands free on the floor, not on furniture: no triangle of the building is inside it. Positions are
offsets from the building's origin, metres, z up.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from warp_scanner import draws
from warp_scanner.buildings.positions import inside
from warp_scanner.rooms.footprints import Footprints, join
from warp_scanner.rooms.furniture import FurnitureConfig, Marks, build_furniture, spread_furniture
from warp_scanner.rooms.shells import Site
from warp_scanner.scenes import scenes
from warp_scanner.scenes.building import Building, Pieced, Triangles, element_bounds, fixed
from warp_scanner.scenes.scenes import CEILING, FLOOR, GAP, WALL, scene_mesh
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import Sensor
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles, clearance

WALL_LENGTH, WALL_THICKNESS = (1.0, 4.5), (0.1, 0.3)  # [m] of what is added, unless it is a copy
COLUMN_WIDTH = (0.2, 0.9)  # [m] square or round
_STANDING = 1.0  # [m] least height of what counts as a wall or column rather than a sill or a base
_OPEN_HEIGHT = 2.6  # [m] of what is added where there is no ceiling
_STEP = 0.2  # [m] between the points that must be free inside whatever is put in
_TRIES = 48
_PATCH = (8.0, 8.0, 2.5)  # [m] around the sensor that furniture is drawn for
_GAP = 0.1  # [m] between pieces of furniture
_FURNITURE = FurnitureConfig(table_spacing=(1.5, 2.5), chair_spacing=(1.0, 2.0), table_limit=8, chair_limit=12)


class Change(NamedTuple):
    """One object that is there in one of the two scenes only."""

    triangles: Triangles  # of one element
    center: np.ndarray  # (3,) [m] of its upright box
    size: np.ndarray  # (3,) [m] full edge lengths along the own axes
    yaw: float  # [deg]
    semantic: int


class _Box(NamedTuple):
    """Upright; fields as of a Change."""

    center: np.ndarray
    size: np.ndarray
    yaw: float


def removable(building: Building, semantic: int) -> np.ndarray:
    """Rows of the elements of that class that are at least 1 m high."""
    low, high = (corner[:, 2] for corner in element_bounds(building.triangles))
    return np.flatnonzero((building.elements.semantic == semantic) & (high - low >= _STANDING))


def of_element(building: Building, number: int) -> Change:
    """One of the building's own elements."""
    return _own(building, number, building.triangles.element == number)


def of_elements(building: Building, numbers: np.ndarray) -> list[Change]:
    """Several of the building's own elements; its triangles are looked through once."""
    element = building.triangles.element
    order = np.argsort(element, kind="stable")
    first, end = (np.searchsorted(element[order], numbers, side) for side in ("left", "right"))
    return [_own(building, number, order[one:other]) for number, one, other in zip(numbers, first, end, strict=True)]


def _own(building: Building, number: int, own: np.ndarray) -> Change:
    """One element, whose triangles are `own`."""
    corners = building.triangles.faces[own]
    used, faces = np.unique(corners, return_inverse=True)
    vertices, faces = building.triangles.vertices[used], faces.reshape(-1, 3).astype(np.int32)
    semantic = building.triangles.semantic[number]
    triangles = Triangles(vertices, faces, np.zeros(len(corners), np.int32), np.array([semantic], np.uint8))
    return Change(triangles, *_upright_box(triangles), int(semantic))


def joint_change(building: Building, whole: Pieced, rows: Sequence[int]) -> Change:
    """An element that another file has in pieces, by rows of these: its own box, and their triangles."""
    parts = [of_element(building, row).triangles for row in rows]
    start = np.cumsum([0] + [len(one.vertices) for one in parts[:-1]], dtype=np.int32)
    triangles = Triangles(
        np.concatenate([one.vertices for one in parts]),
        np.concatenate([one.faces + first for one, first in zip(parts, start, strict=True)]),
        np.zeros(sum(len(one.faces) for one in parts), np.int32), np.array([whole.element.semantic], np.uint8),
    )  # fmt: skip
    return Change(triangles, np.array(whole.center), np.array(whole.size), whole.yaw, whole.element.semantic)


def added_object(
    building: Building, scene: TriangleScene, kind: tuple[int, float], view: tuple[Pose, Sensor], key: np.ndarray
) -> Change | None:
    """A wall or column at a free place in view and inside the building, from floor to ceiling; None where none fits.

    Args:
        building: the building.
        scene: its triangles, prepared.
        kind: class (scenes.WALL or PILLAR), and the share of objects whose shape is copied from the building's own.
        view: pose of one sensor (R = 1), and the sensor.
        key: (1,) uint64.
    """
    (semantic, copied), (pose, sensor) = kind, view
    position = pose.position[0].astype(np.float64)
    right, left = sensor.azimuths
    spread = draws.uniform(key, "change angle", _TRIES)[0] - 0.5
    angle = np.radians(pose.yaw[0] + (right + left) / 2 + (left - right) * spread)
    heading = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1).astype(np.float32)
    sight = np.minimum(cast_triangles(scene, Rays(position[None], heading)).distance[0], 12.0)
    # The root makes every square metre within sight as likely as any other in its direction.
    reach = sight * np.sqrt(draws.uniform(key, "change distance", _TRIES)[0])
    places = position + reach[:, None].astype(np.float64) * heading
    vertical = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], np.float32)
    room = cast_triangles(scene, Rays(places, vertical), fixed(scene.triangles)).distance.astype(np.float64)
    floor = np.where(np.isfinite(room[:, 0]), position[2] - room[:, 0], _ground(building, position[2]))
    top = np.where(np.isfinite(room[:, 1]), position[2] + room[:, 1], floor + _OPEN_HEIGHT)
    indoors = inside(building, scene, places)
    own = removable(building, semantic)
    copies = draws.uniform(key, "change copied", _TRIES)[0] < copied
    chosen = np.floor(draws.uniform(key, "change model", _TRIES)[0] * max(len(own), 1)).astype(int)
    shapes = _shapes(semantic, key)
    for place in np.flatnonzero(indoors):
        foot, height = np.array([*places[place, :2], floor[place]]), top[place] - floor[place]
        # Under a sloping roof nothing reaches the ceiling everywhere: there the usual height has a chance.
        shape = tuple(shape[place] for shape in shapes)
        boxes = [_box(shape, foot, up) for up in sorted({height, min(height, _OPEN_HEIGHT)})[::-1]]
        copy = None
        if copies[place] and len(own):
            copy = _moved(of_element(building, own[chosen[place]]), foot)
            boxes = [_Box(copy.center, copy.size, copy.yaw)]
        for box in boxes:
            # A copy that is higher than the room would stick out above.
            if 0.5 < box.size[2] <= height + 1e-3 and _is_apart(box, position) and _is_free(scene, box):
                return copy or _parametric(semantic, box, is_round=shape[3])
    return None


def furniture_around(
    scene: TriangleScene, pose: Pose, floor: float, change: Change | None, key: np.ndarray
) -> Triangles | None:
    """Tables and chairs within 4 m of the sensor, wherever they stand free on the floor; None where none does.

    Args:
        scene: the building's triangles, prepared.
        pose: of one sensor (R = 1); pieces keep away from it.
        floor: [m] height that the furniture stands on.
        change: the changed object, which furniture keeps away from as well.
        key: (1,) uint64.

    Returns:
        Triangles with one element per piece.
    """
    middle = np.array([*pose.position[0, :2], floor + _PATCH[2] / 2], np.float64)
    boxes = [(np.zeros(2), np.full(2, 0.4), 0.0)]
    if change is not None:
        boxes.append((change.center[:2] - middle[:2], change.size[:2] / 2, np.radians(change.yaw)))
    center, half, yaw = (np.array([[box[part] for box in boxes]]) for part in range(3))
    others = Footprints(center, half, yaw, np.ones((1, len(boxes)), bool))
    site = Site(key, np.array([_PATCH]), _PATCH[:2], _GAP, others._replace(valid=np.zeros_like(others.valid)))
    marks = spread_furniture(_FURNITURE, site, key)
    stays = np.split(site.settled(join(*marks), others), [_FURNITURE.table_limit], axis=1)
    marks = Marks(*(kind._replace(valid=stay) for kind, stay in zip(marks, stays, strict=True)))
    primitives = scenes.join(*build_furniture(_FURNITURE, site, marks, 0))
    if not np.any(primitives.kind != GAP):
        return None
    vertices, faces, slot = scene_mesh(primitives, 0, sections=12)
    vertices, element = vertices + middle, primitives.element[0, slot]
    stays = [piece for piece in np.unique(element) if _piece_is_free(scene, vertices[faces[element == piece]], floor)]
    if not stays:
        return None
    kept = np.isin(element, stays)
    semantic = [primitives.semantic[0, primitives.element[0] == piece][0] for piece in stays]
    return Triangles(
        vertices.astype(np.float32), faces[kept].astype(np.int32),
        np.searchsorted(stays, element[kept]).astype(np.int32), np.array(semantic, np.uint8),
    )  # fmt: skip


def _ground(building: Building, height: float) -> float:
    """Elevation of the storey that a place without a floor belongs to."""
    below = building.storeys.elevation[building.storeys.elevation <= height + 1e-3]
    return float(below[-1] if len(below) else building.storeys.elevation[0])


def _shapes(semantic: int, key: np.ndarray) -> tuple[np.ndarray, ...]:
    """Length, width, yaw [rad] and roundness of every try."""
    turn = draws.between(key, "change yaw", (-np.pi / 2, np.pi / 2), _TRIES)[0]
    if semantic == WALL:
        length = draws.between(key, "change length", WALL_LENGTH, _TRIES)[0]
        width = draws.between(key, "change thickness", WALL_THICKNESS, _TRIES)[0]
        return length, width, turn, np.zeros(_TRIES, bool)
    width = draws.between(key, "change width", COLUMN_WIDTH, _TRIES)[0]
    return width, width, turn, draws.uniform(key, "change round", _TRIES)[0] < 0.5


def _box(shape: tuple, foot: np.ndarray, height: float) -> _Box:
    length, width, yaw, _ = shape
    return _Box(foot + np.array([0.0, 0.0, height / 2]), np.array([length, width, height]), float(np.degrees(yaw)))


def _parametric(semantic: int, box: _Box, is_round: bool) -> Change:
    import trimesh  # slow to import, and casting rays does not need it

    if is_round:
        mesh = trimesh.creation.cylinder(radius=box.size[0] / 2, height=box.size[2], sections=64)
    else:
        mesh = trimesh.creation.box(extents=box.size)
    turn = trimesh.transformations.rotation_matrix(np.radians(box.yaw), [0, 0, 1])
    turn[:3, 3] = box.center
    mesh.apply_transform(turn)
    triangles = Triangles(
        mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), np.zeros(len(mesh.faces), np.int32),
        np.array([semantic], np.uint8),
    )  # fmt: skip
    return Change(triangles, *box, semantic)


def _moved(change: Change, foot: np.ndarray) -> Change:
    """The same object standing elsewhere."""
    shift = foot + np.array([0.0, 0.0, change.size[2] / 2]) - change.center
    vertices = (change.triangles.vertices + shift).astype(np.float32)
    return change._replace(triangles=change.triangles._replace(vertices=vertices), center=change.center + shift)


def _upright_box(triangles: Triangles) -> tuple[np.ndarray, np.ndarray, float]:
    """Center, size and yaw [deg] of the upright box of least footprint along an edge of the triangles."""
    points = triangles.vertices.astype(np.float64)
    edges = np.concatenate([points[triangles.faces[:, [0, 1]]], points[triangles.faces[:, [1, 2]]]])
    edges = (edges[:, 1] - edges[:, 0])[:, :2]
    edges = edges[np.linalg.norm(edges, axis=1) > 1e-3]
    yaws = np.unique(np.round(np.mod(np.arctan2(edges[:, 1], edges[:, 0]), np.pi / 2), 6)) if len(edges) else [0.0]
    yaws = np.asarray(yaws)[:360]
    cosine, sine = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    along, across = cosine * points[:, 0] + sine * points[:, 1], cosine * points[:, 1] - sine * points[:, 0]
    best = int(np.argmin(np.ptp(along, axis=1) * np.ptp(across, axis=1)))
    along, across, z, yaw = along[best], across[best], points[:, 2], yaws[best]
    u, v, w = ((axis.min() + axis.max()) / 2 for axis in (along, across, z))
    center = np.array([np.cos(yaw) * u - np.sin(yaw) * v, np.sin(yaw) * u + np.cos(yaw) * v, w])
    size = np.array([np.ptp(axis) for axis in (along, across, z)])
    if size[0] < size[1]:  # the first axis is the longer one
        size, yaw = size[[1, 0, 2]], yaw - np.pi / 2
    return center, size, float(np.degrees(yaw))


def _is_free(scene: TriangleScene, box: _Box) -> bool:
    """No triangle of the scene is inside the object's box, but for what touches its foot and its top."""
    # Points in steps of 0.2 m and balls of 0.2 m around them cover the box and a little more on every side.
    x, y = (_steps(-length / 2, length / 2) for length in box.size[:2])
    z = _steps(min(0.25 - box.size[2] / 2, 0.0), max(box.size[2] / 2 - 0.25, 0.0))
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    cosine, sine = np.cos(np.radians(box.yaw)), np.sin(np.radians(box.yaw))
    turned = np.column_stack(
        [cosine * points[:, 0] - sine * points[:, 1], sine * points[:, 0] + cosine * points[:, 1], points[:, 2]]
    )
    return bool(np.all(clearance(scene, turned + box.center, 1.0) > _STEP))


def _is_apart(box: _Box, position: np.ndarray) -> bool:
    """The object leaves the sensor the gap that everything else leaves it."""
    x, y = position[:2] - box.center[:2]
    cosine, sine = np.cos(np.radians(box.yaw)), np.sin(np.radians(box.yaw))
    beyond = np.abs([cosine * x + sine * y, cosine * y - sine * x]) - box.size[:2] / 2
    return bool(np.linalg.norm(np.maximum(beyond, 0.0)) > 0.5)


def _piece_is_free(scene: TriangleScene, corners: np.ndarray, floor: float) -> bool:
    """A piece of furniture, (t, 3, 3) corners, meets nothing and stands on a floor if there are any."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    axes = (_steps(low[0], high[0]), _steps(low[1], high[1]), _steps(min(floor + 0.25, high[2]), high[2]))
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if np.any(clearance(scene, points, 1.0) <= _STEP):
        return False
    feet = points[points[:, 2] == points[:, 2].min()]
    below = cast_triangles(scene, Rays(feet, np.array([[0.0, 0.0, -1.0]], np.float32))).distance[:, 0]
    if not np.isin(scene.triangles.semantic, (FLOOR, CEILING)).any():
        below = np.where(np.isinf(below), feet[:, 2] - floor, below)  # a file without floors
    return bool(np.all(np.abs(feet[:, 2] - below - floor) < 0.05))


def _steps(low: float, high: float) -> np.ndarray:
    return np.linspace(low, high, max(2, int(np.ceil((high - low) / _STEP)) + 1))
