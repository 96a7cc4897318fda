"""One shard of a data set: labelled clouds with their truth, a pure function of settings and index range."""

import numpy as np

from jaxmm import heap
from jaxmm.config import CONDITIONS, SCENARIOS, SCENES, Config
from jaxmm.data import labelled_rooms
from jaxmm.data.preprocessed_pairs import sides_of
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.learning import shards
from jaxmm.learning.batches import LabelledCloud

Rows = dict[str, np.ndarray]


def make_shard(config: Config, raw: bool, first: int, stop: int) -> bytes:
    """The pairs [first, stop) of the data set that `config` describes, as a shard's bytes.

    Args:
        config: scan, room and preprocess settings; rooms are drawn from `data.train_seed`, and `shards.places` mixes
            scenes as `data` says.
        raw: add both raw scans of every pair.
        first: number of the first pair, at least 0.
        stop: number after the last pair, above `first`.

    Raises:
        RuntimeError: the settings leave no space for a scene.
    """
    # Before and between, so that a process which makes many shards needs no more than one that makes a single one.
    heap.give_back()
    arrays = _arrays(config, raw, np.arange(first, stop))
    heap.give_back()
    fields = shards.FIELDS | (shards.RAW_FIELDS if raw else {})
    return shards.encode(
        {name: arrays[name].astype(shards.DTYPES[field.dtype], copy=False) for name, field in fields.items()}
    )


def _arrays(config: Config, raw: bool, index: np.ndarray) -> Rows:
    """The fields of the pairs of these numbers, not yet of the types that a shard holds."""
    places = shards.places(config.data, index)
    made: list[tuple[LabelledCloud, Rows]] = [None] * len(index)  # type: ignore[list-item]
    directions = np.zeros((0, 3), np.float32)
    kinds = np.stack([places.scene, places.condition], axis=1)
    # Rooms of one kind are scanned together, once for all models, and each cloud lands in its own place.
    for kind in np.unique(kinds, axis=0):
        rows = np.flatnonzero((kinds == kind).all(axis=1))
        rooms, number = np.unique(places.room[rows], return_inverse=True)
        source = CloudSource("", SCENES[kind[0]], CONDITIONS[kind[1]], config.data.train_seed)
        pairs = labelled_rooms.pairs_of(config, source, rooms, threads=1)  # engines share out shards, not rays
        directions = pairs.directions
        sides = sides_of(config, pairs, threads=1)
        truths = [_truth(pairs, row) | (_raw_scans(pairs, row) if raw else {}) for row in range(len(rooms))]
        for scenario in np.unique(places.scenario[rows]):
            chosen = places.scenario[rows] == scenario
            model = source._replace(scenario=SCENARIOS[scenario])
            clouds = labelled_rooms.clouds_of(config, model, pairs, 1, sides)
            for place, room in zip(rows[chosen], number[chosen], strict=True):
                made[place] = clouds[room], truths[room]
    told = {"index": index} | {name: getattr(places, name) for name in places._fields}
    arrays = _joined([cloud for cloud, _ in made]) | _stacked([truth for _, truth in made]) | told
    if raw:
        arrays["directions"] = directions
    return arrays


def _truth(pairs, row: int) -> Rows:
    """Of one pair, its changed objects filled up to MOST_CHANGES."""

    def padded(field: np.ndarray, gap: float) -> np.ndarray:
        more = shards.MOST_CHANGES - field.shape[1]
        return np.concatenate([field[row], np.full((more, *field.shape[2:]), gap, field.dtype)])

    box = pairs.box
    return {
        "observable_fraction": padded(pairs.observable_fraction, np.nan),
        "box_center": padded(box.center, np.nan),
        "box_size": padded(box.size, np.nan),
        "box_yaw": padded(box.yaw, np.nan),
        "box_type": np.where(padded(box.change, 0) != 0, padded(box.object_type, 0), 0),
        "box_change": padded(box.change, 0),
        "box_element": np.where(padded(box.change, 0) != 0, padded(box.element, -1), -1),
        "box_moved_from": padded(box.moved_from, -1),
        "sensor_position": pairs.pose.position[row],
        "sensor_yaw": pairs.pose.yaw[row],
        "sensor_pitch": pairs.pose.pitch[row],
        "true_position": pairs.true_pose.position[row],
        "true_yaw": pairs.true_pose.yaw[row],
        "true_pitch": pairs.true_pose.pitch[row],
    }


def _raw_scans(pairs, row: int) -> Rows:
    return {
        f"{side}_{name}": getattr(scan, name)[row]
        for side, scan in (("dt", pairs.dt), ("robot", pairs.robot))
        for name in ("distance", "element", "semantic")
    }


def _joined(clouds: list[LabelledCloud]) -> Rows:
    """One array per field, the clouds one after the other."""
    fields = zip(LabelledCloud._fields, zip(*clouds, strict=True), strict=True)
    offset = np.cumsum([0] + [len(cloud.points) for cloud in clouds])
    return {name: np.concatenate(parts) for name, parts in fields} | {"offset": offset}


def _stacked(truths: list[Rows]) -> Rows:
    return {name: np.stack([truth[name] for truth in truths]) for name in truths[0]}
