"""Features of a candidate that the judge weighs: what tells a pillar, a wall and neither apart.

N points of one side of the scans, F clues. World frame: metres, z up. Plan: x and y.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import logit

from jaxmm.learning.upright_shapes import face_through, turn_of
from jaxmm.objects.candidates import Candidate, CandidateSettings
from jaxmm.objects.face_ends import End, Look, back_of, ends_of
from jaxmm.objects.face_finish import FAR
from jaxmm.objects.main_directions import UNKNOWN, off_grid
from jaxmm.objects.patches import Patch, Sight, crossings
from jaxmm.objects.pieces import Piece, front_of
from jaxmm.objects.usual_sizes import Habits
from jaxmm.objects.walls import reach, seen_thin


class Opinions(NamedTuple):
    """What is known of each point alone."""

    pillar: np.ndarray  # (N,) P(of a changed pillar)
    wall: np.ndarray  # (N,) P(of a changed wall)
    apart: np.ndarray  # (N,) [m] to the surface of the other side


class Surroundings(NamedTuple):
    """What the building is like around the sensor that saw a candidate."""

    grid: float | None = None  # [rad] the direction that most of it stands along or across; None where nobody knows
    habits: Habits = Habits()


ONTO = 0.1  # [m] points this close to the other side's surface may be its own
AROUND = 0.3  # [m]
# Of a shaft, the line through its points is what is called its face here, but for its length and its angle to the grid.
CLUES = (
    "round",  # 1 for a shaft, else 0
    "length",  # [m] of the first face, or the diameter of the shaft
    "span",  # [m] of all points along the first face; 0 of a shaft
    "side",  # [m] length of the face across it; 0 without one
    "pieces",  # how many
    "side_goes_on",  # [m] most that the face across may go on; 0 without one
    "thin",  # 1 where one looks through where the side of a square pillar would be
    "arc",  # [rad] that is seen of the shaft
    "flat",  # [m] root mean square of the distances of all its points from the line of the first face
    "bulge",  # [m] the largest of them, of a shaft: how much of a circle it is; 0 of a face
    "near_goes_on",  # [m] most that the face may go on unseen at the end that is nearer to the sensor
    "far_goes_on",  # [m] and at the other
    "longest",  # [m] the length with what it may go on at both ends
    "near_deep",  # [m] behind the face, beside the nearer end, where one first looks through
    "far_deep",  # [m] and beside the other
    "back",  # [m] behind the face at which rays pass along its back
    "near_in_view",  # [m] from the nearer end to the edge of the view, on in the line of the face
    "far_in_view",  # [m] and from the other
    "near_shift",  # [m] that the face ends, at the nearer end, beyond its thinned points, as all rays show
    "far_shift",  # [m] and at the other
    "near_side",  # [m] behind the face, to which one sees the surface go on from the nearer end
    "far_side",  # [m] and from the other
    "near_jump",  # [m] from there back to what comes next; -1 where nothing comes
    "far_jump",  # [m] and at the other end
    "near_before",  # share of the rays next to the nearer end that end before the face; -1 without one
    "far_before",  # and next to the other
    "near_missing",  # share of them of which nothing came back
    "far_missing",  # and next to the other
    "points",  # logarithm of their number, for each scan that saw some
    "pillar",  # log odds of the mean of P(of a changed pillar)
    "wall",  # and of a changed wall
    "pillar_spread",  # standard deviation of P(of a changed pillar)
    "wall_spread",  # and of a changed wall
    "wall_share",  # of its points that are of a wall rather than of a pillar
    "top",  # [m] of the highest point above the floor
    "bottom",  # [m] of the lowest
    "left",  # [m] from the highest to the ceiling
    "over",  # logarithm of 1 + the rays that head for the space between its top and the ceiling
    "free_over",  # share of them that pass through
    "range",  # [m] from the sensor, in plan
    "beyond",  # [m] that the sensor is beyond the nearer end, along the face; negative short of it; 3 at most
    "slant",  # cosine of the angle between the first face and the line of sight to most of the points
    "bearing",  # [deg] between the line of sight to the middle of the face and the face's normal
    "off_grid",  # [deg] between the first face and the building, 0 to 45; UNKNOWN of a shaft, or without a building
    "apart",  # [m] median distance of its points to the surface of the other side, 1 at most
    "apart_least",  # [m] the least of them
    "near_apart",  # [m] the least of those at the nearer end, 1 at most
    "far_apart",  # [m] and at the other
    "onto",  # share of them within ONTO of it
    "filled",  # points for each square decimetre from the lowest to the highest, along the first face or the diameter
    "around",  # logarithm of 1 + the other points within AROUND in plan that are farther than ONTO from that surface
    *(f"own_{name}" for name in Habits._fields),  # what is usual in the building, see Habits
)  # fmt: skip


def clues_of(
    sight: Sight,
    looks: Sequence[Look],
    candidate: Candidate,
    opinions: Opinions,
    building: Surroundings,
    settings: CandidateSettings,
) -> np.ndarray:
    """The CLUES (F,) of one candidate.

    Args:
        sight: of all points.
        looks: the same, scan by scan.
        candidate: of some of them.
        opinions: of all points.
        building: what it is like there.
        settings: how far is looked.
    """
    first, flat = candidate.first, _flat(sight, candidate.first)
    sight = sight.around(candidate.members)
    looks = [look._replace(sight=look.sight._replace(floor=sight.floor, ceiling=sight.ceiling)) for look in looks]
    told = (
        _of_shape(sight, candidate, settings)
        | _of_ends(sight, looks, candidate, flat, opinions, settings)
        | _of_points(sight, candidate, opinions)
        | _of_heights(sight, candidate, settings)
        | _of_place(sight, candidate, flat)
    )
    told["off_grid"] = UNKNOWN
    if first.face is not None and building.grid is not None:
        told["off_grid"] = float(off_grid(turn_of(first.face.along), building.grid))
    told |= {f"own_{name}": value for name, value in building.habits._asdict().items()}
    width = told["span"] if first.face is not None else told["length"]
    told["filled"] = np.exp(told["points"]) / (100.0 * (width + 0.1) * (told["top"] - told["bottom"] + 0.1))
    return np.array([told[name] for name in CLUES])


def _flat(sight: Sight, piece: Piece) -> Piece:
    """A piece with a face: of a shaft, the line through its points."""
    if piece.face is not None:
        return piece
    return piece._replace(face=face_through(sight.points[:, :2], piece.members), circle=None)


def _of_shape(sight: Sight, candidate: Candidate, settings: CandidateSettings) -> dict[str, float]:
    first, side = candidate.first, candidate.crossing
    if first.circle is not None:
        none = dict.fromkeys(("span", "side", "side_goes_on", "thin"), 0.0)
        return none | {"round": 1.0, "length": 2.0 * first.circle.radius, "pieces": 1.0, "arc": first.circle.arc}
    side_goes_on = max(min(reach(sight, side, way, settings), FAR) for way in (-1.0, 1.0)) if side is not None else 0.0
    return {
        "round": 0.0,
        "length": first.face.length,
        "span": float(np.ptp(sight.points[candidate.members, :2] @ first.face.along)),
        "side": side.face.length if side is not None else 0.0,
        "pieces": float(len(candidate.pieces)),
        "side_goes_on": side_goes_on,
        "thin": float(seen_thin(sight, first, settings)),
        "arc": 0.0,
    }


def _of_ends(
    sight: Sight,
    looks: Sequence[Look],
    candidate: Candidate,
    piece: Piece,
    opinions: Opinions,
    settings: CandidateSettings,
) -> dict[str, float]:
    face, members = piece.face, candidate.members
    near, far = ends_of(sight, looks, piece, members, opinions.apart, settings)
    set_back = np.setdiff1d(piece.members, face.members, assume_unique=True)  # panes do not make a wall uneven
    on = np.setdiff1d(members, set_back, assume_unique=True)
    off = np.abs((sight.points[on, :2] - face.center) @ face.across)
    return {
        "flat": float(np.sqrt(np.mean(off**2))),
        "bulge": float(off.max()) if candidate.first.circle is not None else 0.0,
        **_of_end("near", near),
        **_of_end("far", far),
        "longest": face.length + near.goes_on + far.goes_on,
        "back": back_of(looks, piece, settings),
    }


def _of_end(name: str, end: End) -> dict[str, float]:
    told = end._asdict()
    told |= told.pop("finish")._asdict()
    return {f"{name}_{what}": value for what, value in told.items()}


def _of_points(sight: Sight, candidate: Candidate, opinions: Opinions) -> dict[str, float]:
    members, scans = candidate.members, _scans(sight, candidate)
    pillar, wall, apart = (one[members] for one in opinions)
    return {
        "points": float(np.log(len(members) / scans)),
        "pillar": _logit(pillar),
        "wall": _logit(wall),
        "pillar_spread": float(pillar.std()),
        "wall_spread": float(wall.std()),
        "wall_share": float(np.mean(wall > pillar)),
        "apart": min(float(np.median(apart)), 1.0),
        "apart_least": min(float(apart.min()), 1.0),
        "onto": float(np.mean(apart <= ONTO)),
        "around": float(np.log1p(_around(sight, members, opinions.apart) / scans)),
    }


def _scans(sight: Sight, candidate: Candidate) -> int:
    """How many scans saw something of it: each counts what the others count too."""
    return len(np.unique(sight.origin[candidate.members], axis=0))


def _of_heights(sight: Sight, candidate: Candidate, settings: CandidateSettings) -> dict[str, float]:
    z, scans = sight.points[candidate.members, 2], _scans(sight, candidate)
    low, high = float(z.min()), float(z.max())
    patch = Patch(*front_of(candidate.first), high + settings.rim, sight.ceiling - settings.rim)
    over = crossings(sight, patch, settings.tolerance)
    return {
        "top": high - sight.floor,
        "bottom": low - sight.floor,
        "left": sight.ceiling - high,
        "over": float(np.log1p(over.total / scans)),
        "free_over": over.free,
    }


def _of_place(sight: Sight, candidate: Candidate, piece: Piece) -> dict[str, float]:
    face, sensor = piece.face, piece.origin[:2]
    away = np.median(sight.points[candidate.members, :2], axis=0) - sensor
    distance = max(float(np.linalg.norm(away)), 1e-6)
    along, across = np.abs((sensor - face.center) @ np.stack([face.along, face.across], axis=1))
    return {
        "range": distance,
        "beyond": float(np.clip(along - face.length / 2, -FAR, FAR)),
        "slant": abs(float(face.along @ away)) / distance,
        "bearing": float(np.degrees(np.arctan2(along, across))),
    }


def _around(sight: Sight, members: np.ndarray, apart: np.ndarray) -> int:
    """New points beside the members (n,) of a candidate: furniture is seldom one face alone."""
    others = np.setdiff1d(np.flatnonzero(apart > ONTO), members, assume_unique=True)
    places = sight.points[members, :2]
    low, high = places.min(axis=0) - AROUND, places.max(axis=0) + AROUND
    near = others[((sight.points[others, :2] >= low) & (sight.points[others, :2] <= high)).all(axis=1)]
    return int(np.sum(cKDTree(places).query(sight.points[near, :2], distance_upper_bound=AROUND)[0] < AROUND))


def _logit(probability: np.ndarray) -> float:
    return float(logit(np.clip(np.mean(probability), 0.003, 0.997)))
