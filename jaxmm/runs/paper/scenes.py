"""The test scenes of a row: rooms with one change, with several, with errors, and views of buildings from IFC files.

Every scene comes as one view for each model that is asked, so that one scan serves all. In the table's rows heuristic
labels are told from scans without errors: of a scan that is noisy or out of place, distances above the threshold say
little of the change, and would make the raw distance perfect by construction.
"""

import dataclasses
import itertools
import os
import tempfile
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.config import Config, Table
from jaxmm.data.evidence_sources import gather
from jaxmm.data.labelled_buildings import View, building_views
from jaxmm.data.labelled_rooms import RAYS_AT_ONCE, Gatherer, clouds_of, distances_of, heuristic_of, pairs_of, truth_of
from jaxmm.data.preprocessed_pairs import Sides, sides_of
from jaxmm.data.simulator_settings import CloudSource, ray_count
from jaxmm.inputs import InputError
from jaxmm.learning.batches import LabelledCloud
from jaxmm.runs.paper.rows import ALIGNED, BUILDINGS, MISALIGNED, NOISY, TestScenes
from warp_scanner.buildings.files import read_building
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.clouds.points import Kept, points_of
from warp_scanner.rooms.pairs import PRESETS, Pairs
from warp_scanner.rooms.rooms import make_rooms
from warp_scanner.scenes.building import Building
from warp_scanner.scenes.scenes import GAP, is_structure

SIGMA = 0.1  # [m] of the sensor noise that the thesis tells of
# The thesis moves and turns a scan "slightly".
SHIFT, TURN = 0.05, 1.0  # [m], [deg]
MARGIN = 0.1  # [m] ranges must differ by more to be testable; with noise, by three standard deviations more
TRIED = 8  # numbers of views are tried for each that is kept, before a building is given up
BUILT = 3  # procedural buildings are tried for each that is asked for


class Scene(NamedTuple):
    """One test scene, as each of some models sees it."""

    number: int  # of the room, or of the view
    place: str  # "" for rooms, else the building
    views: dict[str, View]  # by scenario


def scan_errors(range_noise: float = 0.0, metres: float = 0.0) -> dict[str, float]:
    """Scan settings for robot scans that err: range noise [m], and a pose off by so much, with 20 degrees a metre."""
    settings = {"range_noise": range_noise, "testable_margin": round(MARGIN + 3 * range_noise, 6)}
    # Of each of three coordinates and two angles, so that the whole is about as far off as asked for.
    degrees = metres * TURN / SHIFT
    return settings | {"position_error": round(metres / 3**0.5, 6), "angle_error": round(degrees / 2**0.5, 6)}


def with_scan(config: Config, changes: dict) -> Config:
    """The settings with some of [scan] others."""
    return dataclasses.replace(config, scan=Table.of(config.scan.thawed() | changes))


def room_scenes(
    config: Config, scenes: TestScenes, scenarios: Iterable[str], count: int, errors: dict[str, float] | None = None
) -> Iterator[Scene]:
    """The first `count` rooms of the test seed, each as the models of some scenarios see it.

    Args:
        config: settings.
        scenes: of the kind ROOMS.
        scenarios: of the models.
        count: how many rooms.
        errors: scan settings by which robot scans err, and heuristic labels with them; None: those that
            `scenes.change` stands for, and labels without errors.
    """
    relabelled = errors is None and scenes.change != ALIGNED
    if errors is None:
        errors = {ALIGNED: {}, NOISY: scan_errors(SIGMA), MISALIGNED: scan_errors(metres=SHIFT)}[scenes.change]
    erring = with_scan(config, errors) if errors else config
    at_once = max(1, RAYS_AT_ONCE // ray_count(config))
    for start in range(0, count, at_once):
        rooms = np.arange(start, min(start + at_once, count))
        source = CloudSource("", scenes.scene, scenes.condition, config.data.test_seed)
        pairs = pairs_of(erring, source, rooms)
        ideal = pairs_of(config, source, rooms) if relabelled else None
        views = _views(erring, source, (pairs, ideal, rooms), tuple(scenarios))
        for row, room in enumerate(rooms):
            yield Scene(int(room), "", {scenario: views[scenario][row] for scenario in views})


def _views(
    config: Config, source: CloudSource, made: tuple[Pairs, Pairs | None, np.ndarray], scenarios: tuple[str, ...]
) -> dict[str, list[View]]:
    (pairs, ideal, rooms), gatherer = made, _once(gather)
    sides = sides_of(config, pairs)
    views = {}
    for scenario in scenarios:
        own = source._replace(scenario=scenario)
        clouds = clouds_of(config, own, pairs, sides=sides, gatherer=gatherer)
        if ideal is not None:
            clouds = _labelled_without_errors(config, own, ideal, clouds, sides)
        clouds = [_with_all_changes(own, pairs, row, cloud, sides) for row, cloud in enumerate(clouds)]
        views[scenario] = [
            View(cloud, truth_of(own, pairs, row, int(rooms[row])), Sides([sides.dt[row]], [sides.robot[row]]))
            for row, cloud in enumerate(clouds)
        ]
    return views


def _with_all_changes(source: CloudSource, pairs: Pairs, row: int, cloud: LabelledCloud, sides: Sides) -> LabelledCloud:
    """The cloud with every return from an added (or removed) object as positive, whichever its type.

    Of several objects the thesis's labels do not tell pillars from walls either: that is left to boxes, and counted
    there. With one change it is the same.
    """
    if source.scenario.endswith("removed"):
        return cloud._replace(true=pairs.changed_dt[row, sides.dt[row].pixel])
    return cloud._replace(true=pairs.changed_robot[row, sides.robot[row].pixel])


def _once(gatherer: Gatherer) -> Gatherer:
    """Models that look at the same side of the same pairs share its evidence."""
    found: dict[bool, list[np.ndarray]] = {}

    def shared(config: Config, source: CloudSource, *arguments) -> list[np.ndarray]:
        removed = source.scenario.endswith("removed")
        if removed not in found:
            found[removed] = gatherer(config, source, *arguments)
        return found[removed]

    return shared


def _labelled_without_errors(
    config: Config, source: CloudSource, ideal: Pairs, clouds: list[LabelledCloud], sides: Sides
) -> list[LabelledCloud]:
    """The clouds with heuristic labels as error-free scans of the same rooms have them.

    What was removed is seen in the DT scan, which never errs; a point of the robot's takes the label of what its ray
    meets without noise.
    """
    clear, removed = sides_of(config, ideal), source.scenario.endswith("removed")
    if removed:
        seen, other = clear.dt, clear.robot
    else:
        points = points_of(ideal.pose, ideal.directions, ideal.robot.distance)
        seen = [Kept(points[row, kept.pixel], kept.pixel) for row, kept in enumerate(sides.robot)]
        other = clear.dt
    distances = distances_of(ideal, seen, other, None)
    return [
        cloud._replace(heuristic=heuristic_of(config, source, kept.points, cloud.element, distance))
        for cloud, kept, distance in zip(clouds, seen, distances, strict=True)
    ]


def procedural_buildings(config: Config) -> Iterator[tuple[str, Building]]:
    """Generated rooms of the preset `varied`, unlike those of the training, written as IFC files and read back.

    Raises:
        InputError: ifcopenshell is not installed.
    """
    for number in itertools.count():
        yield f"room_{number}", _through_file(config.data.test_seed, number)


@lru_cache(maxsize=128)
def _through_file(seed: int, number: int) -> Building:
    room = make_rooms(PRESETS["varied"].room, seed, np.array([number]))
    room = room._replace(kind=np.where(is_structure(room), room.kind, GAP))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"room_{number}.ifc"
        try:
            write_room(path, room, 0, path.stem)
            return read_building(path)
        except ImportError as error:
            raise InputError(str(error)) from error


def building_scenes(
    config: Config, scenes: TestScenes, buildings: Iterable[tuple[str, Building]], asked: tuple[int, int]
) -> Iterator[Scene]:
    """Views of one change in buildings that have the object in question, space, and furniture in view.

    Args:
        config: settings.
        scenes: of the kind BUILDINGS.
        buildings: (name, building), as many as it takes.
        asked: how many buildings, and views of each.
    """
    count, views = asked
    source = CloudSource(scenes.scene, scenes.scene, scenes.condition, config.data.test_seed)
    done = 0
    for tried, (name, building) in enumerate(buildings, start=1):
        made = building_views(config, building, source, range(TRIED * views))
        try:
            found = [Scene(view.truth.index, name, {scenes.scene: view}) for view in itertools.islice(made, views)]
        except (ValueError, RuntimeError):  # nothing of the kind to remove, or no space
            found = []
        yield from found
        done += bool(found)
        if done == count or tried == BUILT * count:
            return


def scenes_of(config: Config, scenes: TestScenes, scenarios: Iterable[str], count: int) -> Iterator[Scene]:
    """All test scenes of a row; `count` is of rooms."""
    if scenes.kind == BUILDINGS:
        asked = config.paper.buildings, config.paper.views
        return building_scenes(config, scenes, procedural_buildings(config), asked)
    return room_scenes(config, scenes, scenarios, count)


def ifc_files() -> list[Path]:
    """The IFC files of JAXMM_DATA; none where it names no folder."""
    folder = data_root()
    return sorted((folder / "ifc").glob("*.ifc")) if folder else []


def read_file(path: Path) -> Building:
    """The building in an IFC file.

    Raises:
        InputError: it cannot be read, or ifcopenshell is not installed.
    """
    try:
        return read_building(path)
    except (ValueError, ImportError) as error:
        raise InputError(str(error)) from error


def data_root() -> Path | None:
    """The folder of real data that JAXMM_DATA names, if there is one."""
    named = os.environ.get("JAXMM_DATA")
    return Path(named) if named and Path(named).is_dir() else None
