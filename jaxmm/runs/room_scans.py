"""Generated rooms as if they came in files: a building as the prior, one robot scan, and the truth.

World frame: metres, z up, the origin in the middle of the room.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from jaxmm.learning.boxes import Box
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.priors import Prior, prior_of_building, prior_of_cloud
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.pairs import PRESETS, PairConfig, Pairs, make_pairs
from warp_scanner.scenes.scenes import PILLAR
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, sensor_named


class RoomCase(NamedTuple):
    """One room."""

    pairs: Pairs  # the truth, of R rooms
    row: int  # which of them
    ids: np.ndarray  # (E,) element id in the truth of every element of the prior
    prior: Prior
    scan: PosedScan


def room_cases(scene: str, condition: str, seed: int, rooms: range, **changed: Any) -> Iterator[RoomCase]:
    """Rooms, scanned by a camera of 320 x 200.

    Args:
        scene: what changes, see scenarios.SceneConfig.
        condition: "clean" or "occluded".
        seed: of the rooms.
        rooms: their numbers.
        changed: fields of a PairConfig, a sensor by name too, of `room` those that differ, and `preset`: which of
            PRESETS has the others, by default "varied".
    """
    given = {"sensor": OAK_D_PRO_SMALL} | changed
    if isinstance(given["sensor"], str):
        given["sensor"] = sensor_named(given["sensor"])
    preset = PRESETS[given.pop("preset", "varied")]
    if isinstance(given.get("room"), dict):
        given["room"] = dataclasses.replace(preset.room, **given["room"])
    settings = dataclasses.replace(preset, scenario=scene, condition=condition, seed=seed, **given)
    yield from cases_of(settings, rooms)


def cases_of(settings: PairConfig, rooms: range) -> Iterator[RoomCase]:
    """The same of any settings of the simulator."""
    pairs = make_pairs(settings, np.asarray(rooms))
    points = points_of(pairs.pose, pairs.directions, pairs.robot.distance)
    turned = rotation_of(pairs.pose.yaw, pairs.pose.pitch).astype(np.float64)
    for row in range(len(rooms)):
        building, ids = building_of_room(pairs.prior, row)
        back = np.isfinite(pairs.robot.distance[row])
        place = pairs.pose.position[row].astype(np.float64)
        scan = PosedScan(points[row, back], place, turned[row], settings.sensor)
        yield RoomCase(pairs, row, ids, prior_of_building(building), scan)


def as_cloud(case: RoomCase) -> Prior:
    """The prior of a room as what a scan of it from the same place shows: a cloud without elements."""
    pairs, row = case.pairs, case.row
    pose = type(pairs.pose)(*(field[row : row + 1] for field in pairs.pose))
    distance = pairs.dt.distance[row : row + 1]
    return prior_of_cloud(points_of(pose, pairs.directions, distance)[np.isfinite(distance)].astype(np.float64))


def true_boxes(pairs: Pairs, row: int, sign: int) -> tuple[list[Box], list[float]]:
    """True boxes of one change (1 added, -1 removed) in one room, and how much of each can be observed."""
    box, chosen = pairs.box, np.flatnonzero(pairs.box.change[row] == sign)
    boxes = [
        Box(
            "pillar" if box.object_type[row, one] == PILLAR else "wall", box.center[row, one].astype(np.float64),
            box.size[row, one].astype(np.float64), float(box.yaw[row, one]),
        )
        for one in chosen
    ]  # fmt: skip
    return boxes, [float(pairs.observable_fraction[row, one]) for one in chosen]
