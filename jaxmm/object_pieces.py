"""Pieces of objects: clusters of probable points become upright faces and round shafts, pieces of one wall one piece.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from sklearn.cluster import DBSCAN

from jaxmm.object_shafts import shaft_of
from jaxmm.object_shapes import Circle, Face, circle_through, face_along, face_through, faces_of
from jaxmm.object_sight import Crossings, Patch, Sight, crossings, upright_patch


@dataclasses.dataclass(frozen=True)
class PieceSettings:
    """How probable points become pieces. Lengths in metres."""

    link: float = 0.35  # points closer than this, heights halved, are of one cluster
    neighbours: int = 4  # that a point within a cluster has, itself included
    least_points: int = 10  # of a piece
    least_height: float = 0.25  # from the lowest to the highest point of a piece
    furniture_height: float = 2.25  # what is seen no higher above the floor may be furniture; nothing higher is
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
    face: Face | None  # a straight run; its members are the piece's
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
    """Faces and round shafts among the chosen points, cluster by cluster.

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


def upright(sight: Sight, pieces: list[Piece], settings: PieceSettings) -> list[Piece]:
    """The pieces that are no furniture: nobody looks past them above or below, or they are higher than furniture is.

    What stands right beside a piece that does not, and is no higher, is another side of the same thing. What is below
    an opening and what is above it, in one plane, are as high as both together.
    """
    pieces = [_trimmed(sight, piece, settings) for piece in pieces]
    fits = [_may_be_upright(sight, piece, settings) for piece in pieces]
    fits = [
        fit or any(_is_around_opening(sight, piece, other, settings) for other in pieces)
        for piece, fit in zip(pieces, fits, strict=True)
    ]
    low = [piece for piece, fit in zip(pieces, fits, strict=True) if not fit]
    passed = [piece for piece, fit in zip(pieces, fits, strict=True) if fit]
    return [piece for piece in passed if not any(_is_side_of(sight, piece, other, settings) for other in low)]


def joined(sight: Sight, pieces: list[Piece], settings: PieceSettings) -> list[Piece]:
    """The pieces, those in one line made one where the gap between them is not seen to be free; most points first."""
    pieces = sorted(pieces, key=lambda piece: -len(piece.members))
    first = 0
    while first < len(pieces):
        for second in range(first + 1, len(pieces)):
            if _is_one(sight, pieces[first], pieces[second], settings):
                pieces[first] = _merged(sight, pieces[first], pieces.pop(second), settings)
                break  # the grown face may now reach one that it did not
        else:
            first += 1
    return pieces


def _clusters(sight: Sight, chosen: np.ndarray, settings: PieceSettings) -> list[np.ndarray]:
    if len(chosen) == 0:
        return []
    # What hides a strip of an upright thing leaves a gap of its height, so heights count half.
    places = sight.points[chosen] * [1.0, 1.0, 0.5]
    order = np.lexsort(places.T)  # a point on the edge of two clusters must not go by the caller's order
    label = DBSCAN(eps=settings.link, min_samples=settings.neighbours).fit_predict(places[order])
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
        away = np.linalg.norm(places - piece.circle.center, axis=1)
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
    members = shaft_of(sight, piece.members, settings.tolerance, piece.face.along)
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
    off = np.minimum(np.abs(np.linalg.norm(places - circle.center, axis=1) - circle.radius), most)
    straight = np.full(len(places), most)
    for face in faces[:3]:
        place, beside = (places - face.center) @ face.along, (places - face.center) @ face.across
        straight = np.minimum(straight, np.hypot(beside, np.maximum(np.abs(place) - face.length / 2, 0.0)))
    return circle if np.sum(off**2) < 0.6 * np.sum(straight**2) and circle.on.mean() > 0.6 else None


def _trimmed(sight: Sight, piece: Piece, settings: PieceSettings) -> Piece:
    """A face without what is lower at either end of it and looked over: furniture in one line with it."""
    if piece.face is None:
        return piece
    sight = sight.around(piece.members)
    for way in (-1.0, 1.0):
        place = (sight.points[piece.members, :2] - piece.face.center) @ piece.face.along * way
        z = sight.points[piece.members, 2]
        edge = float(place[z >= z.max() - settings.lower].max())  # beyond it all is lower
        beyond = place > edge
        if beyond.sum() < settings.neighbours or (~beyond).sum() < settings.least_points:
            continue
        start, end = (piece.face.center + way * one * piece.face.along for one in (edge, place.max()))
        patch = Patch(start, end, float(z[beyond].max()) + settings.rim, sight.ceiling - settings.rim)
        if crossings(sight, patch, settings.tolerance).free > settings.free:
            members = piece.members[~beyond]
            piece = piece._replace(members=members, face=face_through(sight.points[:, :2], members))
    return piece


def _may_be_upright(sight: Sight, piece: Piece, settings: PieceSettings) -> bool:
    z = sight.points[piece.members, 2]
    low, high = float(z.min()), float(z.max())
    start, end, sight = *front_of(piece), sight.around(piece.members)

    def free(bottom: float, top: float) -> bool:
        patch = Patch(start, end, bottom + settings.rim, top - settings.rim)
        return crossings(sight, patch, settings.tolerance).free > settings.free

    below, above = (sight.floor, low), (high, sight.ceiling)
    if high - low >= settings.furniture_height:  # a lorry is as high as a wall, but stands on wheels
        return not all(top - bottom > settings.clearance and free(bottom, top) for bottom, top in (below, above))
    if high - low < settings.least_height:
        return False
    gaps = (below, above) if high - sight.floor < settings.tallest else (below,)
    return not any(top - bottom > settings.least_gap and free(bottom, top) for bottom, top in gaps)


def _is_around_opening(sight: Sight, piece: Piece, other: Piece, settings: PieceSettings) -> bool:
    """Whether two faces lie in one plane, one above the other, and are higher than furniture together."""
    if piece is other or piece.face is None or other.face is None or not _is_in_line(piece, other, settings):
        return False
    (low, high), (bottom, top) = (
        (sight.points[one.members, 2].min(), sight.points[one.members, 2].max()) for one in (piece, other)
    )
    if not (high < bottom or top < low) or max(high, top) - min(low, bottom) < settings.furniture_height:
        return False
    place = np.sort((other.face.ends - piece.face.center) @ piece.face.along)
    half = piece.face.length / 2
    return bool(min(place[1], half) - max(place[0], -half) > min(other.face.length, piece.face.length) / 2)


def _is_side_of(sight: Sight, piece: Piece, other: Piece, settings: PieceSettings) -> bool:
    if piece.cluster != other.cluster or len(other.members) < len(piece.members) / 4:
        return False
    points, others = sight.points[piece.members], sight.points[other.members]
    if points[:, 2].max() > others[:, 2].max() + settings.step_up:
        return False
    return bool(cKDTree(others[:, :2]).query(points[:, :2])[0].min() <= settings.beside)


def front_of(piece: Piece) -> tuple[np.ndarray, np.ndarray]:
    """Both ends (2,) of what one sees of a piece, drawn in a little: rays past its edges tell nothing."""
    if piece.face is not None:
        start, end = piece.face.ends
        return start + 0.15 * (end - start), end - 0.15 * (end - start)
    away = piece.circle.center - piece.origin[:2]
    side = np.array([-away[1], away[0]]) / max(float(np.linalg.norm(away)), 1e-6) * piece.circle.radius * 0.7
    return piece.circle.center - side, piece.circle.center + side


def _is_one(sight: Sight, a: Piece, b: Piece, settings: PieceSettings) -> bool:
    """Whether two pieces are of one wall; a face and the one at its back are not one face."""
    if a.face is None or b.face is None or not _is_in_line(a, b, settings):
        return False
    ends = b.face.ends - a.face.center
    (low, high), half = np.sort(ends @ a.face.along), a.face.length / 2
    between = (half, low) if low > half else (high, -half)
    gap = between[1] - between[0]
    if gap <= settings.link or gap > settings.hidden_gap:
        return bool(gap <= settings.link)
    start, end = (a.face.center + a.face.along * place for place in between)
    sight = sight.around(a.members)
    if gap <= settings.run_gap:
        return bool(between_of(sight, start, end, settings).free <= settings.free)
    return is_hidden(sight, start, end, settings)


def _is_in_line(a: Piece, b: Piece, settings: PieceSettings) -> bool:
    """Whether one face lies in the plane of the other, turned to the same side."""
    across = np.abs((b.face.ends - a.face.center) @ a.face.across).max()
    turned = a.toward @ b.toward < np.cos(np.radians(settings.turn))
    return bool(not turned and across <= settings.in_line + 0.02 * b.face.length)


def is_hidden(sight: Sight, start: np.ndarray, end: np.ndarray, settings: PieceSettings) -> bool:
    """Whether something hides the gap between two places (2,) [m], and nobody looks through it."""
    crossed = between_of(sight, start, end, settings)
    return crossed.before > 0 and crossed.free < 0.1


def between_of(sight: Sight, start: np.ndarray, end: np.ndarray, settings: PieceSettings) -> Crossings:
    """What rays do that head for the gap between two places (2,) [m], from floor to ceiling."""
    inset = 0.1 * (end - start)
    patch = upright_patch(sight, start + inset, end - inset, settings.rim)
    return crossings(sight, patch, settings.tolerance)


def _merged(sight: Sight, a: Piece, b: Piece, settings: PieceSettings) -> Piece:
    """Two pieces of one wall as one. Where one is set back, as a window's pane is, the wall's face is the other."""
    places, members = sight.points[:, :2], np.sort(np.concatenate([a.members, b.members]))
    front, back = (a, b) if (b.face.center - a.face.center) @ a.toward < 0.0 else (b, a)
    if np.abs((b.face.ends - a.face.center) @ a.face.across).max() <= settings.tolerance:
        off = np.abs((places[members] - a.face.center) @ a.face.across)
        line = face_through(places, members[off <= 2.0 * settings.tolerance])  # what is set back is farther off
    else:
        # A radiator or a board before a wall ends lower than that.
        top, others = (sight.points[one.members, 2].max() for one in (front, back))
        own = back if top < others - settings.lower else front
        longer = max(a.face, b.face, key=lambda face: face.length)
        line = own.face._replace(along=longer.along)
    return a._replace(members=members, face=face_along(places, members, line))
