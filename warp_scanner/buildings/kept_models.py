"""IFC files that were read before: their elements as arrays, kept on disk by what the file holds and how it was read.

Nearly all the time that an IFC file takes goes into the shapes of its elements, and a model is compared with many
scans. The environment variable JAXMM_KEEP_MODELS says how many megabytes are kept; 0 keeps none.
"""

import contextlib
import dataclasses
import functools
import hashlib
import io
import json
import os
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from subprocess import Popen
from typing import Any

from warp_scanner.caches import cache_folder
from warp_scanner.guarded import Plain, answer_of, begin, drop, from_bytes, limits_for, save
from warp_scanner.kept import Store
from warp_scanner.scenes.building import ReadOptions

VARIABLE = "JAXMM_KEEP_MODELS"
MOST = 256  # [MB] where the variable says nothing
Parse = Callable[[Path, Any], Plain]
_READERS = ("buildings", "scenes")  # rooms whose code makes a building out of a file
# Processes that were started and not asked yet, by the key of what they read.
_begun: dict[str, Popen] = {}


def store() -> Store | None:
    """Where models are kept; None where none are.

    Raises:
        ValueError: the variable holds no number of megabytes.
    """
    asked = os.environ.get(VARIABLE, str(MOST))
    if not (asked.isascii() and asked.isdigit()):
        raise ValueError(f"{VARIABLE}: expected a number of megabytes, 0 to keep none, got {asked!r}")
    return Store(cache_folder("models"), int(asked) * 1_000_000) if int(asked) else None


def key_of(path: Path, options: ReadOptions) -> str:
    """Of a file: what it holds, how it is read, and what reads it."""
    with open(path, "rb") as file:
        content = hashlib.file_digest(file, "sha256").hexdigest()
    how = [content, dataclasses.asdict(options), metadata.version("ifcopenshell"), _reader()]
    return hashlib.sha256(json.dumps(how, sort_keys=True).encode()).hexdigest()


def read(parse: Parse, path: Path, options: ReadOptions) -> Plain:
    """A building out of its file: kept, or by now read in the background, or read by a process of its own.

    Args:
        parse: reads it, as `guarded.read_guarded` takes it.
        path: the file.
        options: how.

    Raises:
        ValueError: as `read_guarded` does.
    """
    key = key_of(path, options)
    begun, plain = _begun.pop(key, None), _kept(key)
    if begun is None and plain is not None:
        return plain
    plain = answer_of(begun or _begin(parse, path, options), path, limits_for(path))
    _keep(key, plain)
    return plain


@contextlib.contextmanager
def ahead(parse: Parse, path: Path, options: ReadOptions) -> Iterator[None]:
    """Within, a file that is not kept is read in the background, for `read` with the same arguments to wait for."""
    key, mine = key_of(path, options), False
    if key not in _begun and _kept(key) is None:
        _begun[key], mine = _begin(parse, path, options), True
    try:
        yield
    finally:
        if mine and key in _begun:
            drop(_begun.pop(key))


def _begin(parse: Parse, path: Path, options: ReadOptions) -> Popen:
    return begin(parse, path, dataclasses.asdict(options), limits_for(path))


def _kept(key: str) -> Plain | None:
    place = store()
    content = None if place is None else place.get(key)
    return None if content is None else from_bytes(content)[1]


def _keep(key: str, plain: Plain) -> None:
    place = store()
    if place is not None:
        content = io.BytesIO()
        save(content, True, plain)
        place.put(key, content.getvalue())


@functools.cache
def _reader() -> str:
    """A digest of our own code that reads: another version may read the same file otherwise."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    for room in _READERS:
        for file in sorted((root / room).glob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()
