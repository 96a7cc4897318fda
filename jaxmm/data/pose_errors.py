"""Pairs whose robot is not quite where it is believed to be: registration corrects its pose by what it sees.

R robots, P rays. World frame: metres, z up.
"""

import numpy as np

from jaxmm.rays.registration import register
from warp_scanner.sensors.poses import Pose, rotation_of


def localised(pose: Pose, directions: np.ndarray, dt: np.ndarray, robot: np.ndarray) -> Pose:
    """Where R robots stand, judged by what they see: the registration of each scan with that of the prior from `pose`.

    Args:
        pose: of R sensors, as believed.
        directions: (P, 3) unit vectors in the sensor frame.
        dt: (R, P) ranges [m] of the prior from there, inf = nothing.
        robot: (R, P) ranges [m] as measured.

    Returns:
        Poses without roll, as gravity tells it.
    """
    found = []
    for row, (position, rotation) in enumerate(zip(pose.position, rotation_of(pose.yaw, pose.pitch), strict=True)):
        rays = directions @ rotation.T
        scan, prior = (rays[np.isfinite(r)] * r[np.isfinite(r), None] + position for r in (robot[row], dt[row]))
        motion = register(scan, prior, position).motion
        forward = motion[:3, :3] @ rotation[:, 0]
        yaw, pitch = np.arctan2(forward[1], forward[0]), np.arcsin(np.clip(forward[2], -1.0, 1.0))
        found.append((*(motion[:3, :3] @ position + motion[:3, 3]), *np.degrees([yaw, pitch])))
    columns = np.array(found, np.float32).reshape(-1, 5)
    return Pose(columns[:, :3], columns[:, 3], columns[:, 4])
