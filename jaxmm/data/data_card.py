"""The card of a data set: what it is and is not, how it was made, every field, and where it ends."""

from jaxmm.config import CONDITIONS, SCENARIOS
from jaxmm.files import MANIFEST
from jaxmm.learning.shards import CLASSES, FIELDS, FORMAT_VERSION, MOST_CHANGES, RAW_FIELDS, Field, Manifest

CARD = "card.md"

TEXT = """# Scans of generated rooms before and after a change

{count} pairs of scans, {points} labelled points, in {files} shards of up to {pairs_per_shard} pairs{raw}.

## What it is

Each pair is one generated room, scanned twice by a virtual sensor from one pose: the *DT scan* of the building
model, and the *robot scan* of reality. Between the two, one pillar or wall was added or removed, or several were, or
nothing was; in `occluded` pairs reality also holds furniture, which the model does not know or holds elsewhere. Every
pair is stored as the cloud that the model of its scenario scores: the DT scan where something was removed, the robot
scan where something was added, after the filters and the voxel grid that the settings name. The simulator knows which
returns came from the changed object, so `true` has no errors of annotation.

## What it is not

No real sensor, room or person had a part in it. Rooms are drawn from ranges, not from buildings. The DT scan has no
errors; simulated errors of the robot scan: {errors}. Scores on it
say how methods compare under known truth, and nothing about how well they do on real scans.

## How it was made

`jaxmm generate` with the settings in `config.toml` and the packages and code in `versions.json`; {manifest} repeats
both. Rooms are drawn from seed {seed}. Each shard is a pure function of the settings and its range of pair numbers:
any engine, any number of workers and any order give the same bytes, and each shard's sha256 stands in the manifest.
Pairs come in rounds of {round}: {scenarios}, each {conditions}, sharing one room number. Rounds with the scenario's own
change, rounds without a change and rounds with several follow each other in the ratio
{train_rooms} : {unchanged_rooms} : {multi_rooms}, in lowest terms, in that order.

## Fields

A shard is a safetensors file: 8 bytes with the length of the header (little-endian), a JSON header with dtype, shape
and place of every field, then plain little-endian numbers. No code is needed to read it, nothing in it can run, and
`numpy.memmap(file, dtype, "r", 8 + header_length + data_offsets[0], shape)` maps a field without reading it. n pairs,
P points of all clouds one after the other, M = {changes} changed objects at most{rays}. World frame: metres, z up, the
origin in the middle of the room.

| field | type | shape | meaning |
|---|---|---|---|
{fields}

A return with `true` and without `testable` is one that no method could know: leave it out of losses and scores.

## Known limits

- The robot's points lie where the robot is *believed* to be: with a pose error, `sensor_*` put its ranges there, not
  `true_*`.
- `object_filter = "height"`, the thesis's filter, judges an object by its scanned points. A changed object whose top
  is not in view is filtered out with the furniture, and its pair has no positive point: ask for "none" to keep it.
- A pair with several changes is negative for every model whose kind of change is not among them.
- `heuristic` repeats the thesis's labels, errors included: it is there to measure what such labels cost.
- Scenes of one seed share room numbers, not rooms: which room a number gives depends on the scene, for rooms are
  redrawn until the change is in view. `clean` and `occluded` of one number do share room, pose and changed object: keep
  them on one side of a split.
- Objects that no ray hits leave no points; `observable_fraction` says how much of the change could be seen.
- Random numbers are exact on every machine; ranges are computed in float32, and another processor may round otherwise.

## Licence

MIT, as the code that made it. No other data went into it.

Class ids of raw scans: {classes}. Format version {version}.
"""


def text(manifest: Manifest, errors: str) -> str:
    """The card of a finished data set, Markdown; `errors` says in words how the robot scans err."""
    data = manifest.config["data"]
    fields = FIELDS | (RAW_FIELDS if manifest.raw else {})
    return TEXT.format(
        count=manifest.count,
        points=sum(entry.points for entry in manifest.shards.values()),
        files=manifest.shard_count,
        pairs_per_shard=manifest.pairs_per_shard,
        raw=", with both raw scans of every pair" if manifest.raw else "",
        errors=errors,
        manifest=f"`{MANIFEST}`",
        seed=data["train_seed"],
        round=len(SCENARIOS) * len(CONDITIONS),
        scenarios=", ".join(SCENARIOS),
        conditions=" and ".join(CONDITIONS),
        train_rooms=data["train_rooms"],
        unchanged_rooms=data["unchanged_rooms"],
        multi_rooms=data["multi_rooms"],
        changes=MOST_CHANGES,
        rays=", R rays of a scan" if manifest.raw else "",
        fields="\n".join(_row(name, field) for name, field in fields.items()),
        classes=CLASSES,
        version=FORMAT_VERSION,
    )


def _row(name: str, field: Field) -> str:
    shape = ", ".join(map(str, field.shape))
    return f"| `{name}` | {field.dtype} | ({shape}) | {field.meaning} |"
