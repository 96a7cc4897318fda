"""Trains the judge of objects on candidates of generated rooms.

    python -m jaxmm.runs.object_training --out jaxmm/weights/objects.safetensors [--rooms 30000] [--draws DIR]

K candidates, F clues. What each of them is, is known: the true object whose box holds most of its points. The first
MIXED draws of rooms are of all kinds: small things and large ones, walls free or against others, straight rooms and
turned ones; priors are buildings and clouds. The others are plain ones, as those that benchmarks measure, so fewer
rooms than the default are less plain. All of them are with and without furniture, with one change, many or none;
sensors are ideal, as built, and spinning; ranges settle first, as in `detect`. A tenth of the rooms is kept
from training, to say how well it does. Where draws of rooms are kept, the same command goes on with those that are
missing.
"""

import argparse
import hashlib
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.ensemble import GradientBoostingClassifier

from jaxmm.config import CONDITIONS, MULTI_SCENARIOS, SCENARIOS, UNCHANGED
from jaxmm.files import load_arrays, write_arrays
from jaxmm.inputs import InputError
from jaxmm.learning.boxes import MISMATCH_TYPES, Box
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.learning.upright_shapes import outside
from jaxmm.objects.clues import CLUES
from jaxmm.objects.finder import ObjectSettings, examine
from jaxmm.objects.judge import KINDS, ObjectJudge, judge_objects, of_rounds, save_judge
from jaxmm.objects.main_directions import QUARTER
from jaxmm.objects.walls import KnownBuilding
from jaxmm.progress import bar_of
from jaxmm.rays.range_noise import settled
from jaxmm.rays.scan_rays import rays_of_scan
from jaxmm.runs.room_scans import RoomCase, as_cloud, room_cases, true_boxes
from jaxmm.verdicts.scan_fusion import judged_side
from jaxmm.verdicts.station_steps import look_at
from jaxmm.versions import versions
from jaxmm.weights import DEFAULT
from warp_scanner.cores import worker_pool
from warp_scanner.rooms.scenarios import CROWDED

SEED = 4  # of the rooms: of no other training, validation or test
AT_ONCE = 20  # rooms of one draw
ADDING = tuple(name for name in (*SCENARIOS, *MULTI_SCENARIOS) if "removed" not in name or "added" in name)
SCENES = (*ADDING, *8 * (CROWDED,), *3 * (UNCHANGED,))  # against a building nobody looks for removed objects
CLOUD_SCENES = (*SCENARIOS, *MULTI_SCENARIOS, UNCHANGED, UNCHANGED)
MIXED = 410  # draws, the first ones, of all kinds of rooms; the others are plain
TOUCHING = ("never", "never", "never", "never", "structure", "walls")
KINDS_OF_ROOM = (*4 * ("varied",), "thesis")
SENSORS = (*6 * ("oak-d-pro-small",), "oak-d-pro-small-real", "ouster-64")
CLOUDS = 0.1  # share of draws whose prior is a cloud
SMALL = 0.3  # and with smaller things: buildings have columns below 0.3 m and walls below 1.5 m
SMALL_WALLS = (0.8, 3.5)  # [m] lengths of changed ones
SMALL_ROOM = {
    "pillar_width": (0.15, 0.9), "wall_count_x": (1, 5), "wall_count_y": (1, 5), "wall_least_spacing": 1.0,
    "wall_randomness": (0.5, 1.0), "wall_density": (0.4, 0.8),
}  # fmt: skip
STRAIGHT = 0.4  # and in which all walls and columns stand along the shell, as in most buildings
STRAIGHT_ROOM = {"wall_rotation": (0.0, 0.0), "pillar_rotation": (0.0, 0.0)}
ANYHOW = 0.4  # share of those rooms in which what is new is turned against the building
WITHIN = 0.12  # [m] of a box a point may be off
ROUNDS, RATE, DEPTH, SHARE, CLUES_AT_ONCE, LEAST = 500, 0.05, 6, 0.7, 10, 40
KEPT = 10  # every so many draws one is kept from training


class Examples(NamedTuple):
    """Candidates with what they are."""

    clues: np.ndarray  # (K, F)
    kind: np.ndarray  # (K,) int index into KINDS


class Draw(NamedTuple):
    """What AT_ONCE rooms have in common, and how each is looked at."""

    scene: str
    condition: str
    of_cloud: bool
    changed: dict[str, Any]  # settings for `room_cases`
    turned: np.ndarray  # (AT_ONCE,) [rad] added to the directions of each building before clues are taken; 0: as it is


def drawn(number: int) -> Draw:
    """The settings of a draw."""
    draw = np.random.default_rng((SEED, number))
    return mixed(draw) if number < MIXED else plain(draw)


def plain(draw: np.random.Generator) -> Draw:
    """Of rooms as benchmarks measure."""
    scene, condition, sensor = (str(draw.choice(names)) for names in (SCENES, CONDITIONS, SENSORS))
    return Draw(scene, condition, False, {"preset": "varied", "sensor": sensor, "room": {}}, np.zeros(AT_ONCE))


def mixed(draw: np.random.Generator) -> Draw:
    """Of rooms of all kinds."""
    of_cloud = bool(draw.random() < CLOUDS)
    scenes = CLOUD_SCENES if of_cloud else SCENES
    scene, condition, kind, sensor, touching = (
        str(draw.choice(names)) for names in (scenes, CONDITIONS, KINDS_OF_ROOM, SENSORS, TOUCHING)
    )
    changed: dict[str, Any] = {"preset": kind, "sensor": sensor, "touching": touching, "room": {}}
    if of_cloud and condition == "occluded" and draw.random() < 0.5:
        changed["prior_furniture"] = "moved"
    if draw.random() < SMALL:
        changed |= {"wall_length": SMALL_WALLS, "room": SMALL_ROOM}
    is_straight = bool(draw.random() < STRAIGHT)
    if is_straight:
        changed["room"] = changed["room"] | STRAIGHT_ROOM
    turned = np.where(draw.random(AT_ONCE) < ANYHOW * is_straight, draw.uniform(0.0, QUARTER, AT_ONCE), 0.0)
    return Draw(scene, condition, of_cloud, changed, turned)


def examples_of_draw(number: int) -> Examples:
    """The candidates of AT_ONCE rooms."""
    return examples_of_rooms(drawn(number), SEED, number)


def examples_of_rooms(draw: Draw, seed: int, number: int) -> Examples:
    """The same of any draw, its rooms those of a number among all of a seed."""
    judges, rooms = read_judges(DEFAULT), range(number * AT_ONCE, (number + 1) * AT_ONCE)
    cases = room_cases(draw.scene, draw.condition, seed, rooms, **draw.changed)
    return joined([_examples_of_room(case, judges, draw) for case in cases])


def kept_examples(path: Path | None, make: Callable[[int], Examples], number: int) -> Examples:
    """What `make` gives of a number, read from a file where it is there, else written to it; None: of no file."""
    if path and path.exists():
        return Examples(**load_arrays(path))
    made = make(number)
    if path:
        write_arrays(path, made._asdict())
    return made


def kept_draw(folder: Path | None, number: int) -> Examples:
    """The candidates of AT_ONCE rooms, kept in a folder; None: in none."""
    return kept_examples(folder and folder / f"{number:06d}.npz", examples_of_draw, number)


class _Learnt(ClassifierMixin, BaseEstimator):
    """Whether something is nothing, as a judge says it: further trees go on from there."""

    def __init__(self, judge: ObjectJudge):
        self.judge = judge

    def fit(self, clues: np.ndarray, kind: np.ndarray, sample_weight: np.ndarray | None = None) -> "_Learnt":
        """Nothing more is learnt."""
        self.classes_ = np.arange(2)
        return self

    def predict_proba(self, clues: np.ndarray) -> np.ndarray:
        """Probability (K, 2) that it is something, and that it is nothing."""
        nothing = judge_objects(self.judge, clues)[:, :1]
        return np.hstack([1.0 - nothing, nothing])


def boosted_trees(onto: ObjectJudge | None = None, rounds: int | None = None) -> GradientBoostingClassifier:
    """What learns, before it does: its settings were chosen on candidates of validation rooms.

    Args:
        onto: a judge whose errors the trees learn; None: from nothing.
        rounds: how many; by default ROUNDS.
    """
    return GradientBoostingClassifier(
        n_estimators=rounds or ROUNDS, learning_rate=RATE, max_depth=DEPTH, subsample=SHARE,
        max_features=CLUES_AT_ONCE, min_samples_leaf=LEAST, random_state=0, init=onto and _Learnt(onto),
    )  # fmt: skip


def fit(
    examples: Examples, onto: ObjectJudge | None = None, rounds: int | None = None, band: int | None = None
) -> ObjectJudge:
    """The trees, each grown on a share of the candidates, drawn anew, and on a few clues at every branch.

    Args:
        examples: to learn from.
        onto: a judge that is to learn more of low rooms, which all examples then are from: its rounds that count
            everywhere are gone on from, and come first with those of other bands. They stay as they are. What is
            learnt is whether anything is there: which type it is, they know from far more rooms.
        rounds: how many are grown; by default ROUNDS.
        band: of low rooms, from 1, in which further rounds count alone; see `ObjectJudge`. With `onto` alone.

    Raises:
        ValueError: a judge without a band, or a band without a judge.
    """
    if (onto is None) != (not band):
        raise ValueError("further rounds count in a band of low rooms, from 1, and first ones everywhere")
    clues, kind = examples.clues.astype(np.float32), examples.kind
    if onto is None:
        boosted = boosted_trees(rounds=rounds).fit(clues, kind)
    else:
        boosted = boosted_trees(of_rounds(onto, onto.low == 0), rounds).fit(clues, kind == KINDS.index("nothing"))
    trees = [[_whole(tree.tree_) for tree in each] for each in boosted.estimators_]
    clue, limit, leaf = (np.array([[tree[part] for tree in each] for each in trees]) for part in range(3))
    if onto is None:
        share = np.bincount(kind, minlength=len(KINDS)) / len(kind)
        return ObjectJudge(np.log(share).astype(np.float32), clue, limit, leaf, np.zeros(len(leaf), np.uint8))
    none = [(0, 0), (0, len(KINDS) - 1), (0, 0)]  # scores of the types stay: their trees end before they begin
    clue, limit, leaf = np.pad(clue, none), np.pad(limit, none, constant_values=np.inf), np.pad(leaf, none)
    others = of_rounds(onto, onto.low != band)
    grown = zip(others[1:], (clue, limit, leaf, np.full(len(leaf), band, np.uint8)), strict=True)
    return ObjectJudge(onto.start, *(np.concatenate(both) for both in grown))


def _whole(tree: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Clues, limits and leaves of a tree (sklearn.tree.Tree), as ObjectJudge has them: grown to its full depth."""
    inner = 2**DEPTH - 1
    clue, limit, leaf = np.zeros(inner, np.uint8), np.full(inner, np.inf, np.float32), np.zeros(inner + 1, np.float32)
    below = [(0, 0)]  # node of the tree, place in the arrays
    while below:
        node, place = below.pop()
        ends = tree.children_left[node] < 0
        if place >= inner:
            leaf[place - inner] = RATE * tree.value[node, 0, 0]
        elif ends:
            below.append((node, 2 * place + 1))
        else:
            clue[place] = tree.feature[node]
            limit[place] = _floored(tree.threshold[node])
            below += [(tree.children_left[node], 2 * place + 1), (tree.children_right[node], 2 * place + 2)]
    return clue, limit, leaf


def _floored(limit: float) -> np.float32:
    """The largest float32 that is no greater: what is float32 itself goes on to the same side of both."""
    near = np.float32(limit)
    return near if near <= limit else np.nextafter(near, np.float32(-np.inf))


def _examples_of_room(case: RoomCase, judges: Judges, draw: Draw) -> Examples:
    prior, changes = (as_cloud(case), MISMATCH_TYPES) if draw.of_cloud else (case.prior, ("added",))
    try:
        looked = look_at(prior, rays_of_scan(settled(case.scan).scan), judges, changes)[0]
    except InputError:  # hardly anything of the cloud in view
        return joined([])
    parts = []
    for change in changes:
        judged = judged_side([looked], change)
        if not len(judged.points):
            continue
        known = _turned(prior.known, float(draw.turned[case.row]))
        examined = examine(judged, ObjectSettings(), known)
        truth = true_boxes(case.pairs, case.row, 1 if change == "added" else -1)[0]
        kind = [kind_of(examined.sight.points[one.members], truth) for one in examined.candidates]
        parts.append(Examples(examined.clues, np.array(kind, np.int64)))
    return joined(parts)


def _turned(known: KnownBuilding, angle: float) -> KnownBuilding:
    """A building as if what was scanned in it were turned against it, by an angle [rad]."""
    if known.uprights is None:
        return known
    uprights, own = (one._replace(turn=(one.turn + angle) % QUARTER) for one in (known.uprights, known.own))
    return known._replace(uprights=uprights, own=own)


def kind_of(points: np.ndarray, truth: list[Box]) -> int:
    """Index into KINDS of the true object in whose box most of the points (n, 3) lie; of none where fewer than half."""
    share = [0.0]
    for box in truth:
        turn, center, edges = np.radians(box.rotation), np.asarray(box.center), np.asarray(box.dimensions)
        off = outside(points[:, :2], center[:2], edges[:2], np.array([np.cos(turn), np.sin(turn)]))
        share.append(float(np.mean(off <= WITHIN)))
    best = int(np.argmax(share))
    return KINDS.index(truth[best - 1].object_type) if share[best] > 0.5 else 0


def joined(parts: list[Examples]) -> Examples:
    """All of them, in their order."""
    parts = [Examples(np.zeros((0, len(CLUES))), np.zeros(0, np.int64)), *parts]
    return Examples(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def told_of(judge: ObjectJudge, kept: Examples) -> dict[str, float]:
    """How well a judge does on candidates that it was not trained on."""
    share = judge_objects(judge, kept.clues)
    real, is_real = share[:, 0] < 0.5, kept.kind > 0
    typed = np.where(share[:, 2] > share[:, 1], 2, 1)
    return {
        "candidates": len(kept.kind),
        "cross_entropy": float(-np.log(share[np.arange(len(kept.kind)), kept.kind] + 1e-9).mean()),
        "precision": float(is_real[real].mean()),
        "recall": float(real[is_real].mean()),
        "right_type": float((typed == kept.kind)[is_real].mean()),
    }


def models_digest() -> str:
    """Of the networks whose probabilities a judge learns to weigh."""
    return hashlib.sha256(DEFAULT.read_bytes()).hexdigest()


def draws_name() -> str:
    """Of the folder that keeps draws: what other code made, or of other networks, would differ."""
    return f"{versions()['code'][:12]}-{models_digest()[:12]}"


def main(out: Path, rooms: int, kept_in: Path | None = None) -> None:
    """Make the rooms, train, save, and print how it does on the draws that it did not train on."""
    models = models_digest()
    folder = kept_in and kept_in / draws_name()
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
    with worker_pool() as pool:
        count = max(10, rooms // AT_ONCE)
        draws = []
        with bar_of(f"{count * AT_ONCE} rooms", count * AT_ONCE, "room") as bar:
            for draw in pool.map(partial(kept_draw, folder), range(count)):
                draws.append(draw)
                bar.update(AT_ONCE)
    kept = joined(draws[::KEPT])
    judge = fit(joined([draw for number, draw in enumerate(draws) if number % KEPT]))
    told = told_of(judge, kept)
    rooms = str(AT_ONCE * len(draws))
    save_judge(judge, out, {"seed": str(SEED), "rooms": rooms, "kept": json.dumps(told), "models": models})
    print(json.dumps(told))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    parser.add_argument("--rooms", type=int, default=30_000, metavar="N")
    parser.add_argument("--draws", type=Path, metavar="DIR", help="keep what was made of rooms there, to go on from")
    asked = parser.parse_args()
    main(asked.out, asked.rooms, asked.draws)
