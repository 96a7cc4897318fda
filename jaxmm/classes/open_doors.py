"""Whether the leaf of a door that rays pass stands open near its place: there rays end on what no model has.

P rays of one scan, H places of a leaf. Positions are offsets from the prior's origin: metres, z up.
"""

from typing import NamedTuple

import numpy as np

from warp_scanner.scenes.scenes import BOX, Primitives
from warp_scanner.sensors.scan import Rays, cast_rays

ANGLES = np.radians([35.0, 60.0, 85.0, 110.0, 135.0, 160.0])  # by which a leaf may stand open, to either side
THICK = 0.05  # [m] of a leaf
DOUBLE = 1.3  # [m] from which a door may have two
LEAST_RAYS = 20  # that tell of a place
TAKEN = 0.3  # share of those that end where a leaf may be, all others pass behind it
ERROR, GROWS = 0.05, 0.01  # [m] of a range, and more for each metre: nobody knows the angle


class Opening(NamedTuple):
    """What a door fills, upright."""

    center: np.ndarray  # (3,) [m]
    along: np.ndarray  # (2,) unit vector
    width: float  # [m]
    height: float


def opening_of(corners: np.ndarray) -> Opening:
    """The opening that the corners (v, 3) of a door span."""
    middle = corners[:, :2].mean(axis=0)
    along = np.linalg.svd(corners[:, :2] - middle, full_matrices=False)[2][0]
    at = (corners[:, :2] - middle) @ along
    low, high = corners[:, 2].min(), corners[:, 2].max()
    center = np.array([*(middle + along * (at.min() + at.max()) / 2.0), (low + high) / 2.0])
    return Opening(center, along, float(np.ptp(at)), float(high - low))


def leaf_is_near(opening: Opening, view: tuple[np.ndarray, np.ndarray, np.ndarray], expected: np.ndarray) -> bool:
    """Whether something stands beside an opening where its leaf would, were it open, and the model has nothing.

    Args:
        opening: of the door.
        view: position (3,), unit vectors (P, 3) and ranges (P,) [m] of a scan's rays that came back.
        expected: (P,) [m] what they should meet in the model without the door.
    """
    position, direction, distance = view
    offset = (opening.center - position).astype(np.float64)
    far = np.linalg.norm(offset)
    reach = opening.width + opening.height
    # Only rays that come near: all leaves are in a ball around the opening.
    if far > reach:
        near = direction @ (offset / far) >= np.sqrt(1.0 - (reach / far) ** 2)
        direction, distance, expected = direction[near], distance[near], expected[near]
    if not len(direction):
        return False
    leaves = _leaves(opening)
    for met in cast_rays(leaves, None, Rays(np.tile(position, (len(leaves.kind), 1)), direction)).distance:
        margin = ERROR + GROWS * met
        with np.errstate(invalid="ignore"):
            tells = np.isfinite(met) & (expected - met > 2.0 * margin)
            through, support = tells & (distance > met + margin), tells & (np.abs(distance - met) <= margin)
        passed, ended = int(through.sum()), int(support.sum())
        if passed + ended >= LEAST_RAYS and ended >= TAKEN * (passed + ended):
            return True
    return False


def _leaves(opening: Opening) -> Primitives:
    """(H, 1) boxes, where the leaf may stand."""
    places = []
    widths = (opening.width, opening.width / 2.0) if opening.width > DOUBLE else (opening.width,)
    for width in widths:
        for side in (-1.0, 1.0):
            hinge = opening.center[:2] + side * opening.along * opening.width / 2.0
            own = np.arctan2(*(-side * opening.along)[::-1])
            for angle in own + np.concatenate([ANGLES, -ANGLES]):
                middle = hinge + width / 2.0 * np.array([np.cos(angle), np.sin(angle)])
                places.append((*middle, opening.center[2], width, angle))
    x, y, z, width, angle = np.array(places, np.float32).T
    half = np.stack([width / 2.0, np.full_like(width, THICK / 2.0), np.full_like(width, opening.height / 2.0)], axis=1)
    shape = (len(places), 1)
    return Primitives(
        np.full(shape, BOX, np.uint8), np.stack([x, y, z], axis=1)[:, None], half[:, None], angle[:, None],
        np.zeros(shape, np.int32), np.ones(shape, np.uint8),
    )  # fmt: skip
