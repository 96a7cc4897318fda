"""Elements that touch or lie in each other, one of them gone: whose surface is it that rays end on?

    python -m benchmarks.views.touching [--scenes 24] [--seed 5] [--sensors ouster-64-real tls-real]

Two walls that meet at a corner, at a T or in one line and overlap there, a column in a wall, a wall upon a slab and
below another, a lining that shares a wall's face. Walls are parallel to the axes of a scene that is turned by any
angle; behind them is nothing, in half of the scenes but a post. Of the pair either is gone, in one scene of six none.
*Tells* is how many noise-free rays that should end on what is gone end more than 0.1 m behind it; *in view* how many
end there or bring nothing back. A line for each kind, as Markdown.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.views.building_views import scanned
from jaxmm.inputs import InputError
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import PRESENT, REMOVED
from jaxmm.weights import DEFAULT
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.cores import worker_pool
from warp_scanner.scenes.building import Building
from warp_scanner.scenes.scenes import BOX, CEILING, FLOOR, OTHER, PILLAR, WALL, Primitives
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import sensor_named
from warp_scanner.sensors.triangles import cast_triangles, prepare

FULL = {"scenes": 24, "sensors": ("ouster-64-real", "tls-real")}
SMOKE = {"scenes": 1, "sensors": ("oak-d-pro-small-real",)}
BEHIND, LEAST_RAYS, LEAST_VIEW = 0.1, 500, 2000  # [m], and rays that tell, or should end on what is gone
UNTOUCHED, POST = 1.0 / 6.0, 0.5  # shares of the scenes
CLASSES = {WALL: "IfcWall", PILLAR: "IfcColumn", FLOOR: "IfcSlab", CEILING: "IfcSlab", OTHER: "IfcCovering"}
COLUMNS = (
    "kind", "scenes", "gone, of 500 rays that tell", "of those removed", "present", "gone, of fewer",
    "of those removed", "present", "standing", "of those removed",
)  # fmt: skip

Boxes = tuple[tuple[tuple, tuple, int], ...]  # low and high corner [m], semantic


class Scene(NamedTuple):
    """A pair of elements, and what is around them."""

    boxes: Boxes  # of the model; the pair comes first
    extra: Boxes  # what the model does not have
    place: np.ndarray  # (3,) [m] of the sensor
    yaw: float  # [rad] of all


def _wall(rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Thickness, height, distance and half length [m] of a wall before the sensor."""
    return rng.uniform(0.1, 0.35), rng.uniform(2.4, 3.2), rng.uniform(1.8, 5.0), rng.uniform(1.5, 4.0)


def _off(rng: np.random.Generator) -> float:
    """[m] by which faces that should be one are apart: mostly none."""
    return rng.choice((0.0, 0.0, rng.uniform(-0.02, 0.02)))


def line(rng: np.random.Generator) -> Boxes:
    """Two walls in one line, one of which begins before the other ends."""
    thick, high, away, half = _wall(rng)
    end, over, off = rng.uniform(-1.0, 1.0), rng.uniform(0.1, 0.5), _off(rng)
    return (
        ((end - 2 * half, away, 0.0), (end, away + thick, high), WALL),
        ((end - over, away + off, 0.0), (end + rng.uniform(1.0, 4.0), away + thick, high), WALL),
    )


def corner(rng: np.random.Generator) -> Boxes:
    """Two walls across each other at an end of the first; the second goes to the sensor's side, or away from it."""
    thick, high, away, half = _wall(rng)
    other, end = rng.uniform(0.1, 0.35), rng.uniform(0.8, 3.0)
    low, top = (away - rng.uniform(1.0, 3.0), away + thick) if rng.random() < 0.4 else (
        away + _off(rng), away + rng.uniform(1.0, 4.0))  # fmt: skip
    return (
        ((end - 2 * half, away, 0.0), (end, away + thick, high), WALL),
        ((end - other, low, 0.0), (end + _off(rng), top, high), WALL),
    )


def tee(rng: np.random.Generator) -> Boxes:
    """A wall that ends within another, or on its face, behind or before it."""
    thick, high, away, half = _wall(rng)
    other, at, end = rng.uniform(0.1, 0.35), rng.uniform(-1.0, 1.0), away + rng.uniform(0.0, thick)
    low, top = (away - rng.uniform(0.8, 1.5), end) if rng.random() < 0.4 else (
        away + _off(rng), away + rng.uniform(1.0, 4.0))  # fmt: skip
    at += other if low < away - 0.1 else 0.0
    return (
        ((-half, away, 0.0), (half, away + thick, high), WALL),
        ((at, low, 0.0), (at + other, top, high), WALL),
    )


def column(rng: np.random.Generator) -> Boxes:
    """A column in a wall, that ends with its face or stands out of it."""
    thick, high, away, half = _wall(rng)
    size, at = rng.uniform(0.2, 0.5), rng.uniform(-half + 0.5, half - 0.5)
    front = away - rng.choice((0.0, rng.uniform(0.0, 0.05), rng.uniform(0.05, 0.2)))
    return (
        ((-half, away, 0.0), (half, away + thick, high), WALL),
        ((at - size / 2, front, 0.0), (at + size / 2, front + size, high), PILLAR),
    )


def upon(rng: np.random.Generator) -> Boxes:
    """A wall in or upon the edge of a slab; the sensor stands on that."""
    thick, high, away, half = _wall(rng)
    foot = rng.choice((0.0, -0.2))
    return (
        ((-half, away, foot), (half, away + thick, high), WALL),
        ((-half - 1.0, away - rng.uniform(1.0, 4.0), -0.2), (half + 1.0, away + thick, 0.0), FLOOR),
    )


def lining(rng: np.random.Generator) -> Boxes:
    """A wall with a lining on a part of its face."""
    thick, high, away, half = _wall(rng)
    own, start = rng.uniform(0.01, 0.06), rng.uniform(-half, 0.0)
    return (
        ((-half, away, 0.0), (half, away + thick, high), WALL),
        ((start, away - own, 0.0), (rng.uniform(start + 0.5, half), away, high * rng.uniform(0.4, 1.0)), OTHER),
    )


KINDS: dict[str, Callable[[np.random.Generator], Boxes]] = {
    one.__name__: one for one in (line, corner, tee, column, upon, lining)
}


def drawn_scene(kind: str, seed: tuple[int, int]) -> tuple[Scene, np.random.Generator]:
    """A scene, and where its draws go on."""
    rng = np.random.default_rng((*seed, list(KINDS).index(kind)))
    pair = KINDS[kind](rng)
    high = pair[0][1][2]
    around: list[tuple[tuple, tuple, int]] = [((-6.0, -3.2, 0.0), (6.0, -3.0, high), WALL)]
    around.append(((-6.2, -3.2, 0.0), (-6.0, pair[0][0][1], high), WALL))
    near = pair[0][0][1]  # [m] where the first one's face is
    floor = near if kind != "upon" else pair[1][0][1]
    around.append(((-6.2, -3.2, -0.2), (6.0, floor - 0.002, 0.0), FLOOR))
    if rng.random() < 0.5:
        around.append(((-6.2, -3.2, high), (6.0, near + 0.2, high + 0.2), CEILING))
    extra = ()
    if rng.random() < POST:
        x, y, size = rng.uniform(-3.0, 3.0), near + rng.uniform(5.0, 12.0), rng.uniform(0.1, 0.4)
        extra = (((x, y, -0.2), (x + size, y + size, rng.uniform(1.5, 3.0)), OTHER),)
    place = np.array([rng.uniform(-1.5, 1.5), rng.uniform(-2.0, near - 1.7), rng.uniform(1.2, 1.8)])
    return Scene((*pair, *around), extra, place, rng.uniform(-np.pi, np.pi)), rng


def building_of(boxes: Boxes, yaw: float) -> Building:
    """The boxes, turned about z, each as an element."""
    low, high = (np.array([box[side] for box in boxes], float) for side in (0, 1))
    semantic, turn = np.array([box[2] for box in boxes], np.uint8), np.array([
        [np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])  # fmt: skip
    count = len(boxes)
    found = building_of_room(
        Primitives(
            np.full((1, count), BOX, np.uint8), ((low + high) / 2 @ turn.T)[None].astype(np.float32),
            ((high - low) / 2)[None].astype(np.float32), np.full((1, count), yaw, np.float32),
            np.arange(count, dtype=np.int32)[None], semantic[None],
        ), 0)[0]  # fmt: skip
    classes = tuple(CLASSES[int(one)] for one in semantic)
    return found._replace(elements=found.elements._replace(ifc_class=classes))


def told(kind: str, seed: tuple[int, int], sensor_name: str, judges: Judges) -> dict[str, Any]:
    """What is told of one scene, or why its scan is refused."""
    scene, rng = drawn_scene(kind, seed)
    whole = building_of((*scene.boxes, *scene.extra), scene.yaw)
    there = np.ones(len(whole.elements.guid), bool)
    gone = -1 if rng.random() < UNTOUCHED else int(rng.integers(2))
    if gone >= 0:
        there[gone] = False
    c, s = np.cos(scene.yaw), np.sin(scene.yaw)
    place = scene.place @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = np.array([rng.uniform(-180.0, 180.0)], np.float32)
    pose = Pose(place[None].astype(np.float32), turned, np.zeros(1, np.float32))
    sensor, full = sensor_named(sensor_name), prepare(whole.triangles)
    rays = rays_of(sensor, pose)
    model = there.copy()
    model[: len(scene.boxes)] = True
    model[len(scene.boxes) :] = False
    meets, truth = cast_triangles(full, rays, model), cast_triangles(full, rays, there).distance[0]
    own = (meets.element[0] == gone) & (truth > meets.distance[0] + BEHIND)
    scan, _ = scanned(full, there, (sensor, pose), seed)
    prior = prior_of_building(building_of(scene.boxes, scene.yaw))
    settings = DetectSettings(classes=("all",), propose_views=False)
    try:
        found = detect_scans(prior, [NamedScan(scan, "scan", len(scan.points), "given")], judges, settings)
    except InputError as error:
        return {"kind": kind, "refused": str(error)}
    verdict = {one.guid: one for one in found.elements}
    guids = prior.building.elements.guid
    return {
        "kind": kind, "gone": gone,
        "tells": int((own & np.isfinite(truth)).sum()), "in_view": int(own.sum()),
        "verdicts": [verdict[guid].verdict for guid in guids],
    }  # fmt: skip


def table(views: list[dict[str, Any]]) -> str:
    """A row for each kind, and one for all, as Markdown."""
    lines = [f"| {' | '.join(COLUMNS)} |", f"|{' --- |' * len(COLUMNS)}"]
    for name in (*KINDS, "all"):
        some = [one for one in views if name in (one["kind"], "all") and "refused" not in one]
        gone = [one for one in some if one["gone"] >= 0 and one["in_view"] >= LEAST_VIEW]
        cells: list[Any] = [name, len(some)]
        for is_told in (True, False):
            mine = [one for one in gone if (one["tells"] >= LEAST_RAYS) == is_told]
            verdicts = [one["verdicts"][one["gone"]] for one in mine]
            cells += [len(mine), verdicts.count(REMOVED), verdicts.count(PRESENT)]
        standing = [verdict for one in some for row, verdict in enumerate(one["verdicts"]) if row != one["gone"]]
        lines.append(f"| {' | '.join(map(str, [*cells, len(standing), standing.count(REMOVED)]))} |")
    return "\n".join(lines)


def _part(task: tuple[str, tuple[int, int], str]) -> dict[str, Any]:
    return told(*task, read_judges(DEFAULT))


def main() -> None:
    """All kinds by all sensors."""
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("--scenes", type=int, metavar="N", help="of each kind and sensor")
    parser.add_argument("--sensors", nargs="+", metavar="NAME")
    parser.add_argument("--seed", type=int, default=5, metavar="N")
    asked = parser.parse_args()
    for sensor in asked.sensors:
        with worker_pool() as pool:
            tasks = [(kind, (asked.seed, number), sensor) for kind in KINDS for number in range(asked.scenes)]
            views = list(pool.map(_part, tasks))
        print(f"\n{sensor}, {sum('refused' in one for one in views)} refused\n\n{table(views)}", flush=True)


if __name__ == "__main__":
    main()
