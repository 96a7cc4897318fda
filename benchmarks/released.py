"""What `detect` finds in the thesis's released scan pairs: one cloud is the prior, the other the scan.

    python -m benchmarks.released ROOT [--rooms test|train] [--json FILE]

ROOT is the thesis's repository. No pose is given: it is estimated from the cloud of the scan, with the field of view
of the camera that the thesis used. Prints, for each pair, the objects of the scenario that were found, how far
off they are, and every other mismatch, which is false; or why the pair is refused.
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command_line import CommandLine, end_without
from benchmarks.timing import write_report
from jaxmm.commands.detect_files import Reading, detect
from jaxmm.files import load_json
from jaxmm.inputs import InputError
from jaxmm.learning.box_match import footprint, match_boxes
from jaxmm.learning.boxes import Box
from jaxmm.thesis.repository import ThesisPair, find_pairs, read_pair
from jaxmm.verdicts.results import Detection, box_of
from warp_scanner.sensors.sensors import Pinhole

CAMERA = Pinhole(width=320, height=240, horizontal_fov=80.0, vertical_fov=60.0)
FULL, SMOKE = {"pairs": None}, {"pairs": 1}  # at most so many
APART = 0.5  # [m] between the points of two objects


def run(root: Path, rooms: str, most: int | None) -> list[dict[str, Any]]:
    """One row for each pair, of the first ones where there is a limit."""
    return [row_of(pair) for pair in find_pairs(root, rooms)[:most]]


def row_of(pair: ThesisPair) -> dict[str, Any]:
    """One pair."""
    added = pair.scenario.endswith("added")
    prior, scan = (pair.other, pair.scored) if added else (pair.scored, pair.other)
    case = f"{pair.source} {pair.room} {pair.scenario} {pair.condition}"
    try:
        found = detect(prior, scan, reading=Reading(sensor=CAMERA))
    except InputError as error:
        return {"case": case, "refused": str(error)}
    return {
        "case": case,
        "pose": [round(value, 3) for value in found.scans[0].pose],
        "registration": found.registration,
        **compared(found, pair),
    }


def compared(found: Detection, pair: ThesisPair) -> dict[str, Any]:
    """Found objects against the true ones: by released boxes where there are some, by labelled points always."""
    kind, change = pair.scenario.split("_")
    true = read_pair(pair)
    places = true.points[true.label].astype(np.float64)
    mine = [one for one in found.mismatches if (one.object_type, one.mismatch_type) == (kind, change)]
    holding = [float(np.mean(_beside(box_of(one), places) <= 0.1)) for one in mine]
    right = [one for one, share in zip(mine, holding, strict=True) if share > 0.1]
    told = [
        {
            "type": one.object_type, "change": one.mismatch_type, "center": np.round(one.center, 3).tolist(),
            "dimensions": np.round(one.dimensions, 3).tolist(), "probability": round(one.probability, 3),
            "right": any(one is other for other in right),
        }
        for one in found.mismatches
    ]  # fmt: skip
    return {
        "labelled_points": len(places), "held": round(max(holding, default=0.0), 3), "found": len(right),
        "false": len(found.mismatches) - len(right), "boxes": _against_boxes(found, pair), "mismatches": told,
    }  # fmt: skip


def _against_boxes(found: Detection, pair: ThesisPair) -> list[dict[str, Any]]:
    """Every released box of the pair, and the found one that stands for it."""
    _, change = pair.scenario.split("_")
    true = [
        Box(one["label"], np.array(one["center"]), np.array(one["dimensions"]), float(one["rotation"]))
        for path in sorted(pair.scored.parent.parent.glob("bounding_boxes/*.json"))
        for one in load_json(path)["objects"]
    ]
    boxes = [box_of(one) for one in found.mismatches if one.mismatch_type == change]
    told = []
    matches = {match.truth: match for match in match_boxes(boxes, true)}
    for number, box in enumerate(true):
        match = matches.get(number)
        off = boxes[match.found].center - box.center if match else None
        turn = np.radians(box.rotation) + (np.pi / 2 if box.dimensions[0] >= box.dimensions[1] else 0.0)
        told.append({
            "true": np.round([*box.center, *box.dimensions], 3).tolist(),
            "overlap": round(match.overlap, 3) if match else None,
            "center_off": round(float(np.linalg.norm(off[:2])), 3) if match else None,
            "plane_off": round(abs(float(off[:2] @ [np.cos(turn), np.sin(turn)])), 3) if match else None,
        })  # fmt: skip
    return told


def _beside(box: Box, points: np.ndarray) -> np.ndarray:
    """How far (n,) [m] points (n, 3) lie outside a box in plan, along the axis on which they are furthest."""
    corners = footprint(box, box.center[:2])
    axes = np.stack([corners[1] - corners[0], corners[3] - corners[0]])
    length = np.linalg.norm(axes, axis=1)
    return (np.abs((points[:, :2] - box.center[:2]) @ (axes / length[:, None]).T) - length / 2).max(axis=1)


def table(rows: list[dict[str, Any]]) -> str:
    """Rows as Markdown."""
    lines = ["| pair | labelled points in the box | found | false | released boxes: overlap, plan, plane [m] |"]
    lines.append("| --- | --- | --- | --- | --- |")
    for row in rows:
        if "refused" in row:
            lines.append(f"| {row['case']} | refused: {row['refused'].split(': ', 1)[-1]} | | | |")
            continue
        boxes = "; ".join(f"{one['overlap']}, {one['center_off']}, {one['plane_off']}" for one in row["boxes"])
        lines.append(f"| {row['case']} | {row['held']:.3f} | {row['found']} | {row['false']} | {boxes or '-'} |")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_input("root")
    parser.add_argument("--rooms", choices=("test", "train"), default="test")
    parser.add_json()
    asked = parser.parse_args()
    if asked.root is None:
        end_without("benchmarks.released needs ROOT, the thesis's repository, which is no part of this project")
    try:
        result = run(asked.root, asked.rooms, asked.pairs)
    except InputError as error:
        end_without(str(error))
    print(table(result))
    if asked.json:
        write_report(asked.json, result)
