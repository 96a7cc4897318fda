"""Writes a folder of shards: whatever kills it, the manifest lists whole shards only, and the same command goes on.

One process writes; engines only compute, so a shard's bytes depend on nothing but settings and index range.
"""

import contextlib
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from jaxmm import run_folder, versions
from jaxmm.config import Config
from jaxmm.data import data_card, dataset, local_engine, simulator_settings
from jaxmm.files import MANIFEST, check_folder, write_atomically, write_text
from jaxmm.inputs import InputError
from jaxmm.learning import shards
from jaxmm.learning.shards import Entry, Manifest
from jaxmm.progress import bar_of
from jaxmm.rays.evidence import FEATURES

PAIRS_PER_SHARD = 256  # enough that rooms of one kind are many, and drawn together
RAW_SHARD_BYTES = 64e6  # raw scans are large: fewer pairs a shard bound the memory of a worker
POINT_BYTES, RAW_RAY_BYTES = 23 + 4 * len(FEATURES), 18  # of one point of a cloud, and of one ray of both raw scans
SAMPLE = 64  # pairs that tell how large a pair is, at most
OWN_FILES = {".lock", run_folder.CONFIG, run_folder.VERSIONS, MANIFEST, data_card.CARD, "shards"}
MANIFEST_SHARE = 0.02  # of the time, at most, may go into rewriting the manifest


class Request(NamedTuple):
    """What to make, and how."""

    count: int  # pairs
    raw: bool = False
    engine: str = "local"  # or "ray"
    workers: int | None = None  # processes; None: one a core
    verify: bool = False  # check what is there by sha256, not only by size
    repair: bool = False  # and make again what is damaged


def generate(config: Config, folder: Path | str, request: Request) -> Manifest:
    """Make the shards that are missing in `folder`, and return the manifest of all.

    Raises:
        InputError: a count or worker count below 1; more than the disk can hold; a folder of something else, of other
            settings or other code, or held by another process; a damaged shard and no leave to repair it; no Ray.
        OSError: a file cannot be written; what the manifest lists stays whole.
    """
    folder = Path(folder)
    for name in ("count", "workers"):
        value = getattr(request, name)
        if value is not None and value < 1:
            raise InputError(f"--{name}: expected at least 1, got {value}")
    check_folder(folder, "--out")
    results = _engine(request)
    _check_space(config, folder, request, results)
    with run_folder.open_run(folder, config, threads_matter=False):  # every shard is the work of one thread
        manifest = _opened(config, folder, request)
        earlier = dict(manifest.shards)  # what repaired shards must turn out to be
        _drop_damaged(folder, manifest, request)
        if request.verify or request.repair:
            print(f"{len(manifest.shards)} shards are whole", file=sys.stderr)
        _fill(config, folder, manifest, (results, request.workers, earlier))
        write_text(folder / data_card.CARD, data_card.text(manifest, simulator_settings.errors_of(config)))
    return manifest


def _engine(request: Request):
    """The engine's `results`; Ray is imported, and its cluster sought, only when asked for."""
    if request.engine == "local":
        return local_engine.results
    from jaxmm.data import ray_engine

    ray_engine.connect(request.workers)
    return ray_engine.results


def _opened(config: Config, folder: Path, request: Request) -> Manifest:
    """The manifest of a folder, begun when there is none."""
    if not (folder / MANIFEST).exists():
        if foreign := {path.name for path in folder.iterdir()} - OWN_FILES:
            raise InputError(f"{folder}: expected a new folder or one of shards, found {min(foreign)}")
        pairs = _pairs_per_shard(config, request.raw)
        manifest = Manifest(request.count, pairs, request.raw, run_folder.as_table(config), versions.versions(), {})
        shards.write_manifest(folder, manifest)
        return manifest
    manifest = shards.read_manifest(folder)
    if manifest.raw != request.raw:
        kinds = {True: "with raw scans", False: "without raw scans"}
        raise InputError(f"{folder}: holds shards {kinds[manifest.raw]}; choose another --out or remove it")
    if manifest.count > request.count:
        raise InputError(f"{folder}: holds {manifest.count} pairs, got --count {request.count}; choose another --out")
    if manifest.count < request.count:
        last = manifest.shard_count - 1
        grown = manifest._replace(count=request.count)
        if manifest.span(last) != grown.span(last):  # the last shard was a short one
            grown.shards.pop(last, None)
        shards.write_manifest(folder, grown)
        return grown
    return manifest


def _drop_damaged(folder: Path, manifest: Manifest, request: Request) -> None:
    """Forget the shards that have to be made again.

    Raises:
        InputError: some are damaged, and nobody asked for a repair.
    """
    thorough = request.verify or request.repair
    damaged = {}
    for number, entry in sorted(manifest.shards.items()):
        if damage := shards.damage_of(folder, number, entry, thorough=thorough):
            damaged[number] = damage
    if damaged and not request.repair:
        number, damage = next(iter(damaged.items()))
        more = f", and {len(damaged) - 1} more" if len(damaged) > 1 else ""
        path = shards.shard_path(folder, number)
        raise InputError(f"{path}: a damaged shard: {damage}{more}; --repair makes it again")
    for number in damaged:
        del manifest.shards[number]
    if damaged:
        shards.write_manifest(folder, manifest)  # before a single file changes


def _fill(config: Config, folder: Path, manifest: Manifest, how: tuple) -> None:
    """Make what is missing, shard by shard, in whatever order the engine delivers."""
    results, workers, earlier = how
    make = partial(dataset.make_shard, config, manifest.raw)
    missing = (manifest.span(n) for n in range(manifest.shard_count) if n not in manifest.shards)
    done = sum(entry.stop - entry.first for entry in manifest.shards.values())
    written, cost = -float("inf"), 0.0
    with bar_of("generate pairs", manifest.count, "pair", done) as bar:
        try:
            for span, content in results(make, missing, workers):
                number = span[0] // manifest.pairs_per_shard
                manifest.shards[number] = _stored(folder, number, (span, content, earlier.get(number)))
                # A long manifest is not written for every shard; what it misses after a kill is made again.
                begin = time.monotonic()
                if begin - written > cost / MANIFEST_SHARE:
                    shards.write_manifest(folder, manifest)
                    written, cost = time.monotonic(), time.monotonic() - begin
                bar.update(span[1] - span[0])
        except BaseException:
            with contextlib.suppress(OSError):  # a full disk is told of by the error that comes first
                shards.write_manifest(folder, manifest)
            raise
        shards.write_manifest(folder, manifest)


def _stored(folder: Path, number: int, what: tuple[tuple[int, int], bytes, Entry | None]) -> Entry:
    """Write one shard, whole or not at all, and tell of it."""
    span, content, earlier = what
    entry = shards.entry_of(folder, number, span, content)
    path = shards.shard_path(folder, number)
    if earlier is not None and entry != earlier:
        raise RuntimeError(f"{path}: made again, it differs from what {MANIFEST} lists; this machine is another")
    write_atomically(path, lambda temporary: temporary.write_bytes(content))
    return entry


def _pairs_per_shard(config: Config, raw: bool) -> int:
    pixels = simulator_settings.ray_count(config)
    return max(1, min(PAIRS_PER_SHARD, int(RAW_SHARD_BYTES // (pixels * RAW_RAY_BYTES)))) if raw else PAIRS_PER_SHARD


def _check_space(config: Config, folder: Path, request: Request, results: Callable[..., Iterator[tuple]]) -> None:
    """Refuse what the disk cannot hold; the size of a pair is measured when its upper bound does not settle it."""
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    free = shutil.disk_usage(existing).free
    done = 0
    if (folder / MANIFEST).exists():
        done = sum(entry.stop - entry.first for entry in shards.read_manifest(folder).shards.values())
    missing = request.count - done
    pixels = simulator_settings.ray_count(config)
    if missing * pixels * (POINT_BYTES + request.raw * RAW_RAY_BYTES) <= free / 2:
        return
    # No larger than a shard, and made by the engine, so that the memory this takes is that of a worker.
    make, few = partial(dataset.make_shard, config, request.raw), min(SAMPLE, _pairs_per_shard(config, request.raw))
    ((_, sample),) = results(make, [(0, few)], request.workers)
    need = missing * len(sample) / few
    if need > free:
        sizes = f"about {need / 1e9:.3g} GB, and {existing} has {free / 1e9:.3g} GB free"
        raise InputError(f"--count: {request.count} pairs need {sizes}")
