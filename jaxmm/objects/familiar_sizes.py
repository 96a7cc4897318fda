"""What the sizes of a building's own columns and walls tell of a new thing: which of both it is likelier.

The judge of objects learnt from rooms whose pillars are of any width, and stand free. Most buildings have columns of
few sections and walls of few footprints, and what is new there is mostly of a size that is there already. Metres.
"""

from collections.abc import Callable

import numpy as np

from jaxmm.learning.upright_shapes import line_through
from jaxmm.objects.candidates import Candidate
from jaxmm.objects.sections import Section
from jaxmm.objects.solids import SolidSettings
from jaxmm.objects.walls import KnownBuilding, Solid

CORNER = 1.42  # times its side: how wide a square column is that is seen at its corner, which may pass for a shaft
SQUARE = 1.25  # most of a section's longer side, in shorter ones, that may
THINNED = 0.12  # [m] by which such a shaft may look thinner than the column, as points are thinned
SPAN = 1.0  # [m] over which sides of other things may be anywhere
ASKEW = 15.0  # [deg] from the directions of the building, beyond which no wall of it stands


def by_size(
    share: np.ndarray,
    candidate: Candidate,
    pillar: Solid | None,
    known: KnownBuilding,
    settings: SolidSettings,
    off_grid: Callable[[], float],
) -> np.ndarray:
    """The probabilities (3,) of nothing, a pillar and a wall, moved between the last two by the sizes in a building.

    What has a size of the building is likelier of that kind, by how much seldomer other things have it by chance: the
    more sizes a building has, the less each tells. One face as slender as a column tells more, where a wall would show
    no more than its end: a column always looks like that, a wall only from its own line. But it tells nothing where it
    is as thick as the building's walls, too, and they stand in that direction. What is seen of a face that goes on
    unseen is no size.

    Args:
        share: (3,) as the judge has them.
        candidate: of which it has.
        pillar: what it would be as a pillar; None where its shape tells nothing.
        known: sizes that the building has already.
        settings: how well they must fit, and how much likelier they make what has them.
        off_grid: tells the angle [deg] between a wall of which this is the end and the building, 0 to 45.
    """
    if pillar is None:
        return share
    is_shaft = candidate.first.circle is not None
    sizes = pillar.edges[:1] if is_shaft else np.sort(pillar.edges[list(pillar.measured)])
    if not len(sizes):
        return share
    column = any(_has_section(sizes, one, is_shaft, settings) for one in known.columns)
    # The end of a wall, alone, is no thicker than many a column: its length tells.
    wall = not is_shaft and any(_near(sizes, np.array(one)[-len(sizes) :], settings) for one in known.short_walls)
    if column == wall:
        return share
    factor = _likelier(known.columns if column else known.short_walls, len(sizes), settings)
    if column and len(sizes) == 1 and (is_shaft or sizes[0] <= settings.most_thickness):
        if _near(sizes, np.array(known.walls), settings) and off_grid() <= ASKEW:
            return share
        factor *= settings.end_on
    return _with_odds(share, share[1:] * ([factor, 1.0] if column else [1.0, factor]))


def _with_odds(share: np.ndarray, odds: np.ndarray) -> np.ndarray:
    """The same with other odds (2,) of a pillar and a wall; whether it is real stays as it is."""
    return np.append(share[0], odds * ((1.0 - share[0]) / max(odds.sum(), np.finfo(float).tiny)))


def by_length(share: np.ndarray, places: np.ndarray, known: KnownBuilding, settings: SolidSettings) -> np.ndarray:
    """The probabilities (3,) of nothing, a pillar and a wall, the second moved to the last of what is too long for it.

    A wall that is curved, or goes around a corner, has more than one side, as pillars have.

    Args:
        share: (3,) as the judge has them.
        places: (n, 2) [m] of its points in plan.
        known: its own columns, which may be longer.
        settings: how long a pillar may be, its diagonal included.
    """
    _, along = line_through(places)
    longest = max((float(np.hypot(a, b)) + settings.fits for a, b, _ in known.columns), default=0.0)
    if np.ptp(places @ along) <= max(longest, settings.longest_column):
        return share
    return _with_odds(share, np.array([0.0, 1.0]))


def by_width(share: np.ndarray, candidate: Candidate, known: KnownBuilding, settings: SolidSettings) -> np.ndarray:
    """The probabilities (3,) of nothing, a pillar and a wall, moved to the last where a lone face is wide for a column.

    A building of many walls, whose columns are at most half as wide, or that has none, hardly gets one that is as wide
    as a piece of wall; where two sides are seen, its shape tells. Of few walls, as of one room, it says nothing that
    there is no such column yet.

    Args:
        share: (3,) as the judge has them.
        candidate: of which it has.
        known: its walls and columns.
        settings: how wide columns are, how seldom wider, and how many walls are many.
    """
    own, first = known.own, candidate.first
    if own is None or own.is_wall.sum() < settings.many_walls:
        return share
    if own.longer[~own.is_wall].max(initial=0.0) > settings.widest_column / 2:
        return share
    if first.face is None or candidate.crossing is not None or first.face.length <= settings.widest_column:
        return share
    return _with_odds(share, share[1:] / [settings.seldom_wider, 1.0])


def by_section(share: np.ndarray, section: Section | None, known: KnownBuilding, settings: SolidSettings) -> np.ndarray:
    """The probabilities (3,) of nothing, a pillar and a wall, the last moved to the second of what is short for a wall.

    All rays tell it, where they pass behind a face that may be the end of a wall.

    Args:
        share: (3,) as the judge has them.
        section: that all rays show of it; None where they show none.
        known: its own walls, which may be as short.
        settings: how short no wall is.
    """
    shortest = min((float(max(one)) - settings.fits for one in known.short_walls), default=np.inf)
    if section is None or section.most.max() >= min(shortest, settings.shortest_wall):
        return share
    return _with_odds(share, share[1:] * [settings.seldom_shorter, 1.0])


def _likelier(sizes: tuple[tuple, ...], sides: int, settings: SolidSettings) -> float:
    """How many times likelier what has one of some sizes is of their kind: as often as that is so, by chance."""
    by_chance = len(sizes) * (2.0 * settings.fits / SPAN) ** sides
    return max(settings.familiar / by_chance, 1.0)


def _has_section(sizes: np.ndarray, column: tuple[float, float, bool], is_shaft: bool, settings: SolidSettings) -> bool:
    *sides, is_round = column
    if not is_shaft:
        return not is_round and _near(sizes, np.array(sides), settings)
    if is_round:
        return _near(sizes, np.array(sides), settings)
    is_square = max(sides) <= SQUARE * min(sides)
    return bool(is_square and min(sides) - THINNED <= sizes[0] <= CORNER * max(sides) + settings.fits)


def _near(sizes: np.ndarray, sides: np.ndarray, settings: SolidSettings) -> bool:
    """Whether both sides are those of something known, or one of them where only one is seen."""
    if len(sizes) == 2:
        return bool(np.abs(sizes - np.sort(sides)).max() <= settings.fits)
    return bool(np.abs(sizes - sides).min(initial=np.inf) <= settings.fits)
