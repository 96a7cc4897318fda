"""The data sheet of an exported benchmark, and the schema of what it says of each scene."""

from typing import Any

from jaxmm.exchange.scenes import LABELS
from jaxmm.exchange.tasks import SPLITS, ExportSettings, Task, split_of_building

README, SCHEMA, SETTINGS = "README.md", "schema.json", "settings.toml"

TEXT = """# Building models and scans in which something changed

{count} scenes: {splits}. Each is a building model, and one robot scan of a reality in which walls or pillars were added
or removed, or nothing was. The questions: which returns of the scan are of something new, which elements of the model
are gone, where do changed objects stand, and what can nobody tell from this scan?

## One scene

`<split>/<number>/`, for example `validation/000003/`:

| file | content |
|---|---|
| `scene.json` | sensor, pose, counts, the model's walls and pillars, and the path of the model; see `schema.json` |
| `model.ifc` | the building model, IFC4; of scenes in building files `scene.json` points to `buildings/` |
| `scan.ply` | the robot scan: x, y, z [m] of every return, where the robot believes to have measured it |
| `misses.ply` | unit vectors of the rays that brought nothing back, in the axes of the world |
| `reference.ply` | the model, scanned from the same pose without errors: x, y, z, and `element`, see below |
| `truth.npz` | not in `test`: see below |

`element` is the row in the list `elements` of `scene.json`; -1 for floors, ceilings and doors. PLY files are binary,
little-endian; their rows are rays in the order of the sensor's rows and columns, without those that are missing. World
frame of the model: metres, z up. `pose.rotation` takes the sensor's axes (x forward, y left, z up) to those of the
world.

## Truth

`truth.npz` holds plain arrays. Labels are numbers:

| number | label |
|---|---|
{labels}

| array | content |
|---|---|
| `scan` (N,) | label of each return of `scan.ply` |
| `reference` (M,) | label of each return of `reference.ply` |
| `elements` (E,) | label of each entry of `elements` |
| `objects` (J, 9) | of each changed object: label, centre x, y, z, full edges [m], yaw [degrees], observable fraction |
| `scene` () | what changed, in words |
| `hurdles` () | how many of these make it hard: furniture, a sensor that errs, a pose that errs |

*Unobservable* is a return of a changed object along whose ray model and reality differ by no more than 0.1 m, and an
element of which fewer than 20 rays, or fewer than 3 % of those that should meet it, tell whether it stands. No method
can know these: points are left out of scores, and of elements it is counted how often a method says "gone" all the
same. An object with an observable fraction below 0.2 need not be found.

The truth of `test` is in `{truth}`, which need not be given to those who are to be tested. Whoever holds the settings
can make it again, so a closed contest needs a seed of its own, and a folder without `{settings}` and `manifest.json`.

## Scores

`jaxmm benchmark score DIR PREDICTIONS` scores one file a scene, `000004.npz` or `000004.csv`. What they hold, and what
the scores mean, is told in `docs/benchmark-data.md` of jaxmm.

## How it was made

`jaxmm benchmark export` with the settings in `{settings}` and the code whose hash `manifest.json` has. A scene is a
pure function of these and of its number: any order and number of processes give the same scene, and more scenes change
none of those before. Rooms of different splits are of different seeds{buildings}. Scenarios take turns; furniture is in
{occluded:.0%} of the scenes, errors of the sensor in {erring:.0%}, errors of the pose ({position} m and {angle}
degrees) in {lost:.0%} of the rooms.

## What it is not

No real sensor, room or person had a part in it. Rooms are drawn from ranges, not from buildings; furniture is boxes and
cylinders. Scores say how methods compare under known truth, and nothing about how well they do on real scans.

## Licence

The scenes of generated rooms: MIT, as the code that made them. Scenes in building files, and the files in `buildings/`:
whatever licence those files came with.
"""


def text(settings: ExportSettings, tasks: list[Task], truth: str) -> str:
    """The data sheet, Markdown."""
    counts = {split: sum(task.split == split for task in tasks) for split in SPLITS}
    rows = sorted({task.building for task in tasks if task.building is not None})
    own = "; ".join(f"{split_of_building(row)}: number {row + 1}" for row in rows)
    return TEXT.format(
        count=len(tasks),
        splits=", ".join(f"{count} {split}" for split, count in counts.items()),
        labels="\n".join(f"| {number} | {label} |" for number, label in enumerate(LABELS)),
        truth=truth,
        settings=SETTINGS,
        buildings=f", and a building file belongs to one split only ({own}, in the order of their names)"
        if own
        else "",
        occluded=settings.occluded_share,
        erring=settings.erring_share,
        lost=settings.lost_share,
        position=settings.position_error,
        angle=settings.angle_error,
    )


def schema() -> dict[str, Any]:
    """JSON schema of scene.json."""
    vector = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
    count = {"type": "integer", "minimum": 0}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:jaxmm:benchmark-scene",
        "title": "One scene of a benchmark that jaxmm exported",
        "type": "object",
        "required": ["name", "split", "model", "pose", "sensor", "points", "elements"],
        "additionalProperties": False,
        "properties": {
            "name": {"type": "string", "pattern": "^[0-9]{6}$"},
            "split": {"enum": list(SPLITS)},
            "model": {"type": "string", "description": "Path of the IFC file, from the folder of the scene."},
            "pose": {
                "type": "object",
                "description": "Where the robot believes that the sensor stood: metres and degrees, world frame.",
                "required": ["position", "yaw", "pitch", "rotation"],
                "additionalProperties": False,
                "properties": {
                    "position": vector,
                    "yaw": {"type": "number", "description": "Counter-clockwise from x."},
                    "pitch": {"type": "number", "description": "Upwards."},
                    "rotation": {"type": "array", "items": vector, "minItems": 3, "maxItems": 3},
                },
            },
            "sensor": {
                "type": "object",
                "description": "Rays, range limits [m] and errors; null is no limit.",
                "required": ["name", "kind", "range_limits", "imperfections"],
                "properties": {"name": {"type": "string"}, "kind": {"enum": ["pinhole", "spinning"]}},
            },
            "points": {
                "type": "object",
                "required": ["scan", "misses", "reference"],
                "additionalProperties": False,
                "properties": dict.fromkeys(("scan", "misses", "reference"), count),
            },
            "elements": {
                "type": "array",
                "description": "Walls and pillars of the model.",
                "items": {
                    "type": "object",
                    "required": ["guid", "class"],
                    "additionalProperties": False,
                    "properties": {
                        "guid": {"type": "string", "description": "GlobalId in the IFC file."},
                        "class": {"enum": ["wall", "pillar"]},
                    },
                },
            },
        },
    }
