"""Candidates: pieces that belong together, of one object or of none.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxmm.learning.upright_shapes import face_through
from jaxmm.objects.patches import Sight
from jaxmm.objects.pieces import Piece
from jaxmm.objects.wall_joining import is_hidden
from jaxmm.objects.walls import WallSettings, is_back, reach


@dataclasses.dataclass(frozen=True)
class CandidateSettings(WallSettings):
    """How pieces become candidates. Lengths in metres."""

    wall_length: float = 1.4  # a face from this length on takes up all faces within a wall's thickness of it
    least_host: float = 0.3  # a face from this length on takes up what may be the far end of its wall
    far_shaft: float = 0.3  # most diameter of a shaft that may be such an end, two of whose sides passed for one


class Candidate(NamedTuple):
    """Pieces that are of one object, or of none."""

    pieces: tuple[Piece, ...]  # the one with most points first, a long face before all
    members: np.ndarray  # (n,) int of their points, in order

    @property
    def first(self) -> Piece:
        """The piece that shows most."""
        return self.pieces[0]

    @property
    def crossing(self) -> Piece | None:
        """A face across the first one, which tells how deep the object is at least."""
        across = (piece for piece in self.pieces[1:] if abs(piece.face.along @ self.first.face.along) < CROSSING)
        return next((piece for piece in across if piece.face.length > LEAST_SIDE), None)


CROSSING = 0.5  # most cosine of the angle between two faces that meet at a corner
LEAST_SIDE = 0.08  # [m] of a face; less is noise


def candidates_of(sight: Sight, pieces: list[Piece], settings: CandidateSettings) -> list[Candidate]:
    """Shafts, long faces with all that is within a wall's thickness of them, and groups of faces that meet.

    Args:
        sight: of all points.
        pieces: of changed points, the largest first.
        settings: what belongs together.
    """
    shafts = [[piece] for piece in pieces if piece.circle is not None]
    faces = [piece for piece in pieces if piece.face is not None]
    walls: list[list[Piece]] = []
    loose: list[Piece] = []
    for piece in faces:
        parts = next((group for group in walls if _is_of_wall(group[0], piece, settings)), None)
        if parts is not None:
            parts.append(piece)
        elif piece.face.length >= settings.wall_length:
            walls.append([piece])
        else:
            loose.append(piece)
    # A short end may come before its wall, where it has more points.
    waiting, loose = loose, []
    for piece in waiting:
        parts = next((group for group in walls if _is_of_wall(group[0], piece, settings)), loose)
        parts.append(piece)
    groups = _with_far_ends(sight, walls + _grouped(loose, settings) + shafts, settings)
    return [Candidate(tuple(one), np.sort(np.concatenate([piece.members for piece in one]))) for one in groups]


def _is_of_wall(wall: Piece, piece: Piece, settings: CandidateSettings) -> bool:
    return _is_side(wall, piece, settings) or is_back(wall, piece, settings)


def _is_side(wall: Piece, piece: Piece, settings: CandidateSettings) -> bool:
    """Whether a face is an end of a wall, or its other face: within its length, and the thickness of walls."""
    offset = piece.face.ends - wall.face.center
    across, along = np.abs(offset @ wall.face.across), np.abs(offset @ wall.face.along)
    beyond = wall.face.length / 2 + settings.corner
    return bool(across.max() <= settings.most_thickness and along.max() <= beyond)


def _with_far_ends(sight: Sight, groups: list[list[Piece]], settings: CandidateSettings) -> list[list[Piece]]:
    """The groups, those that are the far end of another's face made part of it: what is between is hidden."""
    groups = sorted(groups, key=lambda group: -group[0].face.length if group[0].face is not None else 0.0)
    kept: list[list[Piece]] = []
    for group in groups:
        hosts = (one for one in kept if one[0].face is not None and one[0].face.length >= settings.least_host)
        host = next((one for one in hosts if _is_far_end(sight, one[0], group, settings)), None)
        if host is None:
            kept.append(group)
        else:
            host += [
                piece._replace(face=face_through(sight.points[:, :2], piece.members), circle=None) for piece in group
            ]
    return kept


def _is_far_end(sight: Sight, wall: Piece, group: list[Piece], settings: CandidateSettings) -> bool:
    """Whether pieces, no wider than a wall is thick, lie where a wall ends whose face goes on behind something."""
    if group[0].circle is not None and 2.0 * group[0].circle.radius > settings.far_shaft:
        return False
    offset = sight.points[np.concatenate([piece.members for piece in group]), :2] - wall.face.center
    depth, place = -(offset @ wall.toward), offset @ wall.face.along
    if (
        np.ptp(place) > settings.most_thickness
        or depth.min() < -settings.in_line
        or depth.max() > settings.most_thickness
    ):
        return False
    way = 1.0 if place.mean() > 0.0 else -1.0
    from_here, to_there = way * wall.face.length / 2, (place * way).min() * way
    if not settings.corner < (to_there - from_here) * way <= settings.hidden_gap:
        return False
    sight = sight.around(wall.members)
    if reach(sight, wall, way, settings) < settings.shown:  # one sees that the face ends before
        return False
    start, end = (wall.face.center + wall.face.along * one for one in (from_here, to_there))
    return is_hidden(sight, start, end, settings)


def _grouped(pieces: list[Piece], settings: CandidateSettings) -> list[list[Piece]]:
    """Faces that meet at corners, or are at each other's back, together; most points first."""
    groups: list[list[Piece]] = []
    for piece in pieces:
        meeting = [any(_belong(piece, other, settings) for other in group) for group in groups]
        merged = [piece, *(one for group, meets in zip(groups, meeting, strict=True) if meets for one in group)]
        groups = [group for group, meets in zip(groups, meeting, strict=True) if not meets]
        groups.append(sorted(merged, key=lambda one: -len(one.members)))
    return groups


def _belong(a: Piece, b: Piece, settings: CandidateSettings) -> bool:
    return _apart(a, b) <= settings.corner or is_back(a, b, settings)


def _apart(a: Piece, b: Piece) -> float:
    """Least distance [m] of the ends of two faces."""
    return float(np.linalg.norm(a.face.ends[:, None] - b.face.ends, axis=2).min())
