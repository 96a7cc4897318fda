"""Clues: what tells of a candidate whether it is a pillar, a wall or neither.

N points of one side of the scans, F clues. World frame: metres, z up. Plan: x and y.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import logit

from jaxmm.object_candidates import Candidate, CandidateSettings
from jaxmm.object_pieces import Piece, front_of
from jaxmm.object_sight import Patch, Sight, crossings
from jaxmm.object_walls import reach, seen_thin


class Opinions(NamedTuple):
    """What is known of each point alone."""

    pillar: np.ndarray  # (N,) P(of a changed pillar)
    wall: np.ndarray  # (N,) P(of a changed wall)
    apart: np.ndarray  # (N,) [m] to the surface of the other side


ONTO = 0.1  # [m] points this close to the other side's surface may be its own
AROUND = 0.3  # [m]
UNKNOWN = -10.0  # as an angle, which no angle is
FAR = 3.0  # [m] that a face may go on for; more tells no more
CLUES = (
    "round",  # 1 for a shaft, else 0
    "length",  # [m] of the first face, or the diameter of the shaft
    "span",  # [m] of all points along the first face; 0 of a shaft
    "side",  # [m] length of the face across it; 0 without one
    "pieces",  # how many
    "side_goes_on",  # [m] most that the face across may go on; 0 without one
    "goes_on",  # [m] most that the first face may go on unseen at one of its ends
    "goes_on_least",  # [m] and at the other
    "thin",  # 1 where one looks through where the side of a square pillar would be
    "arc",  # [rad] that is seen of the shaft
    "points",  # logarithm of their number, for each scan that saw some
    "pillar",  # log odds of the mean of P(of a changed pillar)
    "wall",  # and of a changed wall
    "top",  # [m] of the highest point above the floor
    "bottom",  # [m] of the lowest
    "left",  # [m] from the highest to the ceiling
    "over",  # logarithm of 1 + the rays that head for the space between its top and the ceiling
    "free_over",  # share of them that pass through
    "range",  # [m] from the sensor, in plan
    "slant",  # cosine of the angle between the line of sight and the first face
    "off_grid",  # [deg] between the first face and the building, 0 to 45; UNKNOWN of a shaft, or without a building
    "apart",  # [m] median distance of its points to the surface of the other side, 1 at most
    "onto",  # share of them within ONTO of it
    "filled",  # points for each square decimetre from the lowest to the highest, along the first face or the diameter
    "around",  # logarithm of 1 + the other points within AROUND in plan that are farther than ONTO from that surface
)  # fmt: skip


def clues_of(
    sight: Sight, candidate: Candidate, opinions: Opinions, grid: float | None, settings: CandidateSettings
) -> np.ndarray:
    """The CLUES (F,) of one candidate.

    Args:
        sight: of all points.
        candidate: of some of them.
        opinions: of all points.
        grid: [rad] the direction that most of the building stands along or across; None where nobody knows.
        settings: how far is looked.
    """
    first, members = candidate.first, candidate.members
    scans = len(np.unique(sight.origin[members], axis=0))  # each of which counts what the others count too
    z, apart = sight.points[members, 2], opinions.apart[members]
    low, high = float(z.min()), float(z.max())
    patch = Patch(*front_of(first), high + settings.rim, sight.ceiling - settings.rim)
    over = crossings(sight, patch, settings.tolerance)
    away = np.median(sight.points[members, :2], axis=0) - first.origin[:2]
    distance = max(float(np.linalg.norm(away)), 1e-6)
    of_all = [
        np.log(len(members) / scans), _logit(opinions.pillar[members]), _logit(opinions.wall[members]),
        high - sight.floor, low - sight.floor, sight.ceiling - high, np.log1p(over.total / scans), over.free, distance,
    ]  # fmt: skip
    of_surface = [min(float(np.median(apart)), 1.0), float(np.mean(apart <= ONTO))]
    around = float(np.log1p(_around(sight, members, opinions.apart) / scans))
    if first.circle is not None:
        shape = [1.0, 2.0 * first.circle.radius, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, first.circle.arc]
        filled = _filled(len(members) / scans, 2.0 * first.circle.radius, high - low)
        return np.array([*shape, *of_all, 0.0, UNKNOWN, *of_surface, filled, around])
    face, side = first.face, candidate.crossing
    goes_on = _goes_on(sight, first, settings)
    side_goes_on = _goes_on(sight, side, settings)[1] if side is not None else 0.0
    span = float(np.ptp(sight.points[members, :2] @ face.along))
    shape = [
        0.0, face.length, span, side.face.length if side is not None else 0.0, float(len(candidate.pieces)),
        side_goes_on, goes_on[1], goes_on[0], float(seen_thin(sight, first, settings)), 0.0,
    ]  # fmt: skip
    of_turn = [abs(float(face.along @ away)) / distance, _off(face.along, grid)]
    return np.array([*shape, *of_all, *of_turn, *of_surface, _filled(len(members) / scans, span, high - low), around])


def _goes_on(sight: Sight, piece: Piece, settings: CandidateSettings) -> list[float]:
    return sorted(min(reach(sight, piece, way, settings), FAR) for way in (-1.0, 1.0))


def _off(along: np.ndarray, grid: float | None) -> float:
    if grid is None:
        return UNKNOWN
    turn = np.degrees(np.arctan2(along[1], along[0]) - grid) % 90.0
    return float(min(turn, 90.0 - turn))


def _filled(count: float, width: float, height: float) -> float:
    return count / (100.0 * (width + 0.1) * (height + 0.1))


def _around(sight: Sight, members: np.ndarray, apart: np.ndarray) -> int:
    """New points beside the members (n,) of a candidate: furniture is seldom one face alone."""
    others = np.setdiff1d(np.flatnonzero(apart > ONTO), members, assume_unique=True)
    places = sight.points[members, :2]
    low, high = places.min(axis=0) - AROUND, places.max(axis=0) + AROUND
    near = others[((sight.points[others, :2] >= low) & (sight.points[others, :2] <= high)).all(axis=1)]
    return int(np.sum(cKDTree(places).query(sight.points[near, :2], distance_upper_bound=AROUND)[0] < AROUND))


def _logit(probability: np.ndarray) -> float:
    return float(logit(np.clip(np.mean(probability), 0.003, 0.997)))
