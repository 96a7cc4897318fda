"""Solids: pieces that belong together become one wall or one pillar, with what is hidden of it made up for.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

import dataclasses

import numpy as np

from jaxmm.object_pieces import Piece
from jaxmm.object_shapes import rectangle_along, upright_along
from jaxmm.object_sight import Sight
from jaxmm.object_walls import KnownSizes, Solid, WallSettings, reach, seen_thin, wall_behind, wall_end_on


@dataclasses.dataclass(frozen=True)
class SolidSettings(WallSettings):
    """How pieces become walls and pillars. Lengths in metres."""

    wall_length: float = 1.4  # a face from this length on is a wall's
    least_column: float = 0.26  # a lone face that is narrower is the end of a wall
    slender: float = 2.5  # length over thickness of a wall that shows two sides, at least
    least_width: float = 0.15  # of a lone face that goes on unseen; less tells nothing of its shape


def solids_of(
    sight: Sight, pieces: list[Piece], score: tuple[np.ndarray, np.ndarray], settings: SolidSettings, known: KnownSizes
) -> list[Solid]:
    """Walls and pillars from pieces, most points first.

    Args:
        sight: of all points.
        pieces: of the changed ones, the largest first.
        score: P(of a changed pillar) and P(of a changed wall) of all points, (N,) each.
        settings: what tells walls from pillars.
        known: sizes that the building has already.
    """
    solids = [_shaft(piece, settings, known) for piece in pieces if piece.circle is not None]
    walls: list[tuple[Piece, list[Piece]]] = []
    loose = []
    for piece in (piece for piece in pieces if piece.face is not None):
        parts = next((others for wall, others in walls if _is_side(wall, piece, settings)), None)
        if parts is not None:
            parts.append(piece)
        elif piece.face.length >= settings.wall_length:
            walls.append((piece, []))
        else:
            loose.append(piece)
    # A short end may come before its wall, where it has more points.
    waiting, loose = loose, []
    for piece in waiting:
        parts = next((others for wall, others in walls if _is_side(wall, piece, settings)), loose)
        parts.append(piece)
    solids += [wall_behind(sight, wall, others, settings, known.walls) for wall, others in walls]
    small = [_small(sight, group, score, settings, known) for group in _grouped(loose, settings)]
    return _without_splinters(sight, solids + [solid for solid in small if solid is not None], settings)


def _shaft(piece: Piece, settings: SolidSettings, known: KnownSizes) -> Solid:
    width = 2.0 * piece.circle.radius
    fitting = [one for one, _, is_round in known.columns if is_round and abs(one - width) <= settings.fits]
    width = min(fitting, key=lambda one: abs(one - width), default=width)
    return Solid("pillar", "round", piece.circle.center, np.array([width, width]), np.array([1.0, 0.0]), piece.members)


def _is_side(wall: Piece, piece: Piece, settings: SolidSettings) -> bool:
    """Whether a face is an end of a wall, or its other face: within the thickness that walls may have."""
    offset = piece.face.ends - wall.face.center
    across, along = np.abs(offset @ wall.face.across), np.abs(offset @ wall.face.along)
    beyond = wall.face.length / 2 + settings.corner
    return bool(across.max() <= settings.most_thickness and along.max() <= beyond)


def _grouped(pieces: list[Piece], settings: SolidSettings) -> list[list[Piece]]:
    """Faces that meet at corners, together; most points first."""
    groups: list[list[Piece]] = []
    for piece in pieces:
        meeting = [any(_apart(piece, other) <= settings.corner for other in group) for group in groups]
        merged = [piece, *(one for group, meets in zip(groups, meeting, strict=True) if meets for one in group)]
        groups = [group for group, meets in zip(groups, meeting, strict=True) if not meets]
        groups.append(sorted(merged, key=lambda one: -len(one.members)))
    return groups


def _apart(a: Piece, b: Piece) -> float:
    """Least distance [m] of the ends of two faces."""
    return float(np.linalg.norm(a.face.ends[:, None] - b.face.ends, axis=2).min())


def _small(
    sight: Sight,
    group: list[Piece],
    score: tuple[np.ndarray, np.ndarray],
    settings: SolidSettings,
    known: KnownSizes,
) -> Solid | None:
    """A pillar, or a wall of which little is seen; None where too little is."""
    first = group[0]
    members = np.sort(np.concatenate([piece.members for piece in group]))
    pillar, wall = (float(one[members].mean()) for one in score)
    second = next((piece for piece in group[1:] if _crosses(first, piece)), None)
    if second is not None:
        return _corner(sight, group, (first, second), wall > pillar, settings, known)
    length = first.face.length
    shown = max(reach(sight, first, way, settings) for way in (-1.0, 1.0)) < settings.shown
    if not shown and length < settings.least_width:
        return None
    thin = seen_thin(sight, first, settings)
    if log_odds_of_wall(length, (pillar, wall), (shown, thin), settings) > 0.0:
        narrow = length < settings.least_column
        return wall_end_on(first, settings) if narrow else wall_behind(sight, first, group[1:], settings, known.walls)
    if (outline := _angled(sight.points[members, :2], first, settings)) is not None:
        center, edges, along = outline
        return Solid("pillar", "rectangular", center, _fitting(edges, settings, known), along, members)
    edges = np.array([length, _depth(length, settings, known)])
    center = first.face.center - first.toward * edges[1] / 2
    return Solid("pillar", "rectangular", center, edges, first.face.along, members)


def log_odds_of_wall(
    length: float, score: tuple[float, float], told: tuple[bool, bool], settings: SolidSettings
) -> float:
    """Log odds that a lone face is a wall's, not a pillar's: a logistic regression on faces of validation rooms.

    Args:
        length: of the face [m].
        score: mean P(pillar) and P(wall) of its points.
        told: whether both its ends are seen, and whether what is behind it is seen to be thin.
        settings: what is narrow.
    """
    pillar, wall = (float(np.clip(one, 0.003, 0.997)) for one in score)
    models = float(np.clip(np.log(wall / (1 - wall)) - np.log(pillar / (1 - pillar)), -5.0, 5.0))
    shown, thin = told
    if length < settings.least_column:  # the end of a wall looks like a pillar to any model
        return 1.2 + 0.3 * models + 1.8 * shown
    return -1.3 + 0.5 * models + 1.6 * length - 1.6 * (shown and not thin) + 1.4 * thin


def _angled(places: np.ndarray, first: Piece, settings: SolidSettings) -> tuple[np.ndarray, ...] | None:
    """Centre (2,), edges (2,) [m] and direction (2,) of two short sides of a rectangle that passed for one face."""
    off_face = (places - first.face.center) @ first.face.across
    along = upright_along(places)
    center, edges = rectangle_along(places, along)
    inner = edges / 2 - np.abs((places - center) @ np.stack([along, [-along[1], along[0]]]).T)
    smeared, outlined = (float(np.sqrt(np.mean(off**2))) for off in (off_face, inner.min(axis=1)))
    if edges.min() < settings.least_width or smeared < settings.tolerance or outlined > 0.5 * smeared:
        return None
    return center, edges, along


def _crosses(a: Piece, b: Piece) -> bool:
    return bool(abs(a.face.along @ b.face.along) < 0.5 and b.face.length > 0.08)


def _corner(
    sight: Sight,
    group: list[Piece],
    faces: tuple[Piece, Piece],
    rather_wall: bool,
    settings: SolidSettings,
    known: KnownSizes,
) -> Solid:
    """A pillar or a wall from two faces that meet."""
    first = faces[0]
    thin, side = sorted(faces, key=lambda piece: piece.face.length)
    slender = side.face.length >= settings.slender * thin.face.length
    if slender and (seen_thin(sight, side, settings) or (thin.face.length <= 0.2 and rather_wall)):
        return wall_behind(sight, side, [piece for piece in group if piece is not side], settings, known.walls)
    hidden, open_side = (
        max(reach(sight, piece, way, settings) for way in (-1.0, 1.0)) >= settings.shown for piece in (thin, side)
    )
    if side.face.length < settings.least_column and hidden and not open_side:
        return wall_end_on(side, settings)
    members = np.sort(np.concatenate([piece.members for piece in group]))
    along = upright_along(sight.points[members, :2])
    center, edges = rectangle_along(sight.points[members, :2], along)
    if hidden and not open_side:
        # The rest of the hidden side, away from the sensor.
        axes = np.stack([along, [-along[1], along[0]]])
        grown = np.array([_depth(edges.max(), settings, known) if edge < edges.max() else edge for edge in edges])
        grown = np.maximum(grown - edges, 0.0)
        center = center + (np.sign(axes @ (center - first.origin[:2])) * grown / 2) @ axes
        edges = edges + grown
    return Solid("pillar", "rectangular", center, _fitting(edges, settings, known), along, members)


def _depth(width: float, settings: SolidSettings, known: KnownSizes) -> float:
    """Depth [m] of a pillar of which one face is seen: square, unless its building has a column with such a face."""
    sections = [(a, b) for a, b, is_round in known.columns if not is_round]
    sections += [(b, a) for a, b in sections]
    fitting = [section for section in sections if abs(section[0] - width) <= settings.fits]
    return min(fitting, key=lambda section: abs(section[0] - width), default=(width, width))[1]


def _fitting(edges: np.ndarray, settings: SolidSettings, known: KnownSizes) -> np.ndarray:
    """The edges (2,) [m], or those of a known column that they fit."""
    sections = [np.array(turned) for a, b, is_round in known.columns if not is_round for turned in ((a, b), (b, a))]
    fitting = [section for section in sections if np.abs(section - edges).max() <= settings.fits]
    return min(fitting, key=lambda section: np.abs(section - edges).max(), default=edges)


def _without_splinters(sight: Sight, solids: list[Solid], settings: SolidSettings) -> list[Solid]:
    """The solids but for those most of whose points lie in or right beside one with more points."""
    kept: list[Solid] = []
    for solid in sorted(solids, key=lambda one: -len(one.members)):
        places = sight.points[solid.members, :2]
        if not any(np.mean(_off(places, other) <= settings.corner) > 0.5 for other in kept):
            kept.append(solid)
    return kept


def _off(places: np.ndarray, solid: Solid) -> np.ndarray:
    """How far (n,) [m] places are outside of a solid, along the axis on which they are furthest; < 0 inside."""
    axes = np.stack([solid.along, [-solid.along[1], solid.along[0]]])
    return (np.abs((places - solid.center) @ axes.T) - solid.edges / 2).max(axis=1)
