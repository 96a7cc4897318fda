"""The building as it was built: elements that stand off their places, and the model with them where they stand.

E elements, S scans, T triangles. Positions are offsets from the prior's origin, world axes: metres, z up.

A wall that stands 60 mm off its place is neither gone nor new. Deviations are measured first; what then judges scans is
the model with every element where it stands, so that nothing is held for new, gone or hidden for having moved a little.
"""

from collections.abc import Callable, Collection, Iterable
from typing import NamedTuple

import numpy as np

from jaxmm.classes.selection import CLASSES
from jaxmm.deviations.agreed_poses import agreed, with_poses
from jaxmm.deviations.deviation import Deviation, deviations_by, is_told, shifted
from jaxmm.deviations.heights import passed_above
from jaxmm.deviations.pose_errors import EXACT, HELD, KEPT, REGISTERED
from jaxmm.deviations.seen_surfaces import Faces
from jaxmm.deviations.shifted_columns import Beside, columns_of, shifts_of
from jaxmm.deviations.tolerances import DeviationSettings
from jaxmm.deviations.wholes import deviations_of_wholes
from jaxmm.verdicts.behind_removed import filling
from jaxmm.verdicts.placement import Placed
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.results import Key
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import DISPLACED, OCCLUDED, PRESENT, REMOVED, UNSCANNED, Verdict, keys_of
from warp_scanner.scenes.building import Building, element_bounds, rows_by_key
from warp_scanner.scenes.building_edits import move_element
from warp_scanner.scenes.scenes import DOOR, WINDOW
from warp_scanner.sensors.triangles import prepare_part

KEPT_SHIFT, KEPT_TURN = 0.003, 0.1  # [m], [deg] of the sensor, up to which a pose is as it was given
LEAST_MOVED = 0.01  # [m] off its place, from which an element is judged where it stands
WHOLLY = 0.95  # share of them, below which a column may stand beside its place
MOST_HALF = 0.02  # [m] that an offset may be wrong by, where it is asked whether it is the same element
MOST_OPEN = 0.1  # [m] that an offset may be less than the pose has it, where it is open how far off the pose is
AJAR = 1.0  # [deg] by which a door or a window is turned that stands ajar
STANDS = 0.5  # share of the rays that could reach an element, that end on it where it stands


class AsBuilt(NamedTuple):
    """What stands where."""

    prior: Prior  # with every element where it stands
    found: dict[int, Deviation]  # by row of the element; of those that stand within reach of their places
    tolerance: np.ndarray  # (E,) [m] of each element
    # Of what has pieces, of which some face is seen; None where they do not move as one.
    wholes: dict[Key, Deviation | None]

    def deviation(self, row: int) -> Deviation | None:
        """Of an element; None where nothing is known: all that is off may be the pose."""
        one = self.found.get(row)
        return one if one is not None and is_told(one) else None

    def by(self, scans: int) -> "AsBuilt":
        """What the first so many scans tell of, as all of them do."""
        return self._replace(found={row: one for row, one in self.found.items() if one.scans[0] < scans})


def as_built(
    prior: Prior,
    shown: list[Faces],
    beside: Iterable[Beside],
    again: Callable[[Prior, np.ndarray], list[Faces]],
    settings: DetectSettings,
) -> AsBuilt:
    """Measure what stands where.

    Args:
        prior: a building.
        shown: of its faces, by each scan.
        beside: what each scan shows about its columns, scan after scan.
        again: what each shows of some elements (n,) int of a prior of which columns were moved.
        settings: how.
    """
    limits = settings.deviations
    tolerance, shown = tolerances(prior, limits), agreed(shown)
    found = deviations_by(prior.scene, shown, tolerance)
    # Farther than that it is another thing, or the same one that was moved.
    farthest = limits.most + MOST_HALF
    found = {row: one for row, one in found.items() if np.linalg.norm(one.step) <= farthest + _open_by(one)}
    vacant = passed_above(prior.scene.triangles, (one.heights for one in shown), in_place=True)
    moved = {row: _step(one) for row, one in found.items() if _is_off(one)}
    # What stands beside its place is where its rays pass.
    slender = np.union1d(columns_of(prior.scene), _ends(shown)).astype(np.int64)
    # What is partly of glass is not looked for there: points that lie on it may be of what is behind its glass.
    slender = np.setdiff1d(slender, _glazed(prior.building))
    lost = [row for row in slender if row not in found or found[row].stands < WHOLLY]
    around = {
        row: step for row, step in moved.items() if row not in lost
    }  # a wall that moved explains its points there
    others = _with_moved(prior, around, found) if around and lost else prior
    shifts = shifts_of(prior.scene, beside, np.array(lost, int), limits.most, others.scene)
    if shifts:
        there = _with_moved(prior, moved | {row: (one.step, np.zeros(3)) for row, one in shifts.items()}, found)
        laid = [
            with_poses(one, known.poses) for one, known in zip(again(there, np.array(list(shifts))), shown, strict=True)
        ]
        laid = deviations_by(there.scene, laid, tolerance)
        for row, shift in shifts.items():
            one = shifted(laid[row], shift) if row in laid and laid[row].stands >= STANDS else None
            if one is not None and np.linalg.norm(one.offset) <= farthest:
                found[row], moved[row] = one, _step(one)
    now = _with_moved(prior, moved, found) if moved else prior
    if vacant.any():
        # Past what stands beside its place rays pass, too: where it is found, they must as well.
        if beside := [row for row in np.flatnonzero(vacant) if row in moved]:
            there = again(now, np.array(beside))
            over = passed_above(now.scene.triangles, (one.heights for one in there), in_place=False)
            vacant[beside] = over[beside]
        found = {row: one for row, one in found.items() if not vacant[row]}
        kept = {row: step for row, step in moved.items() if not vacant[row]}
        now = (_with_moved(prior, kept, found) if kept else prior)._replace(vacant=vacant)
    wholes = _wholes(prior, shown, found.keys() - shifts.keys(), limits)
    return AsBuilt(now, found, tolerance, wholes)


def _ends(shown: list[Faces]) -> list[int]:
    """Rows of walls that scans meet at their ends alone; none of which another scan shows a side."""
    ends = {row for one in shown for row in one.ends.tolist()}
    sides = {each.element for one in shown for each in one.seen if each.element not in one.ends}
    return sorted(ends - sides)


def _wholes(
    prior: Prior, shown: list[Faces], known: Collection[int], limits: DeviationSettings
) -> dict[Key, Deviation | None]:
    """What those tell together that are pieces of one element elsewhere."""
    if not prior.building.pieced:
        return {}
    row_of, own = rows_by_key(prior.building.elements), set(np.unique(prior.scene.triangles.element).tolist())
    wholes = {}
    for whole in prior.building.pieced:
        if rows := [row for row in (row_of.get(key) for key in whole.pieces) if row in own]:
            wholes[keys_of(whole)[0]] = rows, limits.of(class_name(whole.element.semantic))
    return deviations_of_wholes(prior.scene, shown, wholes, known)


def panes_of(prior: Prior) -> np.ndarray | None:
    """(T,) bool, of the triangles of its scene: glass, but for doors and windows; None where nobody knows.

    Rays end on what is behind it, as on the shelf behind a pane.
    """
    panes = _panes_of(prior.building)
    return None if panes is None else panes[_in_scene(prior)]


def _panes_of(building: Building) -> np.ndarray | None:
    triangles = building.triangles
    if building.clear is None:
        return None
    return building.clear & ~np.isin(triangles.semantic[triangles.element], (DOOR, WINDOW))


def _in_scene(prior: Prior) -> np.ndarray:
    """(T,) bool: triangles of the building that are in the scene: it lacks some elements, as what hangs in no wall."""
    return np.isin(prior.building.triangles.element, np.unique(prior.scene.triangles.element))


def _glazed(building: Building) -> np.ndarray:
    """(n,) int rows of what is partly of glass, but for doors and windows."""
    panes = _panes_of(building)
    return np.zeros(0, np.int32) if panes is None else np.unique(building.triangles.element[panes])


def knows_deviations(prior: Prior, settings: DetectSettings) -> bool:
    """Whether anything is measured: a cloud has no elements, and the thesis's preset knows of none that moved."""
    return prior.has_elements and settings.preset != "thesis"


def _is_off(one: Deviation) -> bool:
    """Whether an element surely stands, and surely not in its place, as the pose has it."""
    off = max(float(np.linalg.norm(one.step)), one.worst)
    open_by = one.step_half if is_told(one) and not one.before else 0.0  # either way what is seen there is not new
    return one.stands >= STANDS and off > max(LEAST_MOVED, open_by)


def _open_by(one: Deviation) -> float:
    """[m] by which it may stand nearer to its place than the pose has it, as that may be off."""
    if one.before:  # then it is open whether it is the element at all
        return 0.0
    if not is_told(one):
        return MOST_OPEN
    # What is wider open has two places, by poses apart from each other: as it is, it is beyond or another moved.
    return one.half if MOST_HALF < one.half <= MOST_OPEN else 0.0


def _step(one: Deviation) -> tuple[np.ndarray, np.ndarray]:
    return np.array(one.step), np.array(one.turned)


def tolerances(prior: Prior, limits: DeviationSettings) -> np.ndarray:
    """(E,) [m] of each element, by its class."""
    return np.array([limits.of(class_name(int(one))) for one in prior.scene.triangles.semantic])


def class_name(semantic: int) -> str:
    """What settings call a class of scenes; nothing for one that they do not know."""
    return next((name for name, value in CLASSES.items() if value == semantic), "")


def is_displaced(one: Deviation, tolerance: float, least_rays: int) -> bool:
    """Whether so many rays end on an element, and most of those that could, and it is surely off by more [m]."""
    return is_told(one) and one.rays >= least_rays and one.stands >= STANDS and one.surely > tolerance


def with_displaced(verdicts: list[Verdict], stands: AsBuilt, least_rays: int) -> list[Verdict]:
    """The verdicts, with those of elements that stand off their places, and of those that only their faces show."""
    semantic, found = stands.prior.scene.triangles.semantic, list(verdicts)
    glazed = set(_glazed(stands.prior.building).tolist())
    for row, one in stands.found.items():
        verdict, enough = found[row].verdict, one.rays >= least_rays
        # What passes through its glass tells no more of what is partly of glass than what never got there.
        least = STANDS if verdict in (OCCLUDED, UNSCANNED) or row in glazed else WHOLLY
        probability = found[row].probability
        if enough and one.stands >= least:
            if verdict == REMOVED:  # by rays that pass through its place, while most end on it, off that
                probability = min(probability, 1.0 - one.stands)
            verdict = PRESENT
        if verdict == PRESENT and is_displaced(one, stands.tolerance[row], least_rays):
            ajar = semantic[row] in (DOOR, WINDOW) and (one.turn is None or abs(one.turn) > AJAR)
            verdict = PRESENT if ajar else DISPLACED
        found[row] = found[row]._replace(verdict=verdict, probability=probability)
    return found


def trust_in(one: Placed, refine: bool) -> str:
    """How far the pose of a scan is believed, one of pose_errors.TRUSTS."""
    if not refine:
        return EXACT
    if one.held:
        return HELD
    return KEPT if one.shift <= KEPT_SHIFT and one.turn <= KEPT_TURN else REGISTERED


def _with_moved(prior: Prior, moved: dict[int, tuple[np.ndarray, np.ndarray]], known: dict[int, Deviation]) -> Prior:
    """The prior with some elements moved about their middles, by a step [m] and a rotation vector [rad] each.

    Doors and windows go with their wall, unless they were measured.
    """
    triangles = prior.building.triangles
    count = len(triangles.semantic)
    steps = {row: (row, *step) for row, step in moved.items()}
    for row, step in moved.items():
        chosen = np.zeros(count, bool)
        chosen[row] = True
        own = [int(other) for other in np.flatnonzero(filling(prior.building, chosen)) if other not in known]
        steps |= dict.fromkeys(own, (row, *step))
    low, high = (bound.astype(np.float64) for bound in element_bounds(triangles))
    now = triangles
    for row, (leader, step, turn) in steps.items():
        now = move_element(now, row, step, turn, (low[leader] + high[leader]) / 2.0)
    scene = prepare_part(now, _in_scene(prior))
    return prior._replace(building=prior.building._replace(triangles=now), scene=scene)
