"""How well changed walls and pillars are found as objects in rooms that nothing was chosen on, by both presets.

    python -m benchmarks.objects --out runs/objects [--rooms 200] [--case unfiltered] [--only all_four unchanged ...]

Each row is one kind of scene, clean or occluded, of rooms of the test seed; added objects are looked for among the
robot's points, removed ones among the prior's, as if nobody knew its elements. `default` is finder.find_objects,
`thesis` is boxes.fit_boxes for each of the four networks; both see the same probabilities. Rows that `--out` holds
are not made again. Writes objects.json and prints Markdown.

An object counts from an observable fraction of 0.2 on. A box is right when it matches a changed object, however little
of it shows, by the rule of jaxmm/learning/box_match.py; all others are wrong, those around what hardly shows too.
"""

import hashlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.accuracy import CONDITIONS as CASES
from benchmarks.accuracy import condition_config
from benchmarks.command_line import CommandLine
from jaxmm import run_folder
from jaxmm.config import CONDITIONS, SCENES, UNCHANGED, Config
from jaxmm.data.labelled_rooms import clouds_of, pairs_of
from jaxmm.data.preprocessed_pairs import sides_of
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.files import load_json, write_json
from jaxmm.inputs import InputError
from jaxmm.learning import model_files
from jaxmm.learning.batches import LabelledCloud
from jaxmm.learning.box_match import match_boxes
from jaxmm.learning.boxes import Box, fit_boxes
from jaxmm.learning.model import Model, pick_model
from jaxmm.learning.room_scores import predict
from jaxmm.objects.face_finish import Rays
from jaxmm.objects.finder import Judged, find_objects
from jaxmm.objects.walls import KnownBuilding
from jaxmm.rays.cloud_evidence import LEVELS
from jaxmm.rays.evidence import FEATURES
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.scenes.scenes import WALL
from warp_scanner.sensors.poses import rotation_of

FULL, SMOKE = {"rooms": 200, "only": []}, {"rooms": 1, "only": ["pillar_added"]}
OBSERVABLE = 0.2
AT_ONCE = 16  # rooms, bounds the memory
PRESETS = ("default", "thesis")
CHANGES = {"added": 1, "removed": -1}
APART = FEATURES.index("apart")


class Truth(NamedTuple):
    """One changed object."""

    box: Box
    observable: float


def rooms_of(config: Config, model: Model, source: CloudSource, count: int) -> list[dict[str, Any]]:
    """What both presets find in the first `count` rooms, as JSON: one record a room and change."""
    records = []
    for start in range(0, count, AT_ONCE):
        index = np.arange(start, min(start + AT_ONCE, count))
        pairs = pairs_of(config, source, index)
        sides = sides_of(config, pairs)
        clouds = {
            change: clouds_of(config, source._replace(scenario=f"pillar_{change}"), pairs, sides=sides)
            for change in CHANGES
        }
        for row, room in enumerate(index.tolist()):
            here = {change: made[row] for change, made in clouds.items()}
            extent, known = _extent(config, pairs, row, here), _known(config, pairs, row)
            for change, cloud in here.items():
                judged = _judged(config, model, (cloud, change), _rays(pairs, row), extent)
                found = {"default": _probable(judged, known), "thesis": _as_thesis(judged)}
                truth = _truths(pairs, row, CHANGES[change])
                scores = {preset: score_of(boxes, truth) for preset, boxes in found.items()}
                records.append({"room": room, "change": change} | scores)
    return records


def score_of(found: list[Box], truth: list[Truth]) -> dict[str, Any]:
    """Found boxes and true ones, each with its type and whether it is right or found; errors [m] of the right ones."""
    matches = match_boxes(found, [one.box for one in truth])
    right, hit = {match.found for match in matches}, {match.truth for match in matches}
    errors = [
        [truth[match.truth].box.object_type, error_of(found[match.found], truth[match.truth].box)] for match in matches
    ]
    return {
        "found": [[box.object_type, i in right] for i, box in enumerate(found)],
        "true": [[one.box.object_type, round(one.observable, 4), j in hit] for j, one in enumerate(truth)],
        "errors": [[kind, round(error, 4)] for kind, error in errors],
    }


def error_of(box: Box, truth: Box) -> float:
    """How far [m] the centre of a pillar is off in plan, or the middle plane of a wall, at the box's centre."""
    off = np.subtract(box.center, truth.center)[:2]
    if truth.object_type == "pillar":
        return float(np.linalg.norm(off))
    turn = np.radians(truth.rotation + (0.0 if truth.dimensions[0] >= truth.dimensions[1] else 90.0))
    return float(abs(off @ [-np.sin(turn), np.cos(turn)]))


def table_row(name: str, condition: str, change: str, records: list[dict[str, Any]]) -> dict[str, Any]:
    """Sums and shares over the records of a row."""
    row: dict[str, Any] = {"scene": name, "condition": condition, "change": change, "rooms": len(records)}
    for preset in PRESETS:
        scores = [record[preset] for record in records]
        found = [right for score in scores for _, right in score["found"]]
        hits = [hit for score in scores for _, observable, hit in score["true"] if observable >= OBSERVABLE]
        errors = {
            kind: [error for score in scores for one, error in score["errors"] if one == kind]
            for kind in ("pillar", "wall")
        }
        row[preset] = {
            "boxes": len(found),
            "objects": len(hits),
            "precision": float(np.mean(found)) if found else None,
            "recall": float(np.mean(hits)) if hits else None,
            "without_a_box": sum(not score["found"] for score in scores) / max(len(scores), 1),
        }
        for kind, values in errors.items():
            row[preset][f"{kind}_error"] = [float(q) for q in np.quantile(values, [0.5, 0.9])] if values else None
    return row


def markdown(rows: list[dict[str, Any]]) -> str:
    """The table, both presets side by side."""
    head = (
        "| scene | | objects | precision | recall | pillar centre [m] | wall plane [m] "
        "| precision, thesis | recall, thesis | pillar centre, thesis [m] | wall plane, thesis [m] |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|"
    )
    return "\n".join([head, *(_line(row) for row in rows)])


def _line(row: dict[str, Any]) -> str:
    def share(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f}"

    def spread(values: list[float] | None) -> str:
        return "-" if values is None else f"{values[0]:.3f}, {values[1]:.3f}"

    cells = [f"{row['scene']}: {row['change']}".replace("_", " "), row["condition"], str(row["default"]["objects"])]
    for preset in PRESETS:
        told = row[preset]
        # Where nothing changed there is neither; the share of sides without a box stands in for precision.
        empty = not told["objects"]
        precision = f"{share(told['without_a_box'])} without" if empty else share(told["precision"])
        cells += [precision, share(told["recall"]), spread(told["pillar_error"]), spread(told["wall_error"])]
    return f"| {' | '.join(cells)} |"


def _judged(
    config: Config, model: Model, which: tuple[LabelledCloud, str], rays: Rays, extent: tuple[float, float]
) -> Judged:
    cloud, change = which
    pillar, wall = (
        predict(pick_model(model, f"{kind}_{change}"), cloud.evidence, config.network) for kind in ("pillar", "wall")
    )
    told = None if change == "removed" else (rays,)  # as in `detect`
    return Judged(cloud.points, pillar, wall, cloud.evidence[:, APART], rays.origin[None], *extent, rays=told)


def _rays(pairs: Pairs, row: int) -> Rays:
    """All rays of the robot's scan, from where it is believed to be."""
    turned = rotation_of(pairs.pose.yaw[row : row + 1], pairs.pose.pitch[row : row + 1])[0]
    return Rays(pairs.pose.position[row], pairs.directions @ turned.T, pairs.robot.distance[row])


def _probable(judged: Judged, known: KnownBuilding) -> list[Box]:
    found = find_objects(judged, known=known)
    return [one.box for one in found if one.box.probability >= DetectSettings().least_probability]


def _as_thesis(judged: Judged) -> list[Box]:
    boxes = []
    for kind in ("pillar", "wall"):
        boxes += fit_boxes(judged.points, getattr(judged, kind), kind)
    return boxes


def _extent(config: Config, pairs: Pairs, row: int, clouds: dict[str, LabelledCloud]) -> tuple[float, float]:
    """Floor and ceiling: of the prior where it is known, else of what the clouds show."""
    if config.preprocess.evidence == "exact":
        half = float(pairs.size[row, 2]) / 2
        return -half, half
    z = np.concatenate([cloud.points[:, 2] for cloud in clouds.values()])
    low, high = np.percentile(z, LEVELS) if len(z) else (0.0, 0.0)
    return float(low), float(max(high, low + 0.5))


def _known(config: Config, pairs: Pairs, row: int) -> KnownBuilding:
    """What is usual in the prior, where it is known; its elements are not told."""
    if config.preprocess.evidence != "exact":
        return KnownBuilding()
    return prior_of_building(building_of_room(pairs.prior, row)[0]).known


def _truths(pairs: Pairs, row: int, change: int) -> list[Truth]:
    box = pairs.box
    return [
        Truth(
            Box(
                "wall" if box.object_type[row, one] == WALL else "pillar",
                box.center[row, one].astype(float),
                box.size[row, one].astype(float),
                float(box.yaw[row, one]),
            ),
            float(pairs.observable_fraction[row, one]),
        )
        for one in np.flatnonzero(box.change[row] == change)
    ]


def main(model: Path, out: Path, rooms: int, case: str, only: list[str]) -> None:
    models, trained = model_files.load_models(model)
    config = condition_config(trained, case, rooms)
    path = model / run_folder.MODELS if model.is_dir() else model
    begun = {"model": hashlib.sha256(path.read_bytes()).hexdigest(), "case": case, "rooms": rooms}
    told = out / "begun.json"
    if told.exists() and load_json(told) != begun:
        raise InputError(f"{out}: holds rows of other models, rooms or settings; choose another --out or remove it")
    write_json(told, begun)
    rows = []
    for scene in only or SCENES:
        for condition in CONDITIONS:
            file = out / "rows" / f"{scene}_{condition}.json"
            if not file.exists():
                source = CloudSource("pillar_added", scene, condition, config.data.test_seed)
                write_json(file, rooms_of(config, models["evidence"], source, rooms))
            records = load_json(file)
            for change in CHANGES:
                chosen = [record for record in records if record["change"] == change]
                if scene == UNCHANGED or any(record["default"]["true"] for record in chosen):
                    rows.append(table_row(scene, condition, change, chosen))
                    print(_line(rows[-1]), flush=True)
    write_json(out / "objects.json", {"rows": rows, "meta": begun})
    print(markdown(rows))


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_out(about="folder of the rows")
    parser.add_argument("--model", type=Path, default=DEFAULT, help="run folder or .safetensors file")
    parser.add_argument("--rooms", type=int, help="test rooms a row")
    parser.add_argument("--case", choices=CASES, default="unfiltered", help="a condition of benchmarks/accuracy.py")
    parser.add_argument("--only", nargs="+", choices=SCENES, help="some scenes only")
    options = parser.parse_args()
    main(options.model, options.out, options.rooms, options.case, options.only)
