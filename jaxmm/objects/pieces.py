"""Pieces of objects: clusters of probable points become upright faces and round shafts.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxmm.learning.density_clusters import density_clusters
from jaxmm.learning.upright_shapes import Circle, Face, circle_through, face_through, faces_of
from jaxmm.objects.patches import Sight
from jaxmm.objects.shafts import face_of_shaft, shaft_of
from jaxmm.vectors import lengths


@dataclasses.dataclass(frozen=True)
class PieceSettings:
    """How probable points become pieces. Lengths in metres."""

    link: float = 0.35  # points closer than this, heights halved, are of one cluster
    neighbours: int = 4  # that a point within a cluster has, itself included
    least_points: int = 10  # of a piece
    least_height: float = 0.25  # from the lowest to the highest point of a piece
    furniture_height: float = 2.25  # what is seen no higher above the floor may be furniture; what is higher is none
    tallest: float = 2.5  # furniture that one looks over; what ends higher, as under the open sky, may be a wall
    tolerance: float = 0.05  # of a point from the face or the circle that it lies on
    run_gap: float = 0.5  # most between neighbours of one face
    hidden_gap: float = 2.5  # most between faces of one wall, where nothing shows that the gap is free
    in_line: float = 0.15  # most of one face from the line of the other, if they are of one wall
    turn: float = 8.0  # [degrees] most between them
    free: float = 0.5  # share of the rays through a patch beyond which it is free
    rim: float = 0.04  # left out above and below a piece when one looks past it
    least_gap: float = 0.1  # to ceiling or floor, through which one can look
    clearance: float = 0.25  # to both, through which one looks past what is higher than furniture, and yet no wall
    beside: float = 0.2  # most between two sides of one thing
    step_up: float = 0.15  # most of one side's top above the other's
    lower: float = 0.3  # by which what stands in one line with a thing is lower, if it is none of it
    arc: float = 1.2  # [rad] least that is seen of a circle
    radius: tuple[float, float] = (0.05, 1.0)


class Piece(NamedTuple):
    """What is seen of one object, or of a part of it."""

    members: np.ndarray  # (n,) int of the points
    face: Face | None  # a straight run; its members are the piece's, but for what is set back in it
    circle: Circle | None  # or a round shaft
    cluster: int
    origin: np.ndarray  # (3,) [m] where it was seen from

    @property
    def toward(self) -> np.ndarray:
        """(2,) unit normal of the face, toward where it was seen from."""
        across = self.face.across
        return across if (self.origin[:2] - self.face.center) @ across >= 0.0 else -across

    @property
    def nearer(self) -> float:
        """-1 or 1, which end of the face is nearer to where it was seen from; of two as near, the first."""
        return 1.0 if (self.origin[:2] - self.face.center) @ self.face.along > 0.0 else -1.0


def pieces_of(sight: Sight, chosen: np.ndarray, loose: np.ndarray, settings: PieceSettings) -> list[Piece]:
    """Faces and round shafts among the chosen points, cluster by cluster; capitals and bases of columns are of none.

    Args:
        sight: of all points.
        chosen: (n,) int of the probable points.
        loose: (l,) int of others that are new too, if hardly probable: those that continue a face or a shaft are of it.
        settings: what is a face, and what is round.
    """
    pieces: list[Piece] = []
    for number, cluster in enumerate(_clusters(sight, chosen, settings)):
        members = shaft_of(sight, cluster, settings.tolerance)
        places = sight.points[members, :2]
        faces = faces_of(places, settings.tolerance, settings.run_gap, settings.least_points)
        circle = _round(places, faces, settings)
        if circle is None and _is_surrounded(places, sight.origin[members, :2]):
            faces = _faces_of_each(places, sight.origin[members], settings)
        shapes = [(members[circle.on], None, circle)] if circle is not None else []
        if circle is None:
            shapes = [(members[face.members], face._replace(members=members[face.members]), None) for face in faces]
        pieces += [Piece(*shape, number, np.median(sight.origin[shape[0]], axis=0)) for shape in shapes]
    for index in sorted(range(len(pieces)), key=lambda index: -len(pieces[index].members)):
        pieces[index], loose = _grown(sight, pieces[index], loose, settings)
    return [_narrowed(sight, piece, settings) for piece in pieces]


def _clusters(sight: Sight, chosen: np.ndarray, settings: PieceSettings) -> list[np.ndarray]:
    if len(chosen) == 0:
        return []
    # What hides a strip of an upright thing leaves a gap of its height, so heights count half.
    places = sight.points[chosen] * [1.0, 1.0, 0.5]
    order = np.lexsort(places.T)  # a point on the edge of two clusters must not go by the caller's order
    label = density_clusters(places[order], settings.link, settings.neighbours)
    clusters = [np.sort(chosen[order[label == number]]) for number in range(label.max() + 1)]
    return [members for members in clusters if len(members) >= settings.least_points]


def _is_surrounded(places: np.ndarray, origin: np.ndarray) -> bool:
    """Whether scans look at places (n, 2) from opposite sides; `origin` (n, 2) is where each was seen from."""
    away = np.unique(origin, axis=0) - places.mean(axis=0)
    return bool((away @ away.T).min() < 0.0)


def _faces_of_each(places: np.ndarray, origin: np.ndarray, settings: PieceSettings) -> list[Face]:
    """Faces among places (n, 2), of each scan alone: a line between both sides of a thin wall is of neither."""
    scans, number = np.unique(origin, axis=0, return_inverse=True)
    found = []
    for scan in range(len(scans)):
        own = np.flatnonzero(number.reshape(-1) == scan)
        faces = faces_of(places[own], settings.tolerance, settings.run_gap, settings.least_points)
        found += [face._replace(members=own[face.members]) for face in faces]
    return sorted(found, key=lambda face: -len(face.members))


def _grown(sight: Sight, piece: Piece, loose: np.ndarray, settings: PieceSettings) -> tuple[Piece, np.ndarray]:
    """The piece with the loose points that continue it, and those that are left."""
    above = sight.points[loose, 2] > sight.around(piece.members).ceiling  # it is on the next storey
    higher, loose = loose[above], loose[~above]
    if not len(loose):
        return piece, higher
    places = sight.points[loose, :2]
    if piece.circle is not None:
        away = lengths(places - piece.circle.center)
        on = np.abs(away - piece.circle.radius) <= settings.tolerance
        grown = piece._replace(members=np.sort(np.append(piece.members, loose[on])))
        return grown, np.append(loose[~on], higher)
    face = piece.face
    near = np.flatnonzero(np.abs((places - face.center) @ face.across) <= settings.tolerance)
    place, half = (places[near] - face.center) @ face.along, face.length / 2
    low, high = -_run_end(-place, half, settings.link), _run_end(place, half, settings.link)
    on = near[(place >= low) & (place <= high)]
    members = np.sort(np.append(piece.members, loose[on]))
    grown = piece._replace(members=members, face=face_through(sight.points[:, :2], members))
    return grown, np.append(np.delete(loose, on), higher)


def _narrowed(sight: Sight, piece: Piece, settings: PieceSettings) -> Piece:
    """A face of a column without what a capital, or corbels, have in its plane."""
    if piece.face is None:
        return piece
    members = face_of_shaft(sight, piece.members, piece.face.along, settings.tolerance)
    if len(members) == len(piece.members):
        return piece
    return piece._replace(members=members, face=face_through(sight.points[:, :2], members))


def _run_end(place: np.ndarray, end: float, gap: float) -> float:
    """Where a run that reaches to `end` [m] ends if places (n,) go on from there with no gap wider than `gap`."""
    steps = np.sort(np.append(end, place[place > end]))
    wide = np.flatnonzero(np.diff(steps) > gap)
    return float(steps[wide[0]] if len(wide) else steps[-1])


def _round(places: np.ndarray, faces: list[Face], settings: PieceSettings) -> Circle | None:
    """The circle of a cluster (n, 2), if it fits its points clearly better than the three best faces do."""
    if np.linalg.norm(np.ptp(places, axis=0)) > 4.0 * settings.radius[1]:
        return None
    circle = circle_through(places, settings.tolerance)
    if circle is None or circle.arc < settings.arc or not settings.radius[0] <= circle.radius <= settings.radius[1]:
        return None
    most = settings.tolerance
    off = np.minimum(np.abs(lengths(places - circle.center) - circle.radius), most)
    straight = np.full(len(places), most)
    for face in faces[:3]:
        place, beside = (places - face.center) @ face.along, (places - face.center) @ face.across
        straight = np.minimum(straight, np.hypot(beside, np.maximum(np.abs(place) - face.length / 2, 0.0)))
    return circle if np.sum(off**2) < 0.6 * np.sum(straight**2) and circle.on.mean() > 0.6 else None


def front_of(piece: Piece) -> tuple[np.ndarray, np.ndarray]:
    """Both ends (2,) of what one sees of a piece, drawn in a little: rays past its edges tell nothing."""
    if piece.face is not None:
        start, end = piece.face.ends
        return start + 0.15 * (end - start), end - 0.15 * (end - start)
    away = piece.circle.center - piece.origin[:2]
    side = np.array([-away[1], away[0]]) / max(float(np.linalg.norm(away)), 1e-6) * piece.circle.radius * 0.7
    return piece.circle.center - side, piece.circle.center + side
