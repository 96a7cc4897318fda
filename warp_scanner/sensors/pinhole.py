"""Casts whole pinhole images at the primitives of many rooms: the thin host side of two files of kernels.

R rooms, K slots of primitives, P = W H pixels. World frame: metres, z up.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from warp_scanner.kernels import outlines
from warp_scanner.kernels import pinhole as kernels
from warp_scanner.launches import load, share, share_out, thread_count
from warp_scanner.scenes.scenes import GAP, Primitives, take
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.scan import Rays, Scan, cast_rays, cast_slots
from warp_scanner.sensors.sensors import Pinhole

_ROOMS_AT_ONCE = 32  # bounds the memory of what is only needed on the way


class _Image(NamedTuple):
    """What a launch writes; None where it is not asked for. All (R, P)."""

    distance: np.ndarray
    slot: np.ndarray | None
    element: np.ndarray | None
    semantic: np.ndarray | None


def cast_image(
    primitives: Primitives, present: np.ndarray | None, sensor: Pinhole, pose: Pose, threads: int | None = None
) -> Scan:
    """The first surface in every pixel: what scan.cast_rays gives for the sensor's directions, many times faster.

    Both agree but for pixels whose ray passes an edge closer than rounding can tell. Where a sensor is inside a
    primitive or touches one, the general kernel answers for its room.

    Args:
        primitives: the table of R rooms.
        present: (R, K) bool, False leaves a primitive out; None = all are there.
        sensor: the camera.
        pose: of R sensors.
        threads: how many to use; by default one for each core it may run on.

    Raises:
        ValueError: the shapes disagree, or a position is not finite.
    """
    shape = (len(primitives.kind), sensor.width * sensor.height)
    # The kernel writes every entry.
    image = _Image(np.empty(shape, np.float32), None, np.empty(shape, np.int32), np.empty(shape, np.uint8))
    left_over = _draw(image, primitives, present, (sensor, pose), threads)
    scan = Scan(image.distance, image.element, image.semantic)
    if len(left_over):
        again = cast_rays(*_general(primitives, present, sensor, pose, left_over), threads)
        for whole, part in zip(scan, again, strict=True):
            whole[left_over] = part
    return scan


def cast_image_slots(
    primitives: Primitives, present: np.ndarray | None, sensor: Pinhole, pose: Pose, threads: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """As cast_image, but tells which slot was hit: distance (R, P) float32, slot (R, P) int32, -1 on a miss."""
    shape = (len(primitives.kind), sensor.width * sensor.height)
    image = _Image(np.empty(shape, np.float32), np.empty(shape, np.int32), None, None)
    left_over = _draw(image, primitives, present, (sensor, pose), threads)
    if len(left_over):
        again = cast_slots(*_general(primitives, present, sensor, pose, left_over), threads)
        image.distance[left_over], image.slot[left_over] = again
    return image.distance, image.slot


def _general(primitives: Primitives, present: np.ndarray | None, sensor: Pinhole, pose: Pose, rooms: np.ndarray):
    """Arguments of the general kernel for some of the rooms."""
    rays = Rays(pose.position[rooms], sensor.directions(), rotation_of(pose.yaw[rooms], pose.pitch[rooms]))
    return take(primitives, rooms), None if present is None else np.asarray(present)[rooms], rays


def _draw(
    image: _Image, primitives: Primitives, present: np.ndarray | None, seen: tuple[Pinhole, Pose], threads: int | None
) -> np.ndarray:
    """Fill the image, and return the rooms (indices) that the fast path cannot answer for."""
    sensor, pose = seen
    room_count, slot_count = primitives.kind.shape
    present = np.ones((room_count, slot_count), bool) if present is None else np.asarray(present, bool)
    if present.shape != (room_count, slot_count):
        raise ValueError(f"present must be {(room_count, slot_count)}, got {present.shape}")
    position = np.asarray(pose.position, np.float32)
    if position.shape != (room_count, 3) or not np.all(np.isfinite(position)):
        raise ValueError(f"pose.position must be ({room_count}, 3) and finite, got {position.shape}")
    if room_count == 0:
        return np.zeros(0, np.int64)
    load(outlines)
    load(kernels)
    camera = _camera(sensor)
    threads = thread_count(threads)
    at_once = min(_ROOMS_AT_ONCE, -(-room_count // threads))
    general = np.zeros(room_count, bool)
    rotation = rotation_of(pose.yaw, pose.pitch)

    def draw_rooms(first: int, count: int) -> None:
        rows = slice(first, first + count)
        scene = Primitives(*(field[rows] for field in primitives))
        view = _view(scene, present[rows], (position[rows], rotation[rows]), camera)
        out = _Image(*(None if field is None else field[rows] for field in image))
        # Rooms are shared out first; only a lone part leaves threads for its tiles.
        _draw_tiles(out, scene, (view, camera), threads if count == room_count else 1)
        general[rows] = view.general.numpy()

    share_out(draw_rooms, room_count, threads, at_once)
    return np.flatnonzero(general)


def _draw_tiles(image: _Image, scene: Primitives, seen: tuple, threads: int) -> None:
    """Draw some rooms, given their view and the camera."""
    view, camera = seen
    miss = np.full((len(scene.kind), 1), -1, np.int32)
    out = kernels.Image()
    out.element_of = share(np.concatenate([miss, scene.element], axis=1, dtype=np.int32), wp.int32)
    out.semantic_of = share(np.concatenate([miss * 0, scene.semantic], axis=1).astype(np.uint8), wp.uint8)
    for name, dtype in (("distance", wp.float32), ("slot", wp.int32), ("element", wp.int32), ("semantic", wp.uint8)):
        if getattr(image, name) is not None:
            setattr(out, name, share(getattr(image, name), dtype))
    tiles = -(-camera.width // kernels.TILE_COLUMNS) * -(-camera.height // kernels.TILE_ROWS) * len(scene.kind)

    def launch(first: int, count: int) -> None:
        wp.launch(kernels.draw_tiles, dim=count, inputs=[first, view, camera, out], device="cpu")

    share_out(launch, tiles, threads)


def _camera(sensor: Pinhole) -> outlines.Camera:
    """The camera as the kernels want it."""
    camera = outlines.Camera()
    camera.width, camera.height = sensor.width, sensor.height
    edge_u, edge_v = (np.tan(np.radians(fov) / 2) for fov in (sensor.horizontal_fov, sensor.vertical_fov))
    camera.step_u, camera.step_v = -2.0 * edge_u / sensor.width, -2.0 * edge_v / sensor.height
    camera.first_u, camera.first_v = edge_u + camera.step_u / 2, edge_v + camera.step_v / 2
    return camera


def _view(
    primitives: Primitives,
    present: np.ndarray,
    sensors: tuple[np.ndarray, np.ndarray],
    camera: outlines.Camera,
) -> outlines.View:
    shape = present.shape
    view = outlines.View()
    view.outline = wp.empty(shape, dtype=outlines.Outline, device="cpu")
    view.window = wp.empty(shape, dtype=wp.vec4i, device="cpu")
    view.count = wp.empty(shape[0], dtype=int, device="cpu")
    view.general = wp.empty(shape[0], dtype=wp.bool, device="cpu")
    kind = np.where(present, primitives.kind, GAP).astype(np.uint8)
    solids = [np.asarray(field, np.float32) for field in (primitives.center, primitives.half_size, primitives.yaw)]
    inputs = [share(kind, wp.uint8)]
    inputs += [share(field, dtype) for field, dtype in zip(solids, (wp.vec3, wp.vec3, wp.float32), strict=True)]
    inputs += [share(sensors[0], wp.vec3), share(sensors[1], wp.mat33), camera]
    wp.launch(outlines.prepare_view, dim=shape[0], inputs=inputs, outputs=[view], device="cpu")
    return view
