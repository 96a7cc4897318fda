"""Labelled clouds, and training batches drawn from them as a pure function of (seed, step).

Axes: S scenarios, B clouds, N points, F features. Nothing here remembers what was drawn before, so a run that resumes
at step k sees exactly the batches that an undisturbed run would.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from jaxmm.config import SCENARIOS, TRAINED_METHODS
from jaxmm.inputs import InputError
from jaxmm.learning.preprocess import augmentations

LEAST_SHOWN = 10  # testable points of an object, below which its points are no examples of it


class LabelledCloud(NamedTuple):
    """One preprocessed cloud, seen from its own side of the pair; N points, each a real return of the sensor."""

    points: np.ndarray  # (N, 3) float32 [m] world frame
    distance: np.ndarray  # (N,) float32 [m] to the other cloud of the pair; the room's diagonal where that is empty
    element: np.ndarray  # (N,) int32 instance that was hit
    heuristic: np.ndarray  # (N,) bool the thesis's label: a distance threshold, then its cluster filter
    true: np.ndarray  # (N,) bool the return came from the mismatch
    testable: np.ndarray  # (N,) bool prior and reality differ measurably along this very ray
    evidence: np.ndarray  # (N, F) float32, columns as evidence.FEATURES; (N, 0) where none was gathered


def labels_of(cloud: LabelledCloud, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Labels (N,) of one kind, "heuristic", "true" or "object", and where they are void (N,).

    A return from the mismatch that is not testable is void among true labels: by itself nobody could know. Among object
    labels it is as good as the others of its object, and void only where that hardly shows: to learn, not to score.
    """
    if kind == "heuristic":
        return cloud.heuristic, np.zeros(len(cloud.heuristic), bool)
    if kind == "true":
        return cloud.true, cloud.true & ~cloud.testable
    changed = np.flatnonzero(cloud.true)
    _, number = np.unique(cloud.element[changed], return_inverse=True)
    shown = np.bincount(number.ravel(), cloud.testable[changed], len(changed) + 1)
    void = np.zeros(len(cloud.true), bool)
    void[changed] = shown[number.ravel()] < LEAST_SHOWN
    return cloud.true, void


class Batch(NamedTuple):
    """What one joint training step consumes; fixed shapes, padding marked."""

    features: np.ndarray  # (S, B, N, F) float32
    labels: np.ndarray  # (S, B, N) bool; arbitrary where mask is False
    mask: np.ndarray  # (S, B, N) bool; False marks padding
    scored: np.ndarray  # (S, B, N) bool; False also where the label is void: nothing to learn from, nothing to count
    seeds: np.ndarray  # (S, B) uint32, of each cloud's dropout


def features_of(
    method: str, points: np.ndarray, distance: np.ndarray, evidence: np.ndarray | None = None
) -> np.ndarray:
    """The network's input (N, F) float32: the NN distance [m], after absolute coordinates [m] for `xyz_nn`.

    For `xyz` it is the coordinates alone, for `evidence` the evidence itself.

    Raises:
        InputError: it has another width than the method takes, as of clouds that another version made.
    """
    if method == "evidence":
        found = np.asarray(evidence, np.float32)
    elif method == "xyz":
        found = np.asarray(points, np.float32)
    else:
        found = np.asarray(distance, np.float32)[:, None]
        if TRAINED_METHODS[method] > 1:
            found = np.concatenate([np.asarray(points, np.float32), found], axis=1)
    wanted = TRAINED_METHODS[method]
    if found.shape[1:] != (wanted,):
        made = "made without any" if not found.shape[1:] or not found.shape[1] else "made by another version"
        raise InputError(
            f"expected {wanted} features of each point for {method}, got {found.shape[-1] if found.ndim else 0}: the "
            f"clouds were {made}, make them again"
        )
    return found


class Sampler(NamedTuple):
    """Draws the batches of one method. `clouds[s]` are the training clouds of scenario s."""

    clouds: Sequence[Sequence[LabelledCloud]]
    method: str
    label_kind: str  # "heuristic", "true" or "object"
    batch_size: int
    point_count: int  # points per cloud; longer clouds are thinned at random, shorter ones padded
    copies: int  # 4 with the augmented copies of each cloud, else 1
    seed: int
    numbers: tuple[int, ...] | None = None  # of the scenarios, if they are not the first of config.SCENARIOS

    def batch(self, step: int) -> Batch:
        """The batch of training step `step`, counted from 0. Each epoch is a new permutation of clouds and copies."""
        return self.part(step, range(self.batch_size))

    def part(self, step: int, slots: range) -> Batch:
        """Some neighbouring slots of that batch, bit for bit as in the whole: what one of several hosts needs of it."""
        shape = (len(self.clouds), len(slots), self.point_count)
        batch = Batch(
            features=np.zeros((*shape, TRAINED_METHODS[self.method]), np.float32),
            labels=np.zeros(shape, bool),
            mask=np.zeros(shape, bool),
            scored=np.zeros(shape, bool),
            seeds=self._seeds(step)[:, slots.start : slots.stop],
        )
        for row, (scenario, clouds) in enumerate(zip(self.scenarios, self.clouds, strict=True)):
            for slot in slots:
                epoch, place = divmod(step * self.batch_size + slot, len(clouds) * self.copies)
                item = _epoch_order(self.seed, scenario, epoch, len(clouds) * self.copies)[place]
                index, copy = divmod(int(item), self.copies)
                rng = _generator(self.seed, 1, scenario, step, slot)
                cloud = self._moved(clouds[index], scenario, index, copy)
                _fill(batch, (row, slot - slots.start), cloud, (self, scenario), rng)
        return batch

    @property
    def scenarios(self) -> tuple[int, ...]:
        """Numbers of the scenarios: a scenario's draws are its own, whichever others are drawn beside it."""
        return tuple(range(len(self.clouds))) if self.numbers is None else self.numbers

    def _seeds(self, step: int) -> np.ndarray:
        shape = (max(self.scenarios) + 1, self.batch_size)  # filled row by row: more rows change none before them
        return _generator(self.seed, 0, step).integers(0, 2**32, shape, np.uint32)[list(self.scenarios)]

    def _moved(self, cloud: LabelledCloud, scenario: int, index: int, copy: int) -> LabelledCloud:
        """Copy 0 is the cloud itself; 1 to 3 are its fixed augmentations."""
        if copy == 0:
            return cloud
        moves = augmentations(_generator(self.seed, 2, scenario, index))
        return cloud._replace(points=moves[copy - 1].apply(cloud.points))


def validation_batch(
    clouds: Sequence[Sequence[LabelledCloud]],
    method: str,
    label_kind: str,
    point_count: int,
    numbers: tuple[int, ...] | None = None,
) -> Batch:
    """All validation clouds as one batch, B the most of any scenario; thinned to at most `point_count` points."""
    shape = (len(clouds), max(map(len, clouds)), point_count)
    batch = Batch(
        np.zeros((*shape, TRAINED_METHODS[method]), np.float32),
        np.zeros(shape, bool),
        np.zeros(shape, bool),
        np.zeros(shape, bool),
        np.zeros(shape[:2], np.uint32),
    )
    sampler = Sampler(clouds, method, label_kind, shape[1], point_count, 1, 0, numbers)
    for row, (scenario, members) in enumerate(zip(sampler.scenarios, clouds, strict=True)):
        for slot, cloud in enumerate(members):
            _fill(batch, (row, slot), cloud, (sampler, scenario), _generator(0, 3, scenario, slot))
    return batch


def _fill(
    batch: Batch, place: tuple[int, int], cloud: LabelledCloud, drawn: tuple[Sampler, int], rng: np.random.Generator
) -> None:
    (sampler, scenario), count = drawn, len(cloud.points)
    chosen = np.arange(count) if count <= sampler.point_count else rng.permutation(count)[: sampler.point_count]
    labels, void = labels_of(cloud, _kind_of(sampler.label_kind, scenario))
    batch.features[place][: len(chosen)] = features_of(
        sampler.method, cloud.points[chosen], cloud.distance[chosen], cloud.evidence[chosen]
    )
    batch.labels[place][: len(chosen)] = labels[chosen]
    batch.mask[place][: len(chosen)] = True
    batch.scored[place][: len(chosen)] = ~void[chosen]


def _kind_of(kind: str, scenario: int) -> str:
    """Object labels are for what the robot saw; of what the prior says, only rays can tell whether it is gone."""
    return "true" if kind == "object" and SCENARIOS[scenario].endswith("removed") else kind


@lru_cache(maxsize=64)
def _epoch_order(seed: int, scenario: int, epoch: int, count: int) -> np.ndarray:
    return _generator(seed, 4, scenario, epoch).permutation(count)


def _generator(*key: int) -> np.random.Generator:
    return np.random.default_rng(key)
