"""Which pieces are no furniture: walls and columns are high, and nobody looks past them above or below.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

import numpy as np
from scipy.spatial import cKDTree

from jaxmm.learning.upright_shapes import face_through
from jaxmm.objects.patches import Patch, Sight, crossings
from jaxmm.objects.pieces import Piece, PieceSettings, front_of
from jaxmm.objects.wall_joining import is_in_line


def upright(sight: Sight, pieces: list[Piece], settings: PieceSettings) -> list[Piece]:
    """The pieces that are no furniture: nobody looks past them above or below.

    Of what is higher than furniture nobody looks past both. What stands right beside a piece that is furniture, and is
    no higher, is another side of the same thing. What is below an opening and what is above it, in one plane, are as
    high as both together.
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
    if piece is other or piece.face is None or other.face is None or not is_in_line(piece, other, settings):
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
