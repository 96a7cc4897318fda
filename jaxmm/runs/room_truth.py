"""What a scan of a known scene could tell of each element of its model: the truth that verdicts are compared with.

P rays of the scan.
"""

from collections.abc import Iterable

import numpy as np

from jaxmm.runs.room_scans import RoomCase
from jaxmm.verdicts.standing_alone import APART
from jaxmm.verdicts.verdicts import OCCLUDED, PRESENT, REMOVED, UNSCANNED, VerdictSettings, is_enough
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles

LIMITS = VerdictSettings()  # how many rays tell


def true_verdicts(case: RoomCase, rows: Iterable[int]) -> dict[int, str]:
    """Present, removed, occluded or unscanned, of some rows of the table of elements.

    They count rays as the simulator knows them, with the limits of VerdictSettings: in the whole model, and of what
    these leave open in the model without all else that is gone.
    """
    pairs, row, told = case.pairs, case.row, {}
    gone = set(pairs.box.element[row, pairs.box.change[row] < 0].tolist())
    rest, robot = _without(case, gone), pairs.robot.distance[row]
    for asked in rows:
        number = int(case.ids[asked])
        told[asked], whole = REMOVED if number in gone else PRESENT, pairs.dt.element[row] == number
        if number in gone:
            past, reach = _without(case, gone - {number})
            tells, tells_past = pairs.testable_dt[row], np.isfinite(robot) & (robot > reach + APART)
        else:
            past, tells = rest[0], pairs.robot.element[row] == number
            tells_past = tells
        views = (whole, tells), (past == number, tells_past)
        if not any(is_enough(np.sum(meant & by), np.sum(meant), LIMITS) for meant, by in views):
            told[asked] = OCCLUDED if whole.any() or np.any(past == number) else UNSCANNED
    return told


def _without(case: RoomCase, gone: set[int]) -> tuple[np.ndarray, np.ndarray]:
    """Which element (P,) each ray of a scan meets in its model without some, -1 for none, and its range [m]."""
    scan = case.scan
    rays = Rays(scan.position[None], (case.pairs.directions @ scan.rotation.T).astype(np.float32))
    met = cast_triangles(case.prior.scene, rays, ~np.isin(case.ids, sorted(gone)))
    within = (met.element[0] >= 0) & (met.distance[0] <= scan.sensor.range_limits[1])
    return np.where(within, case.ids[met.element[0]], -1), met.distance[0]
