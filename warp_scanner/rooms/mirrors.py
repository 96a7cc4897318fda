"""Mirrors that hang on the outer walls of rooms, and what share of the rays they and panes of glass throw back.

R rooms. World frame: metres, z up; a room is centred on the origin.
"""

from typing import NamedTuple

import numpy as np

from warp_scanner import draws
from warp_scanner.rooms.settings import Range
from warp_scanner.scenes.scenes import BOX, OTHER, Primitives, Tags, solids
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.reflections import Sheen

WIDTH: Range = (1.2, 4.0)  # [m]
HEIGHT: Range = (1.5, 2.4)
THICKNESS = 0.02
ABOVE_FLOOR = 0.1
BESIDE = 30.0  # [deg] to either side of straight ahead, within which the middle of a mirror hangs
GAP = 0.05  # [m] to the corners and the ceiling of the room


class Shares(NamedTuple):
    """What becomes of the rays that meet a thing; the rest ends on it."""

    mirrored: float
    passed: float


# Round numbers. Polished glass throws back 8 % of the light head-on, and most of it at grazing angles (Fresnel); what a
# scanner reports of that depends on which return is the strongest. Dust, frames and films send some back.
MIRROR, GLASS = Shares(0.95, 0.0), Shares(0.3, 0.5)


def hung_mirrors(size: np.ndarray, pose: Pose, key: np.ndarray, element: int) -> Primitives:
    """One mirror for each room, (R, 1): a thin box on the outer wall that is about straight ahead of the sensor.

    Args:
        size: (R, 3) [m] inside of the shells.
        pose: of the sensors.
        key: (R,) from draws.keys.
        element: number that the mirrors get.
    """
    count, half = len(key), np.asarray(size, np.float64) / 2
    aside = draws.between(key, "mirror aside", (-BESIDE, BESIDE), 1)[:, 0]
    yaw, place = np.radians(pose.yaw + aside), np.asarray(pose.position, np.float64)[:, :2]
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    with np.errstate(divide="ignore"):
        # Where each ray meets the walls that it runs towards, across x and across y.
        reach = (np.where(ahead > 0.0, half[:, :2], -half[:, :2]) - place) / ahead
    axis, rows = np.argmin(np.where(np.isfinite(reach), reach, np.inf), axis=1), np.arange(count)
    way, along = np.sign(ahead[rows, axis]), 1 - axis
    most = half[rows, along] - GAP
    wide = np.minimum(draws.between(key, "mirror width", WIDTH, 1)[:, 0] / 2, most)
    tall = np.minimum(draws.between(key, "mirror height", HEIGHT, 1)[:, 0], 2.0 * half[:, 2] - ABOVE_FLOOR - GAP) / 2
    met = place + ahead * reach[rows, axis, None]
    center, box = np.zeros((count, 3)), np.zeros((count, 3))
    center[rows, axis] = way * (half[rows, axis] - THICKNESS / 2)
    center[rows, along] = np.clip(met[rows, along], wide - most, most - wide)
    center[:, 2] = ABOVE_FLOOR + tall - half[:, 2]
    box[rows, axis], box[rows, along], box[:, 2] = THICKNESS / 2, wide, tall
    parts = [[column[:, None] for column in table.T] for table in (center, box)]
    return solids(np.ones((count, 1), bool), *parts, 0.0, Tags(BOX, element, OTHER))


def sheen_of(count: int, things: dict[int, Shares]) -> Sheen:
    """A table of `count` elements of which some, by number, throw rays back or let them pass."""
    sheen = Sheen(np.zeros(count), np.zeros(count))
    for number, shares in things.items():
        sheen.mirrored[number], sheen.passed[number] = shares
    return sheen
