"""The one path by which clouds reach training: Grain delivers batches, drawn ahead of the step that needs them.

Which cloud comes when is not Grain's to decide but the Sampler's, whose draws are a pure function of (seed, step): a
shuffle of Grain's own would tie a run's bits to its version. So Grain walks over step numbers, a batch is made when its
number is reached, and the place in that walk is all the state there is.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import grain
import numpy as np

from jaxmm.config import SCENARIOS, Config, build
from jaxmm.files import MANIFEST, REMEDY, load_json, write_json
from jaxmm.inputs import InputError
from jaxmm.learning import shards
from jaxmm.learning.batches import Batch, LabelledCloud, Sampler
from jaxmm.learning.shards import Manifest

AHEAD = 2  # batches that wait ready


class Host(NamedTuple):
    """One of several processes that train together, each on its own slots of every batch."""

    index: int = 0
    count: int = 1


def batches(sampler: Sampler, first: int, stop: int, host: Host | None = None) -> grain.DatasetIterator[Batch]:
    """The batches of the steps [first, stop), as an iterator whose state Grain can store and restore.

    Hosts share out the slots of a batch in order: side by side, their parts are the whole batch bit for bit.

    Raises:
        ValueError: the batch size is no multiple of the number of hosts, or there is no such host.
    """
    host = host or Host()
    if sampler.batch_size % host.count or not 0 <= host.index < host.count:
        raise ValueError(f"host must be one of a number that divides {sampler.batch_size} slots, got {host}")
    share = sampler.batch_size // host.count
    slots = range(host.index * share, (host.index + 1) * share)
    make = sampler.batch if host.count == 1 else partial(sampler.part, slots=slots)
    steps = grain.MapDataset.range(first, stop).map(make)
    # One thread: drawing is NumPy under the interpreter lock, and more would only take turns.
    return iter(steps.to_iter_dataset(grain.ReadOptions(num_threads=1, prefetch_buffer_size=AHEAD)))


class ShardClouds(Sequence[LabelledCloud]):
    """Clouds of one scenario out of a folder of shards, mapped when first asked for, so that any number fits."""

    def __init__(self, folder: Path, manifest: Manifest, index: np.ndarray, opened: dict[int, dict[str, np.ndarray]]):
        """`index` holds the pair numbers in order; `opened` is shared by all sequences of a folder."""
        self._folder, self._manifest, self._index, self._opened = folder, manifest, index, opened

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, item: int) -> LabelledCloud:
        """A cloud whose arrays are read-only views of the file.

        Raises:
            InputError: its shard is damaged.
        """
        number, row = divmod(int(self._index[item]), self._manifest.pairs_per_shard)
        if number not in self._opened:
            entry = self._manifest.shards[number]
            self._opened[number] = shards.map_shard(self._folder, number, entry, self._manifest.raw)
        arrays = self._opened[number]
        start, end = arrays["offset"][row : row + 2]
        return LabelledCloud(*(arrays[name][start:end] for name in LabelledCloud._fields))


def shard_clouds(config: Config, folder: Path, seal: Path) -> list[ShardClouds]:
    """Training clouds of each scenario out of shards, in the order in which rooms made on the spot would come.

    Args:
        config: the run's settings.
        folder: what `jaxmm generate` wrote.
        seal: file that remembers which shards the run began with.

    Raises:
        InputError: the shards are not complete, are of other scans, rooms, preprocessing or seed than the run, hold no
            cloud of some scenario, or are not those that the run began with.
    """
    manifest = shards.read_manifest(folder)
    if len(manifest.shards) < manifest.shard_count:
        raise InputError(f"{folder}: {len(manifest.shards)} of {manifest.shard_count} shards; generate completes it")
    made_for = build(Config, manifest.config, str(folder / MANIFEST))
    other = [name for name in ("scan", "room", "preprocess") if getattr(made_for, name) != getattr(config, name)]
    other += ["train_seed"] * (made_for.data.train_seed != config.data.train_seed)
    if other:
        raise InputError(f"{folder}: shards of other {', '.join(other)} settings than this run's")
    _check_seal(seal, [entry.sha256 for _, entry in sorted(manifest.shards.items())])
    places, opened = shards.places(made_for.data, np.arange(manifest.count)), {}
    # The last key counts first: own changes, none, then several; clean before occluded; then by number.
    kind = np.digitize(places.scene, [len(SCENARIOS), len(SCENARIOS) + 1])
    order = np.lexsort((places.room, places.condition, kind))
    chosen = [order[places.scenario[order] == scenario] for scenario in range(len(SCENARIOS))]
    if not all(map(len, chosen)):
        raise InputError(f"{folder}: {manifest.count} pairs are too few to hold every scenario; expected at least 8")
    return [ShardClouds(folder, manifest, index, opened) for index in chosen]


def _check_seal(seal: Path, content: Any) -> None:
    if not seal.exists():
        write_json(seal, content)
    elif load_json(seal) != content:
        raise InputError(f"{seal}: the run began with other shards than there are now; {REMEDY}")
