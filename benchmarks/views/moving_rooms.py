"""Rooms in which somebody walks and a box is carried away, scanned again and again: folders of PCD files.

As DynamicMap_Benchmark has them (https://github.com/KTH-RPL/DynamicMap_Benchmark, its pages on data): every scan in
`pcd/`, points in the world frame, the sensor's pose in VIEWPOINT; the map of all scans in `gt_cloud.pcd`, its intensity
0 where what was scanned stands and 1 where it moved. Metres, z up.
"""

from pathlib import Path

import numpy as np
import trimesh
from pypcd4 import PointCloud
from scipy.spatial.transform import Rotation

from jaxmm.runs.room_scans import RoomCase, room_cases
from warp_scanner.clouds.points import points_of
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.building_edits import join
from warp_scanner.scenes.scenes import OTHER
from warp_scanner.sensors.imperfections import imperfect
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import sensor_named
from warp_scanner.sensors.surface import incidence_of
from warp_scanner.sensors.triangles import cast_faces, cast_triangles, face_normals, prepare

FIELDS = ("x", "y", "z", "intensity")
MAP, SCANS = "gt_cloud.pcd", "pcd"
STEP = 0.05  # [m] from scan to scan, that the sensor moves
MOST_TRIES = 20  # rooms, for each that is asked for
LEAST_SPACE = 2.2  # [m] around the sensor, to walk in
WALK = 100.0  # [deg] around the sensor, that somebody walks from the first scan to the last
PERSON, BOX = (0.3, 0.5, 1.75), (0.6, 0.6, 0.9)  # [m]
VOXEL = 0.05  # [m] of the map


def write_rooms(folder: Path, rooms: int, scans: int, sensor: str, seed: int) -> list[Path]:
    """A folder below `folder` for each of so many rooms, with so many scans.

    Raises:
        RuntimeError: too few of the rooms have space to walk in.
    """
    made: list[Path] = []
    for number in range(MOST_TRIES * rooms):
        if len(made) == rooms:
            return made
        (case,) = room_cases("unchanged", "clean", seed, range(number, number + 1), sensor=sensor)
        place = folder / f"room_{number:02d}"
        if _write(place, case, scans, sensor, (seed, number)):
            made.append(place)
    raise RuntimeError(f"of {MOST_TRIES * rooms} rooms only {len(made)} have space to walk in, {rooms} were asked for")


def _write(place: Path, case: RoomCase, scans: int, sensor: str, key: tuple[int, int]) -> bool:
    origin, base = case.scan.position.astype(np.float32), len(case.prior.building.elements.guid)
    angle = np.radians(np.arange(0.0, 360.0, 5.0))
    around = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)]).astype(np.float32)
    reach = cast_triangles(case.prior.scene, Rays(origin[None], around)).distance[0]
    wide = int(WALK / 5.0)
    free = np.array([np.roll(reach, -start)[:wide].min() for start in range(len(angle))])
    start, space = int(free.argmax()), float(free.max())
    down = cast_triangles(case.prior.scene, Rays(origin[None], np.array([[0.0, 0.0, -1.0]], np.float32))).distance[0, 0]
    if space < LEAST_SPACE or not np.isfinite(down):
        return False
    (place / SCANS).mkdir(parents=True, exist_ok=True)
    points, moved = [], []
    for number in range(scans):
        turn = angle[start] + np.radians(WALK) * number / max(scans - 1, 1)
        movers = [_upright(origin, down, turn, 0.6 * space, PERSON)]
        if number < scans // 2:  # then it is carried away
            movers.append(_upright(origin, down, angle[start] + np.radians(WALK / 2.0), 0.85 * space, BOX))
        shift = np.array([np.cos(angle[start]), np.sin(angle[start]), 0.0]) * STEP * number
        pose = Pose((origin + shift).astype(np.float32)[None], *(np.zeros(1, np.float32) for _ in range(2)))
        ends, element = _scan(join(case.prior.building.triangles, _triangles(movers)), sensor, pose,
                              (key[0], key[1] * 1000 + number))  # fmt: skip
        write_pcd(place / SCANS / f"{number:06d}.pcd", ends, np.zeros(len(ends)), pose)
        points.append(ends)
        moved.append(element >= base)
    whole, labels = np.concatenate(points), np.concatenate(moved)
    thin = np.concatenate([np.flatnonzero(part)[thin_clouds([whole[part]], VOXEL)[0]] for part in (labels, ~labels)])
    write_pcd(place / MAP, whole[thin], labels[thin].astype(np.float64), None)
    return True


def write_pcd(path: Path, points: np.ndarray, intensity: np.ndarray, pose: Pose | None) -> None:
    """Points (N, 3) [m] in the world frame, with their intensity (N,), and the pose (R = 1) of the sensor."""
    cloud = PointCloud.from_points([*points.T, intensity], FIELDS, (np.float32,) * len(FIELDS))
    if pose is not None:
        x, y, z, w = Rotation.from_matrix(rotation_of(pose.yaw, pose.pitch)[0]).as_quat()
        cloud.metadata.viewpoint = tuple(float(value) for value in (*pose.position[0], w, x, y, z))
    cloud.save(path)


def _scan(triangles: Triangles, sensor: str, pose: Pose, key: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) [m] and the element (N,) of each."""
    scene, device = prepare(triangles), sensor_named(sensor)
    rays = rays_of(device, pose)
    scan, face = cast_faces(scene, rays)
    incidence = incidence_of(face_normals(scene.triangles, face), rays)
    found = imperfect(scan, incidence, device, key[0], np.array([key[1]]))
    back = np.isfinite(found.distance[0])
    return points_of(pose, device.directions(), found.distance)[0, back], found.element[0, back]


def _upright(origin: np.ndarray, down: float, turn: float, reach: float, size: tuple[float, ...]) -> trimesh.Trimesh:
    """A box that stands on the floor, so far from the sensor."""
    box = trimesh.creation.box(size, trimesh.transformations.rotation_matrix(turn, [0.0, 0.0, 1.0]))
    step = np.array([reach * np.cos(turn), reach * np.sin(turn), size[2] / 2.0 - down])
    box.apply_translation(origin + step)
    return box


def _triangles(boxes: list[trimesh.Trimesh]) -> Triangles:
    whole = trimesh.util.concatenate(boxes)
    element = np.repeat(np.arange(len(boxes)), [len(box.faces) for box in boxes]).astype(np.int32)
    return Triangles(
        np.asarray(whole.vertices, np.float32), np.asarray(whole.faces, np.int32), element,
        np.full(len(boxes), OTHER, np.uint8),
    )  # fmt: skip
