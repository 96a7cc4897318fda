"""Where a whole stands that the model has in pieces: by the faces of all of them, as one body.

A wall that is turned moves each of its pieces otherwise: no piece by itself tells how the wall is turned, and about
what. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

from collections.abc import Collection, Hashable
from typing import TypeVar

import numpy as np

from jaxmm.deviations.deviation import Deviation, bodies_of, by_element, deviation_of, is_told
from jaxmm.deviations.element_motion import NORMAL, Seen, left_of, motion_of, telling
from jaxmm.deviations.seen_surfaces import Faces
from warp_scanner.sensors.triangles import TriangleScene

Name = TypeVar("Name", bound=Hashable)


def deviations_of_wholes(
    scene: TriangleScene, shown: list[Faces], wholes: dict[Name, tuple[list[int], float]], known: Collection[int]
) -> dict[Name, Deviation | None]:
    """The deviation of each whole of which some face is seen; None where its pieces do not move as one body.

    Args:
        scene: the model.
        shown: by each scan.
        wholes: by name the rows of the pieces, and the tolerance [m] that a piece may be off where the body has it.
        known: rows of the elements that their faces show within reach of their places.
    """
    faces, body_of = by_element(shown), bodies_of(scene)
    found: dict[Name, Deviation | None] = {}
    for name, (rows, tolerance) in wholes.items():
        if seen := [one for row in rows if row in known for one in faces.get(row, ())]:
            body = body_of(*rows)
            as_one = deviation_of(seen, shown, body, tolerance)
            is_one = is_told(as_one) and _moves_as_one(seen, shown, body.middle, tolerance)
            found[name] = as_one if is_one else None
    return found


def _moves_as_one(seen: list[Seen], shown: list[Faces], middle: np.ndarray, tolerance: float) -> bool:
    poses, sensors = [one.poses for one in shown], [one.sensor for one in shown]
    seen = telling(seen, poses, sensors, middle)
    step = motion_of(seen, poses, sensors, middle).step
    left, sigma = left_of(seen, step, poses, sensors, middle)
    return bool(np.all(np.abs(left) <= tolerance + NORMAL * sigma))
