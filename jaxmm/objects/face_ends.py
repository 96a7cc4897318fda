"""Both ends of a face: how far it may go on there, how deep the thing behind it may be, and where the view ends.

N points of one side of the scans, S scans. World frame: metres, z up. Plan: x and y.
"""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.objects.candidates import Candidate
from jaxmm.objects.face_finish import FAR, INSIDE, Crossed, Finish, Rays, crossed_by, finish_of
from jaxmm.objects.patches import Sight, crossings, crossings_along, upright_patch
from jaxmm.objects.pieces import Piece
from jaxmm.objects.view_window import View, edge_beyond
from jaxmm.objects.walls import LOOKED_THROUGH, STEP, WallSettings, reach
from jaxmm.vectors import lengths

DEEP_STEPS = 20  # of STEP each, behind a face, in which one looks for the back of a thing
BACKS = (0.2, 0.4, 0.6, 0.8, 1.0, 1.3)  # [m] behind a face, where one looks along it
SLENDER = 0.3  # [m] a lone face whose thinned points span less is as wide as all rays show
THINNED = 0.1  # [m] that thinning takes off either end of a face, at most
STRAYS = 2  # rays beyond either end that do not make a face longer
AT_END = 0.2  # [m] of an end a point is at it
HEIGHTS = (0.1, 0.3, 0.5, 0.7, 0.9)  # quantiles of all points of a thing, for which the edge of the view is sought


class Look(NamedTuple):
    """One scan by itself: what another one sees of the front of a thing says nothing of its back."""

    sight: Sight  # of its points
    view: View | None  # None where nobody knows the edges
    rays: Callable[[], Rays]  # all that it has, where they are known; else those to its points


class End(NamedTuple):
    """One end of a face."""

    goes_on: float  # [m] most that the face may go on unseen; FAR at most
    deep: float  # [m] behind the face, beside this end, where some scan first looks through; FAR where none does
    in_view: float  # [m] to the edge of the view, on in the line of the face; FAR at most
    apart: float  # [m] least distance of its points to the surface of the other side; 1 at most
    finish: Finish  # as all rays show it


def ends_of(
    sight: Sight,
    looks: Sequence[Look],
    piece: Piece,
    members: np.ndarray,
    apart: np.ndarray,
    settings: WallSettings,
) -> tuple[End, End]:
    """The end of a face that is nearer to where it was seen from, and the other one.

    Which comes first where it is seen from right before its middle, nobody can say.

    Args:
        sight: of all points.
        looks: (S,) the same, scan by scan.
        piece: with the face.
        members: (n,) int of the points of all that the face is part of.
        apart: (N,) [m] from the surface of the other side.
        settings: how far is looked.
    """
    saw = np.unique(sight.origin[members], axis=0)
    views = [look.view for look in looks if np.any(np.all(look.sight.origin[:1] == saw, axis=1))]
    heights = np.quantile(sight.points[members, 2], HEIGHTS)
    places = sight.points[members, :2]

    @functools.cache  # both ends are mostly seen from one place, and its rays are many
    def crossed_from(place: tuple[float, ...]) -> Crossed:
        return _crossed(looks, place, piece, sight.points[members, 2])

    def end_at(way: float) -> End:
        end, toward = piece.face.ends[0 if way < 0 else 1], way * piece.face.along
        at_end = members[lengths(places - end) < AT_END]
        return End(
            min(reach(sight, piece, way, settings), FAR),
            min((_deep(look.sight, piece, end, settings) for look in looks), default=FAR),
            max((edge_beyond(view, end, toward, heights, FAR) for view in views), default=FAR),
            float(np.min(apart[at_end], initial=1.0)),
            finish_of(crossed_from(_asked(sight, piece, end)), piece.face.length, way),
        )

    return end_at(piece.nearer), end_at(-piece.nearer)


def back_of(looks: Sequence[Look], piece: Piece, settings: WallSettings) -> float:
    """How far [m] behind a face the rays of some scan pass along its back: what is behind it is no deeper there.

    FAR where none do.
    """
    for back in BACKS:
        start, end = piece.face.ends - back * piece.toward
        for look in looks:
            patch = upright_patch(look.sight, start, end, settings.rim)
            if crossings(look.sight, patch, settings.tolerance).free > LOOKED_THROUGH:
                return back
    return FAR


def as_all_rays_show(sight: Sight, looks: Sequence[Look], candidate: Candidate, tolerance: float) -> Candidate:
    """A lone slender face, grown to where all rays show that it ends; any other candidate as it is.

    Of a face a quarter of a metre wide thinned points may span half, and what is left tells nothing of its shape.

    Args:
        sight: of all points.
        looks: (S,) the same, scan by scan.
        candidate: of thinned points.
        tolerance: [m] from the line of a face, within which a ray that ends is on it.
    """
    first = candidate.first
    if len(candidate.pieces) > 1 or first.face is None or first.face.length >= SLENDER:
        return candidate
    z, half = sight.points[candidate.members, 2], first.face.length / 2
    crossed = _crossed(looks, _asked(sight, first, first.face.center), first, z)
    on = (np.abs(crossed.past) <= tolerance) & (np.abs(crossed.place) <= half + THINNED)
    place = np.sort(crossed.place[on])[STRAYS:-STRAYS]
    low, high = place.min(initial=-half), place.max(initial=half)
    center = first.face.center + (low + high) / 2 * first.face.along
    face = first.face._replace(center=center, length=float(high - low))
    return candidate._replace(pieces=(first._replace(face=face),))


def _asked(sight: Sight, piece: Piece, end: np.ndarray) -> tuple[float, ...]:
    """The place [m] from which most of the face at one of its ends (2,) [m] was seen, its front."""
    origin = sight.origin[piece.members]
    before = (origin[:, :2] - piece.face.center) @ piece.toward > 0.0
    near = before & (lengths(sight.points[piece.members, :2] - end) < INSIDE)
    places, many = np.unique(origin[near if near.any() else before], axis=0, return_counts=True)
    return tuple((places[np.argmax(many)] if len(places) else piece.origin).tolist())


def _crossed(looks: Sequence[Look], place: tuple[float, ...], piece: Piece, z: np.ndarray) -> Crossed:
    """Where all rays from a place [m] cross a face: several scans may be from the very same one."""
    asked = [look for look in looks if np.all(look.sight.origin == place, axis=1).any()]
    parts = [Crossed(np.zeros(0), np.zeros(0)), *(crossed_by(look.rays(), piece, z) for look in asked)]
    return Crossed(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def _deep(sight: Sight, piece: Piece, end: np.ndarray, settings: WallSettings) -> float:
    near, far = (end - steps * STEP * piece.toward for steps in (1, DEEP_STEPS + 1))
    patch = upright_patch(sight, near, far, settings.rim)
    found = crossings_along(sight, patch, settings.tolerance, DEEP_STEPS)
    return next((STEP * (number + 1) for number, one in enumerate(found) if one.free > LOOKED_THROUGH), FAR)
