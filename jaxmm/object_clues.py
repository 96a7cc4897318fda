"""Clues: what tells of a candidate whether it is a pillar, a wall or neither.

N points of one side of the scans, F clues. World frame: metres, z up. Plan: x and y.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import logit

from jaxmm.object_candidates import Candidate, CandidateSettings
from jaxmm.object_pieces import front_of
from jaxmm.object_sight import Patch, Sight, crossings
from jaxmm.object_walls import reach, seen_thin


class Opinions(NamedTuple):
    """What is known of each point alone."""

    pillar: np.ndarray  # (N,) P(of a changed pillar)
    wall: np.ndarray  # (N,) P(of a changed wall)
    apart: np.ndarray  # (N,) [m] to the surface of the other side


ONTO = 0.1  # [m] points this close to the other side's surface may be its own
AROUND = 0.3  # [m]
CELL = 0.05  # [m] in which places are counted along a direction
MOST_POINTS = 4000  # that the direction of a building is sought among
MOST_REACH = 50.0  # [m] from their middle, beyond which points are left out
TURNS = 90  # directions tried, over a quarter of a turn
FAR = 3.0  # [m] that a face may go on for; more tells no more
CLUES = (
    "round",  # 1 for a shaft, else 0
    "length",  # [m] of the first face, or the diameter of the shaft
    "span",  # [m] of all points along the first face; 0 of a shaft
    "side",  # [m] length of the face across it; 0 without one
    "pieces",  # how many
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
    "off_grid",  # [deg] between the first face and the directions of what stands around, 0 to 45; -10 of a shaft
    "apart",  # [m] median distance of its points to the surface of the other side, 1 at most
    "onto",  # share of them within ONTO of it
    "filled",  # points for each square decimetre from the lowest to the highest, along the first face or the diameter
    "around",  # logarithm of 1 + the other points within AROUND in plan that are farther than ONTO from that surface
)  # fmt: skip


def clues_of(
    sight: Sight, candidate: Candidate, opinions: Opinions, grid: float, settings: CandidateSettings
) -> np.ndarray:
    """The CLUES (F,) of one candidate.

    Args:
        sight: of all points.
        candidate: of some of them.
        opinions: of all points.
        grid: [rad] the direction that most stands along, from `grid_of`.
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
        shape = [1.0, 2.0 * first.circle.radius, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, first.circle.arc]
        filled = _filled(len(members) / scans, 2.0 * first.circle.radius, high - low)
        return np.array([*shape, *of_all, 0.0, -10.0, *of_surface, filled, around])
    face, side = first.face, candidate.crossing
    goes_on = sorted(min(reach(sight, first, way, settings), FAR) for way in (-1.0, 1.0))
    span = float(np.ptp(sight.points[members, :2] @ face.along))
    shape = [
        0.0, face.length, span, side.face.length if side is not None else 0.0, float(len(candidate.pieces)),
        goes_on[1], goes_on[0], float(seen_thin(sight, first, settings)), 0.0,
    ]  # fmt: skip
    turn = np.degrees(np.arctan2(face.along[1], face.along[0]) - grid) % 90.0
    of_turn = [abs(float(face.along @ away)) / distance, min(turn, 90.0 - turn)]
    return np.array([*shape, *of_all, *of_turn, *of_surface, _filled(len(members) / scans, span, high - low), around])


def grid_of(places: np.ndarray) -> float:
    """Direction [rad], 0 to a quarter turn, along and across which most places (N, 2) [m] lie in lines; 0 of none.

    It is that in which the counts of places along both axes are most uneven, as the sum of their squares tells.
    """
    if not len(places):
        return 0.0
    places = places[np.abs(places - np.median(places, axis=0)).max(axis=1) <= MOST_REACH]
    if not len(places):  # two heaps of points, and the middle is far from both
        return 0.0
    places = places[np.lexsort(places.T)][:: -(-len(places) // MOST_POINTS)]
    step = np.pi / 2 / TURNS
    rough = _most_uneven(places, step * np.arange(TURNS))
    return float(_most_uneven(places, rough + step * np.linspace(-1.0, 1.0, 21)) % (np.pi / 2))


def _most_uneven(places: np.ndarray, angle: np.ndarray) -> float:
    along = np.stack([np.cos(angle), np.sin(angle)])
    uneven = np.zeros(len(angle))
    for axis in (along, np.stack([-along[1], along[0]])):
        cell = np.floor((places - places.mean(axis=0)) @ axis / CELL).astype(np.int64)
        cell -= cell.min()
        many = int(cell.max()) + 2
        count = np.bincount((cell + many * np.arange(len(angle))).ravel(), minlength=many * len(angle))
        count = count.reshape(len(angle), many)
        uneven += ((count[:, 1:] + count[:, :-1]) ** 2).sum(axis=1)  # a line on the border of two cells is one
    return float(angle[np.argmax(uneven)])


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
