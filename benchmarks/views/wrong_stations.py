"""One station of several that lies wrong, or sees too little to know: is what moved still told?

    python -m benchmarks.views.wrong_stations [--rooms 48] [--seed 5321] [--kept FILE]    half an hour

Rooms of four walls, a wall that parts them, sometimes a wall beside it, two columns, turned by any angle; one of the
walls stands 30 to 100 mm off its place, in one room of five none does. Three to twelve stations stand anywhere in a
room, by a sensor as built. Their poses are told right (half of the rooms), are off by up to 5 cm and 1 degree, or one
of them lies 20 to 60 mm off after it was laid upon the model, whatever registration made of it. A line for each kind,
as Markdown: *alone* tells each station's pose by itself, as earlier builds did, *together* by what all of them see.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.views.building_views import scanned
from benchmarks.views.kept_views import KeptViews
from benchmarks.views.told_offsets import share_with_interval
from benchmarks.views.touching import Boxes, building_of
from benchmarks.views.wrong_poses import disturbed
from jaxmm.deviations.agreed_poses import agreed
from jaxmm.deviations.deviation import Deviation, deviations_by, is_told
from jaxmm.deviations.seen_surfaces import Faces
from jaxmm.inputs import InputError
from jaxmm.learning.prediction import read_judges
from jaxmm.rays.joint_poses import held_together
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.as_built import is_displaced, tolerances
from jaxmm.verdicts.detection import distance_to
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import Prior, prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.station_steps import HeldStations, face_station, lay_station
from jaxmm.weights import DEFAULT
from warp_scanner.scenes.building_edits import move_element
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, WALL
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.sensors import sensor_named
from warp_scanner.sensors.triangles import prepare

FULL = {"rooms": 48, "sensors": ("velodyne-16-real", "ouster-64-real", "tls-real")}
SMOKE = {"rooms": 1, "sensors": ("velodyne-16-real",)}
SEED = 5321
RIGHT, OFF, WRONG = KINDS = ("told right", "told up to 5 cm and 1° off", "one lies 20 to 60 mm off")
TURNS = (RIGHT, OFF, RIGHT, WRONG)
MOST_OFF = (0.05, 1.0, 0.5)  # [m], [deg] about the vertical and about the others
SHIFT, LIES_OFF, STILL = (0.03, 0.1), (0.02, 0.06), 0.2  # [m], [m], share of the rooms
THICK, HALF_COLUMN, CLEAR = 0.2, 0.2, 0.5  # [m]
LEAST_RAYS, SURELY = 500, 0.012  # that end on an element; [m] beyond the tolerance, from which on it must be told
STATIONS = (3, 13)
COLUMNS = (
    "poses", "told", "rooms", "off by more than 42 mm", "of those displaced", "still", "of those displaced",
    "given an interval", "held", "of what moved", "half interval [mm]: median", "mean",
)  # fmt: skip


class Room(NamedTuple):
    """A room, and what stands off its place in it."""

    prior: Prior
    moved: dict[int, np.ndarray]  # row -> (3,) [m]
    scans: list[PosedScan]


class _Laid(HeldStations):
    """Stations of which one lies elsewhere than it was laid."""

    def __init__(self, scans: list[PosedScan], wrong: tuple[int, np.ndarray] | None):
        shelves = [{"scan": NamedScan(one, f"station {n}", len(one.points), "given")} for n, one in enumerate(scans)]
        super().__init__(shelves, read_judges(DEFAULT), DetectSettings(propose_views=False))
        self._wrong = wrong

    def faces(self, prior: Prior) -> list[Faces]:
        """What each shows of the walls and columns."""
        laid = self.each(lay_station, prior, True)
        if self._wrong is not None:
            number, shift = self._wrong
            one, placed, misfit = self._shelves[number]["laid"]
            scan, station = placed.scan, laid[number]
            moved = scan._replace(points=(scan.points + shift).astype(np.float32), position=scan.position + shift)
            self._shelves[number]["laid"] = one, placed._replace(scan=moved, shift=float(np.linalg.norm(shift))), misfit
            patches = station.patches._replace(middle=station.patches.middle + shift)
            laid[number] = station._replace(patches=patches, sensor=station.sensor + shift)
        held = held_together(laid, lambda points: distance_to(prior, points))
        return [one.faces for one in self.each(face_station, prior, own=held)]


def room_of(seed: int, number: int, sensor: str, kind: str) -> tuple[Room, tuple[int, np.ndarray] | None]:
    """A room, and which of its stations lies wrong, by how much (3,) [m]."""
    rng = np.random.default_rng((seed, number))
    boxes = _boxes(rng)
    yaw = float(rng.uniform(0.0, 2.0 * np.pi))
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    prior = prior_of_building(building_of(boxes, yaw))
    row = int(rng.choice([6, 6, 6, 6, 3, 5]))  # mostly the wall that parts the room, else an outer one
    across = turn[:, 1 if row == 5 else 0]
    moved = {} if rng.random() < STILL else {row: across * rng.uniform(*SHIFT) * rng.choice((-1.0, 1.0))}
    triangles = prior.building.triangles
    for row, step in moved.items():
        triangles = move_element(triangles, row, step, np.zeros(3))
    scene, stands = prepare(triangles), np.ones(len(triangles.semantic), bool)
    scans = []
    for n, place in enumerate(_places(boxes, int(rng.integers(*STATIONS)), rng)):
        stand = turn @ place - prior.origin, rng.uniform(-3.0, 3.0), 0.0
        pose = Pose(*(np.array([one], np.float32) for one in stand))
        scans.append(scanned(scene, stands, (sensor_named(sensor), pose), (seed, 100 * number + n))[0])
    if kind == OFF:
        scans = [disturbed(one, MOST_OFF, rng) for one in scans]
    way = rng.uniform(0.0, 2.0 * np.pi)
    shift = np.array([np.cos(way), np.sin(way), 0.0]) * rng.uniform(*LIES_OFF)
    return Room(prior, moved, scans), (int(rng.integers(len(scans))), shift) if kind == WRONG else None


def _boxes(rng: np.random.Generator) -> Boxes:
    x, y, high = rng.uniform(3.0, 6.0), rng.uniform(2.5, 4.5), rng.uniform(2.5, 3.2)

    def box(low: tuple[float, float], end: tuple[float, float], semantic: int = WALL) -> tuple:
        return (*low, 0.0), (*end, high), semantic

    parts, long = rng.uniform(-x / 2.0, x / 2.0), rng.uniform(0.7, 1.3) * y
    found = [
        ((-x, -y, -THICK), (x, y, 0.0), FLOOR), ((-x, -y, high), (x, y, high + THICK), CEILING),
        box((-x, -y), (-x + THICK, y)), box((x - THICK, -y), (x, y)),
        box((-x + THICK, -y), (x - THICK, -y + THICK)), box((-x + THICK, y - THICK), (x - THICK, y)),
        box((parts - THICK / 2.0, -y + THICK), (parts + THICK / 2.0, -y + THICK + long)),
    ]  # fmt: skip
    if rng.random() < 0.4:
        beside = rng.uniform(-y / 3.0, y / 3.0)
        found.append(box((-x + THICK, beside), (max(-x + 1.0, parts - 1.5), beside + THICK / 2.0)))
    for _ in range(2):
        place = np.array([rng.uniform(1.0 - x, x - 1.0), rng.uniform(0.2 * y, y - 1.0)])
        found.append(box(tuple(place - HALF_COLUMN), tuple(place + HALF_COLUMN), PILLAR))
    return tuple(found)


def _places(boxes: Boxes, count: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """So many places (3,) [m], clear of walls and columns."""
    upright = [(np.array(low[:2]), np.array(high[:2])) for low, high, semantic in boxes if semantic in (WALL, PILLAR)]
    inner = np.array(boxes[0][1][:2])
    while count:
        place = rng.uniform(-inner, inner)
        if all(np.any(place < low - CLEAR) or np.any(place > high + CLEAR) for low, high in upright):
            yield np.array([*place, rng.uniform(1.2, 1.8)])
            count -= 1


def told(room: Room, faces: list[Faces], agree: Callable[[list[Faces]], list[Faces]]) -> list[dict[str, Any]]:
    """Of each element that rays tell of: what it is off, what is told, and how surely."""
    tolerance = tolerances(room.prior, DetectSettings().deviations)
    found = deviations_by(room.prior.scene, agree(faces), tolerance)
    return [_row(room, row, one, float(tolerance[row])) for row, one in found.items() if one.rays >= LEAST_RAYS]


def _row(room: Room, row: int, one: Deviation, tolerance: float) -> dict[str, Any]:
    step = room.moved.get(row)
    way = np.array(one.direction)
    true = 0.0 if step is None else float(step @ way)
    new: dict[str, Any] = {"moved": step is not None, "displaced": bool(is_displaced(one, tolerance, LEAST_RAYS))}
    new["by"] = 0.0 if step is None else float(np.linalg.norm(step))
    if is_told(one):
        new |= {"off": one.distance - true, "half": one.half}
    return new


def line(kind: str, name: str, rooms: list[list[dict[str, Any]]]) -> str:
    """A line of the table."""
    every = [one for room in rooms for one in room]
    known = [one for one in every if "half" in one]
    far = [one for one in every if one["by"] > DetectSettings().deviations.tolerance + SURELY]

    def share(flags: list[bool]) -> str:
        return share_with_interval(int(np.sum(flags)), len(flags))

    still, half = (
        [one for one in every if not one["moved"]],
        1000.0 * np.array([one["half"] for one in known] or [np.nan]),
    )
    held = [(one["moved"], abs(one["off"]) <= one["half"]) for one in known]
    cells = (
        kind, name, len(rooms), len(far), share([one["displaced"] for one in far]), len(still),
        share([one["displaced"] for one in still]), f"{len(known)} of {len(every)}",
        share([is_in for _, is_in in held]), share([is_in for moved, is_in in held if moved]),
        f"{np.median(half):.1f}", f"{half.mean():.1f}",
    )  # fmt: skip
    return "| " + " | ".join(map(str, cells)) + " |"


def main() -> None:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("--rooms", type=int, metavar="N")
    parser.add_argument("--seed", type=int, default=SEED, metavar="N")
    parser.add_argument("--sensors", nargs="+", metavar="NAME", help="in turn, a room each")
    parser.add_argument("--kept", type=Path, metavar="JSONL", help="keep what was told of each room here, and go on")
    asked = parser.parse_args()
    kept = KeptViews(asked.kept)
    for number in range(asked.rooms):
        sensor, kind = asked.sensors[number % len(asked.sensors)], TURNS[number // len(asked.sensors) % len(TURNS)]
        if kept.has((sensor, asked.seed, number)):
            continue
        room, wrong = room_of(asked.seed, number, sensor, kind)
        try:
            faces = _Laid(room.scans, wrong).faces(room.prior)
        except InputError as error:
            kept.add((sensor, asked.seed, number), {"kind": kind, "refused": str(error)})
            continue
        both = {"alone": told(room, faces, list), "together": told(room, faces, agreed)}
        kept.add((sensor, asked.seed, number), {"kind": kind, "sensor": sensor} | both)
    rooms = [one for _, one in kept.items() if "refused" not in one]
    print(f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}")
    for kind in (*KINDS, "all"):
        own = [one for one in rooms if kind in (one["kind"], "all")]
        for name in ("alone", "together") if own else ():
            print(line(kind, name, [one[name] for one in own]))


if __name__ == "__main__":
    main()
