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
from jaxmm.deviations.meetings import STEEP
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
MOST_STARTS = 128  # poses that are tried against what the others of all scans make of them, the likeliest
MAY_BE_OFF = 3.0  # standard deviations, from which on it is asked whether an element moved


class _Scan(NamedTuple):
    """What the faces of one scan say by each pose that it may have."""

    candidates: list[PoseError]
    cost: np.ndarray  # (A,) of each pose, its own faces in the model: negative log likelihood, as every cost here
    off: np.ndarray  # (A, G, 3) [m, rad, rad] levels and slopes by it
    variance: np.ndarray  # (A, G, 3) [m2, rad2, rad2] of these, and of the pose
    alone: np.ndarray  # (A, G) what each face costs in `cost`
    rows: np.ndarray  # (G, 3, 6) how they change with a motion of their element
    element: np.ndarray  # (G,) int


class _Moved(NamedTuple):
    """An element that all scans have elsewhere."""

    step: np.ndarray  # (6,) [m, rad] shift and turn about the middle of its faces
    covariance: np.ndarray  # (6, 6) [m, rad, squared]
    cost: float  # of its having moved


# An element, the scans that show it with a pose of each, and whether that is one scan by itself.
_Key = tuple[int, tuple[tuple[int, int], ...], bool]


class _Answer(NamedTuple):
    """Poses of all scans."""

    cost: float
    chosen: tuple[int, ...]  # (S,)


def agreed(shown: list[Faces]) -> list[Faces]:
    """What scans show, the poses of each in the order in which they are likely by all of them.

    Where several scans have other poses at once or not at all, their lists go together, place by place (`among`).
    """
    if len(shown) > 1 and any(len(one.poses) + len(one.unlikely) > 1 for one in shown):
        shown = _agreed(shown)
    doubted = [_is_at_odds(one) for one in shown]
    if not any(doubted):
        return shown
    return [with_poses(one, [_undecided(one)]) if no else one for one, no in zip(shown, doubted, strict=True)]


def _is_at_odds(one: Faces) -> bool:
    """Whether no more upright faces speak for the likeliest pose of a scan than against it, and others may be."""
    votes = one.poses[0].votes
    if len(one.poses) < 2 or not len(votes):
        return False
    upright = [each.fit.number for each in one.seen if each.fit.number >= 0 and abs(each.fit.normal[2]) <= STEEP]
    return bool(2 * np.sum(votes[upright] > 0.5) <= len(upright))


def _undecided(one: Faces) -> PoseError:
    """What tells of the pose of a scan without those faces that have a vote by some of its poses alone."""
    votes = np.stack([pose.votes > 0.5 for pose in one.poses])
    among = np.flatnonzero(votes.any(axis=0) & ~votes.all(axis=0))
    pose = one.poses[0]
    told, right = pose.told_without([each.fit for each in one.seen if each.fit.number in among], one.sensor)
    kept = pose.votes.copy()
    kept[among] = 0.0
    return pose._replace(told=told, right=right, votes=kept, share=1.0, among=-1)


def _agreed(shown: list[Faces]) -> list[Faces]:
    scans = _scans(shown)
    known = _Known(scans)
    found = [_descent(known, None, known.moved(dict.fromkeys(range(len(scans)), 0)))]
    for number, pose in _starts(shown):
        # As this scan by itself has it by this pose: what the others make of it is seen then.
        found.append(_descent(known, (number, pose), known.moved({number: pose})))
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


def _starts(shown: list[Faces]) -> list[tuple[int, int]]:
    """Scans, and poses of those that may have several, to begin from.

    Of too many those are left out that are least likely by their scans, and first the likeliest of each scan: from
    these all begin. What is not begun from is not told to be open.
    """
    every = [(number, pose) for number, one in enumerate(shown) if len(one.poses) > 1 for pose in range(len(one.poses))]
    if len(every) <= MOST_STARTS:
        return every
    weight = np.array([shown[number].poses[pose].share + (pose > 0) for number, pose in every])
    # By how likely they are, and no other order: that of the scans must not matter.
    return [one for one, likely in zip(every, weight >= np.sort(weight)[-MOST_STARTS], strict=True) if likely]


class _Known:
    """What was worked out: how an element moved by the poses of the scans that show it, and what that costs each scan.

    Answers that are tried differ in few poses; of elements that only other scans show, all is known then.
    """

    def __init__(self, scans: list[_Scan]):
        self._scans = scans
        self._faces: list[dict[int, np.ndarray]] = []  # of each scan, by element: numbers (F,) of its faces
        self._off: list[list[set[int]]] = []  # of each scan, by pose: elements that may be off
        self._by: dict[int, list[int]] = {}  # element -> scans that show it
        for number, one in enumerate(scans):
            own = {element: np.flatnonzero(one.element == element) for element in np.unique(one.element).tolist()}
            square = (np.square(one.off) / one.variance).max(axis=2)
            self._faces.append(own)
            self._off.append([set(one.element[far].tolist()) for far in square > MAY_BE_OFF**2])
            for element in own:
                self._by.setdefault(element, []).append(number)
        self._moved: dict[_Key, _Moved | None] = {}
        self._changes: dict[tuple[int, _Key], np.ndarray] = {}
        self._answers: dict[tuple[int, ...], tuple[_Answer, list[np.ndarray]]] = {}

    def moved(self, chosen: dict[int, int]) -> dict[int, _Key]:
        """The elements that moved by some scans, with a pose of each; by one scan, those that may have."""
        found = {}
        for element in sorted(set().union(*(self._off[one][pose] for one, pose in chosen.items()))):
            key = element, tuple((one, chosen[one]) for one in self._by[element] if one in chosen), len(chosen) == 1
            if key not in self._moved:
                self._moved[key] = self._motion(*key)
            if self._moved[key] is not None:
                found[element] = key
        return found

    def answer(self, chosen: tuple[int, ...]) -> tuple[_Answer, list[np.ndarray]]:
        """What poses (S,) of all scans cost, and the `costs` of all by what then moved."""
        if chosen not in self._answers:
            moved = self.moved(dict(enumerate(chosen)))
            costs = self.costs(moved)
            total = sum(float(one[pose]) for one, pose in zip(costs, chosen, strict=True))
            total += sum(there.cost for key in moved.values() if (there := self._moved[key]) is not None)
            self._answers[chosen] = _Answer(total, chosen), costs
        return self._answers[chosen]

    def costs(self, moved: dict[int, _Key]) -> list[np.ndarray]:
        """Of each scan (A,) what its poses cost, if some elements moved."""
        found = []
        for number, (scan, own) in enumerate(zip(self._scans, self._faces, strict=True)):
            changes = [self._change(number, moved[element]) for element in own if element in moved]
            found.append(scan.cost + np.sum(changes, axis=0) if changes else scan.cost)
        return found

    def _change(self, number: int, key: _Key) -> np.ndarray:
        """(A,) what it changes of a scan's poses that one element moved."""
        if (number, key) not in self._changes:
            scan, mine, there = self._scans[number], self._faces[number][key[0]], self._moved[key]
            left = _left(scan.off[:, mine], scan.variance[:, mine], scan.rows[mine], there)
            self._changes[number, key] = (left - scan.alone[:, mine]).sum(axis=1)
        return self._changes[number, key]

    def _motion(self, element: int, chosen: tuple[tuple[int, int], ...], is_alone: bool) -> _Moved | None:
        faces = [(one, pose, self._faces[one][element]) for one, pose in chosen]
        off = np.concatenate([self._scans[one].off[pose, mine] for one, pose, mine in faces])
        variance = np.concatenate([self._scans[one].variance[pose, mine] for one, pose, mine in faces])
        rows = np.concatenate([self._scans[one].rows[mine] for one, _, mine in faces])
        there = _motion(off, variance, rows, np.concatenate([np.full(len(mine), one) for one, _, mine in faces]))
        cost = there.cost + float(_left(off, variance, rows, there).sum())
        square = (np.square(off) / variance).max(axis=1)
        return there if is_alone or cost < float(surprise(square).sum()) else None


def _descent(known: _Known, kept: tuple[int, int] | None, moved: dict[int, _Key]) -> _Answer:
    """The likeliest poses by what moved, and what moved by these, in turns; of one scan the pose may be kept."""
    best, costs = _Answer(np.inf, ()), known.costs(moved)
    for _ in range(ROUNDS):
        chosen = [int(np.argmin(one)) for one in costs]
        if kept is not None:
            chosen[kept[0]] = kept[1]
        now, costs = known.answer(tuple(chosen))
        if now.cost >= best.cost - 1e-9:
            break
        best = now
    return best


def _left(off: np.ndarray, variance: np.ndarray, rows: np.ndarray, moved: _Moved) -> np.ndarray:
    """(..., F) what faces (..., F, 3) cost where their element moved."""
    spread = ((rows @ moved.covariance) * rows).sum(axis=-1)
    return surprise((np.square(off - rows @ moved.step) / (variance + spread)).max(axis=-1))


def _motion(off: np.ndarray, variance: np.ndarray, rows: np.ndarray, scan: np.ndarray) -> _Moved:
    """How one element moved, by what most of its faces (F, 3) in some scans (F,) agree on."""
    scaled = rows / variance[..., None]
    info, right = scaled.swapaxes(1, 2) @ rows, (scaled.swapaxes(1, 2) @ off[..., None])[..., 0]
    steps, spreads = _least_squares((np.unique(scan)[:, None] == scan).astype(np.float64), info, right)
    wide = variance + np.einsum("gij,sjk,gik->sgi", rows, spreads, rows, optimize=True)
    apart = np.square(off - np.einsum("gij,sj->sgi", rows, steps))
    best = steps[np.argmin(surprise((apart / wide).max(axis=2)).sum(axis=1))]
    votes = votes_of((np.square(off - rows @ best) / variance).max(axis=1))
    steps, spreads = _least_squares(votes[None], info, right)
    # As of one face that moved: by millimetres or by decimetres, one as likely as the other.
    far = np.sqrt((np.square(off) / variance * (votes[:, None] > 0.5)).max(initial=1.0))
    return _Moved(steps[0], spreads[0], float(np.log(2.0 * SIZES * far / MOVED)))


def _least_squares(votes: np.ndarray, info: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Motions (S, 6) and their covariances (S, 6, 6), by votes (S, F) of faces with normal equations of each."""
    told = (votes @ info.reshape(len(info), 36)).reshape(-1, 6, 6)
    spread = np.linalg.inv(told + np.diag(1.0 / np.square(FREE)))
    return (spread @ (votes @ right)[..., None])[..., 0], spread


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
