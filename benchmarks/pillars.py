"""New square and oblong pillars in rooms of boxes: how many are called walls, and how well their sections are measured.

    python -m benchmarks.pillars --out runs/pillars.json [--rooms 300] [--seed 77]     six minutes

Rooms of 5 x 4.4 to 16 x 10 m with up to two columns of their own and up to three low boxes; a new pillar, 0.2 to 0.6 m
wide, turned at random, 1 to 8 m away; a camera, a spinning sensor and a terrestrial scanner in turn, exact or with
5 mm of noise. The scan is compared with the room without the pillar and the boxes. Errors are of those that are called
pillars: of centres in plan, and of the worse edge of the section. What only one face shows of a pillar that is not
square, nobody can know. Prints Markdown.
"""

from typing import Any, NamedTuple

import numpy as np

from benchmarks.command_line import CommandLine
from jaxmm.files import write_json
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.scenes.building import Building
from warp_scanner.scenes.scenes import BOX, CEILING, FLOOR, PILLAR, TABLE, WALL, Primitives
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, OUSTER_64, TLS
from warp_scanner.sensors.triangles import cast_triangles, prepare

FULL, SMOKE = {"rooms": 300}, {"rooms": 3}
SENSORS = {"camera": OAK_D_PRO_SMALL, "spinning": OUSTER_64, "terrestrial": TLS.resampled(900, 450)}
NOISE = 0.005  # [m] in every other three rooms
CLEAR = 0.9  # [m] of the pillar from walls, and of boxes from the sensor
IN_SIGHT = 0.93  # cosine of the angle between the pillar and what may hide it
AROUND = 1.5  # [m] of the true centre, within which a found object stands for the pillar
OFF = 0.06  # [m] by which a section is wrong


class Box(NamedTuple):
    """One upright box."""

    center: tuple[float, float, float]  # [m]
    half: tuple[float, float, float]
    semantic: int
    yaw: float = 0.0  # [rad]


def row_of(judges: Judges, number: int, seed: int) -> dict[str, Any]:
    """One room: what the pillar was called, and how far it is off."""
    rng, name = np.random.default_rng([seed, number]), list(SENSORS)[number % len(SENSORS)]
    while True:  # until a place of that range is in the room
        x, y, height = rng.uniform((2.5, 2.2, 2.5), (8.0, 5.0, 3.4))
        sensor = rng.uniform((0.4 - x, 0.4 - y, 1.0), (x - 0.4, y - 0.4, 1.8))
        reach, bearing = rng.uniform(1.0, 8.0), rng.uniform(0.0, 2.0 * np.pi)
        ahead = np.array([np.cos(bearing), np.sin(bearing)])
        place = sensor[:2] + reach * ahead
        if np.all(np.abs(place) < np.array([x, y]) - CLEAR):
            break
    width = rng.uniform(0.2, 0.6)
    depth = width if rng.random() < 0.6 else rng.uniform(max(0.2, width / 2), width)
    pillar = Box((*place, height / 2), (width / 2, depth / 2, height / 2), PILLAR, rng.uniform(0.0, np.pi))
    beside = [one for one in rng.uniform((0.5 - x, 0.5 - y), (x - 0.5, y - 0.5), (5, 2)) if _clear(one, sensor, place)]
    count = int(rng.integers(0, 3))
    own = [Box((*one, height / 2), (*np.full(2, rng.choice([0.15, 0.2, 0.25])), height / 2), PILLAR)
           for one in beside[:count]]  # fmt: skip
    low = [Box((*one, 0.4), (*rng.uniform(0.2, 0.5, 2), 0.4), TABLE, rng.uniform(0.0, 3.0)) for one in beside[count:]]
    room = [*_shell(x, y, height), *own]
    noise = NOISE * (number // len(SENSORS) % 2)
    scan = _scan(
        building_of([*room, *low, pillar]), sensor, bearing + rng.uniform(-0.3, 0.3), SENSORS[name], noise, rng
    )
    settings = DetectSettings(refine=False, propose_views=False)
    found = detect_scans(prior_of_building(building_of(room)), [scan], judges, settings)
    new = [one for one in found.mismatches if one.mismatch_type == "added"]
    new = [one for one in new if np.linalg.norm(one.center[:2] - place) < AROUND]
    row = {"room": number, "sensor": name, "range": round(reach, 2), "called": new[0].object_type if new else "nothing"}
    if row["called"] == "pillar":
        edges = np.abs(np.sort(new[0].dimensions[:2]) - np.sort([width, depth]))
        row |= {"center": float(np.linalg.norm(new[0].center[:2] - place)), "edge": float(edges.max())}
    return row


def building_of(boxes: list[Box]) -> Building:
    """Boxes as a building, each an element."""
    center, half, semantic, yaw = (np.array(field)[None] for field in zip(*boxes, strict=True))
    kind, element = np.full(yaw.shape, BOX, np.uint8), np.arange(len(boxes), dtype=np.int32)[None]
    size = (center.astype(np.float32), half.astype(np.float32), yaw.astype(np.float32))
    return building_of_room(Primitives(kind, *size, element, semantic.astype(np.uint8)), 0)[0]


def _clear(one: np.ndarray, sensor: np.ndarray, place: np.ndarray) -> bool:
    """Whether what stands there hides neither the sensor nor the pillar, and does not touch it."""
    offset, ahead = one - sensor[:2], place - sensor[:2]
    apart = min(np.linalg.norm(offset), np.linalg.norm(one - place) - 0.3)
    return bool(apart > CLEAR and offset @ ahead < IN_SIGHT * np.linalg.norm(offset) * np.linalg.norm(ahead))


def _shell(x: float, y: float, height: float) -> list[Box]:
    flat, middle = (x + 0.2, y + 0.2, 0.1), height / 2
    sides = [Box((way * (x + 0.1), 0.0, middle), (0.1, y, middle), WALL) for way in (-1.0, 1.0)]
    sides += [Box((0.0, way * (y + 0.1), middle), (x, 0.1, middle), WALL) for way in (-1.0, 1.0)]
    return [Box((0.0, 0.0, -0.1), flat, FLOOR), Box((0.0, 0.0, height + 0.1), flat, CEILING), *sides]


def _scan(building: Building, place, bearing: float, sensor, noise: float, rng: np.random.Generator) -> NamedScan:
    rotation = rotation_of(np.degrees([bearing]), np.zeros(1))[0]
    direction = (sensor.directions() @ rotation.T).astype(np.float32)
    distance = cast_triangles(prepare(building.triangles), Rays(place[None].astype(np.float32), direction)).distance[0]
    back = np.isfinite(distance) & (distance >= sensor.range_limits[0])
    distance = distance[back] + noise * rng.standard_normal(back.sum())
    points = (place + direction[back] * distance[:, None]).astype(np.float32)
    return NamedScan(PosedScan(points, place, rotation, sensor), "scan", len(points), "given")


def table(rows: list[dict[str, Any]]) -> str:
    """Markdown, sensor by sensor and of all."""
    lines = [
        "| sensor | pillars | called walls | not found | centre [m], median, 90 % | worse edge [m], median, 90 % "
        f"| off by more than {OFF} m |",
        f"|{' --- |' * 7}",
    ]
    for name in (*SENSORS, "all"):
        mine = [row for row in rows if name in (row["sensor"], "all")]
        called = [row["called"] for row in mine]
        right = [row for row in mine if row["called"] == "pillar"]
        cells = ["- | - | -"]
        if right:
            spread = ["{:.3f}, {:.3f}".format(*np.quantile([row[key] for row in right], (0.5, 0.9)))
                      for key in ("center", "edge")]  # fmt: skip
            cells = [*spread, f"{np.mean([row['edge'] > OFF for row in right]):.3f}"]
        counts = f"{len(mine)} | {called.count('wall')} | {called.count('nothing')}"
        lines.append(f"| {name} | {counts} | {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_out("FILE")
    parser.add_argument("--rooms", type=int, metavar="N")
    parser.add_argument("--seed", type=int, default=77, metavar="N")
    asked = parser.parse_args()
    judges = read_judges(DEFAULT)
    rows = [row_of(judges, number, asked.seed) for number in range(asked.rooms)]
    write_json(asked.out, {"rows": rows})
    print(table(rows))
