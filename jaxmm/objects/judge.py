"""What a candidate is: nothing, a pillar or a wall. C candidates, F clues, T rounds of trees, K kinds.

Gradient-boosted trees (J. H. Friedman, "Greedy function approximation: a gradient boosting machine", Annals of
Statistics 29, 2001) that learned it from candidates of generated rooms, see object_training.py. They are kept as plain
arrays, so that a file of them is data and no program.
"""

import functools
from pathlib import Path
from typing import NamedTuple

import numpy as np
import safetensors
import safetensors.numpy
from scipy.special import softmax

from jaxmm.files import write_atomically
from jaxmm.inputs import InputError, one_line
from jaxmm.objects.clues import CLUES
from jaxmm.weights import OBJECTS

LOW = (2.4, 2.8)  # [m] from floor to ceiling, up to which rooms are of the first, and of the second band
KINDS = ("nothing", "pillar", "wall")


class ObjectJudge(NamedTuple):
    """Whole binary trees of depth D: from node n a candidate goes on to node 2 n + 1, or 2 n + 2 if its clue is larger.

    A score is the sum of the leaves that a candidate comes to, and probabilities are their softmax.
    """

    start: np.ndarray  # (K,) float32 scores before all trees
    clue: np.ndarray  # (T, K, 2^D - 1) uint8 index into CLUES
    limit: np.ndarray  # (T, K, 2^D - 1) float32; inf where a tree ends early, so that the first leaf below counts
    leaf: np.ndarray  # (T, K, 2^D) float32
    low: np.ndarray  # (T,) uint8: 0 for rounds that count everywhere, else the band of LOW that they count in alone


def judge_objects(judge: ObjectJudge, clues: np.ndarray) -> np.ndarray:
    """Probability (C, K) of each of KINDS, from the clues (C, F)."""
    clues = np.asarray(clues, np.float32)
    row, rounds, kind = np.ogrid[: len(clues), : len(judge.leaf), : len(judge.start)]
    node = np.zeros((len(clues), *judge.leaf.shape[:2]), np.int64)
    inner = judge.limit.shape[2]
    for _ in range((inner + 1).bit_length() - 1):
        larger = clues[row, judge.clue[rounds, kind, node]] > judge.limit[rounds, kind, node]
        node = 2 * node + 1 + larger
    leaf = judge.leaf[rounds, kind, node - inner]
    if judge.low.any():
        leaf[(judge.low != 0) & (judge.low != band_of(clues)[:, None])] = 0.0
    return softmax(judge.start + leaf.sum(axis=1, dtype=np.float64), axis=1)


def height_of(clues: np.ndarray) -> np.ndarray:
    """(C,) [m] of the rooms of candidates, by the clues (C, F): how high these reach, and what is left above."""
    return clues[:, CLUES.index("top")] + clues[:, CLUES.index("left")]


def band_of(clues: np.ndarray) -> np.ndarray:
    """(C,) int: the band of LOW that the room of each candidate is in, 1 or 2; 0: it is higher."""
    return (np.searchsorted(np.float32(LOW), height_of(clues)) + 1) % (len(LOW) + 1)


def of_rounds(judge: ObjectJudge, which: np.ndarray) -> ObjectJudge:
    """With those of its rounds alone that `which` (T,) names."""
    return ObjectJudge(judge.start, *(field[which] for field in judge[1:]))


def save_judge(judge: ObjectJudge, path: Path, metadata: dict[str, str]) -> None:
    """Write it as safetensors, a tensor for each field."""
    content = safetensors.numpy.save(judge._asdict(), metadata | {"clues": " ".join(CLUES)})
    write_atomically(path, lambda temporary: temporary.write_bytes(content))


def load_judge(path: Path) -> ObjectJudge:
    """Read what `save_judge` wrote.

    Raises:
        InputError: it is not a whole file of ours, or it was trained on other clues.
    """
    try:
        with safetensors.safe_open(path, framework="numpy") as file:
            told = (file.metadata() or {}).get("clues", "")
            tensors = {name: file.get_tensor(name) for name in file.keys()}
    except (safetensors.SafetensorError, OSError, TypeError) as error:
        raise InputError(f"{path}: not a whole safetensors file: {one_line(error)}") from error
    if told.split() != list(CLUES) or tensors.keys() != set(ObjectJudge._fields):
        raise InputError(f"{path}: expected a judge of objects by the {len(CLUES)} clues of this version, got {told!r}")
    judge = ObjectJudge(**tensors)
    if not _fits(judge):
        raise InputError(f"{path}: expected trees for {len(KINDS)} kinds whose parts agree, got {_shapes(judge)}")
    return judge


def _fits(judge: ObjectJudge) -> bool:
    """Whether shapes, types and values are those of trees."""
    shape = judge.leaf.shape
    if judge.start.shape != (len(KINDS),) or len(shape) != 3 or shape[1] != len(KINDS) or shape[2].bit_count() != 1:
        return False
    if not judge.clue.shape == judge.limit.shape == (*shape[:2], shape[2] - 1):
        return False
    if judge.low.shape != shape[:1] or judge.low.dtype != np.uint8 or np.any(judge.low > len(LOW)):
        return False
    if judge.clue.dtype != np.uint8 or any(one.dtype != np.float32 for one in (judge.start, judge.limit, judge.leaf)):
        return False
    finite = np.isfinite(judge.start).all() and np.isfinite(judge.leaf).all() and not np.isnan(judge.limit).any()
    return bool(finite and np.all(judge.clue < len(CLUES)))


def _shapes(judge: ObjectJudge) -> str:
    return ", ".join(f"{name} {array.dtype} {array.shape}" for name, array in judge._asdict().items())


@functools.cache
def default_judge() -> ObjectJudge:
    """The one that is shipped, read once."""
    return load_judge(OBJECTS)
