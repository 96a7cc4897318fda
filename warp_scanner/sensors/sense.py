"""Scans rooms with any sensor: pinholes by the fast path, all others ray by ray, then whatever the sensor adds.

R rooms, K slots of primitives, P rays. World frame: metres, z up.
"""

import numpy as np

from warp_scanner import draws
from warp_scanner.scenes.scenes import Primitives
from warp_scanner.sensors.imperfections import imperfect
from warp_scanner.sensors.pinhole import cast_image, cast_image_slots
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.scan import Rays, Scan, cast_rays, cast_slots
from warp_scanner.sensors.sensors import Pinhole, Sensor
from warp_scanner.sensors.surface import incidence_of, normals_of


def rays_of(sensor: Sensor, pose: Pose) -> Rays:
    """The rays of R sensors that share their directions."""
    return Rays(pose.position, sensor.directions(), rotation_of(pose.yaw, pose.pitch))


def cast(
    primitives: Primitives, present: np.ndarray | None, sensor: Sensor, pose: Pose, threads: int | None = None
) -> Scan:
    """The first surface along every ray of a sensor, without limits of its range and without errors.

    Args:
        primitives: the table of R rooms.
        present: (R, K) bool, False leaves a primitive out; None = all are there.
        sensor: any.
        pose: of R sensors.
        threads: how many to use; by default one for each core it may run on.

    Raises:
        ValueError: the shapes disagree, or a position is not finite.
    """
    if isinstance(sensor, Pinhole):
        return cast_image(primitives, present, sensor, pose, threads)
    return cast_rays(primitives, present, rays_of(sensor, pose), threads)


def cast_which(
    primitives: Primitives, present: np.ndarray | None, sensor: Sensor, pose: Pose, threads: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """As cast, but tells which slot was hit: distance (R, P) float32, slot (R, P) int32, -1 on a miss."""
    if isinstance(sensor, Pinhole):
        return cast_image_slots(primitives, present, sensor, pose, threads)
    return cast_slots(primitives, present, rays_of(sensor, pose), threads)


def within_reach(scan: Scan, sensor: Sensor) -> Scan:
    """The scan with misses for all that is nearer or farther than the sensor's range limits."""
    low, high = np.float32(sensor.range_limits)
    lost = (scan.distance < low) | (scan.distance > high)
    if not lost.any():
        return scan
    return Scan(
        np.where(lost, np.float32(np.inf), scan.distance),
        np.where(lost, np.int32(-1), scan.element),
        np.where(lost, np.uint8(0), scan.semantic),
    )


def measured(
    scan: Scan,
    scene: tuple[Primitives, np.ndarray],
    seen: tuple[Sensor, Pose],
    which: tuple[int, np.ndarray],
    threads: int | None = None,
) -> Scan:
    """What the sensor reports of a scan without errors.

    Args:
        scan: from `cast`.
        scene: the primitives, and (R, K) bool which of them are there.
        seen: the sensor with its imperfections, and its poses.
        which: seed and (R,) room numbers: they fix every error.
        threads: how many to use; by default one for each core it may run on.
    """
    (sensor, pose), incidence = seen, None
    if sensor.imperfections.by_incidence:
        distance, slot = cast_which(*scene, sensor, pose, threads)
        rays = rays_of(sensor, pose)
        incidence = incidence_of(normals_of(scene[0], slot, distance, rays), rays)
    return imperfect(scan, incidence, sensor, *which)


def with_noise(scan: Scan, sensor: Sensor, sigma: np.ndarray, which: tuple[int, np.ndarray]) -> Scan:
    """The scan with independent Gaussian errors of its ranges; what they push out of the sensor's reach is lost.

    Args:
        scan: (R, P).
        sensor: its range limits count.
        sigma: (R,) standard deviations [m].
        which: seed and (R,) room numbers: they fix every error.
    """
    if not np.any(sigma):
        return scan
    errors = draws.normal(draws.keys(*which), "pair range noise", scan.distance.shape[1])
    distance = scan.distance + np.asarray(sigma, np.float32)[:, None] * errors
    # Nothing is measured behind the sensor, and misses stay misses.
    distance = np.where(distance > 0.0, distance, np.float32(np.inf))
    return _gated(scan._replace(distance=distance), sensor)


def _gated(scan: Scan, sensor: Sensor) -> Scan:
    lost = np.isinf(scan.distance)
    kept = Scan(scan.distance, np.where(lost, np.int32(-1), scan.element), np.where(lost, np.uint8(0), scan.semantic))
    return within_reach(kept, sensor)
