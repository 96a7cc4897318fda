"""From points with two probabilities to objects: which walls and pillars stand there, how large, and how surely.

probable points -> clusters -> upright faces and shafts -> faces of one wall joined -> walls and pillars -> boxes.
N points of one side of some scans, S scans. World frame: metres, z up. An object is an upright prism, turned by any
angle, and reaches from floor to ceiling unless one sees that it does not. What is low, and seen to end below the
ceiling, is furniture, whatever its points look like.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxmm.boxes import Box
from jaxmm.object_levels import levels_of
from jaxmm.object_pieces import joined, pieces_of, upright
from jaxmm.object_sight import Sight, sensors_of
from jaxmm.object_solids import SolidSettings, solids_of
from jaxmm.object_walls import KnownSizes, Solid


class Judged(NamedTuple):
    """One side of one scan or several, thinned to about one point a voxel of 0.1 m, and what the networks say of it."""

    points: np.ndarray  # (N, 3) [m] world, or offsets from some origin
    pillar: np.ndarray  # (N,) P(of a changed pillar)
    wall: np.ndarray  # (N,) P(of a changed wall)
    apart: np.ndarray  # (N,) [m] to the surface of the other side
    sensor: np.ndarray  # (S, 3) [m] where the scans were taken from, in the frame of the points
    floor: float  # [m]
    ceiling: float
    scan: np.ndarray | None = None  # (N,) int which of the S saw each point; where None, the nearest
    furniture: bool = True  # whether it may hold furniture, as a robot scan does and a building model does not


class Found(NamedTuple):
    """One object."""

    box: Box  # its probability is that it is real
    members: np.ndarray  # (n,) int of the points that it was fitted to, in order


@dataclasses.dataclass(frozen=True)
class ObjectSettings(SolidSettings):
    """How points become objects; chosen on validation rooms, as were the settings of the steps. Lengths in metres."""

    threshold: float = 0.3  # a point is looked at from this probability on; whether its object is real is told by all
    least_apart: float = 0.0  # points closer to the other side's surface are none of an object
    surface_margin: float = 0.05  # points this near to floor or ceiling are none either

    def __post_init__(self):
        if not 0.0 <= self.threshold <= 1.0:
            raise ValueError(f"threshold must lie in [0, 1], got {self.threshold}")
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not np.all(np.asarray(value) >= 0.0):  # also false for NaN
                raise ValueError(f"{field.name} must not be negative, got {value}")
        if self.link <= 0.0 or self.tolerance <= 0.0:
            raise ValueError(f"link and tolerance must be positive, got {self.link} and {self.tolerance}")


def find_objects(
    judged: Judged, settings: ObjectSettings | None = None, known: KnownSizes | None = None
) -> list[Found]:
    """Find the walls and pillars among the points that the networks hold for changed.

    Args:
        judged: all points of one side; those that did not change tell where nothing stands.
        settings: by default those that were best in validation rooms.
        known: wall thicknesses and column sections of the building, taken on where they fit.

    Returns:
        Objects, the surest first, unlikely ones too. Their order and content do not depend on the order of the points.

    Raises:
        ValueError: shapes that disagree, values that are not finite, probabilities outside [0, 1], or a ceiling that
            is not above the floor.
    """
    settings, known = settings or ObjectSettings(), known or KnownSizes()
    sight, score = _checked(judged)
    probability, z = np.maximum(*score), sight.points[:, 2]
    inside = (z > sight.floor + settings.surface_margin) & (z < sight.ceiling - settings.surface_margin)
    chosen = inside & (probability >= settings.threshold) & (np.asarray(judged.apart) >= settings.least_apart)
    pieces = upright(sight, pieces_of(sight, np.flatnonzero(chosen), settings), settings)
    solids = solids_of(sight, joined(sight, pieces, settings), score, settings, known)
    apart = np.asarray(judged.apart, np.float64)
    found = []
    for solid in solids:
        low = judged.furniture and z[solid.members].max() - sight.floor < settings.furniture_height
        odds = log_odds_of_object(probability[solid.members])
        if low:
            odds = min(odds, log_odds_of_low_object(sight, solid, probability, apart))
        found.append(Found(_box(sight, solid, float(1.0 / (1.0 + np.exp(-odds))), settings), solid.members))
    return sorted(found, key=lambda one: (-one.box.probability, *one.box.center))


def log_odds_of_object(probability: np.ndarray) -> float:
    """Log odds that an object is real, from the probabilities of its points (n,): many of one mind say more than few.

    A logistic regression on objects of validation rooms, less what makes up for changes being rarer elsewhere.
    """
    return float(_mean_logit(probability) + 1.3 * np.log(len(probability)) - 4.8)


def log_odds_of_low_object(sight: Sight, solid: Solid, probability: np.ndarray, apart: np.ndarray) -> float:
    """The same of an object of which nothing is seen above the height of furniture, so that it may be some.

    Furniture stands against walls, is wide and longer than deep, and where it is round, a leg.
    """
    members, edges = solid.members, np.maximum(solid.edges, 0.05)
    is_round, is_block = solid.shape == "round", solid.object_type == "pillar" and solid.shape != "round"
    longer = np.log(edges.max() / edges.min()) if is_block else 0.0
    wider = np.log(edges.min() / 0.5) if is_block else 0.0
    thinner = min(np.log(edges.min() / 0.3), 0.0) if is_round else 0.0
    of_points = 0.7 * _mean_logit(probability[members]) + 1.25 * np.log(len(members))
    of_place = 6.0 * np.clip(np.median(apart[members]), 0.0, 1.0)
    of_shape = 1.9 * is_round + 8.0 * thinner - 4.8 * longer - 2.6 * wider
    return float(of_points + of_place + of_shape - 9.1)


def _mean_logit(probability: np.ndarray) -> float:
    mean = float(np.clip(np.mean(probability), 0.003, 0.997))
    return float(np.log(mean / (1.0 - mean)))


def _box(sight: Sight, solid: Solid, probability: float, settings: ObjectSettings) -> Box:
    low, high = levels_of(sight, solid, settings)
    turn = float(np.degrees(np.arctan2(solid.along[1], solid.along[0])))
    return Box(
        solid.object_type,
        np.array([*solid.center, (low + high) / 2]),
        np.array([*solid.edges, high - low]),
        (turn + 90.0) % 180.0 - 90.0,
        solid.shape,
        probability,
        len(solid.members),
    )


def _checked(judged: Judged) -> tuple[Sight, tuple[np.ndarray, np.ndarray]]:
    points, sensors = np.asarray(judged.points, np.float64), np.asarray(judged.sensor, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points must be (N, 3), got {points.shape}")
    if sensors.ndim != 2 or sensors.shape[1] != 3 or not len(sensors):
        raise ValueError(f"sensor must be (S >= 1, 3), got {sensors.shape}")
    if not np.isfinite(points).all() or not np.isfinite(sensors).all():
        raise ValueError("points and sensor must be finite")
    for name in ("pillar", "wall", "apart"):
        if np.shape(getattr(judged, name)) != (len(points),):
            raise ValueError(f"{name} must be ({len(points)},), got {np.shape(getattr(judged, name))}")
    score = np.asarray(judged.pillar, np.float64), np.asarray(judged.wall, np.float64)
    if not all(np.all((one >= 0.0) & (one <= 1.0)) for one in score):  # also false for NaN
        raise ValueError("pillar and wall must lie in [0, 1], got values outside it")
    if not judged.floor < judged.ceiling:
        raise ValueError(f"floor must lie below ceiling, got {judged.floor} and {judged.ceiling}")
    origin = sensors_of(points, sensors, judged.scan)
    return Sight(points, origin, float(judged.floor), float(judged.ceiling)), score
