"""How one element moved from its place: by least squares over all its faces in all scans.

S scans. Positions are offsets from the prior's origin, world axes: metres, z up. A motion is a shift [m] of the
element's middle and a rotation vector [rad] about it (6,).
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from jaxmm.deviations.fits import Fit
from jaxmm.deviations.pose_errors import PoseError, rows_of, rows_of_all, scatter
from jaxmm.deviations.tolerances import Slope

FREE = (1.0, 1.0, 1.0, 0.03, 0.03, 0.1)  # [m, rad] standard deviations of an element off its place, before it is seen
FIXED = 0.05  # [m] of a direction of the shift, up to which faces fix it
FIXED_TURN = np.radians(0.5)  # of a turn
NORMAL = 1.96  # standard deviations to either side hold 95 %
WITHIN = 0.95  # share of what may be that an interval holds
MOST_OPEN, BISECTED = 64, 40  # poses of all scans together that are weighed, and steps to where an interval ends
FIXED_BY = 3  # faces that fix a wall: where it stands, how it is turned, and how it leans
LEAST_BENT = np.radians(1.0)  # that one face of an element is turned otherwise than another, to be none of it
AT_ODDS = 4.0  # standard deviations, from which on a face contradicts what all faces together say


Loose = tuple[np.ndarray, np.ndarray]  # correction (6,) of a pose, and its covariance (6, 6)


class Seen(NamedTuple):
    """One face of an element in one scan: what is left of its rays, by C places of 0.1 m on it."""

    element: int
    group: int  # as in Meetings
    fit: Fit  # without its rays
    rays: int  # that end on it; 0 where another fit says so already
    looks: np.ndarray  # (3,) float64 sum of unit vectors toward the sensor, of rays that end on it
    cell: np.ndarray  # (C,) int64 places on the face; none of a fit that says the same rays again
    apart: np.ndarray  # (C,) float64 [m] off the fitted face
    off: np.ndarray  # (2, C) float64 [m] off the model's face, with the likeliest pose and as the pose is
    face: np.ndarray  # (2, C) float64 [m] the same of the fitted face
    place: np.ndarray  # (C, 3) float64 [m] in the middle of what ends there
    scan: int = 0  # number of the scan

    def moved_by(self, change: np.ndarray, sensor: np.ndarray) -> "Seen":
        """With another likeliest pose, by so much (6,) another correction about the sensor (3,) [m]."""
        by = (change[:3] + np.cross(change[3:], self.place - sensor)) @ self.fit.normal
        both = np.stack([by, np.zeros_like(by)])
        return self._replace(off=self.off + both, face=self.face + both)


class Swing(NamedTuple):
    """What a motion may as well be by the other poses of one scan, or of scans that go together."""

    share: np.ndarray  # (A,) how likely each pose is, the likeliest first
    step: np.ndarray  # (A, 6) how much else the motion is by it; the first is zero


class Motion(NamedTuple):
    """A motion with all that it may as well be."""

    step: np.ndarray  # (6,)
    covariance: np.ndarray  # (6, 6)
    swings: tuple[Swing, ...]  # of each scan, or of scans that go together
    answers: tuple[np.ndarray, ...]  # (6,) what else it may be: by each scan, or without what may be a cupboard
    keep: np.ndarray = np.zeros((3, 3))  # projection onto the directions of the shift that are fixed; zero if none is

    def fixed(self) -> "Motion":
        """With what its faces fix, by any one pose that its scans may have: the interval holds what it is by others."""
        square, axes = np.linalg.eigh(self.covariance[:3, :3])
        fixed = axes[:, square < FIXED**2]
        return self._replace(keep=fixed @ fixed.T)

    @property
    def turned(self) -> np.ndarray:
        """(3,) [rad] rotation vector of what the faces fix."""
        square, axes = np.linalg.eigh(self.covariance[3:, 3:])
        fixed = axes[:, square < FIXED_TURN**2]
        return fixed @ fixed.T @ self.step[3:]

    @property
    def angles(self) -> tuple[float | None, float | None]:
        """Turn about the vertical, and lean [deg]; None where no face fixes it."""
        spread, turned = self.covariance[3:, 3:], self.turned
        turn = float(np.degrees(turned[2])) if spread[2, 2] < FIXED_TURN**2 else None
        leans = np.linalg.eigvalsh(spread[:2, :2])[0] < FIXED_TURN**2
        return turn, float(np.degrees(np.linalg.norm(turned[:2]))) if leans else None

    def slopes(self, long: float, high: float) -> tuple[Slope, ...]:
        """What its turn puts its ends off over its length [m], and its lean its head over its height [m]; if fixed."""
        ways = np.zeros((2, 6))
        ways[0, 5], ways[1, 3:5] = 1.0, np.linalg.eigh(self.covariance[3:5, 3:5])[1][:, 0]
        return tuple(
            Slope(length * abs(float(np.tan(np.radians(angle)))), length * self._half(way), length)
            for angle, way, length in zip(self.angles, ways, (long, high), strict=True)
            if angle is not None
        )

    def half(self, way: np.ndarray) -> float:
        """[m] by which the fixed part of the shift along a way (3,) may be more or less: so much to either side."""
        along = np.array([*(self.keep @ way), 0.0, 0.0, 0.0])
        return self._half(along) + max((abs(float(along @ (one - self.step))) for one in self.answers), default=0.0)

    def _half(self, along: np.ndarray) -> float:
        """Within how much of it 95 % of what may be lies, along a way (6,): a mixture of normals, by all poses."""
        sigma = float(np.sqrt(max(along @ self.covariance @ along, 0.0)))
        share, place = np.ones(1), np.zeros(1)
        for one in self.swings:  # scans are off each by itself
            share = np.outer(share, one.share).ravel()
            place = np.add.outer(place, one.step @ along).ravel()
            if len(share) > MOST_OPEN:
                kept = np.argsort(-share)[:MOST_OPEN]
                share, place = share[kept] / share[kept].sum(), place[kept]
        low, high = NORMAL * sigma, NORMAL * sigma + float(np.abs(place).max())
        if len(share) == 1 or sigma == 0.0:
            return high
        for _ in range(BISECTED):
            half = (low + high) / 2.0
            inside = float(share @ (ndtr((half - place) / sigma) - ndtr((-half - place) / sigma)))
            low, high = (half, high) if inside < WITHIN else (low, half)
        return high


def telling(
    seen: list[Seen], poses: list[list[PoseError]], sensors: list[np.ndarray], middle: np.ndarray
) -> list[Seen]:
    """The faces of one element that tell of it: without what may be fronts, where other faces fix the same way.

    And without what is turned otherwise than the face on which most rays end: that is an edge, or another thing.
    Arguments are those of `motion_of`.
    """
    if len(seen) > 1:
        seen = [
            one for scan in sorted({one.scan for one in seen}) for one in _rigid(seen, scan, poses, sensors, middle)
        ]
    rest = [one for one in seen if not one.fit.before]
    if not rest or len(rest) == len(seen):
        return seen
    spread = _solved(rest, _loose(rest, poses, sensors), poses, sensors, middle)[1][:3, :3]
    ways = [one.fit.normal for one in seen if one.fit.before]
    return rest if all(way @ spread @ way < FIXED**2 for way in ways) else seen


def _rigid(
    seen: list[Seen], scan: int, poses: list[list[PoseError]], sensors: list[np.ndarray], middle: np.ndarray
) -> list[Seen]:
    """The faces of one scan that are turned as the one with most rays is."""
    own = [one for one in seen if one.scan == scan]
    main = max(own, key=lambda one: one.rays)
    loose = _loose([main], poses, sensors)
    step, spread, _ = _solved([main], loose, poses, sensors, middle)
    pose, sensor, correction = poses[scan][0], sensors[scan], loose[scan][0][0]

    def turns_alike(one: Seen) -> bool:
        (off, arms), rows = rows_of(one.fit, sensor), rows_of(one.fit, middle)[1]
        left = (off + arms @ correction - rows @ step)[1:]
        turned = np.einsum("ij,jk,ik->i", rows[1:, 3:], spread[3:, 3:], rows[1:, 3:])
        sigma = np.sqrt(np.square(scatter(one.fit, pose.place, pose.tilt)[1:]) + turned)
        return bool(np.all(np.abs(left) <= np.maximum(AT_ODDS * sigma, LEAST_BENT)))

    return [one for one in own if one is main or turns_alike(one)]


def motion_of(seen: list[Seen], poses: list[list[PoseError]], sensors: list[np.ndarray], middle: np.ndarray) -> Motion:
    """The motion of one element.

    Args:
        seen: its faces, at least one.
        poses: of each scan, how far off it may be, the likeliest first.
        sensors: of each scan (3,) [m].
        middle: (3,) [m] of the element.
    """
    scans, loose = sorted({one.scan for one in seen}), _loose(seen, poses, sensors)
    best, spread, gains = _solved(seen, loose, poses, sensors, middle)
    swings = _swings(loose, poses, gains)
    answers: tuple[np.ndarray, ...] = ()
    left, sigma = _left_of(seen, loose, best, poses, sensors, middle)
    if len({one.element for one in seen}) > 1:
        # Pieces stand each a little otherwise: where they scatter by more than their faces do, so does their middle.
        spread = spread * max(1.0, float(np.sum(np.square(left / sigma))) / max(len(seen) - FIXED_BY, 1))
    if len(scans) > 1 and np.any(np.abs(left) > AT_ODDS * sigma):
        parts = ([one for one in seen if one.scan == scan] for scan in scans)
        answers = tuple(_solved(part, loose, poses, sensors, middle)[0] for part in parts)
    if any(one.fit.before for one in seen):
        rest = [one for one in seen if not one.fit.before]
        answers += (_solved(rest, loose, poses, sensors, middle)[0] if rest else np.zeros(6),)
    return Motion(best, spread, swings, answers).fixed()


def _swings(
    loose: dict[int, list[Loose]], poses: list[list[PoseError]], gains: dict[int, np.ndarray]
) -> tuple[Swing, ...]:
    found: dict[tuple[int, int], Swing] = {}
    for scan in (one for one in sorted(gains) if len(poses[one]) > 1):
        places = np.stack([place for place, _ in loose[scan]])
        step, among = (places - places[0]) @ gains[scan].T, poses[scan][0].among
        name = (among, -1 if among >= 0 else scan)
        if name in found:
            step = found[name].step + step
        found[name] = Swing(np.array([one.share for one in poses[scan]]), step)
    return tuple(found.values())


def _solved(
    seen: list[Seen],
    loose: dict[int, list[Loose]],
    poses: list[list[PoseError]],
    sensors: list[np.ndarray],
    middle: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, dict[int, np.ndarray]]:
    """The motion (6,), its covariance, and of each scan how it changes with that scan's correction (6, 6).

    Of several scans each has the less to say, the less its pose is known (generalised least squares).
    """
    told, right = np.diag(1.0 / np.square(FREE)), np.zeros(6)
    scans = sorted({one.scan for one in seen})
    # What a surface does to a sensor's ranges it does in every scan: it does not average out.
    root, how = np.sqrt(len(scans)), {}
    for scan in scans:
        pose, sensor, (correction, spread) = poses[scan][0], sensors[scan], loose[scan][0]
        fits = [one.fit for one in seen if one.scan == scan]
        # A body that moves by a step moves its face as far toward the sensor.
        (off, arms), rows = rows_of_all(fits, sensor), rows_of_all(fits, middle)[1].reshape(-1, 6)
        arms, off = arms.reshape(-1, 6), off.ravel()
        sigma = np.concatenate([scatter(fit, pose.place * root, pose.tilt * root) for fit in fits])
        if len(scans) == 1:
            weighted = rows.T / np.square(sigma)
        else:
            weighted = rows.T @ np.linalg.inv(np.diag(np.square(sigma)) + arms @ spread @ arms.T)
        told += weighted @ rows
        right += weighted @ (off + arms @ correction)
        how[scan] = weighted @ arms
    own = np.linalg.inv(told)
    gains = {scan: own @ one for scan, one in how.items()}
    spread = own.copy()
    if len(scans) == 1:  # of several it is in what each has to say
        spread += gains[scans[0]] @ loose[scans[0]][0][1] @ gains[scans[0]].T
    return own @ right, spread, gains


def left_of(
    seen: list[Seen], step: np.ndarray, poses: list[list[PoseError]], sensors: list[np.ndarray], middle: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What faces (F,) are off where a motion (6,) has them [m], and the standard deviation of that [m]."""
    return _left_of(seen, _loose(seen, poses, sensors), step, poses, sensors, middle)


def _left_of(
    seen: list[Seen],
    loose: dict[int, list[Loose]],
    step: np.ndarray,
    poses: list[list[PoseError]],
    sensors: list[np.ndarray],
    middle: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    left, sigma = np.zeros((2, len(seen)))
    for number, one in enumerate(seen):
        pose, (correction, spread) = poses[one.scan][0], loose[one.scan][0]
        off, arms = rows_of(one.fit, sensors[one.scan])
        left[number] = (off + arms @ correction - rows_of(one.fit, middle)[1] @ step)[0]
        variance = scatter(one.fit, pose.place, pose.tilt)[0] ** 2 + arms[0] @ spread @ arms[0]
        sigma[number] = np.sqrt(variance)
    return left, sigma


def _loose(seen: list[Seen], poses: list[list[PoseError]], sensors: list[np.ndarray]) -> dict[int, list[Loose]]:
    """What all faces but the element's own tell of the pose of each scan."""
    return {
        scan: told_by_others([one.fit for one in seen if one.scan == scan], poses[scan], sensors[scan])
        for scan in {one.scan for one in seen}
    }


def told_by_others(own: list[Fit], poses: list[PoseError], sensor: np.ndarray) -> list[Loose]:
    """By each pose that a scan may have: what all faces but those of one element tell of it.

    Of two walls of which one moved, each pose has one in its place, and no witness of that one but itself: it is
    believed where the other pose tells what it is if not, also if other scans ruled that pose out.
    """
    found = [one.without(own, sensor) for one in poses]
    instead = poses[0].instead
    if len(found) + len(instead) > 1:
        arms = np.stack([rows_of(fit, sensor)[1][0] for fit in own])

        def is_open(spread: np.ndarray) -> bool:
            return bool(np.einsum("fi,ij,fj->f", arms, spread, arms).max() > FIXED**2)

        bare = [number for number, (_, spread) in enumerate(found) if is_open(spread)]
        if len(bare) < len(found) or any(not is_open(one.without(own, sensor)[1]) for one in instead if bare):
            for number in bare:
                found[number] = poses[number].without([], sensor)
    return found
