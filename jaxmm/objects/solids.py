"""From a candidate to one wall or one pillar; what is hidden of it is completed.

N points of one side of the scans. World frame: metres, z up. Plan: x and y.
"""

import dataclasses

import numpy as np

from jaxmm.learning.upright_shapes import face_through, inside_hull, outside, rectangle_along, upright_along
from jaxmm.objects.candidates import LEAST_SIDE, Candidate, CandidateSettings
from jaxmm.objects.patches import Sight
from jaxmm.objects.pieces import Piece
from jaxmm.objects.sections import SURE, Section
from jaxmm.objects.walls import KnownBuilding, Solid, continuations, ends_in_view, wall_behind, wall_end_on

OUTLINED = 0.5  # share of the points of a section with recesses that lie outermost; of a face smeared by noise fewer


@dataclasses.dataclass(frozen=True)
class SolidSettings(CandidateSettings):
    """How candidates become walls and pillars. Lengths in metres."""

    least_column: float = 0.26  # a lone face of a wall that is narrower is its end
    familiar: float = 0.8  # share of new columns, and short walls, that have the size of one of their building
    end_on: float = 100.0  # how many times seldomer a wall shows its end alone than a column looks like that
    many_walls: int = 16  # from so many on, a building seems to have no other columns than it has
    widest_column: float = 0.95  # of a lone face, in such a building, if its own are at most half as wide
    seldom_wider: float = 100.0  # how many times seldomer it gets wider ones than the rooms that the judge learnt from
    shortest_wall: float = 0.9  # but for short ones of the building; what all rays show to be shorter is a column
    seldom_shorter: float = 100.0  # how many times seldomer a wall is so short than the judge knows
    longest_column: float = 2.5  # what is longer, its diagonal included, is a wall, but for columns of the building
    section_fits: float = 0.02  # of a column's section beyond what all rays allow, to be that
    least_width: float = 0.15  # of a lone face that goes on unseen; less tells nothing of its shape


def solid_of(
    sight: Sight,
    candidate: Candidate,
    is_wall: bool,
    settings: SolidSettings,
    known: KnownBuilding,
    thinned: Candidate | None = None,
    section: Section | None = None,
) -> Solid | None:
    """The wall or pillar of which a candidate is what one sees; None where that tells nothing of its shape.

    Args:
        sight: of all points.
        candidate: of the changed ones.
        is_wall: or else a pillar.
        settings: what is assumed of what is hidden.
        known: sizes that the building has already.
        thinned: the same as its thinned points show it, by whose length a wall's side and its end are told apart; None:
            as it is.
        section: that all rays show of it, as a pillar; None where they show none.
    """
    if is_wall:
        return _wall(sight, candidate, thinned or candidate, settings, known)
    pillar = _pillar(sight, candidate, settings, known)
    return pillar if section is None or pillar is None else _with_section(pillar, section, settings, known)


def _pillar(sight: Sight, candidate: Candidate, settings: SolidSettings, known: KnownBuilding) -> Solid | None:
    """The pillar that thinned points show."""
    first = candidate.first
    if first.circle is not None:
        return _shaft(first, settings, known)
    if candidate.crossing is not None:
        return _corner(sight, candidate, settings, known)
    if first.face.length < (LEAST_SIDE if ends_in_view(sight, first, settings) else settings.least_width):
        return None
    return _front(sight, candidate, settings, known)


def without_splinters(sight: Sight, solids: list[Solid], settings: SolidSettings) -> list[Solid]:
    """The solids but for those most of whose points lie in or right beside one that comes before.

    What is likelier real than not comes first, then what has more points: noise takes nothing away from an object.
    """
    kept: list[Solid] = []
    for solid in sorted(solids, key=lambda one: (one.probability < 0.5, -len(one.members))):
        places = sight.points[solid.members, :2]
        if not any(
            np.mean(outside(places, other.center, other.edges, other.along) <= settings.corner) > 0.5 for other in kept
        ):
            kept.append(solid)
    return kept


def _wall(
    sight: Sight, candidate: Candidate, thinned: Candidate, settings: SolidSettings, known: KnownBuilding
) -> Solid | None:
    if candidate.first.circle is not None:  # the edge of a wall, whose two sides passed for a shaft
        face = face_through(sight.points[:, :2], candidate.members)
        return wall_end_on(sight, candidate.first._replace(face=face, circle=None), settings, known)
    side, shown = (max(one.pieces, key=lambda piece: piece.face.length) for one in (candidate, thinned))
    others = [piece for piece in candidate.pieces if piece is not side]
    least = settings.tolerance if ends_in_view(sight, side, settings) else settings.least_width
    if not others and side.face.length < least:
        return None
    if not any(_lies_beyond(side, piece, settings) for piece in others) and _is_end(sight, shown, settings):
        return wall_end_on(sight, side, settings, known)._replace(members=candidate.members)
    return wall_behind(sight, side, others, settings, known)


def _is_end(sight: Sight, piece: Piece, settings: SolidSettings) -> bool:
    """Whether a face is narrow enough for the end of a wall, and no part of its side."""
    if piece.face.length > max(settings.least_column, settings.most_thickness):
        return False
    unseen = [one for one in continuations(sight, piece, settings) if one.reach >= settings.shown]
    # What something hides a part of is a side: it seldom leaves just a part of an end in sight.
    return not unseen or (piece.face.length < settings.least_column and not any(one.covered for one in unseen))


def _lies_beyond(side: Piece, other: Piece, settings: SolidSettings) -> bool:
    """Whether a piece reaches further along a face than that itself: then the face is a wall's side, not its end."""
    place = (other.face.ends - side.face.center) @ side.face.along
    return bool(np.abs(place).max() > side.face.length / 2 + settings.corner)


def _shaft(piece: Piece, settings: SolidSettings, known: KnownBuilding) -> Solid:
    width = 2.0 * piece.circle.radius
    fitting = [one for one, _, is_round in known.columns if is_round and abs(one - width) <= settings.fits]
    width = min(fitting, key=lambda one: abs(one - width), default=width)
    return Solid("pillar", "round", piece.circle.center, np.array([width, width]), np.array([1.0, 0.0]), piece.members)


def _front(sight: Sight, candidate: Candidate, settings: SolidSettings, known: KnownBuilding) -> Solid:
    """A pillar of which one face is seen."""
    first, members = candidate.first, candidate.members
    if (angled := _angled(sight.points[members, :2], candidate, settings, known)) is not None:
        return angled
    length = first.face.length
    edges = np.array([length, _depth(length, settings, known)])
    center = first.face.center - first.toward * edges[1] / 2
    measured = (ends_in_view(sight, first, settings), False)
    return Solid("pillar", "rectangular", center, edges, first.face.along, members, measured)


def _angled(places: np.ndarray, candidate: Candidate, settings: SolidSettings, known: KnownBuilding) -> Solid | None:
    """A pillar of which more than one side passed for one face: the rectangle that its members (n, 2) [m] outline.

    They are two short ones; or flanges with a web between them, which lies inside and tells nothing of the rectangle.
    """
    face = candidate.first.face
    smeared = float(np.sqrt(np.mean(((places - face.center) @ face.across) ** 2)))
    if smeared < settings.tolerance:
        return None
    outermost = inside_hull(places) <= settings.tolerance / 2
    outline = places[outermost] if outermost.mean() >= OUTLINED else places
    along = upright_along(outline)
    center, edges = rectangle_along(outline, along)
    outlined, all_of_it = (
        float(np.sqrt(np.mean(outside(some, center, edges, along) ** 2))) for some in (outline, places)
    )
    if edges.min() < settings.least_width or outlined > 0.5 * smeared:
        return None
    whole = all_of_it <= 0.5 * smeared  # else nothing tells how far the sides go on that hide behind others
    edges = _fitting(edges, settings, known)
    return Solid("pillar", "rectangular", center, edges, along, candidate.members, (whole, whole))


def _corner(sight: Sight, candidate: Candidate, settings: SolidSettings, known: KnownBuilding) -> Solid:
    """A pillar from two faces that meet."""
    first, members = candidate.first, candidate.members
    thin, side = sorted((first, candidate.crossing), key=lambda piece: piece.face.length)
    along = upright_along(sight.points[members, :2])
    center, edges = rectangle_along(sight.points[members, :2], along)
    faces = sorted((thin, side), key=lambda piece: -abs(piece.face.along @ along))  # one gives each edge
    measured = tuple(ends_in_view(sight, piece, settings) for piece in faces)
    if not ends_in_view(sight, thin, settings) and ends_in_view(sight, side, settings):
        # The rest of the hidden side, away from the sensor.
        axes = np.stack([along, [-along[1], along[0]]])
        grown = np.array([_depth(edges.max(), settings, known) if edge < edges.max() else edge for edge in edges])
        grown = np.maximum(grown - edges, 0.0)
        center = center + (np.sign(axes @ (center - first.origin[:2])) * grown / 2) @ axes
        edges = edges + grown
    return Solid("pillar", "rectangular", center, _fitting(edges, settings, known), along, members, measured)


def _with_section(pillar: Solid, section: Section, settings: SolidSettings, known: KnownBuilding) -> Solid:
    """The same pillar with the section that all rays show, completed where they do not show it whole.

    It is that of a column of the building which the rays allow, or else it is square, as far as they do.
    """
    if abs(section.along @ pillar.along) < np.sqrt(0.5):  # its first edge stays the first
        section = section.turned
    if not section.known.any():
        return pillar
    least, most = section.edges - settings.section_fits, section.most + settings.section_fits
    edges = section.edges + np.where(section.room <= SURE, section.room / 2, 0.0).sum(axis=1)
    own = [one for one in _sections(known) if np.all((one >= least) & (one <= most))]
    if own:
        edges = min(own, key=lambda one: float(np.abs(one - edges)[section.known].max()))
    else:
        square = np.minimum(np.maximum(edges[::-1], edges), np.maximum(section.most, edges))
        edges = np.where(section.known, edges, np.minimum(square, np.maximum(edges, settings.wall_length)))
        if edges.min() < min(settings.least_width, edges.max() / 2):  # rays pass behind a flange that is a part of it
            return pillar
    # What is more than is seen lies at the ends where the rays leave room for it.
    unsure = np.where(section.room <= SURE, 0.0, 1.0)
    share = np.where(section.known[:, None], section.room, unsure) + 1e-9
    shift = (edges - section.edges) * (share[:, 1] - share[:, 0]) / share.sum(axis=1) / 2
    axes = np.stack([section.along, [-section.along[1], section.along[0]]])
    return pillar._replace(
        shape="rectangular",
        center=section.center + shift @ axes,
        edges=edges,
        along=section.along,
        measured=tuple(section.known.tolist()),
    )


def _sections(known: KnownBuilding) -> list[np.ndarray]:
    """The sections (2,) [m] of the building's columns, turned either way."""
    return [np.array(turned) for a, b, is_round in known.columns if not is_round for turned in ((a, b), (b, a))]


def _depth(width: float, settings: SolidSettings, known: KnownBuilding) -> float:
    """Depth [m] of a pillar of which one face is seen: square, unless its building has a column with such a face."""
    sections = [(a, b) for a, b, is_round in known.columns if not is_round]
    sections += [(b, a) for a, b in sections]
    fitting = [section for section in sections if abs(section[0] - width) <= settings.fits]
    unknown = (width, min(width, settings.wall_length))
    return min(fitting, key=lambda section: abs(section[0] - width), default=unknown)[1]


def _fitting(edges: np.ndarray, settings: SolidSettings, known: KnownBuilding) -> np.ndarray:
    """The edges (2,) [m], or those of a known column that they fit."""
    fitting = [section for section in _sections(known) if np.abs(section - edges).max() <= settings.fits]
    return min(fitting, key=lambda section: np.abs(section - edges).max(), default=edges)
