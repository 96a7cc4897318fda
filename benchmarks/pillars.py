"""New square and oblong pillars in rooms of boxes: how many are called walls, and how well their sections are measured.

    python -m benchmarks.pillars --out runs/pillars.json [--rooms 300] [--seed 77] [--foreign]     six minutes

Rooms of 5 x 4.4 to 16 x 10 m with up to two columns of their own and up to three low boxes; a new pillar, 0.2 to 0.6 m
wide, turned at random, 1 to 8 m away; a camera, a spinning sensor and a terrestrial scanner in turn, exact or with
5 mm of noise. The scan is compared with the room without the pillar and the boxes. Errors are of those that are called
pillars: of centres in plan, and of the worse edge of the section. What only one face shows of a pillar that is not
square, nobody can know. Prints Markdown.

With --foreign the rooms hold up to five things of kinds that no training has seen (benchmarks/views/foreign_things.py),
and half of them a new pillar. Every mismatch down to a probability of 0.05 is asked for. Told are the new
pillars that are found, the false new objects, and what the probabilities are worth: those that say at least 0.5, and
the share of them that is real; ECE in ten bins; and the share that is false among the surest half and among all.
"""

from typing import Any, NamedTuple

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.views.foreign_things import KINDS, standing, thing_of, with_things
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
SAME, LEAST, SURE = 0.5, 0.05, 0.5  # [m] between a new pillar and what is told of it; probabilities asked for, and told
BINS = 10


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


def foreign_row_of(judges: Judges, number: int, seed: int) -> dict[str, Any]:
    """One room with foreign things: what is told to be new, each with its probability and whether it is real."""
    rng, name = np.random.default_rng([seed, 1, number]), list(SENSORS)[number % len(SENSORS)]
    while True:
        x, y, height = rng.uniform((2.5, 2.2, 2.4), (8.0, 5.0, 3.4))
        sensor = rng.uniform((0.4 - x, 0.4 - y, 1.0), (x - 0.4, y - 0.4, 1.8))
        reach, bearing = rng.uniform(1.0, 8.0), rng.uniform(0.0, 2.0 * np.pi)
        place = sensor[:2] + reach * np.array([np.cos(bearing), np.sin(bearing)])
        if np.all(np.abs(place) < np.array([x, y]) - CLEAR):
            break
    new = bool(number // (2 * len(SENSORS)) % 2)
    width = rng.uniform(0.2, 0.6)
    pillar = Box((*place, height / 2), (width / 2, width / 2, height / 2), PILLAR, rng.uniform(0.0, np.pi))
    room, things, taken = _shell(x, y, height), [], []
    for _ in range(int(rng.integers(1, 6))):
        thing, yaw = thing_of(rng, height), rng.uniform(0.0, 2.0 * np.pi)
        where = rng.uniform((0.6 - x, 0.6 - y), (x - 0.6, y - 0.6))
        if rng.random() < 0.5:  # with its back to a wall
            yaw = np.pi / 2 * rng.integers(4)
            axis, way = int(yaw % np.pi < 0.1), rng.choice((-1.0, 1.0))
            deep = np.ptp(standing(thing, np.zeros(2), yaw).vertices[:, axis]) / 2
            where[axis] = way * ((x, y)[axis] - deep - 0.02)
        apart = min((np.linalg.norm(where - one) for one in taken), default=np.inf)
        if _clear(where, sensor, place) and apart > 1.5:
            things.append(standing(thing, where, yaw))
            taken.append(where)
    building = building_of([*room, pillar] if new else room)
    building = building._replace(triangles=with_things(building.triangles, things))
    noise = NOISE * (number // len(SENSORS) % 2)
    scan = _scan(building, sensor, bearing + rng.uniform(-0.3, 0.3), SENSORS[name], noise, rng)
    settings = DetectSettings(refine=False, propose_views=False, least_probability=LEAST)
    found = detect_scans(prior_of_building(building_of(room)), [scan], judges, settings)
    told = [one for one in found.mismatches if one.mismatch_type == "added"]
    return {
        "room": number, "sensor": name, "new": new, "things": [thing.kind for thing in things],
        "told": [[one.probability, new and bool(np.linalg.norm(one.center[:2] - place) < SAME), one.object_type,
                  _kind_at(one.center[:2], things)] for one in told],
    }  # fmt: skip


def _kind_at(center: np.ndarray, things: list) -> str:
    """Kind of the thing that a place is nearest to."""
    apart = [np.linalg.norm(thing.vertices[:, :2].mean(axis=0) - center) for thing in things]
    return things[int(np.argmin(apart))].kind if apart and min(apart) < AROUND else "none"


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


def foreign_table(rows: list[dict[str, Any]]) -> str:
    """Markdown, sensor by sensor and of all; and which things are taken for new structure."""
    lines = [
        f"| sensor | rooms | new pillars found | false of P >= {SURE} | their mean P | real among all of P >= {SURE} "
        "| mean P of all | ECE | false among the surest half, all |",
        f"|{' --- |' * 9}",
    ]
    for name in (*SENSORS, "all"):
        mine = [row for row in rows if name in (row["sensor"], "all")]
        told = [one for row in mine for one in row["told"]]
        probability, real = np.array([one[0] for one in told]), np.array([one[1] for one in told], bool)
        sure = probability >= SURE
        found = sum(any(p >= SURE and right for p, right, *_ in row["told"]) for row in mine)
        cells = [f"{len(mine)}", f"{found} of {sum(row['new'] for row in mine)}", f"{np.sum(sure & ~real)}"]
        cells += [_mean(probability[sure & ~real]), _mean(real[sure]), _mean(probability[sure])]
        cells += [f"{_ece(probability, real):.3f}", f"{_risk(probability, real, 0.5)}, {_risk(probability, real, 1.0)}"]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    taken = [one[3] for row in rows for one in row["told"] if one[0] >= SURE and not one[1]]
    there = [kind for row in rows for kind in row["things"]]
    shares = ", ".join(f"{kind} {taken.count(kind)} of {there.count(kind)}" for kind in KINDS)
    return "\n".join([*lines, "", f"Taken for new structure: {shares}; beside any thing {taken.count('none')}."])


def _mean(values: np.ndarray) -> str:
    return f"{values.mean():.2f}" if len(values) else "-"


def _ece(probability: np.ndarray, real: np.ndarray) -> float:
    """How far the mean probability of each bin is from the share that is real, by how many each bin holds."""
    number = np.minimum((probability * BINS).astype(int), BINS - 1)
    return sum(abs(np.sum(probability[number == one] - real[number == one])) for one in set(number)) / max(len(real), 1)


def _risk(probability: np.ndarray, real: np.ndarray, share: float) -> str:
    """The share that is false among the surest so many."""
    surest = np.argsort(-probability, kind="stable")[: int(np.ceil(share * len(real)))]
    return _mean(~real[surest])


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_out("FILE")
    parser.add_argument("--rooms", type=int, metavar="N")
    parser.add_argument("--seed", type=int, default=77, metavar="N")
    parser.add_argument("--foreign", action="store_true", help="among things of kinds that no training has seen")
    asked = parser.parse_args()
    judges, made, shown = read_judges(DEFAULT), row_of, table
    if asked.foreign:
        made, shown = foreign_row_of, foreign_table
    rows = [made(judges, number, asked.seed) for number in range(asked.rooms)]
    write_json(asked.out, {"rows": rows})
    print(shown(rows))
