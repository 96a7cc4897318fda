"""Joins simulator and learning: rooms are scanned and become labelled clouds, for training and for evaluation."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from jaxmm.config import Config
from jaxmm.data.evidence_sources import Seen, gather
from jaxmm.data.pose_errors import localised
from jaxmm.data.preprocessed_pairs import Sides, sides_of
from jaxmm.data.simulator_settings import CloudSource, pair_config, ray_count, scene_of
from jaxmm.files import REMEDY, load_arrays, write_arrays
from jaxmm.inputs import InputError
from jaxmm.learning.batches import LabelledCloud
from jaxmm.learning.boxes import Box
from jaxmm.learning.labels import filter_labels, heuristic_labels
from jaxmm.learning.room_scores import RoomTruth
from warp_scanner.clouds.neighbours import nearest
from warp_scanner.clouds.points import Kept
from warp_scanner.rooms.pairs import Pairs, make_pairs
from warp_scanner.scenes.scenes import PILLAR, WALL

# Evidence (N, F) of every pair, from settings, source, pairs, what both sides show, and a number of threads.
Gatherer = Callable[[Config, CloudSource, Pairs, Seen, int | None], list[np.ndarray]]
RAYS_AT_ONCE = 32 * 64_000  # of the rooms that are scanned together: bounds the memory
_CLASSES = {"pillar": PILLAR, "wall": WALL}


def clouds(config: Config, source: CloudSource, index: np.ndarray) -> Iterator[tuple[LabelledCloud, RoomTruth]]:
    """The clouds of the given rooms, each a pure function of (config, source, its index), a few rooms at a time."""
    at_once = max(1, RAYS_AT_ONCE // ray_count(config))
    for start in range(0, len(index), at_once):
        part = np.asarray(index[start : start + at_once])
        scenes = np.array([scene_of(source.scene, int(room)) for room in part])
        made = {}
        for scene in dict.fromkeys(scenes.tolist()):
            chosen = source._replace(scene=scene)
            rooms = part[scenes == scene]
            pairs = pairs_of(config, chosen, rooms)
            for row, cloud in enumerate(clouds_of(config, chosen, pairs)):
                made[int(rooms[row])] = cloud, truth_of(chosen, pairs, row, int(rooms[row]))
        yield from (made[int(room)] for room in part)


def pairs_of(config: Config, source: CloudSource, index: np.ndarray, threads: int | None = None) -> Pairs:
    """Both scans of the given rooms, with the truth about every ray.

    Raises:
        InputError: the settings leave no space for such a scene.
    """
    localise = localised if config.preprocess.registration == "refine" else None
    try:
        return make_pairs(pair_config(config, source), index, threads, localise)
    except RuntimeError as error:
        raise InputError(f"scan and room settings: {error}") from error


def clouds_of(
    config: Config,
    source: CloudSource,
    pairs: Pairs,
    threads: int | None = None,
    sides: Sides | None = None,
    gatherer: Gatherer = gather,
) -> list[LabelledCloud]:
    """Label the side of every pair that the scenario's model sees.

    Args:
        config: how to preprocess and to label.
        source: what the pairs are of.
        pairs: scans of R rooms.
        threads: how many to use; by default one for each core it may run on.
        sides: from `sides_of`, for models that share their pairs; made here when left out.
        gatherer: of the evidence, with the arguments of `gather`.
    """
    seen, other = sides or sides_of(config, pairs, threads)
    if not source.scenario.endswith("removed"):
        seen, other = other, seen
    distances = distances_of(pairs, seen, other, threads)
    evidence = gatherer(config, source, pairs, (seen, other, distances), threads)
    rows = range(len(seen))
    return [_labelled(config, source, pairs, row, (seen[row], distances[row], evidence[row])) for row in rows]


def distances_of(pairs: Pairs, seen: list[Kept], other: list[Kept], threads: int | None) -> list[np.ndarray]:
    """Distance (N,) float32 [m] of each point to the other cloud of its pair, measured in float64."""
    # Where the sensor faces a wall so closely that nothing it sees counts as structure, all is far from nothing.
    farthest = np.linalg.norm(pairs.size, axis=1)
    found = nearest([kept.points for kept in seen], [kept.points for kept in other], threads)
    return [
        np.where(near.index >= 0, near.distance, far).astype(np.float32)
        for near, far in zip(found, farthest, strict=True)
    ]


def _labelled(
    config: Config, source: CloudSource, pairs: Pairs, row: int, seen: tuple[Kept, np.ndarray, np.ndarray]
) -> LabelledCloud:
    """The cloud of one room with its labels and the truth about every point."""
    (points, pixel), distance, evidence = seen
    removed = source.scenario.endswith("removed")
    scan, testable = (pairs.dt, pairs.testable_dt) if removed else (pairs.robot, pairs.testable_robot)
    element = scan.element[row, pixel]
    changed = np.isin(element, pairs.box.element[row, changes_of(source.scenario, pairs, row)])
    heuristic = heuristic_of(config, source, points, element, distance)
    return LabelledCloud(points, distance, element, heuristic, changed, testable[row, pixel], evidence)


def heuristic_of(
    config: Config, source: CloudSource, points: np.ndarray, element: np.ndarray, distance: np.ndarray
) -> np.ndarray:
    """The thesis's labels (N,) bool of points (N, 3) with their elements (N,), from distances (N,) [m]."""
    heuristic = heuristic_labels(distance, config.preprocess.label_distance)
    if source.scenario.endswith("removed") and config.preprocess.label_filter in (source.condition, "always"):
        heuristic = filter_labels(points, element, heuristic, source.scenario.split("_")[0])
    return heuristic


def changes_of(scenario: str, pairs: Pairs, row: int) -> np.ndarray:
    """Which of the changed objects (M,) of one pair are those that a scenario's model looks for, as indices."""
    object_type, _, change = scenario.partition("_")
    box = pairs.box
    wanted = (box.change[row] == (-1 if change == "removed" else 1)) & (box.object_type[row] == _CLASSES[object_type])
    return np.flatnonzero(wanted)


def truth_of(source: CloudSource, pairs: Pairs, row: int, index: int) -> RoomTruth:
    """The objects of the kind that the model looks for in room number `index`, which is row `row` of the pairs."""
    kind, box = source.scenario.split("_")[0], pairs.box
    wanted = changes_of(source.scenario, pairs, row)
    if not len(wanted):
        nowhere = np.full(3, np.nan, np.float32)
        return RoomTruth(index, Box(kind, nowhere, nowhere, np.nan), np.nan)
    first, *others = (Box(kind, box.center[row, i], box.size[row, i], float(box.yaw[row, i])) for i in wanted)
    return RoomTruth(index, first, float(pairs.observable_fraction[row, wanted].mean()), tuple(others))


def cached_clouds(config: Config, source: CloudSource, count: int, path: Path) -> Iterator[LabelledCloud]:
    """The first `count` rooms' clouds, read from `path` when it is there, else made and stored."""
    if not path.exists():
        made = []
        for cloud, _ in clouds(config, source, np.arange(count)):
            made.append(cloud)
            yield cloud
        _store(path, made)
        return
    yield from _stored(path, count)


def _store(path: Path, made: list[LabelledCloud]) -> None:
    """One array per field, the clouds one after the other."""
    fields = zip(LabelledCloud._fields, zip(*made, strict=True), strict=True)
    arrays = {name: np.concatenate(parts) for name, parts in fields}
    write_arrays(path, arrays | {"count": np.array([len(cloud.points) for cloud in made])})


def _stored(path: Path, count: int) -> list[LabelledCloud]:
    arrays = load_arrays(path)
    if set(arrays) != {*LabelledCloud._fields, "count"} or len(arrays["count"]) != count:
        raise InputError(f"{path}: expected {count} clouds of this run; {REMEDY}")
    ends = np.cumsum(arrays["count"])[:-1]
    fields = [np.split(arrays[name], ends) for name in LabelledCloud._fields]
    return [LabelledCloud(*values) for values in zip(*fields, strict=True)]
