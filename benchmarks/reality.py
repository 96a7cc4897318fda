"""Real scans, of which nothing is simulated: is what is told of them right, or refused for a reason?

    JAXMM_DATA=FOLDER python -m benchmarks.reality [--other TREE] [--figures DIR] [--json FILE]     six minutes

Each row is one run of `jaxmm detect`. A scan against itself, against every other of its own points, and against one
half of them, its pose right and off by 0.4 m: nothing changed, so nothing may be told, and it must come to lie where it
was taken. Another scan of the same place: likewise. A model that is drawn from the scan (`drawn_models`): as it is,
with phantom elements where the scan shows nothing, and with two walls left out. Scans of which nobody knows the place
must be refused. With --other, the build in another checkout is asked the same. --figures keeps the plan that each run
of this build draws, named after the case. Nothing is ever chosen by these scans. Prints Markdown.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.command_line import CommandLine, end_without
from benchmarks.timing import write_report
from benchmarks.views.drawn_models import Block, drawn, left_out, phantoms, with_openings, write_blocks
from jaxmm.formats.readers import read_scans
from warp_scanner.scenes.scenes import WALL

# Of each scan the place of its sensor in its own frame [m], and that frame; where they are from: README.md of the data.
SCANS = {
    "real/libpointmatcher/cloud_0.vtk": ((0.0, 0.0, 0.4), "world"),
    "real/libpointmatcher/cloud_1.vtk": ((0.0, 0.0, 0.4), "world"),
    "real/kinect/capture0001.pcd": ((0.0, 0.0, 0.0), "optical"),
    "real/kinect/capture0003.pcd": ((0.0, 0.0, 0.0), "optical"),
    "scans/pcl_office1.pcd": ((0.0, 0.0, 0.0), "optical"),
}
PAIRS = {  # scan, prior: the place of the scan's frame in the prior's [m], and its yaw [deg]
    ("real/libpointmatcher/cloud_1.vtk", "real/libpointmatcher/cloud_0.vtk"): ((0.614, -0.011, 0.006), 6.63),
}
PLACELESS = ("real/ipad/808_db.ply", "real/mobile/indoor.laz", "real/ouster/512x10_raw.bag")  # to be refused
MODELLED = ("real/libpointmatcher/cloud_0.vtk", "real/libpointmatcher/cloud_1.vtk")
OFF = np.array([0.34, 0.2, 0.06])  # [m] 0.4 m
HELD = 0.1  # [m] off the place that the data tell of the sensor, up to which a pose is right: they tell it no better
NEAR = 0.5  # [m] between the centres of an object and what it is held for
FULL = {"scans": tuple(SCANS), "pairs": tuple(PAIRS), "modelled": MODELLED, "placeless": PLACELESS, "generated": False}
SMOKE = {"scans": (), "pairs": (), "modelled": (), "placeless": (), "generated": True}


class Case(NamedTuple):
    """One run, and what is right."""

    name: str
    prior: Path
    scan: Path
    pose: str | None  # of --pose
    frame: str = "world"
    removed: frozenset[str] = frozenset()  # GlobalIds
    added: tuple[np.ndarray, ...] = ()  # (3,) [m] centres
    refused: bool = False
    place: tuple[float, ...] | None = None  # (3,) [m] of the sensor in the prior's frame, where it is known


def identities(scan: np.ndarray, place: tuple, work: Path, name: str) -> Iterator[Case]:
    """Of points (N, 3) [m] in the world and the place of their sensor: parts of them as the prior of the others."""
    parts = {
        "itself": (scan, scan),
        "every other point": (scan[::2], scan[1::2]),
        "its left half": (scan[scan[:, 1] > np.median(scan[:, 1])], scan),
    }
    for what, (prior, seen) in parts.items():
        for how, off in (("", np.zeros(3)), (", 0.4 m off", OFF)):
            if how and what != "itself":
                continue
            files = [work / f"{kind}-{len(list(work.iterdir()))}.npy" for kind in ("prior", "scan")]
            for file, points in zip(files, (prior, seen + off), strict=True):
                np.save(file, points.astype(np.float32))
            yield Case(f"{name} against {what}{how}", *files, _pose(np.asarray(place) + off), place=place)


def models(scan: np.ndarray, place: tuple, work: Path, name: str) -> Iterator[Case]:
    """A model drawn from points (N, 3) [m]: as it is, with phantoms, and with walls left out."""
    position = np.asarray(place, float)
    blocks, ghosts = drawn(scan, position), phantoms(scan, position)
    gone = left_out(blocks, scan)
    solid = [_solid(block, scan, position) for block in blocks]
    kept = [parts for block, parts in zip(blocks, solid, strict=True) if not any(block is one for one in gone)]
    centres = tuple(one.center for one in gone)
    for how, off in (("", np.zeros(3)), (", 0.4 m off", OFF)):
        file = work / f"scan{len(list(work.iterdir()))}.npy"
        np.save(file, (scan + off).astype(np.float32))
        for what, elements, ghost, new in (
            ("as drawn", solid, [], ()),
            (f"with {len(ghosts)} phantoms", [*solid, *([one] for one in ghosts)], ghosts, ()),
            (f"without {len(gone)} walls", kept, [], centres),
        ):
            prior = work / f"model{len(list(work.iterdir()))}.ifc"
            guids = write_blocks(prior, elements)
            removed = frozenset(guids[len(elements) - 1 - row] for row in range(len(ghost)))
            yield Case(f"{name} against a model of it, {what}{how}", prior, file, _pose(position + off), "world",
                       removed, new, place=place)  # fmt: skip


def outcome(case: Case, tree: Path | None, work: Path, figures: Path | None = None) -> str:
    """What one build makes of a case: "right", "refused: ..." or what is wrong; the plan goes to a folder `figures`."""
    out = work / f"out{len(list(work.iterdir()))}"
    command = [sys.executable, "-m", "jaxmm", "detect", str(case.prior), str(case.scan), "--out", str(out)]
    if case.pose is not None:
        command += [f"--pose={case.pose}", "--frame", case.frame]
    environment = os.environ | ({"PYTHONPATH": str(tree)} if tree else {})
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tree, check=False)
    if done.returncode == 2:
        line = done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "no reason"
        return "right: refused" if case.refused else f"refused: {_short(line)}"
    if done.returncode not in (0, 1) or not (out / "report.json").exists():
        return f"failed with {done.returncode}"
    if figures:
        figures.mkdir(parents=True, exist_ok=True)
        shutil.copy(out / "plan.png", figures / f"{re.sub('[^a-z0-9]+', '_', case.name.lower())}.png")
    if case.refused:
        return "wrong: believed without a place"
    return judged(case, json.loads((out / "report.json").read_text(encoding="utf-8")))


def judged(case: Case, report: dict[str, Any]) -> str:
    """Whether a report says what is right."""
    removed = {one["element"] for one in report["mismatches"] if one["mismatch_type"] == "removed" and one["element"]}
    clouds = sum(one["mismatch_type"] == "removed" and one["element"] is None for one in report["mismatches"])
    added = [np.array(one["center"]) for one in report["mismatches"] if one["mismatch_type"] == "added"]
    found = [any(np.linalg.norm((centre - one)[:2]) < NEAR for one in added) for centre in case.added]
    extra = sum(all(np.linalg.norm((one - centre)[:2]) >= NEAR for centre in case.added) for one in added)
    wrong = {
        "falsely removed": len(removed - case.removed) + clouds,
        "not told removed": len(case.removed - removed),
        "falsely added": extra,
        "not told added": found.count(False),
        "displaced": sum(one["verdict"] == "displaced" for one in report["elements"]),
    }
    said = ", ".join(f"{count} {what}" for what, count in wrong.items() if count)
    if case.place is not None and (off := _apart(report, case.place)) > HELD:
        said = f"{said}, its pose {off:.2f} m off".lstrip(", ")
    doubts = [note for scan in report["scans"] for note in scan.get("doubts", ())]
    doubted = f" (doubted: {_short(doubts[0])})" if doubts else ""
    return (f"wrong: {said}" if said else "right") + doubted


def _apart(report: dict[str, Any], place: tuple[float, ...]) -> float:
    return float(np.linalg.norm(np.array(report["scans"][0]["pose"][:3]) - place))


def _short(line: str) -> str:
    return line if len(line) <= 110 else f"{line[:107]}..."


def _pose(place: np.ndarray, yaw: float = 0.0) -> str:
    return ",".join(f"{value:.6g}" for value in (*place, yaw))


def _solid(block: Block, scan: np.ndarray, position: np.ndarray) -> list[Block]:
    return with_openings(block, scan, position) if block.semantic == WALL else [block]


def _points(path: Path, frame: str) -> np.ndarray:
    """The points (N, 3) [m] of a file, z up."""
    points = np.concatenate([scan.points for scan in read_scans(path)])
    points = points[np.isfinite(points).all(1)]
    return points[:, [2, 0, 1]] * [1.0, -1.0, -1.0] if frame == "optical" else points


def cases(asked: Any, data: Path, work: Path) -> Iterator[Case]:
    """All that there are files for."""
    for name in asked.scans:
        place, frame = SCANS[name]
        yield from identities(_points(data / name, frame), place, work, _title(name))
    for scan, prior in asked.pairs:
        shift, yaw = PAIRS[scan, prior]
        turn = Rotation.from_euler("z", yaw, degrees=True).as_matrix()
        for how, off in (("", np.zeros(3)), (", 0.4 m off", OFF)):
            file = work / f"moved{len(list(work.iterdir()))}.npy"
            np.save(file, (_points(data / scan, "world") @ turn.T + shift + off).astype(np.float32))
            place = turn @ np.array(SCANS[scan][0]) + shift
            title = f"{_title(scan)} against {_title(prior)}{how}"
            yield Case(title, data / prior, file, _pose(place + off, yaw), place=tuple(place))
    for name in asked.modelled:
        place, frame = SCANS[name]
        yield from models(_points(data / name, frame), place, work, _title(name))
    for name in asked.placeless:
        yield Case(f"{_title(name)} without a place", data / name, data / name, None, refused=True)
    if asked.generated:  # a room that stands in for the data, where there is none
        place = (0.0, 0.0, 1.5)
        yield from list(identities(_room(), place, work, "a box"))[:1]


def _room() -> np.ndarray:
    """Points (N, 3) [m] on the inside of a box of 6 x 4 x 3 m, as rays from (0, 0, 1.5) meet it."""
    way = np.random.default_rng(0).normal(size=(20_000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    reach = np.min(np.array([3.0, 2.0, 1.5]) / np.abs(way), axis=1)
    return way * reach[:, None] + [0.0, 0.0, 1.5]


def _title(name: str) -> str:
    path = Path(name)
    return f"{path.parent.name}/{path.stem}"


def main() -> None:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose name holds this")
    parser.add_argument("--figures", type=Path, metavar="DIR", help="where to keep the plan of each run")
    parser.add_argument("--other", type=Path, metavar="TREE", help="a checkout of another build, asked the same")
    asked = parser.parse_args()
    data = Path(os.environ.get("JAXMM_DATA", "../shared/data"))
    if not asked.generated and not (data / "real").is_dir():
        end_without(f"{data}: expected real scans in the folder real/, found none; set JAXMM_DATA")
    trees = {"this build": None} | ({str(asked.other.name): asked.other.resolve()} if asked.other else {})
    print(f"| case | {' | '.join(trees)} |\n|{' --- |' * (len(trees) + 1)}")
    rows = []
    with TemporaryDirectory(prefix="reality_") as scratch:
        for case in cases(asked, data, Path(scratch)):
            if asked.only not in case.name:
                continue
            told = {
                name: outcome(case, tree, Path(scratch), None if tree else asked.figures)
                for name, tree in trees.items()
            }
            print(f"| {case.name} | {' | '.join(told.values())} |", flush=True)
            rows.append({"case": case.name, **told})
    for name in trees:
        right = sum(row[name].startswith("right") for row in rows)
        print(f"\n{name}: {right} of {len(rows)} right")
    if asked.json:
        write_report(asked.json, rows)


if __name__ == "__main__":
    main()
