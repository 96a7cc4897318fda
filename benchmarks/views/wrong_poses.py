"""Scans of generated rooms and of building files, with changes and with poses that are wrong.

N points of a scan. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.views.building_views import building_places, scanned
from jaxmm.config import MULTI_SCENARIOS, SCENARIOS, UNCHANGED
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.runs.room_scans import room_cases
from jaxmm.verdicts.priors import Prior
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import sensor_named
from warp_scanner.sensors.triangles import cast_triangles

CHANGED = (*SCENARIOS, *(name for name in MULTI_SCENARIOS if name != "all_four"))  # with one to three changes
STAY = 0.25  # share of the views in which nothing changed
MOST_GONE = 3  # elements of a building file
MOST_LOST, LEAST_SHOWN = 1 / 3, 0.01  # of all rays: how many meet what is gone, and at least each of its elements
LEAST_POINTS = 1000  # of a view


class View(NamedTuple):
    """A scan with its true pose, and the model that it is of."""

    prior: Prior
    scan: PosedScan
    model: Path | None  # the file of the prior, where one was asked for
    changes: str  # in a word or two
    key: tuple[int, ...]  # of all that is still to be drawn


def room_views(sensor: str, numbers: Iterable[int], seed: int, folder: Path | None = None) -> Iterator[View]:
    """Of generated furnished rooms, each with a kind of changes that is drawn; `folder`: where to write models to."""
    for number in numbers:
        key = (seed, number, *sensor.encode())
        rng = np.random.default_rng(key)
        scene = UNCHANGED if rng.random() < STAY else str(rng.choice(CHANGED))
        for case in room_cases(scene, "occluded", seed, range(number, number + 1), sensor=sensor):
            model = folder and folder / "room.ifc"
            if model:
                write_room(model, case.pairs.prior, case.row)
            yield View(case.prior, case.scan, model, scene, key)


def file_views(folder: Path, sensor: str, count: int, seed: int) -> Iterator[View]:
    """From `count` places in every IFC file of a folder, none to three of whose walls and columns in view are gone."""
    for prior, pose, number in building_places(folder, count, seed):
        key = (seed, number, *sensor.encode(), *prior.file.file.encode())
        rng, seen = np.random.default_rng(key), (sensor_named(sensor), pose)
        meets = cast_triangles(prior.scene, rays_of(*seen)).element[0]
        semantic = prior.building.triangles.semantic
        share = np.bincount(meets[meets >= 0], minlength=len(semantic)) / len(meets)
        present, lost = np.ones(len(semantic), bool), 0.0
        if rng.random() >= STAY:
            shown = np.flatnonzero(np.isin(semantic, (WALL, PILLAR)) & (share >= LEAST_SHOWN))
            for row in rng.permutation(shown)[: rng.integers(1, MOST_GONE + 1)]:
                if lost + share[row] <= MOST_LOST:
                    present[row], lost = False, lost + share[row]
        scan, _ = scanned(prior.scene, present, seen, (seed, number))
        if len(scan.points) >= LEAST_POINTS:  # some look out of a building, at nothing
            yield View(prior, scan, folder / prior.file.file, f"{np.sum(~present)} gone", key)


def disturbed(scan: PosedScan, most: tuple[float, float, float], rng: np.random.Generator) -> PosedScan:
    """The scan as it would lie with a pose that is off by up to `most` [m], [deg] of yaw, [deg] of pitch and roll."""
    position = np.asarray(scan.position, np.float64)
    shift = rng.normal(size=3)
    shift *= most[0] * rng.uniform() / np.linalg.norm(shift)
    angles = rng.uniform(-1.0, 1.0, 3) * (most[1], most[2], most[2])
    turn = Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()
    points = (scan.points.astype(np.float64) - position) @ turn.T + position + shift
    return scan._replace(points=points.astype(np.float32), position=position + shift, rotation=turn @ scan.rotation)


def apart(scan: PosedScan, position: np.ndarray, rotation: np.ndarray) -> tuple[float, float]:
    """How far [m] and by what angle [deg] a pose is off a scan's own."""
    turn = np.asarray(rotation, np.float64) @ np.asarray(scan.rotation, np.float64).T
    angle = np.degrees(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)))
    return float(np.linalg.norm(position - scan.position)), float(angle)
