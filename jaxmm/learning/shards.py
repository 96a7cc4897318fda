"""Shards: files of labelled clouds with the truth about each pair, memory-mapped, checksummed, listed in a manifest.

n pairs of a shard, P points of all its clouds one after the other, R rays of a scan, M changed objects, F kinds of
evidence. A shard is a
safetensors file: eight bytes that hold the length of a JSON header (little-endian), the header with dtype, shape and
place of every field, then the plain numbers. FIELDS says what they mean.
"""

import hashlib
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import safetensors.numpy

from jaxmm.config import CONDITIONS, MULTI_SCENARIOS, SCENARIOS, SCENES, UNCHANGED, DataConfig
from jaxmm.files import MANIFEST, load_json, write_json
from jaxmm.inputs import InputError
from jaxmm.rays.evidence import FEATURES

FORMAT, FORMAT_VERSION = "jaxmm shards", 2
DTYPES = {"F32": "<f4", "I32": "<i4", "I64": "<i8", "U8": "|u1", "BOOL": "|b1"}  # safetensors' names
ROUND = len(SCENARIOS) * len(CONDITIONS)  # pairs in a row that share a room number
MOST_CHANGES = 4  # M: changed objects of one pair, at most


class Field(NamedTuple):
    """One array of a shard."""

    dtype: str  # a key of DTYPES
    shape: tuple[str | int, ...]  # "n", "n+1", "P", "R", "M" and "F" as in the docstring of this module
    meaning: str


FIELDS = {
    "index": Field("I64", ("n",), "number of the pair in the whole data set"),
    "scenario": Field("U8", ("n",), "whose model the cloud is for, and which side it shows: " + ", ".join(
        f"{i} {name}" for i, name in enumerate(SCENARIOS))),
    "scene": Field("U8", ("n",), "what differs between prior and reality: " + ", ".join(
        f"{i} {name}" for i, name in enumerate(SCENES))),
    "condition": Field("U8", ("n",), "0 clean, 1 occluded: furniture in the robot scan"),
    "room": Field("I64", ("n",), "room number; with the seed, scene and condition it fixes both scans of the pair"),
    "observable_fraction": Field("F32", ("n", "M"), "testable rays of each changed object over rays that hit it alone"),
    "box_center": Field("F32", ("n", "M", 3), "[m] world, of the changed objects; NaN, as all of these, where fewer"),
    "box_size": Field("F32", ("n", "M", 3), "[m] full edge lengths along its own axes"),
    "box_yaw": Field("F32", ("n", "M"), "[deg] counter-clockwise from world x"),
    "box_type": Field("U8", ("n", "M"), "class of the changed object, 3 wall or 4 pillar; 0 where fewer"),
    "box_change": Field("I32", ("n", "M"), "1 added, -1 removed; 0 where fewer"),
    "box_element": Field("I32", ("n", "M"), "id of the changed object; -1 where fewer"),
    "box_moved_from": Field("I32", ("n", "M"), "which of the M it was before it moved; -1 for what did not"),
    "sensor_position": Field("F32", ("n", 3), "[m] world, of the DT scan, and where the robot is believed to be"),
    "sensor_yaw": Field("F32", ("n",), "[deg] counter-clockwise from world x"),
    "sensor_pitch": Field("F32", ("n",), "[deg] upwards"),
    "true_position": Field("F32", ("n", 3), "[m] where the robot was; other than the above with a pose error only"),
    "true_yaw": Field("F32", ("n",), "[deg]"),
    "true_pitch": Field("F32", ("n",), "[deg]"),
    "offset": Field("I64", ("n+1",), "points of pair i are those from offset[i] up to, not including, offset[i + 1]"),
    "points": Field("F32", ("P", 3), "[m] world: DT scan where an object was removed, robot scan where one was added"),
    "distance": Field("F32", ("P",), "[m] to the nearest point of the pair's other scan"),
    "element": Field("I32", ("P",), "id of the object that was hit"),
    "heuristic": Field("BOOL", ("P",), "the thesis's label: a distance threshold, then its cluster filter"),
    "true": Field("BOOL", ("P",), "the return came from an object that changed as the scenario says"),
    "testable": Field("BOOL", ("P",), "prior and reality differ measurably along this very ray"),
    "evidence": Field("F32", ("P", "F"), "what rays say of the point, 0 columns where none was gathered: " + ", ".join(
        FEATURES)),
}  # fmt: skip
CLASSES = (
    "0 nothing, 1 floor, 2 ceiling, 3 wall, 4 pillar, 5 door, 6 table, 7 chair, 8 window, 9 furniture, 10 other,"
    " 11 cabinet, 12 carton, 13 person"
)
RAW_FIELDS = {"directions": Field("F32", ("R", 3), "unit vectors in the sensor frame: x forward, y left, z up")} | {
    f"{side}_{name}": Field(dtype, ("n", "R"), meaning)
    for side in ("dt", "robot")
    for name, dtype, meaning in (
        ("distance", "F32", "[m] along the ray; inf where nothing was hit"),
        ("element", "I32", "id of the object that was hit; -1 where nothing was"),
        ("semantic", "U8", CLASSES),
    )
}


class Places(NamedTuple):
    """What the pairs of some numbers are; (n,) each."""

    scenario: np.ndarray  # int64, into SCENARIOS
    scene: np.ndarray  # int64, into SCENES
    condition: np.ndarray  # int64, into CONDITIONS
    room: np.ndarray  # int64


class Entry(NamedTuple):
    """One whole shard, as the manifest lists it."""

    file: str
    first: int  # pairs [first, stop) of the data set
    stop: int
    points: int
    bytes: int
    sha256: str


class Manifest(NamedTuple):
    """What a folder of shards holds, and what it shall hold."""

    count: int  # pairs when complete
    pairs_per_shard: int
    raw: bool  # with both raw scans of every pair
    config: dict[str, Any]  # every setting, as `run_folder.as_table`
    versions: dict[str, Any]  # as `versions.versions`
    shards: dict[int, Entry]  # by number, of those that are whole

    @property
    def shard_count(self) -> int:
        return -(-self.count // self.pairs_per_shard)

    def span(self, number: int) -> tuple[int, int]:
        """The pairs [first, stop) of shard `number`."""
        first = number * self.pairs_per_shard
        return first, min(first + self.pairs_per_shard, self.count)


def places(data: DataConfig, index: np.ndarray) -> Places:
    """What pair number i of a data set is, for any (n,) integers.

    Eight pairs in a row are a round: the four scenarios in order, each clean and occluded, with one room number. Of
    t + u + m rounds in a row the first t are of rooms with the scenario's own change, the next u of unchanged ones and
    the last m of rooms with several changes, where t : u : m is the ratio of `train_rooms`, `unchanged_rooms` and
    `multi_rooms` in lowest terms. Every kind counts its rooms from 0; several changes take turns by room number.
    """
    index = np.asarray(index, np.int64)
    counts = np.array([data.train_rooms, data.unchanged_rooms, data.multi_rooms])
    rounds = counts // np.gcd.reduce(counts)
    ends = np.cumsum(rounds)
    block, within = np.divmod(index // ROUND, ends[-1])
    kind = np.searchsorted(ends, within, side="right")
    room = block * rounds[kind] + within - (ends - rounds)[kind]
    scenario, condition = np.divmod(index % ROUND, len(CONDITIONS))
    several = SCENES.index(MULTI_SCENARIOS[0]) + room % len(MULTI_SCENARIOS)
    scene = np.choose(kind, [scenario, SCENES.index(UNCHANGED), several])
    return Places(scenario, scene, condition, room)


def encode(arrays: dict[str, np.ndarray]) -> bytes:
    """A shard's bytes; a pure function of the arrays."""
    return safetensors.numpy.save({name: np.ascontiguousarray(value) for name, value in arrays.items()})


def shard_path(folder: Path, number: int) -> Path:
    return folder / "shards" / f"shard-{number:06d}.safetensors"


def entry_of(folder: Path, number: int, span: tuple[int, int], content: bytes) -> Entry:
    """The manifest's entry for a shard of that content."""
    points = _header(content[8 : 8 + int.from_bytes(content[:8], "little")])["points"]["shape"][0]
    name = shard_path(folder, number).name
    return Entry(name, *span, points, len(content), hashlib.sha256(content).hexdigest())


def damage_of(folder: Path, number: int, entry: Entry, *, thorough: bool) -> str | None:
    """What is wrong with a shard on disk, None when nothing is; `thorough` reads it all, else its size must do."""
    path = shard_path(folder, number)
    try:
        size = path.stat().st_size
        if size != entry.bytes:
            return f"expected {entry.bytes} bytes, found {size}"
        if thorough:
            with open(path, "rb") as file:
                found = hashlib.file_digest(file, "sha256").hexdigest()
            if found != entry.sha256:
                return f"expected sha256 {entry.sha256[:12]}..., found {found[:12]}..."
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    return None


def map_shard(folder: Path, number: int, entry: Entry, raw: bool) -> dict[str, np.ndarray]:
    """The fields of a shard, memory-mapped and read-only, after its size and sha256 were checked.

    Raises:
        InputError: one line that names the shard and says how to make it again.
    """
    path = shard_path(folder, number)
    damage = damage_of(folder, number, entry, thorough=True)
    if damage is None:
        try:
            return _mapped(path, FIELDS | RAW_FIELDS if raw else FIELDS)
        except (ValueError, KeyError, TypeError, OSError) as error:
            damage = f"its fields are not those of this format: {error}"
    raise InputError(f"{path}: a damaged shard: {damage}; jaxmm generate with --repair makes it again")


def _mapped(path: Path, fields: dict[str, Field]) -> dict[str, np.ndarray]:
    whole = np.memmap(path, np.uint8, mode="r").view(np.ndarray)  # plain views of it are quicker to slice than maps
    start = 8 + int.from_bytes(whole[:8].tobytes(), "little")
    header = _header(whole[8:start].tobytes())
    arrays = {}
    for name, field in fields.items():
        told = header[name]
        if told["dtype"] != field.dtype or len(told["shape"]) != len(field.shape):
            raise ValueError(f"{name} is {told['dtype']} {told['shape']}, expected {field.dtype} {field.shape}")
        low, high = told["data_offsets"]
        arrays[name] = whole[start + low : start + high].view(DTYPES[field.dtype]).reshape(told["shape"])
    return arrays


def _header(text: bytes) -> dict[str, Any]:
    return json.loads(text)


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write manifest.json, whole or not at all."""
    value = {"format": FORMAT, "format_version": FORMAT_VERSION} | manifest._asdict()
    value["points"] = sum(entry.points for entry in manifest.shards.values())
    write_json(folder / MANIFEST, value | {"shards": [entry._asdict() for _, entry in sorted(manifest.shards.items())]})


def read_manifest(folder: Path) -> Manifest:
    """What `write_manifest` wrote.

    Raises:
        InputError: there is none, it is damaged, or it is of another format version.
    """
    path = folder / MANIFEST
    if not path.is_file():
        raise InputError(f"{folder}: expected a folder of shards with {MANIFEST}, found none")
    value = load_json(path)
    if not isinstance(value, dict) or value.get("format") != FORMAT or value.get("format_version") != FORMAT_VERSION:
        raise InputError(f"{path}: expected {FORMAT} of version {FORMAT_VERSION}, found something else")
    try:
        manifest = Manifest(**{name: value[name] for name in Manifest._fields} | {"shards": {}})
        for item in value["shards"]:
            entry = Entry(**item)
            number = entry.first // manifest.pairs_per_shard
            if (entry.first, entry.stop) != manifest.span(number) or entry.file != shard_path(folder, number).name:
                raise ValueError(f"{entry.file} is in no place of its own")
            manifest.shards[number] = entry
    except (KeyError, TypeError, ValueError, ZeroDivisionError) as error:
        raise InputError(f"{path}: damaged: {error}; delete it, and jaxmm generate makes all shards again") from error
    return manifest
