"""Poses of several scans that agree on what moved: where one scan leaves open which of two walls did, others tell.

S scans, A poses that one may have, G faces of one scan, F faces of one element in all scans. Positions are offsets from
the prior's origin, world axes: metres, z up.

Each scan by itself tells how far its pose may be off, and by each such pose what moved. An element stands at one place,
whoever looks: of all scans together that is the likeliest by which few elements moved, and each moved alike in all
(elements and poses are solved in turns, as in block coordinate descent, from what each scan by itself has). What else
is about as likely stays, as that several scans have other poses at once.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.deviations.element_motion import FREE, Seen, told_by_others
from jaxmm.deviations.pose_errors import (
    AS_GOOD,
    MOVED,
    SIZES,
    PoseError,
    rows_of,
    rows_of_all,
    scatter,
    surprise,
    votes_of,
)
from jaxmm.deviations.seen_surfaces import Faces

ROUNDS = 8
MAY_BE_OFF = 3.0  # standard deviations, from which on it is asked whether an element moved


class _Scan(NamedTuple):
    """What the faces of one scan say by each pose that it may have."""

    candidates: list[PoseError]
    cost: np.ndarray  # (A,) of each pose, its own faces in the model
    off: np.ndarray  # (A, G, 3) [m] levels and slopes by it
    variance: np.ndarray  # (A, G, 3) of these, and of the pose
    alone: np.ndarray  # (A, G) what each face costs in `cost`
    rows: np.ndarray  # (G, 3, 6) how they change with a motion of their element
    element: np.ndarray  # (G,) int


class _Moved(NamedTuple):
    """An element that all scans have elsewhere."""

    step: np.ndarray  # (6,)
    covariance: np.ndarray  # (6, 6)
    cost: float  # of its having moved


class _Answer(NamedTuple):
    """Poses of all scans."""

    cost: float
    chosen: tuple[int, ...]  # (S,)


def agreed(shown: list[Faces]) -> list[Faces]:
    """What scans show, the poses of each in the order in which they are likely by all of them.

    Where several scans have other poses at once or not at all, their lists go together, place by place (`among`).
    """
    if len(shown) < 2 or not any(len(one.poses) + len(one.unlikely) > 1 for one in shown):
        return shown
    scans = _scans(shown)
    found = [_descent(scans, None, _moved(scans, dict.fromkeys(range(len(scans)), 0)))]
    for number, one in enumerate(shown):
        for pose in range(len(one.poses)) if len(one.poses) > 1 else ():
            # As this scan by itself has it by this pose: what the others make of it is seen then.
            found.append(_descent(scans, (number, pose), _moved(scans, {number: pose})))
    found.sort()
    best = found[0]
    others: dict[tuple[int, ...], float] = {}
    for one in found[1:]:
        if one.cost <= best.cost + AS_GOOD and one.chosen != best.chosen:
            others.setdefault(one.chosen, one.cost)
    poses = [[scan.candidates[number]._replace(share=1.0)] for scan, number in zip(scans, best.chosen, strict=True)]
    for together in _clusters(best.chosen, list(others)):
        cost = np.array([best.cost, *(others[one] for one in together)])
        share = np.exp(best.cost - cost)
        share /= share.sum()
        mine = [number for number in range(len(scans)) if any(one[number] != best.chosen[number] for one in together)]
        for number in mine:
            poses[number] = [
                scans[number].candidates[one[number]]._replace(share=float(part), among=mine[0])
                for one, part in zip([best.chosen, *together], share, strict=True)
            ]
    for number, (one, own) in enumerate(zip(shown, poses, strict=True)):
        kept = {best.chosen[number], *(each[number] for each in others)}
        instead = tuple(pose for place, pose in enumerate(one.poses) if place not in kept)
        poses[number] = [pose._replace(instead=instead) for pose in own]
    return [with_poses(one, own) for one, own in zip(shown, poses, strict=True)]


def with_poses(one: Faces, poses: list[PoseError]) -> Faces:
    """The same scan, its pose told by others as well; what its surfaces are off, by the likeliest."""
    if np.array_equal(one.poses[0].told, poses[0].told) and np.array_equal(one.poses[0].right, poses[0].right):
        return one._replace(poses=poses)
    own: dict[int, list[Seen]] = {}
    for each in one.seen:
        own.setdefault(each.element, []).append(each)
    change = {}
    for element, seen in own.items():
        fits = [each.fit for each in seen]
        now, before = (told_by_others(fits, each, one.sensor)[0][0] for each in (poses, one.poses))
        change[element] = now - before
    return one._replace(poses=poses, seen=[each.moved_by(change[each.element], one.sensor) for each in one.seen])


def _scans(shown: list[Faces]) -> list[_Scan]:
    places: dict[int, list[np.ndarray]] = {}
    for one in shown:
        for each in one.seen:
            places.setdefault(each.element, []).append(each.fit.middle)
    about = {element: np.mean(middles, axis=0) for element, middles in places.items()}
    found = []
    for one in shown:
        fits, candidates = [each.fit for each in one.seen], [*one.poses, *one.unlikely]
        level, arms = rows_of_all(fits, one.sensor)
        rows = np.array([rows_of(each.fit, about[each.element])[1] for each in one.seen]).reshape(-1, 3, 6)
        off = np.stack([level + arms @ pose.correction for pose in candidates])
        usual = candidates[0]
        own = np.square([scatter(fit, usual.place, usual.tilt) for fit in fits]).reshape(-1, 3)
        of_pose = np.stack([np.einsum("gij,jk,gik->gi", arms, pose.covariance, arms) for pose in candidates])
        found.append(_Scan(
            candidates, -np.log([pose.share for pose in candidates]), off, own + of_pose,
            surprise((np.square(off) / own).max(axis=2)), rows, np.array([each.element for each in one.seen], int),
        ))  # fmt: skip
    return found


def _descent(scans: list[_Scan], kept: tuple[int, int] | None, moved: dict[int, _Moved]) -> _Answer:
    """The likeliest poses by what moved, and what moved by these, in turns; of one scan the pose may be kept."""
    best = _Answer(np.inf, ())
    for _ in range(ROUNDS):
        costs = [_costs(one, moved) for one in scans]
        chosen = [int(np.argmin(one)) for one in costs]
        if kept is not None:
            chosen[kept[0]] = kept[1]
        moved = _moved(scans, dict(enumerate(chosen)))
        total = sum(float(_costs(one, moved)[pose]) for one, pose in zip(scans, chosen, strict=True))
        now = _Answer(total + sum(one.cost for one in moved.values()), tuple(chosen))
        if now.cost >= best.cost - 1e-9:
            break
        best = now
    return best


def _costs(scan: _Scan, moved: dict[int, _Moved]) -> np.ndarray:
    """(A,) of each pose of one scan, if some elements moved."""
    cost = scan.cost
    for element in sorted(set(scan.element.tolist()) & moved.keys()):
        mine = scan.element == element
        there = _left(scan.off[:, mine], scan.variance[:, mine], scan.rows[mine], moved[element])
        cost = cost + (there - scan.alone[:, mine]).sum(axis=1)
    return cost


def _left(off: np.ndarray, variance: np.ndarray, rows: np.ndarray, moved: _Moved) -> np.ndarray:
    """(..., F) what faces (..., F, 3) cost where their element moved."""
    spread = np.einsum("gij,jk,gik->gi", rows, moved.covariance, rows)
    return surprise((np.square(off - rows @ moved.step) / (variance + spread)).max(axis=-1))


def _moved(scans: list[_Scan], chosen: dict[int, int]) -> dict[int, _Moved]:
    """The elements that moved by some scans, with a pose of each; by one scan, those that may have."""
    off = np.concatenate([scans[one].off[pose] for one, pose in chosen.items()])
    variance = np.concatenate([scans[one].variance[pose] for one, pose in chosen.items()])
    rows = np.concatenate([scans[one].rows for one in chosen])
    element = np.concatenate([scans[one].element for one in chosen])
    scan = np.concatenate([np.full(len(scans[one].element), one) for one in chosen])
    square = (np.square(off) / variance).max(axis=1, initial=0.0)
    found = {}
    for one in np.unique(element[square > MAY_BE_OFF**2]).tolist():
        mine = element == one
        there = _motion(off[mine], variance[mine], rows[mine], scan[mine])
        cost = there.cost + float(_left(off[mine], variance[mine], rows[mine], there).sum())
        if len(chosen) == 1 or cost < float(surprise(square[mine]).sum()):
            found[one] = there
    return found


def _motion(off: np.ndarray, variance: np.ndarray, rows: np.ndarray, scan: np.ndarray) -> _Moved:
    """How one element moved, by what most of its faces (F, 3) in some scans (F,) agree on."""
    best, least = None, np.inf
    for one in np.unique(scan).tolist():
        there = _least_squares(off, variance, rows, (scan == one).astype(np.float64))
        cost = float(_left(off, variance, rows, there).sum())
        if cost < least:
            best, least = there, cost
    votes = votes_of((np.square(off - rows @ best.step) / variance).max(axis=1))
    return _least_squares(off, variance, rows, votes)


def _least_squares(off: np.ndarray, variance: np.ndarray, rows: np.ndarray, votes: np.ndarray) -> _Moved:
    weight = votes[:, None] / variance
    spread = np.linalg.inv(np.einsum("gi,gij,gik->jk", weight, rows, rows) + np.diag(1.0 / np.square(FREE)))
    step = spread @ np.einsum("gi,gij,gi->j", weight, rows, off)
    # As of one face that moved: by millimetres or by decimetres, one as likely as the other.
    far = np.sqrt((np.square(off) / variance * (votes[:, None] > 0.5)).max(initial=1.0))
    return _Moved(step, spread, float(np.log(2.0 * SIZES * far / MOVED)))


def _clusters(best: tuple[int, ...], others: list[tuple[int, ...]]) -> list[list[tuple[int, ...]]]:
    """Answers that some scan has to do with at once, each in one list."""
    lists: list[tuple[set[int], list[tuple[int, ...]]]] = []
    for one in others:
        mine, own = {number for number, (a, b) in enumerate(zip(best, one, strict=True)) if a != b}, [one]
        apart = []
        for scans, answers in lists:
            if scans & mine:
                mine, own = mine | scans, [*answers, *own]
            else:
                apart.append((scans, answers))
        lists = [*apart, (mine, own)]
    return [own for _, own in lists]
