"""Pieces of one wall become one: faces in one line, where the gap between them is not seen to be free.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

import numpy as np

from jaxmm.object_pieces import Piece, PieceSettings
from jaxmm.object_shapes import face_along, face_through
from jaxmm.object_sight import Crossings, Sight, crossings, upright_patch


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


def _is_one(sight: Sight, a: Piece, b: Piece, settings: PieceSettings) -> bool:
    """Whether two pieces are of one wall; a face and the one at its back are not one face."""
    if a.face is None or b.face is None or not is_in_line(a, b, settings):
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


def is_in_line(a: Piece, b: Piece, settings: PieceSettings) -> bool:
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
