"""Lays robot scans upon the prior before anything is concluded from them, and refuses those that do not fit.

N points of a scan. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxmm.config import bounded
from jaxmm.formats.units import scale_in_words
from jaxmm.inputs import Misfit
from jaxmm.rays.joint_poses import Held
from jaxmm.rays.open_directions import in_words
from jaxmm.rays.registration import MOST_LEFT, Registration, Rival, is_near, register
from jaxmm.rays.scan_rays import PosedScan
from warp_scanner.lengths import length_in_words

MOST_POINTS = 60_000  # that a scan is registered by; it is thinned to one in 0.1 m anyway
AT_ONCE = 1_000_000  # points that are moved
LEAST_POINTS = 50  # of the prior in view, to compare anything with
FAR_SHIFT, FAR_TURN = 0.1, 2.0  # [m], [deg] from which on the prior shows something else
DOUBTED = 0.3  # share of what it sees of walls that lies on walls, below which it may be of another place
MOST_THROUGH = 0.002  # share of the rays, up to which a scan passes through nothing
# Of a scan that hardly matches and passes through nothing: from which share of its walls on what lies upon walls tells
# the place, less what may by chance; and from which shares on that lie on one plane, and before something, one new wall
# fills the view. Chosen on views of eight buildings: of 269 right ones 19 hardly match, and 7 of these are believed so;
# of 267 scans of others, put upon the floor there, 2.
LEAST_CLOSELY, LEAST_LONE, MOST_NOWHERE = 0.03, 0.85, 0.5
# Of a scan that is moved far, at least so much of what it sees of walls lies on walls. Chosen on validation rooms and
# eight buildings: right ones have 0.35 and more, scans of other places in the middle 0.03 and in 95 of 100 up to 0.37.
LEAST_MOVED = 0.33
LEAST_GAINED = 2.0  # surfaces that must lie better on the prior, for a far motion without a doubt: one may have moved
LEAST_ASKED = 0.2  # share of what it sees of walls that the prior must be able to show, for walls to tell of the place


class Passed(NamedTuple):
    """What the rays of a scan do to a building, if they are where they are believed to be."""

    through: float  # share of those with a return that clearly end behind a surface
    nowhere: float  # share of them before which the building has no surface at all


class InFile(NamedTuple):
    """How its file has a scan."""

    zero: np.ndarray  # (3,) [m] of its frame
    unit: float = 1.0  # [m] in which it was read


class Placed(NamedTuple):
    """A scan where it fits best, and how well."""

    scan: PosedScan
    shift: float  # [m] of the sensor
    turn: float  # [deg]
    residual: float  # [m] robust standard deviation about the prior's surface, of what matches
    overlap: float  # share of the points that match
    overlap_before: float
    notes: tuple[str, ...] = ()  # what speaks against it
    open: tuple[str, ...] = ()  # what is to be said of directions along which nothing holds its place, and who does
    held: bool = False  # by other scans, elsewhere than by the prior alone


@dataclasses.dataclass(frozen=True)
class FitLimits:
    """What a scan must reach to be believed."""

    least_overlap: float = bounded(
        0.12, 0.0, 1.0
    )  # share of its points within 0.1 m of the prior's surface; much may be new, or gone
    most_residual: float = bounded(0.07, 0.0)  # [m]; chance alone gives 0.074
    least_upright: float = bounded(
        0.12, 0.0, 1.0
    )  # share of what it sees of walls that lies on walls, of a cloud of those it could show: floors fit anywhere
    least_closely: float = bounded(
        0.06, 0.0, 1.0
    )  # the same less what may match by chance; with more of it, `least_upright` is not asked; 1: it always is


# A cloud as prior shows what was in sight once. Of 384 scans of changed validation rooms none is refused so, and of as
# many scans of others 95 in 100. Asking for more walls refuses right scans that stand before new ones.
OF_CLOUDS = FitLimits(least_overlap=0.05, least_upright=0.05, least_closely=1.0)


def place(
    scan: PosedScan,
    prior: np.ndarray,
    *,
    refine: bool = True,
    limits: FitLimits | None = None,
    in_sight_only: bool = False,
    passed: Callable[[], Passed] | None = None,
    shown: Callable[[PosedScan], np.ndarray] | None = None,
    in_file: InFile | None = None,
) -> Placed:
    """Register a scan.

    Args:
        scan: as believed.
        prior: (M, 3) [m] what the prior shows from about there.
        refine: False only measures how well it fits, and refuses nothing.
        limits: beyond which it is refused.
        in_sight_only: whether the prior holds only what is in sight, see `registration.register`.
        passed: asked of a scan that hardly matches. It is believed as it is where all that it sees may be new: it
            passes through nothing of the prior, and lies a little upon walls, or is one wall. None: it is refused.
        shown: what the prior shows (M, 3) [m] from where a scan is believed to be. From a pose that is far off it shows
            what lies beside the view: the scan is registered once more, to what it shows from where that ended.
        in_file: how its file has it; None: nobody asks whether it fits at another size.

    Raises:
        Misfit: it does not fit; the line says by how much.
    """
    limits, zero = limits or FitLimits(), None if in_file is None else in_file.zero
    if len(prior) < LEAST_POINTS:
        raise Misfit("the prior has nothing in view from there; check pose, units and frame")
    every = max(1, len(scan.points) // MOST_POINTS)
    found = register(scan.points[::every], prior, scan.position, in_sight_only=in_sight_only, zero=zero)
    if refine and shown is not None and _is_far(found, scan):
        found = _once_more(found, scan, every, shown, in_sight_only, zero)
    before = found.overlap_before
    size = _scale_words(found, in_file)
    as_it_is = Placed(scan, 0.0, 0.0, found.residual_before, before, before, size)
    if not refine:  # whoever believes a pose believes it of a view that is all new, too
        return as_it_is
    if (refusal := _refusal(found, _is_far(found, scan), limits)) and not _may_have_moved(found, limits):
        if passed is None or not _may_be_new(found, passed()):
            raise Misfit(refusal)
        return as_it_is._replace(notes=(*size, _all_new(found)))
    moved, shift = _moved(scan, found.motion), _step(scan, found.motion)
    doubts = (*size, *_doubts(found, moved.position - scan.position, limits))
    return Placed(moved, shift, _angle(found.motion), found.residual, found.overlap, before, doubts, _open_words(found))


def hold(
    placed: Placed,
    held: Held,
    believed: PosedScan,
    shown: Callable[[PosedScan], np.ndarray],
    is_misfit: bool,
    in_file: InFile | None = None,
) -> Placed:
    """A scan where others hold it, and how well it fits the prior there.

    Args:
        placed: as it lies on the prior alone.
        held: where others have it.
        believed: as it was given; its points are not asked for.
        shown: what the prior shows (M, 3) [m] from where a scan is.
        is_misfit: whether it fits the prior alone from nowhere.
        in_file: as of `place`.

    Raises:
        Misfit: the prior has nothing in view from there.
    """
    there = _moved(placed.scan, held.motion)
    fit = place(there, shown(there), refine=False, in_file=in_file)
    others = f"{held.others} other scan{'s' * (held.others > 1)}"
    alone = "it fits nothing of the model by itself" if is_misfit else (
        f"the model alone would have it {length_in_words(np.linalg.norm(there.position - placed.scan.position))} away"
    )  # fmt: skip
    turn = np.eye(4)
    turn[:3, :3] = there.rotation @ believed.rotation.T
    return fit._replace(
        shift=float(np.linalg.norm(there.position - believed.position)), turn=_angle(turn),
        overlap_before=placed.overlap_before, held=True,
        open=(f"its place is held by surfaces that it shares with {others}; {alone}",),
    )  # fmt: skip


def correction_of(placed: Placed, source: str) -> tuple[str, ...]:
    """That a pose was far off as it was said, in words; nothing where it was not, or where it was only estimated.

    Args:
        placed: the scan where it fits.
        source: of its pose as believed, see `results.ScanRecord`.
    """
    if source not in ("given", "file") or (placed.shift <= FAR_SHIFT and placed.turn <= FAR_TURN):
        return ()
    off = f"{placed.shift:.2f} m and {placed.turn:.1f} degrees"
    if placed.notes:  # it may have been right
        return (f"its pose was changed by {off}, to where the scan fits best",)
    return (f"its pose was off by {off}: put right",)


def _moved(scan: PosedScan, motion: np.ndarray) -> PosedScan:
    turn, shift = motion[:3, :3], motion[:3, 3]
    points = np.zeros(scan.points.shape, np.float32)
    for start in range(0, len(points), AT_ONCE):  # in doubles they would be twice as large
        block = slice(start, start + AT_ONCE)
        points[block] = scan.points[block].astype(np.float64) @ turn.T + shift
    return scan._replace(
        points=points,
        position=turn @ scan.position + shift,
        rotation=turn @ scan.rotation,
    )


def _step(scan: PosedScan, motion: np.ndarray) -> float:
    """[m] by which a motion (4, 4) moves the sensor."""
    return float(np.linalg.norm(motion[:3, :3] @ scan.position + motion[:3, 3] - scan.position))


def _angle(motion: np.ndarray) -> float:
    """[deg] by which a motion (4, 4) turns."""
    return float(np.degrees(np.arccos(np.clip((np.trace(motion[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))))


def _is_far(found: Registration, scan: PosedScan) -> bool:
    """Whether a motion takes a scan so far that the prior shows something else from there."""
    return _step(scan, found.motion) > FAR_SHIFT or _angle(found.motion) > FAR_TURN


def _once_more(
    found: Registration,
    scan: PosedScan,
    every: int,
    shown: Callable[[PosedScan], np.ndarray],
    in_sight_only: bool,
    zero: np.ndarray | None,
) -> Registration:
    """Registered again from where a first registration ended, with what that says of the start."""
    there = _moved(scan._replace(points=scan.points[::every]), found.motion)
    prior = shown(there)
    if len(prior) < LEAST_POINTS:
        return found
    again = register(there.points, prior, there.position, in_sight_only=in_sight_only, zero=zero)
    motion = again.motion @ found.motion
    if not is_near(_step(scan, motion), np.radians(_angle(motion))):
        return found
    return again._replace(
        motion=motion, residual_before=found.residual_before,
        overlap_before=found.overlap_before, left=found.left, gained=found.gained,
    )  # fmt: skip


def _open_words(found: Registration) -> tuple[str, ...]:
    ways = " and ".join(map(in_words, found.open))
    return (f"nothing that it sees holds its place {ways}: there its pose was believed as it is",) if ways else ()


def _refusal(found: Registration, is_far: bool, limits: FitLimits) -> str:
    """Why a scan does not fit, which may have been moved far, in one line; nothing where it does."""
    if found.overlap < limits.least_overlap or not found.residual <= limits.most_residual:
        off = f", {found.residual:.3f} m off" if np.isfinite(found.residual) else ""
        told = f"{found.overlap:.1%} of its points match the prior{off}"
        return (
            f"the scan does not fit the prior from there: {told}; expected at least {limits.least_overlap:.1%} and at "
            f"most {limits.most_residual} m; check pose, units and frame, or believe them (--no-refine)"
        )
    least = max(limits.least_upright, LEAST_MOVED if is_far else 0.0)
    closely = found.closely > limits.least_closely and not is_far
    if found.asked >= LEAST_ASKED and found.upright < least and not closely:
        other = (
            f", or more than {limits.least_closely:.1%} beyond what may match by chance (it has {found.closely:.1%})"
        )
        return (
            f"the scan does not fit the prior from there: {found.upright:.1%} of {_walls_of(found)} lies on walls, the "
            f"rest on floor and ceiling; expected at least {least:.1%}"
            f"{other if limits.least_closely < 1.0 and not is_far else ''}; is it of this building? check pose, "
            "units and frame, or believe them (--no-refine)"
        )
    return ""


def _may_have_moved(found: Registration, limits: FitLimits) -> bool:
    """Whether a scan that hardly matches would do so elsewhere: then its pose is off, or what it sees has moved."""
    rival = found.rival
    if rival is None or not rival.residual <= limits.most_residual:
        return False
    return rival.overlap >= limits.least_overlap and rival.upright >= LEAST_MOVED


def _may_be_new(found: Registration, passed: Passed) -> bool:
    """Whether a scan that hardly matches is likely to be where it is believed to be, before what is new.

    The scan of another room passes through walls, and what lies upon some there does so after a motion. Where the
    building has nothing behind what is seen, one plane tells nothing.
    """
    if passed.through > MOST_THROUGH:
        return False
    closely = found.closely > LEAST_CLOSELY and found.overlap_before > 0.8 * found.overlap
    return closely or (found.lone >= LEAST_LONE and passed.nowhere <= MOST_NOWHERE)


def _all_new(found: Registration) -> str:
    return (
        f"only {found.overlap_before:.0%} of its points match the prior, but it passes through nothing: its pose was "
        "believed, and the rest is taken for new; is it of this place?"
    )


def _doubts(found: Registration, step: np.ndarray, limits: FitLimits) -> tuple[str, ...]:
    """What speaks against it, moved by a step (3,) [m]: that it may be of another place, or fits only where nobody
    believed it.
    """
    moved: tuple[str, ...] = ()
    shift, along = float(np.linalg.norm(step)), abs(float(step @ np.array(found.weakest)))
    if found.rival:
        return (_rival_words(found.rival),)
    if found.left > MOST_LEFT:
        moved = (
            f"{found.left:.0%} of what lies closely on walls from the pose that was believed is on none when moved by "
            f"{shift:.2f} m: was its pose so far off? If not, something else moved, and is found with --no-refine",
        )
    elif found.overlap_before < limits.least_overlap:  # a new wall that fills the view fits any old one near by
        moved = (
            f"only {found.overlap_before:.0%} of its points match the prior from the pose that was believed, and "
            f"{found.overlap:.0%} when moved by {shift:.2f} m: was its pose so far off? "
            "If not, what it sees is new, and is found with --no-refine",
        )
    elif shift > FAR_SHIFT and found.gained < LEAST_GAINED:
        moved = (
            f"little more than one surface tells that its pose was off by {shift:.2f} m: if it was not, that surface "
            "moved, and is found with --no-refine",
        )
    elif along > FAR_SHIFT and found.telling < LEAST_GAINED:  # all others may tell of how it was turned
        moved = (
            f"little more than one surface tells that its pose was off by {along:.2f} m {in_words(found.weakest)}: if "
            "it was not, that surface moved, or is new, and is found with --no-refine",
        )
    if found.asked < LEAST_ASKED:  # false for NaN, of a scan without walls
        return (f"the prior could show only {found.asked:.0%} of the walls that it sees: is it of this place?", *moved)
    if found.upright < DOUBTED:
        return (f"only {found.upright:.0%} of {_walls_of(found)} lies on walls: is it of this place?", *moved)
    return moved


def _scale_words(found: Registration, in_file: InFile | None) -> tuple[str, ...]:
    scale = found.scale
    return () if scale is None else (f"the scan fits the model better {scale_in_words(scale.factor, in_file.unit)}",)


def _rival_words(rival: Rival) -> str:
    step, many = np.array(rival.step), max(1, round(rival.surfaces))
    flat = float(np.hypot(*step[:2]))
    way = in_words((step[0], step[1], 0.0) if flat > abs(step[2]) else (0.0, 0.0, 1.0))
    turned = f" and turned by {np.degrees(rival.turn):.0f}°" if rival.turn > np.radians(1.0) else ""
    what = "one more surface" if many == 1 else f"about {many} more surfaces"
    return (
        f"moved by {np.linalg.norm(step):.2f} m {way}{turned}, {what} that it sees would lie on the prior; what is "
        "there is held for new, or moved: if it is the scan's pose that is off by that much, give a better one"
    )


def _walls_of(found: Registration) -> str:
    return "what it sees of walls" if found.asked == 1.0 else "what the prior could show of the walls that it sees"
