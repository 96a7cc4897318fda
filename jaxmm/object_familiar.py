"""What the sizes of a building's own columns and short walls tell of a new thing: which of both it is likelier.

The judge of objects learnt from rooms whose pillars are of any width, and stand free. Most buildings have columns of
few sections and walls of few footprints, and what is new there is mostly of a size that is there already. Metres.
"""

import numpy as np

from jaxmm.object_candidates import Candidate
from jaxmm.object_solids import SolidSettings
from jaxmm.object_walls import KnownBuilding, Solid

CORNER = 1.42  # times its side: how wide a square column is that is seen at its corner, which may pass for a shaft
THINNED = 0.12  # [m] by which such a shaft may look thinner than the column, as points are thinned


def by_size(
    share: np.ndarray, candidate: Candidate, pillar: Solid | None, known: KnownBuilding, settings: SolidSettings
) -> np.ndarray:
    """The probabilities (3,) of nothing, a pillar and a wall, moved between the last two by the sizes in a building.

    Two sides that fit decide, and so does one where a wall would show no more than its end: a column always looks like
    that, a wall only from its own line. One wider face fits by chance more often.

    Args:
        share: (3,) as the judge has them.
        candidate: of which it has.
        pillar: what it would be as a pillar; None where its shape tells nothing.
        known: sizes that the building has already.
        settings: how well they must fit, and how much likelier they make what has them.
    """
    if pillar is None:
        return share
    is_shaft, is_corner = candidate.first.circle is not None, candidate.crossing is not None
    width = pillar.edges[0] if is_shaft else candidate.first.face.length
    sizes = np.sort(pillar.edges) if is_corner else np.array([width])
    column = any(_has_section(sizes, one, is_shaft, settings) for one in known.columns)
    # The end of a wall, alone, is no thicker than many a column: its length tells.
    wall = not is_shaft and any(_near(sizes, np.array(one)[-len(sizes) :], settings) for one in known.short_walls)
    if column == wall:
        return share
    slender = is_shaft or width <= settings.most_thickness
    factor = settings.familiar if is_corner or (column and slender) else settings.familiar_face
    odds = share[1:] * ([factor, 1.0] if column else [1.0, factor])
    return np.append(share[0], odds * ((1.0 - share[0]) / odds.sum()))


def _has_section(sizes: np.ndarray, column: tuple[float, float, bool], is_shaft: bool, settings: SolidSettings) -> bool:
    *sides, is_round = column
    if not is_shaft:
        return not is_round and _near(sizes, np.array(sides), settings)
    if is_round:
        return _near(sizes, np.array(sides), settings)
    return bool(min(sides) - THINNED <= sizes[0] <= CORNER * max(sides) + settings.fits)


def _near(sizes: np.ndarray, sides: np.ndarray, settings: SolidSettings) -> bool:
    """Whether both sides are those of something known, or one of them where only one is seen."""
    if len(sizes) == 2:
        return bool(np.abs(sizes - np.sort(sides)).max() <= settings.fits)
    return bool(np.abs(sizes - sides).min() <= settings.fits)
