"""A scene of an exported benchmark as arrays: what others are given, and the truth about it.

N returns of the robot scan, M of the scan of the model, K rays without a return, E walls and columns of the model.
World frame of the model: metres, z up.
"""

import functools
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.config import SCENARIOS
from jaxmm.exchange.tasks import ExportSettings, Task
from jaxmm.inputs import InputError
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.runs.room_scans import RoomCase, room_cases
from jaxmm.runs.room_truth import true_verdicts
from jaxmm.verdicts.priors import Prior, read_prior
from jaxmm.verdicts.verdicts import PRESENT, REMOVED
from warp_scanner.buildings.pairs import BuildingPairConfig, make_building_pairs
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.pairs import Pairs, pairs_at
from warp_scanner.scenes.scenes import PILLAR, WALL, Primitives
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.sensors import Sensor, sensor_named

SAME, UNOBSERVABLE = 0, 5
LABELS = ("unchanged", *SCENARIOS, "unobservable")  # by number
KINDS = {PILLAR: "pillar", WALL: "wall"}
_WAYS = {1: "added", -1: "removed"}
_CODES = {(kind, way): LABELS.index(f"{KINDS[kind]}_{_WAYS[way]}") for kind in KINDS for way in _WAYS}


class Truth(NamedTuple):
    """What really changed; labels are numbers of LABELS."""

    scan: np.ndarray  # (N,) uint8 label of each return of the robot scan
    reference: np.ndarray  # (M,) uint8 of each return of the scan of the model
    elements: np.ndarray  # (E,) uint8 of each wall and column: unchanged, removed, or unobservable
    objects: np.ndarray  # (J, 9) float64: label, centre, full edge lengths [m], yaw [deg], observable fraction
    scene: np.ndarray  # () text: one of config.SCENES
    hurdles: np.ndarray  # () int64: how many of furniture, sensor errors and pose error make it hard


class Element(NamedTuple):
    """A wall or a column of the model."""

    number: int  # element id in the table of a room, row in a building
    guid: str  # of buildings only: rooms get theirs when they are written
    kind: str  # "wall" | "pillar"
    name: str


class Scene(NamedTuple):
    """What others are given, and the truth."""

    scan: np.ndarray  # (N, 3) float64 [m], as the robot believes to have measured them
    misses: np.ndarray  # (K, 3) float32 unit vectors of the rays that brought nothing back, world axes
    reference: np.ndarray  # (M, 3) float64 [m], the model, scanned from there without errors
    element: np.ndarray  # (M,) int32 row of `elements`; -1 for all else
    position: np.ndarray  # (3,) float64 [m] where the robot believes to be
    rotation: np.ndarray  # (3, 3) float64 sensor frame to world
    angles: tuple[float, float]  # [deg] yaw and pitch of it
    sensor: Sensor
    elements: list[Element]  # walls and columns
    truth: Truth
    model: Primitives | Path  # a table of one room, or the building file


def make_scene(settings: ExportSettings, task: Task, buildings: list[Path]) -> Scene:
    """The scene of a task: a pure function of its arguments and of the building file.

    Raises:
        InputError: a building has no place from which a sensor sees anything change.
    """
    if task.building is None:
        errors = {"position_error": settings.position_error, "angle_error": settings.angle_error} if task.lost else {}
        rooms = range(task.number, task.number + 1)
        (case,) = room_cases(task.scene, task.condition, task.seed, rooms, sensor=task.sensor, **errors)
        return _scene(_renumbered(case, task), task)
    path = buildings[task.building]
    turn = SCENARIOS.index(task.scene) if task.scene in SCENARIOS else 0
    # A building may lack what is to go, or a place from which it shows: then the next kind of change is taken.
    kinds = (task.scene, *(SCENARIOS[(turn + step) % len(SCENARIOS)] for step in range(len(SCENARIOS))))
    for kind in dict.fromkeys(kinds):
        try:
            return _scene(_building_case(path, task._replace(scene=kind)), task._replace(scene=kind), path)
        except (ValueError, RuntimeError) as error:
            if isinstance(error, InputError):
                raise
    raise InputError(f"{path}: expected a place from which a sensor sees a wall or a column change, found none")


def _building_case(path: Path, task: Task) -> RoomCase:
    prior, sensor = read_once(path), sensor_named(task.sensor)
    config = BuildingPairConfig(seed=task.seed, scenario=task.scene, condition=task.condition, sensor=sensor)
    pairs = make_building_pairs(prior.building, config, np.array([task.number]), 1)
    back = np.isfinite(pairs.robot.distance[0])
    points = points_of(pairs.pose, pairs.directions, pairs.robot.distance)[0, back]
    turned = rotation_of(pairs.pose.yaw, pairs.pose.pitch)[0].astype(np.float64)
    scan = PosedScan(points, pairs.pose.position[0].astype(np.float64), turned, sensor)
    return RoomCase(pairs, 0, np.arange(len(prior.building.elements.guid)), prior, scan)


@functools.lru_cache(maxsize=2)
def read_once(path: Path) -> Prior:
    """The model in a file, kept for the next scene."""
    return read_prior(path)


def _renumbered(case: RoomCase, task: Task) -> RoomCase:
    """The room with its elements in another order: what changes comes last where rooms are made, and nobody may tell
    by its number what is gone."""
    pairs = pairs_at(case.pairs, slice(case.row, case.row + 1))
    most = int(max(field.max() for field in (pairs.prior.element, pairs.dt.element, pairs.robot.element)))
    order = np.random.default_rng([task.seed, task.number]).permutation(most + 1).astype(np.int32)

    def new(element: np.ndarray) -> np.ndarray:
        return np.where(element >= 0, order[element], element)

    pairs = pairs._replace(
        dt=pairs.dt._replace(element=new(pairs.dt.element)),
        robot=pairs.robot._replace(element=new(pairs.robot.element)),
        box=pairs.box._replace(element=new(pairs.box.element)),
        prior=pairs.prior._replace(element=new(pairs.prior.element)),
    )
    return case._replace(pairs=pairs, row=0, ids=new(case.ids))


def _scene(case: RoomCase, task: Task, model: Path | None = None) -> Scene:
    pairs, row, table = case.pairs, case.row, case.prior.building.elements
    asked = np.flatnonzero(np.isin(table.semantic, list(KINDS)))
    asked = asked[np.argsort(case.ids[asked])]
    origin, place = case.prior.origin, Pose(*(field[row : row + 1] for field in pairs.pose))
    back, seen = np.isfinite(pairs.robot.distance[row]), np.isfinite(pairs.dt.distance[row])
    reference = points_of(place, pairs.directions, pairs.dt.distance[row : row + 1])[0, seen]
    where = np.full(int(case.ids.max()) + 1, -1, np.int32)  # element id -> row of those that are asked for
    where[case.ids[asked]] = np.arange(len(asked))
    return Scene(
        scan=case.scan.points.astype(np.float64) + origin,
        misses=(pairs.directions[~back] @ case.scan.rotation.T).astype(np.float32),
        reference=reference.astype(np.float64) + origin,
        element=where[pairs.dt.element[row, seen]],
        position=case.scan.position + origin,
        rotation=case.scan.rotation,
        angles=(float(place.yaw[0]), float(place.pitch[0])),
        sensor=case.scan.sensor,
        elements=[
            Element(int(case.ids[one]), table.guid[one], KINDS[int(table.semantic[one])], table.name[one])
            for one in asked
        ],
        truth=Truth(
            scan=_labels(pairs, row, 1)[back],
            reference=_labels(pairs, row, -1)[seen],
            elements=_element_labels(case, asked),
            objects=_objects(pairs, row, origin),
            scene=np.array(task.scene),
            hurdles=np.array(task.hurdles),
        ),
        model=model or pairs.prior,
    )


def _element_labels(case: RoomCase, asked: np.ndarray) -> np.ndarray:
    semantic = case.prior.building.elements.semantic
    verdicts = true_verdicts(case, asked.tolist())
    return np.array(
        [
            SAME if verdicts[one] == PRESENT
            else _CODES[int(semantic[one]), -1] if verdicts[one] == REMOVED
            else UNOBSERVABLE
            for one in asked.tolist()
        ],
        np.uint8,
    )  # fmt: skip


def _labels(pairs: Pairs, row: int, change: int) -> np.ndarray:
    """(P,) uint8 of every ray of the robot scan (1) or of the scan of the model (-1)."""
    scan, testable = (pairs.robot, pairs.testable_robot) if change > 0 else (pairs.dt, pairs.testable_dt)
    label = np.zeros(scan.element.shape[1], np.uint8)
    for one in np.flatnonzero(pairs.box.change[row] == change):
        hit = scan.element[row] == pairs.box.element[row, one]
        label[hit] = np.where(testable[row, hit], _CODES[int(pairs.box.object_type[row, one]), change], UNOBSERVABLE)
    return label


def _objects(pairs: Pairs, row: int, origin: np.ndarray) -> np.ndarray:
    box, rows = pairs.box, []
    for one in np.flatnonzero(box.change[row] != 0):
        code = _CODES[int(box.object_type[row, one]), int(box.change[row, one])]
        shown = pairs.observable_fraction[row, one]
        rows.append([code, *(box.center[row, one] + origin), *box.size[row, one], box.yaw[row, one], shown])
    return np.array(rows, np.float64).reshape(-1, 9)
