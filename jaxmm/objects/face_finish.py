"""What all rays of a scan show of where a face finishes, strip by strip along its line.

The points that objects are fitted to are thinned to one a voxel of 0.1 m. Whether a face ends, goes on around a corner
or is hidden shows in strips of a few centimetres, of which every ray tells. M rays of one scan. World frame: metres,
z up. Plan: x and y. Lengths and limits were chosen on rooms of the training.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.objects.pieces import Piece

STRIP = 0.04  # [m] along the face: about two rays of a camera of 320 x 200 at 5 m
INSIDE, STRIPS = 0.4, 50  # from so far [m] short of where the thinned points end, so many strips
ON = 0.12  # [m] past the line: a strip whose middle ray ends no farther is on the face
BEFORE = 0.05  # [m] before the line, beyond which a ray ends on something else
HIDDEN = 0.7  # share of the rays of a strip that end before the line or nowhere, from which on it tells nothing
ENDED = 2  # strips past the line, with which a face has ended: one may be a stray
BACK, FORTH = 0.14, 0.1  # [m] from strip to strip, by which one surface goes on
PATIENCE = 3  # strips without a ray, with which a surface has ended
NEXT = 6  # strips, of which one tells what comes next
SEEN_AT = (0.05, 0.95)  # quantiles of the heights of a thing, between which rays are asked: its rims are no part of it
FAR = 3.0  # [m] that a face may go on, or a thing be deep; more tells no more
NOTHING = -1.0  # a length or a share that no ray tells


class Rays(NamedTuple):
    """Rays from one place or several."""

    origin: np.ndarray  # (3,) [m], or (M, 3)
    direction: np.ndarray  # (M, 3) of any length
    distance: np.ndarray  # (M,) in lengths of the direction; inf where nothing came back


class Crossed(NamedTuple):
    """Where rays meet the upright plane of a face, or would."""

    place: np.ndarray  # (M,) [m] along the face, from its centre
    past: np.ndarray  # (M,) [m] past the plane that they end, FAR at most; inf where nothing came back


class Finish(NamedTuple):
    """Where a face finishes at one end, and what is seen on from there."""

    shift: float  # [m] that it ends beyond its thinned points, -0.4 to 1.6; 0 where no ray ends on it
    side: float  # [m] past its line, to which one goes on seeing the same surface
    jump: float  # [m] from there back to what comes next, 0 where that is nearer; NOTHING where nothing comes
    before: float  # share of the next rays that end before its line; NOTHING without one
    missing: float  # share of them of which nothing came back, though one looked there


class _Strips(NamedTuple):
    """What rays tell, STRIP by STRIP on along a face."""

    rays: np.ndarray  # (STRIPS,) int
    before: np.ndarray  # (STRIPS,) int of them that end before the line
    missing: np.ndarray  # (STRIPS,) int of them of which nothing came back
    past: np.ndarray  # (STRIPS,) [m] past the line that the middle one of the others ends; NaN without one


def crossed_by(rays: Rays, piece: Piece, z: np.ndarray) -> Crossed:
    """The rays that cross the plane of a face from its front, no farther from its ends than strips reach.

    Args:
        rays: of one scan.
        piece: with the face.
        z: (n,) [m] heights of the points of the thing.
    """
    face = piece.face
    heads = _heading(rays, piece)
    origin = np.broadcast_to(rays.origin, rays.direction.shape)[heads].astype(np.float64)
    direction, distance = rays.direction[heads].astype(np.float64), rays.distance[heads].astype(np.float64)
    offset, closing = origin[:, :2] - face.center, -(direction[:, :2] @ piece.toward)
    meets = (offset @ piece.toward) / closing
    height, (low, high) = origin[:, 2] + meets * direction[:, 2], np.quantile(z, SEEN_AT)
    crosses = (meets > 0.0) & (height >= low) & (height <= high)
    place = (offset + meets[:, None] * direction[:, :2])[crosses] @ face.along
    past = ((distance - meets) * closing)[crosses]
    return Crossed(place, np.where(np.isinf(past), past, np.minimum(past, FAR)))


def finish_of(crossed: Crossed, length: float, way: float) -> Finish:
    """The finish of a face at one of its ends.

    Args:
        crossed: of the rays that are asked.
        length: [m] of the face.
        way: -1 or 1, which end.
    """
    strips = _strips(crossed, length / 2 - INSIDE, way)
    end = _end_of(strips, length)
    side, last, stop = _followed(strips, end)
    after, near = strips.past[stop : stop + NEXT], slice(end, end + NEXT)
    after, rays = after[np.isfinite(after)], int(strips.rays[near].sum())
    return Finish(
        end * STRIP - INSIDE,
        side,
        max(float(np.median(after)) - last, 0.0) if len(after) else NOTHING,
        float(strips.before[near].sum() / rays) if rays else NOTHING,
        float(strips.missing[near].sum() / rays) if rays else NOTHING,
    )


def _heading(rays: Rays, piece: Piece) -> np.ndarray:
    """The rays (m,) int that head for the line of a face, no farther from its ends than strips reach."""
    face, most = piece.face, piece.face.length / 2 + STRIP * STRIPS - INSIDE
    offset = rays.origin[..., :2] - face.center
    along, closing = (rays.direction[:, :2] @ np.stack([face.along, -piece.toward], axis=1)).T
    # Where they meet the line, times how fast they come closer: of the many that never do, that is no division by 0.
    place = (offset @ face.along) * closing + (offset @ piece.toward) * along
    return np.flatnonzero((closing > 0.0) & (np.abs(place) <= most * closing))


def _strips(crossed: Crossed, start: float, way: float) -> _Strips:
    number = np.floor((way * crossed.place - start) / STRIP).astype(int)
    within = (number >= 0) & (number < STRIPS)
    number, past = number[within], crossed.past[within]
    kinds = np.where(past < -BEFORE, 0, np.where(np.isposinf(past), 1, 2))
    before, missing, others = (np.bincount(number[kinds == kind], minlength=STRIPS) for kind in range(3))
    behind, at = past[kinds == 2], number[kinds == 2]
    behind, starts = behind[np.lexsort((behind, at))], np.cumsum(others) - others
    middle = np.full(STRIPS, np.nan)
    middle[others > 0] = behind[(starts + (others - 1) // 2)[others > 0]]
    return _Strips(before + missing + others, before, missing, middle)


def _end_of(strips: _Strips, length: float) -> int:
    """The strip after the last one on the face; of a short face from its middle on, as the first may be beyond it."""
    tells = strips.before + strips.missing < HIDDEN * strips.rays
    on, behind = tells & (strips.past <= ON), tells & (strips.past > ON)
    end, ended = round(INSIDE / STRIP), 0
    for number in range(max(int(np.ceil((INSIDE - length / 2) / STRIP)), 0), STRIPS):
        if on[number]:
            end, ended = number + 1, 0
        elif behind[number]:
            ended += 1
            if ended == ENDED:
                break
    return end


def _followed(strips: _Strips, end: int) -> tuple[float, float, int]:
    """The surface from the end of a face on: how far past its line it comes and stops [m], and at which strip."""
    last = float(strips.past[end - 1]) if end else np.nan
    deepest = last = max(last, 0.0) if last <= ON else 0.0
    empty = 0
    for number in range(end, STRIPS):
        past = float(strips.past[number])
        if np.isnan(past):
            empty += 1
            if empty == PATIENCE:
                return deepest, last, number + 1
        elif past < FAR and -FORTH <= past - last <= BACK * (empty + 1):
            deepest, last, empty = max(deepest, past), past, 0
        else:
            return deepest, last, number
    return deepest, last, STRIPS
