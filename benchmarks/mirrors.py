"""Rooms with mirrors and walls of glass: what is found that is not there, with and without leaving images out.

    python -m benchmarks.mirrors [--rooms 20] [--seed 42] [--json FILE]     half an hour

Generated rooms (`varied`, with furniture), scanned with errors by a spinning sensor and a camera. In some a mirror
hangs on an outer wall, or a wall is all mirror (95 % of its rays are thrown back), or all glass (30 % are thrown back,
50 % pass); `none` has nothing of the kind, to show what is lost. Compared with the room's model, and with a scan of it
from the same place. A false object is one that stands for no true one; of removed ones a mirror's own wall counts, too.
The peer is the same detection with `mirrors = false`. Prints Markdown.
"""

import dataclasses
from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.timing import write_report
from benchmarks.views.detection_scores import objects_of
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.runs.room_scans import RoomCase, as_cloud, cases_of
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from warp_scanner import draws
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.mirrors import GLASS, MIRROR, hung_mirrors, sheen_of
from warp_scanner.rooms.pairs import PRESETS, PairConfig
from warp_scanner.rooms.scenarios import Scenes, make_scenes
from warp_scanner.scenes.scenes import WALL, join, take
from warp_scanner.sensors.imperfections import imperfect
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.reflections import reflected, room_caster
from warp_scanner.sensors.sense import rays_of, within_reach
from warp_scanner.sensors.sensors import Pinhole, sensor_named

SEED = 42  # of validation
KINDS = ("none", "mirror", "mirrored wall", "glass wall")
FULL = {
    "sensors": ("ouster-64-real", "oak-d-pro"),
    "scenes": ("unchanged", "wall_removed", "wall_added"),
    "kinds": KINDS,
    "priors": ("model", "cloud"),
    "rooms": 20,
}
SMOKE = {"sensors": ("oak-d-pro",), "scenes": ("wall_removed",), "kinds": KINDS[-1:], "priors": ("model",), "rooms": 1}
CAMERA = (320, 200)  # columns and rows that a camera is asked for
COUNTS = ("added", "removed", "reached", "wanted")


class Case(NamedTuple):
    """A room as its scanner reports it."""

    room: RoomCase
    images: float  # share of the points that came by way of a mirror


def cases(kind: str, scene: str, sensor: str, which: tuple[int, int]) -> Iterator[Case]:
    """Rooms of a seed, as many as are asked for."""
    seed, count = which
    device = sensor_named(sensor)
    if isinstance(device, Pinhole):
        device = device.resampled(*CAMERA)
    settings = dataclasses.replace(PRESETS["varied"], scenario=scene, condition="occluded", seed=seed, sensor=device)
    scenes = make_scenes(settings.scene, seed, np.arange(count))
    for room in cases_of(settings, range(count)):
        yield Case(room, 0.0) if kind == "none" else _mirrored(kind, settings, scenes, room)


def _mirrored(kind: str, settings: PairConfig, scenes: Scenes, room: RoomCase) -> Case:
    one, pairs, sensor = room.row, room.pairs, settings.sensor
    primitives, present = take(scenes.primitives, np.array([one])), scenes.in_real[one : one + 1]
    pose, which = Pose(*(field[one : one + 1] for field in scenes.pose)), (settings.seed, np.array([one]))
    count = int(primitives.element.max()) + 1
    if kind == "mirror":
        primitives = join(primitives, hung_mirrors(scenes.size[one : one + 1], pose, draws.keys(*which), count))
        present, things = np.append(present, [[True]], axis=1), {count: MIRROR}
    else:
        walls = pairs.dt.element[one][(pairs.dt.semantic[one] == WALL) & ~pairs.changed_dt[one]]
        shares = MIRROR if kind == "mirrored wall" else GLASS
        things = {int(np.argmax(np.bincount(walls))): shares} if len(walls) else {}
    found = reflected(room_caster(primitives, present), rays_of(sensor, pose), sheen_of(count + 1, things), which)
    scan = imperfect(within_reach(found.scan, sensor), found.incidence, sensor, *which)
    points, back = points_of(pose, pairs.directions, scan.distance)[0], np.isfinite(scan.distance[0])
    images = float(np.mean(found.mirrored[0][back] > 0)) if back.any() else 0.0
    return Case(room._replace(scan=room.scan._replace(points=points[back])), images)


def counts_of(judges: Judges, room: RoomCase, prior: str, mirrors: bool) -> Counter[str]:
    """False objects, and true ones found, of one room; `left`: whether anything was left out."""
    settings = DetectSettings(refine=False, propose_views=False, mirrors=mirrors)
    known = room.prior if prior == "model" else as_cloud(room)
    found = detect_scans(known, [NamedScan(room.scan, "scan", len(room.scan.points), "given")], judges, settings)
    told = objects_of(found.mismatches, room)
    wrong = Counter(box["change"] for box in told["boxes"] if not (box["right"] or box["hidden"]))
    left = any("mirror images" in note for note in found.scans[0].notes)
    return wrong + Counter(reached=told["reached"], wanted=told["wanted"], left=int(left))


def row_of(case: str, both: tuple[Counter[str], Counter[str]], rooms: int) -> dict[str, Any]:
    """False objects of a room with images left out (ours) and not."""
    wrong = [(one["added"] + one["removed"]) / rooms for one in both]
    more = 1.0 / rooms  # one more in each, so that the ratio is finite
    counts = {f"{name}_{word}": one[name] for word, one in zip(("ours", "peer"), both, strict=True) for name in COUNTS}
    return {
        "case": case, "rooms": rooms, "left_out": both[0]["left"], **counts, "ours": wrong[0], "peer": wrong[1],
        "peer_name": "mirrors = false", "unit": "false objects a room", "ratio": (wrong[0] + more) / (wrong[1] + more),
    }  # fmt: skip


def main() -> None:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("--rooms", type=int, metavar="N", help="of each kind and scene")
    parser.add_argument("--seed", type=int, default=SEED, metavar="N")
    parser.add_json()
    asked = parser.parse_args()
    judges, rows = read_judges(DEFAULT), []
    print("| sensor, prior | mirrors | scene | rooms | images | left out in | false added, before and now | "
          f"false removed | true found |\n|{' --- |' * 9}")  # fmt: skip
    for sensor in asked.sensors:
        for kind in asked.kinds:
            for scene in asked.scenes:
                rooms = list(cases(kind, scene, sensor, (asked.seed, asked.rooms)))
                images = float(np.mean([one.images for one in rooms]))
                for prior in asked.priors:
                    both = tuple(
                        sum((counts_of(judges, one.room, prior, mirrors) for one in rooms), Counter())
                        for mirrors in (True, False)
                    )
                    now, before = both
                    rows.append(row_of(f"{kind}, {scene}, {sensor}, {prior}", both, len(rooms)))
                    told = " | ".join(f"{before[name]}, {now[name]}" for name in ("added", "removed"))
                    found = f"{before['reached']}, {now['reached']} of {now['wanted']}"
                    start = f"{sensor}, {prior} | {kind} | {scene} | {len(rooms)} | {images:.3f} | {now['left']}"
                    print(f"| {start} | {told} | {found} |", flush=True)
    if asked.json:
        write_report(asked.json, rows)


if __name__ == "__main__":
    main()
