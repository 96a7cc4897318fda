"""Doors and windows of a model that stand in no wall: the wall around them is what the model lacks.

Such a wall is seen in strips between what the model has, of which each alone may be anything. So the model is looked at
as if what hangs were not there. E elements; metres, z up.
"""

import numpy as np

from jaxmm.verdicts.priors import Prior
from warp_scanner.scenes.building import Building, element_bounds, fixed
from warp_scanner.scenes.scenes import DOOR, FLOOR, WINDOW
from warp_scanner.sensors.triangles import prepare_part

FILLINGS = (DOOR, WINDOW)
TOUCHES = 0.05  # [m] between what fills an opening and what it is in, at most
LEAST_HEIGHT = 0.5  # [m] of what fills an opening of a wall; what is lower is a skylight


def without_hanging(prior: Prior, kept: np.ndarray) -> Prior:
    """The prior whose surface lacks all doors and windows that hang, with a note; as it is where none does, or all.

    Args:
        prior: of any kind.
        kept: (E,) bool, elements that stay, as somebody asks for their verdict.
    """
    if prior.building is None:
        return prior
    rows = hanging(prior.building)
    rows = rows[~kept[rows]]
    triangles = prior.building.triangles
    stays = ~np.isin(triangles.element, rows)
    if stays.all() or not stays.any():
        return prior
    note = f"{len(rows)} doors and windows of the model are in no wall: they count as new, with what is around them"
    return prior._replace(scene=prepare_part(triangles, stays), notes=(*prior.notes, note))


def hanging(building: Building) -> np.ndarray:
    """Rows (n,) int of the doors and windows that nothing upright holds; furniture and floors are not.

    A roof holds its windows, and what is held holds what touches it: of a row of windows from floor to ceiling only
    those at both ends meet a wall.
    """
    semantic = building.triangles.semantic
    low, high = element_bounds(building.triangles)
    holds = fixed(building.triangles) & ~np.isin(semantic, (*FILLINGS, FLOOR))
    fills = np.isin(semantic, FILLINGS) & (high[:, 2] - low[:, 2] >= LEAST_HEIGHT)  # false without a shape
    loose, last = np.flatnonzero(fills), np.flatnonzero(holds)
    while len(loose) and len(last):
        meets = [
            np.any(np.all((low[last] <= high[row] + TOUCHES) & (high[last] >= low[row] - TOUCHES), axis=1))
            for row in loose
        ]
        loose, last = loose[~np.array(meets)], loose[meets]
    return loose
