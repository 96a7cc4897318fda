"""Pieces of one wall become one: faces in one line, where the gap between them is not seen to be free.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

import numpy as np

from jaxmm.learning.upright_shapes import face_along, face_through
from jaxmm.objects.patches import Crossings, Sight, crossings, upright_patch
from jaxmm.objects.pieces import Piece, PieceSettings

REACHES, SHOWS = 0.55, 0.2  # shares of a wall's length and of its points, that are of its face
UNEVEN = 1.5  # times the deviations of its parts from their lines: less is one line, from which errors turn them
HIGHEST = 0.98  # quantile of heights that stands for the top, as errors move the last


def joined(sight: Sight, pieces: list[Piece], settings: PieceSettings) -> list[Piece]:
    """The pieces, those in one line made one where the gap between them is not seen to be free; most points first."""
    pieces = sorted(pieces, key=lambda piece: -len(piece.members))
    parts = [[piece] for piece in pieces]
    first = 0
    while first < len(pieces):
        for second in range(first + 1, len(pieces)):
            if _is_one(sight, pieces[first], pieces[second], settings):
                whole = _merged(sight, pieces[first], pieces.pop(second))
                parts[first] += parts.pop(second)
                pieces[first] = _fronted(sight, whole, parts[first], settings)
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


def _merged(sight: Sight, a: Piece, b: Piece) -> Piece:
    members = np.sort(np.concatenate([a.members, b.members]))
    return a._replace(members=members, face=face_through(sight.points[:, :2], members))


def _fronted(sight: Sight, piece: Piece, parts: list[Piece], settings: PieceSettings) -> Piece:
    """A piece of several parts, on the line of those in front where others are set back, as a window's panes are.

    The wall reaches along most of it, and shows much of it: a pilaster does not. A board or a radiator before the wall
    ends lower. Where that tells nothing, the line is one through all of it.
    """
    longest = max(parts, key=lambda part: part.face.length)  # a line through all may be slanted
    depth = np.array([(part.face.center - longest.face.center) @ longest.toward for part in parts])
    places, z = sight.points[:, :2], sight.points[:, 2]
    own = np.concatenate([_off(places, part) for part in parts])
    if np.ptp(depth) <= 2.0 * settings.tolerance or _off(places, piece).std() <= UNEVEN * own.std():
        return piece
    ahead = depth >= depth.max() - settings.tolerance
    sides = [
        np.sort(np.concatenate([part.members for part, one in zip(parts, side, strict=True) if one]))
        for side in (ahead, ~ahead)
    ]
    highest = max(float(np.quantile(z[side], HIGHEST)) for side in sides)
    for side in sides:
        face = face_through(places, side)
        reaches = face.length >= REACHES * piece.face.length and len(side) >= SHOWS * len(piece.members)
        if reaches and np.quantile(z[side], HIGHEST) >= highest - settings.lower:
            return piece._replace(face=face_along(places, piece.members, face)._replace(members=side))
    return piece


def _off(places: np.ndarray, piece: Piece) -> np.ndarray:
    """(n,) [m] how far the points of a piece are off its line, to either side."""
    return (places[piece.members] - piece.face.center) @ piece.face.across
