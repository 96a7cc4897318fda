"""Joins scanner and evidence: casts rays at the prior, and tells of every point what the other side's rays say of it.

R rooms, P rays, N points of one scan after preprocessing. World frame: metres, z up.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.rays.evidence import Frame, View, frame_of, margins
from jaxmm.rays.noise_model import Noise, noise_of, sigma_at
from jaxmm.rays.views import Along, view_of_prior, view_of_robot
from warp_scanner.clouds.points import Kept
from warp_scanner.clouds.sightlines import Looks, Predicted, Targets, look, sort_directions
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.sense import cast_which, rays_of
from warp_scanner.sensors.sensors import Sensor
from warp_scanner.sensors.surface import incidence_of, normals_of
from warp_scanner.sensors.surface_distance import surface_distance

FOOTPRINT = 0.05  # [m] half width of what a point of the prior stands for
MOST_ANGLE = 0.06  # [rad] of a footprint, close to the sensor
EVERY = 8  # one of so many rays tells the noise


class Expected(NamedTuple):
    """What the prior says that every ray of R robot scans should meet."""

    distance: np.ndarray  # (R, P) float32 [m], inf = nothing
    cosine: np.ndarray  # (R, P) float32 of the incidence there, NaN = nothing
    margin: np.ndarray  # (R, P) float32 [m]
    noise: list[Noise]  # of each room, measured less expected ranges


def expected_of(pairs: Pairs, sensor: Sensor, threads: int | None = None) -> Expected:
    """Cast the robot's rays, from where it is believed to be, at the prior."""
    distance, slot = cast_which(pairs.prior, None, sensor, pairs.pose, threads)
    rays = rays_of(sensor, pairs.pose)
    cosine = np.cos(incidence_of(normals_of(pairs.prior, slot, distance, rays), rays))
    thin, measured = slice(None, None, EVERY), pairs.robot.distance
    rows = range(len(distance))
    with np.errstate(invalid="ignore"):  # no return where none was expected
        noise = [noise_of((measured[r] - distance[r])[thin], cosine[r, thin], distance[r, thin]) for r in rows]
    margin = np.stack([margins(cosine[r], sigma_at(noise[r], distance[r])) for r in rows])
    return Expected(distance, cosine, margin, noise)


def prior_views(
    pairs: Pairs,
    sensor: Sensor,
    expected: Expected,
    seen: tuple[list[Kept], list[np.ndarray]],
    threads: int | None = None,
) -> list[View]:
    """What the robot's rays say of the points of each DT scan.

    Args:
        pairs: of R rooms.
        sensor: of both scans.
        expected: from `expected_of`.
        seen: the DT points that are left of each room, and their distances to the robot's points (N,) [m].
        threads: how many to use; by default one for each core it may run on.
    """
    spacing = np.radians(max(sensor.spacing))
    targets = []
    for row, (_, pixel) in enumerate(seen[0]):
        reach = pairs.dt.distance[row, pixel]
        angle = np.clip(FOOTPRINT / reach, 0.75 * spacing, max(MOST_ANGLE, 0.75 * spacing))
        unused = np.zeros(len(pixel), np.float32)
        targets.append(Targets(pairs.directions[pixel], reach, angle, unused, unused, pairs.dt.element[row, pixel]))
    predicted = Predicted(pairs.dt.distance, pairs.dt.element, expected.margin)
    looks = look(sort_directions(pairs.directions), pairs.robot.distance, targets, predicted, threads=threads)
    rows = range(len(looks))
    return [_prior_view(pairs, expected, row, (seen[0][row], seen[1][row]), looks[row]) for row in rows]


def _prior_view(pairs: Pairs, expected: Expected, row: int, seen: tuple[Kept, np.ndarray], looks: Looks) -> View:
    (points, pixel), apart = seen
    element, cosine, margin = pairs.dt.element[row, pixel], expected.cosine[row, pixel], expected.margin[row, pixel]
    return view_of_prior(points, element, (looks.count, looks.residual), margin, apart, cosine)


def robot_views(pairs: Pairs, expected: Expected, seen: list[Kept], threads: int | None = None) -> list[View]:
    """What the prior says of the points of each robot scan, along their own rays and all around."""
    apart = surface_distance(pairs.prior, None, [kept.points for kept in seen], threads)
    return [robot_view_of(pairs, expected, row, kept, apart[row]) for row, kept in enumerate(seen)]


def robot_view_of(pairs: Pairs, expected: Expected, row: int, kept: Kept, apart: np.ndarray) -> View:
    """One of them, where the distances (N,) [m] to the prior's surface are known."""
    points, pixel = kept
    fields = (pairs.robot.distance, expected.distance, expected.margin, expected.cosine)
    return view_of_robot(points, Along(*(field[row, pixel] for field in fields)), apart, expected.noise[row])


def frames_of(pairs: Pairs, sensor: Sensor) -> list[Frame]:
    """What heights are judged against in each room."""
    directions = sensor.resampled(160, 100).directions()
    half = pairs.size[:, 2] / 2
    return [
        frame_of(position, directions @ rotation.T, -top, top)
        for position, rotation, top in zip(
            pairs.pose.position, rotation_of(pairs.pose.yaw, pairs.pose.pitch), half, strict=True
        )
    ]
