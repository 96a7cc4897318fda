"""One shard of a data set: labelled clouds with their truth, a pure function of settings and index range."""

import numpy as np

from jaxmm import pipeline, shards
from jaxmm.batches import LabelledCloud
from jaxmm.config import CONDITIONS, SCENARIOS, Config
from jaxmm.pipeline import UNCHANGED, CloudSource

Rows = dict[str, np.ndarray]


def make_shard(config: Config, raw: bool, first: int, stop: int) -> bytes:
    """The pairs [first, stop) of the data set that `config` describes, as a shard's bytes.

    Args:
        config: scan, room and preprocess settings; rooms are drawn from `data.train_seed`, and `shards.places` mixes
            changed and unchanged ones as `data` says.
        raw: add both raw scans of every pair.
        first: number of the first pair, at least 0.
        stop: number after the last pair, above `first`.

    Raises:
        RuntimeError: the settings leave no space for a scene.
    """
    index = np.arange(first, stop)
    places = shards.places(config.data, index)
    kinds = np.stack(places[:3], axis=1)
    made: list[tuple[LabelledCloud, Rows]] = [None] * len(index)  # type: ignore[list-item]
    directions = np.zeros((0, 3), np.float32)
    # Rooms of one kind are scanned together, and each lands in its own place.
    for kind in np.unique(kinds, axis=0):
        rows = np.flatnonzero((kinds == kind).all(axis=1))
        scenario = SCENARIOS[kind[0]]
        scene = scenario if kind[1] else UNCHANGED
        source = CloudSource(scenario, scene, CONDITIONS[kind[2]], config.data.train_seed)
        pairs = pipeline.pairs_of(config, source, places.room[rows], threads=1)  # engines share out shards, not rays
        directions = pairs.directions
        clouds = pipeline.clouds_of(config, source, pairs, threads=1)
        for row, place in enumerate(rows):
            truth = _truth(pairs, row) | (_raw_scans(pairs, row) if raw else {})
            made[place] = clouds[row], truth
    told = {"index": index} | {name: getattr(places, name) for name in places._fields}
    arrays = _joined([cloud for cloud, _ in made]) | _stacked([truth for _, truth in made]) | told
    if raw:
        arrays["directions"] = directions
    fields = shards.FIELDS | (shards.RAW_FIELDS if raw else {})
    return shards.encode({name: arrays[name].astype(shards.DTYPES[field.dtype]) for name, field in fields.items()})


def _truth(pairs, row: int) -> Rows:
    """Of one pair with at most one changed object."""

    def only(field: np.ndarray) -> np.ndarray:
        return field[row, 0] if field.shape[1] else np.full(field.shape[2:], np.nan, field.dtype)

    return {
        "observable_fraction": only(pairs.observable_fraction),
        "box_center": only(pairs.box.center),
        "box_size": only(pairs.box.size),
        "box_yaw": only(pairs.box.yaw),
        "sensor_position": pairs.pose.position[row],
        "sensor_yaw": pairs.pose.yaw[row],
        "sensor_pitch": pairs.pose.pitch[row],
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
