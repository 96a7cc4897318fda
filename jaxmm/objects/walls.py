"""Walls behind the faces that are seen of them: how thick, and how far they go on where something hides it.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxmm.learning.upright_shapes import Face
from jaxmm.objects.main_directions import Uprights, way_to_surface
from jaxmm.objects.patches import LEAST_RAYS, Crossings, Sight, crossings, crossings_along, upright_patch
from jaxmm.objects.pieces import Piece, PieceSettings
from jaxmm.objects.usual_sizes import OwnElements


class KnownBuilding(NamedTuple):
    """What is usual in the building, as its prior says."""

    walls: tuple[float, ...] = ()  # the different thicknesses [m] of its walls
    usual_wall: float = 0.0  # [m] half of the length of its walls is no thicker, or of its inner ones; 0: nobody knows
    columns: tuple[tuple[float, float, bool], ...] = ()  # width and depth [m], and whether it is round
    short_walls: tuple[tuple[float, float], ...] = ()  # thickness and length [m] of those that may pass for pillars
    uprights: Uprights | None = None  # its upright surface: the directions that it stands along, and where walls end
    own: OwnElements | None = None  # each of its walls and columns
    gone: np.ndarray | None = None  # (E,) bool elements of it at which no wall ends, as they are not there; None: none


@dataclasses.dataclass(frozen=True)
class WallSettings(PieceSettings):
    """How faces become walls. Lengths in metres."""

    thickness: float = 0.15  # of a wall of which one face is seen, in a building whose walls nobody knows
    least_thickness: float = 0.08  # that an end or a second face shows; less is noise
    most_thickness: float = 0.42
    usual_length: float = 2.0  # to which a wall is made up where it may go on unseen
    hidden_end: float = 3.0  # beyond the end of a face, as far as it is looked for
    around_sensor: float = 0.6  # a face ends that comes this near to a sensor, half as near beside its line
    shown: float = 0.2  # a face ends where one sees, within this, that it does not go on
    fits: float = 0.06  # of a size from a known one, to be that
    corner: float = 0.25  # most between what meets


class Solid(NamedTuple):
    """One wall or pillar in plan."""

    object_type: str  # "pillar" | "wall"
    shape: str  # "rectangular" | "round"
    center: np.ndarray  # (2,) [m]
    edges: np.ndarray  # (2,) [m] along the own axes
    along: np.ndarray  # (2,) unit vector: the first of those
    members: np.ndarray  # (n,) int of the points
    measured: tuple[bool, bool] = (True, True)  # of the edges, whether they are seen from end to end, not assumed
    probability: float = 1.0  # that it is real
    type_probability: float = 1.0  # that it is of its type, if it is real


class Continuation(NamedTuple):
    """What may be of a wall beyond one end of its face."""

    reach: float  # [m] how much further it may go on; inf where one does not see it end
    hidden: bool  # whether one sees it end, and something hides all of the way there
    covered: bool = False  # whether something nearer hides what is right beyond the end


STEP = 0.1  # [m] in which the line of a face is followed beyond its end
LOOKED_THROUGH = 0.3  # share of the rays that pass, from which on nothing is there
ALONE = 2  # points or fewer far behind the others tell nothing of the thickness of a wall
NEXT_TO, HIDDEN = 2, 0.7  # steps beyond an end, and share of their rays that end before them, which covers them


def wall_behind(sight: Sight, wall: Piece, others: list[Piece], settings: WallSettings, known: KnownBuilding) -> Solid:
    """A wall behind its visible face.

    Args:
        sight: of all points.
        wall: the face.
        others: its ends and its other face, which tell how thick it is.
        settings: what is assumed of it.
        known: the building's own walls, of whose thickness it is where that fits, and all that a wall can end at.
    """
    face = wall.face
    members = np.sort(np.concatenate([wall.members, *(piece.members for piece in others)]))
    offset = sight.points[members, :2] - face.center
    depth = -(offset @ wall.toward)
    # A single column of points on a slanting end may be anywhere on it.
    shows = [piece for piece in others if piece.face.length >= settings.tolerance]
    seen = _reached(depth[depth <= settings.most_thickness], 2.0 * settings.tolerance) if shows else 0.0
    is_seen = seen >= settings.least_thickness
    thickness = _fitting(seen, settings, known.walls) if is_seen else _unseen(sight, wall, settings, known)
    to_its_back = is_seen and any(
        is_back(wall, piece, settings) or ends_in_view(sight, piece, settings) for piece in shows
    )
    # A pillar before the wall, say, is none of its length.
    place = (offset @ face.along)[np.abs(depth) <= settings.most_thickness]
    low, high = float(place.min()), float(place.max())
    sides = [wall, *(piece for piece in others if is_back(wall, piece, settings))]
    middle = face.center - wall.toward * thickness / 2
    ends = []
    for way, last in ((-1.0, low), (1.0, high)):
        on = middle + (last - way * settings.tolerance) * face.along  # its end may be measured a little too far on
        room = max(_room(sight, on, way * face.along, known) - settings.tolerance, 0.0)
        seen_to = _continuation(sight, *_farthest(sides, face, way), settings)
        ends.append(seen_to._replace(reach=min(seen_to.reach, room)))
    before, after = _made_up(high - low, ends, settings)
    low, high = low - before, high + after
    whole = all(one.reach < settings.shown for one in ends)
    center = middle + face.along * (low + high) / 2
    edges = np.array([high - low, thickness])
    return Solid("wall", "rectangular", center, edges, face.along, members, (whole, to_its_back))


def _reached(depth: np.ndarray, close_to: float) -> float:
    """The largest of depths (n,) [m] that others are close to [m], if any is: what lies far behind them hangs there."""
    depth = np.sort(depth)
    close = np.flatnonzero(depth[ALONE:] - depth[:-ALONE] <= close_to)
    return float(depth[close[-1] + ALONE]) if len(close) else float(depth[-1])


def is_back(wall: Piece, piece: Piece, settings: WallSettings) -> bool:
    """Whether a face, seen by another scan, is at the back of a wall's: each may reach beyond the other."""
    if wall.toward @ piece.toward > -np.cos(np.radians(settings.turn)):
        return False
    ends = piece.face.ends - wall.face.center
    depth, place = -(ends @ wall.toward), ends @ wall.face.along
    overlaps = place.min() < wall.face.length / 2 and place.max() > -wall.face.length / 2
    return bool(overlaps and depth.min() >= settings.least_thickness and depth.max() <= settings.most_thickness)


def wall_end_on(sight: Sight, piece: Piece, settings: WallSettings, known: KnownBuilding) -> Solid:
    """A wall behind its end, which is all that is seen of it: as thick as that, and of the usual length.

    It is shorter where its building has something behind it, halfway up.
    """
    toward = piece.toward
    before = settings.tolerance  # its end may be measured a little too far on
    room = _room(sight, piece.face.center + before * toward, -toward, known) - before
    length = max(min(settings.usual_length, room), settings.least_thickness)
    edges = np.array([length, max(piece.face.length, settings.least_thickness)])
    center = piece.face.center - toward * length / 2
    whole = piece.face.length >= settings.least_thickness and ends_in_view(sight, piece, settings)
    return Solid("wall", "rectangular", center, edges, toward, piece.members, (False, whole))


def _room(sight: Sight, start: np.ndarray, along: np.ndarray, known: KnownBuilding) -> float:
    """How far [m] a wall can go on from a place (2,) on its line before it comes upon what its building has there."""
    if known.uprights is None:
        return np.inf
    return way_to_surface(known.uprights, start, along, (sight.floor + sight.ceiling) / 2, known.gone)


def ends_in_view(sight: Sight, piece: Piece, settings: WallSettings) -> bool:
    """Whether one sees that a face goes on at neither end."""
    return all(one.reach < settings.shown for one in continuations(sight, piece, settings))


def reach(sight: Sight, piece: Piece, way: float, settings: WallSettings) -> float:
    """How much further [m] a face may go on at one end (`way` -1 or 1) before one sees that it does not.

    Infinite where that is out of view, or too far away. Right before a sensor that sees it nothing goes on: a robot
    stands there.
    """
    return _continuation(sight, piece, way, settings).reach


def continuations(sight: Sight, piece: Piece, settings: WallSettings) -> tuple[Continuation, Continuation]:
    """What may be of a face beyond its first end, and beyond its second."""
    return tuple(_continuation(sight, piece, way, settings) for way in (-1.0, 1.0))


def _continuation(sight: Sight, piece: Piece, way: float, settings: WallSettings) -> Continuation:
    to_sensor = np.unique(sight.origin[piece.members, :2], axis=0) - _end(piece, way)
    ahead, beside = way * to_sensor @ piece.face.along, np.abs(to_sensor @ piece.face.across)
    if np.any((ahead > 0.0) & (ahead < settings.around_sensor) & (beside < settings.around_sensor / 2)):
        return Continuation(0.0, True)
    found = _steps_beyond(sight, piece, way, settings)
    rays, before = (sum(getattr(one, name) for one in found[:NEXT_TO]) for name in ("total", "before"))
    covered = rays >= LEAST_RAYS and before >= HIDDEN * rays
    ended = next((number for number, one in enumerate(found) if _shows_the_end(one)), None)
    if ended is None:
        return Continuation(np.inf, False, covered)
    return Continuation(ended * STEP, all(one.total for one in found[:ended]), covered)


def _farthest(sides: list[Piece], face: Face, way: float) -> tuple[Piece, float]:
    """Of the sides of a wall the one that reaches farthest along its face (`way` -1 or 1), and which end of it does."""
    ends = [(way * (_end(side, one) - face.center) @ face.along, side, one) for side in sides for one in (-1.0, 1.0)]
    _, side, one = max(ends, key=lambda end: end[0])
    return side, one


def _steps_beyond(sight: Sight, piece: Piece, way: float, settings: WallSettings) -> list[Crossings]:
    steps = round(settings.hidden_end / STEP)
    near = _end(piece, way) + way * piece.face.along * settings.tolerance
    far = near + way * piece.face.along * steps * STEP
    patch = upright_patch(sight, near, far, settings.rim)
    return crossings_along(sight, patch, settings.tolerance, steps)


def _end(piece: Piece, way: float) -> np.ndarray:
    return piece.face.ends[0 if way < 0 else 1]


def _shows_the_end(found: Crossings) -> bool:
    return found.beyond > LOOKED_THROUGH * found.total or found.on > 0.5 * found.total


def seen_thin(sight: Sight, piece: Piece, settings: WallSettings) -> bool:
    """Whether one looks through where the side of a square pillar would be, had it the face as its front."""
    face, toward = piece.face, piece.toward
    if face.length <= settings.most_thickness + 0.1:
        return False
    for end in face.ends:
        near, far = end - toward * settings.most_thickness, end - toward * face.length
        patch = upright_patch(sight, near, far, settings.rim)
        if crossings(sight, patch, settings.tolerance).free > settings.free:
            return True
    return False


def _fitting(seen: float, settings: WallSettings, known: tuple[float, ...]) -> float:
    """What is seen of a thickness [m], or the known one that it fits."""
    near = min(known, key=lambda one: abs(one - seen), default=seen)
    return near if abs(near - seen) <= settings.fits else seen


def _unseen(sight: Sight, wall: Piece, settings: WallSettings, known: KnownBuilding) -> float:
    """A thickness [m] of which nothing is seen: the usual one, or a thinner one where one looks through that.

    It is no less than elsewhere: all that a prior knows may be a thin shell.
    """
    usual = max(known.usual_wall, settings.thickness)
    thinner = {one for one in known.walls if settings.least_thickness < one < usual}
    for thickness in sorted(thinner | {usual}, reverse=True):
        if not any(_looked_through(sight, wall, end, thickness, settings) for end in wall.face.ends):
            return thickness
    return min(usual, settings.least_thickness)


def _looked_through(sight: Sight, wall: Piece, end: np.ndarray, thickness: float, settings: WallSettings) -> bool:
    """Whether rays pass at one end of a face where the back of a wall so thick would be."""
    inner = wall.face.center + 0.9 * (end - wall.face.center)  # rays past the very end tell nothing
    near, far = inner - wall.toward * thickness / 2, inner - wall.toward * thickness
    patch = upright_patch(sight, near, far, settings.rim)
    return crossings(sight, patch, settings.tolerance).free > settings.free


def _made_up(length: float, ends: list[Continuation], settings: WallSettings) -> tuple[float, float]:
    """How far [m] a wall is taken to go on beyond either end.

    Half of the way that something hides. And where it may go on, until it is as long as walls usually are.
    """
    sure = [one.reach / 2 if one.hidden else 0.0 for one in ends]
    more = [
        min(one.reach, settings.hidden_end) - grown if one.reach >= settings.shown else 0.0
        for one, grown in zip(ends, sure, strict=True)
    ]
    missing = max(settings.usual_length - length - sum(sure), 0.0)
    share = min(missing / max(sum(more), 1e-6), 1.0)
    return sure[0] + share * more[0], sure[1] + share * more[1]
