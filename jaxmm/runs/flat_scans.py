"""Small, low and crowded flats as if they came in files: a model that lacks some of it, one scan, and the truth.

World frame: metres, z up, the floor at 0.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.learning.boxes import Box
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.priors import Prior, prior_of_building
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.rooms.flats import Flat, Seen, make_flat, seen_by, seen_by_tilting
from warp_scanner.scenes.scenes import FURNITURE, PILLAR, WALL, take_slots
from warp_scanner.sensors.sensors import sensor_named

SENSORS = (*4 * ("tilting",), "oak-d-pro-small", "ouster-64")
LEAST_SEEN = 60  # points of what the model may lack
LACKS = (0, 1, 1, 2, 2, 3)  # how many elements a model lacks, each as likely
SHORTEST = 0.5  # [m] of a wall that it may lack
HOLDS_THINGS, OF_THEM = 0.5, 0.8  # share of the models that hold things, and of the things that these hold
ONLY_SEEN, LEAST_DRAWN = 0.4, 300  # share of the models that hold but the walls on which so many points are
MISPLACED = 0.005  # [m] standard deviation of the sensor's place about the believed one, along each axis


class FlatCase(NamedTuple):
    """One flat."""

    prior: Prior
    scan: PosedScan  # as it is believed to be taken
    lacking: list[Box]  # walls and columns that stand and are not in the model
    seen: list[np.ndarray]  # (n, 3) [m] the points of each of them
    flat: Flat
    element: np.ndarray  # (N,) int32 slot of the flat that each point is on


def flat_case(
    seed: int, number: int, sensor: str | None = None, lacks: int | None = None, built_in: bool = False
) -> FlatCase:
    """A flat, a pure function of its arguments.

    Args:
        seed: of all flats.
        number: which of them.
        sensor: "tilting", or a name that `sensor_named` knows; None: any of SENSORS.
        lacks: how many walls or columns, that the scan sees, the model is without, if there are so many; None: few.
        built_in: whether cupboards reach up to the ceiling, too.
    """
    rng = np.random.default_rng((seed, number))
    flat = make_flat(rng, built_in)
    drawn_sensor, drawn_count = str(rng.choice(SENSORS)), int(rng.choice(LACKS))
    sensor, lacks = sensor or drawn_sensor, drawn_count if lacks is None else lacks
    seen = seen_by_tilting(rng, flat) if sensor == "tilting" else seen_by(rng, flat, sensor_named(sensor))
    gone = _lacking(rng, flat, seen, lacks)
    table, semantic = flat.primitives, flat.primitives.semantic[0]
    things = ~np.isin(semantic, (WALL, PILLAR)) & (np.arange(len(semantic)) > 1)  # floor and ceiling come first
    held = (rng.random() < HOLDS_THINGS) & (rng.random(len(semantic)) < OF_THEM)
    hidden = np.bincount(seen.element, minlength=len(semantic)) < LEAST_DRAWN
    hidden &= (semantic == WALL) & (rng.random() < ONLY_SEEN)
    kept = np.flatnonzero(~np.isin(np.arange(len(semantic)), gone) & (~things | held) & ~hidden)
    model = take_slots(table, kept)
    model.semantic[things[kept][None]] = FURNITURE
    place = flat.place + rng.normal(0.0, MISPLACED, 3)
    points = (seen.points - flat.place + place).astype(np.float32)
    boxes = [_box(flat, one) for one in gone]
    return FlatCase(
        prior_of_building(building_of_room(model, 0)[0]), PosedScan(points, place, seen.rotation), boxes,
        [points[seen.element == one] for one in gone], flat, seen.element,
    )  # fmt: skip


def _lacking(rng: np.random.Generator, flat: Flat, seen: Seen, count: int) -> list[int]:
    """Slots of what the model lacks: columns first, for there are few."""
    semantic, length = flat.primitives.semantic[0], 2.0 * flat.primitives.half_size[0, :, 0]
    met = np.bincount(seen.element, minlength=len(semantic)) >= LEAST_SEEN
    columns = rng.permutation(np.flatnonzero(met & (semantic == PILLAR)))
    walls = rng.permutation(np.flatnonzero(met & (semantic == WALL) & (length >= SHORTEST) & _is_whole(flat)))
    return [*columns.tolist(), *walls.tolist()][:count]


def _is_whole(flat: Flat) -> np.ndarray:
    """(K,) bool: no lintel."""
    return 2.0 * flat.primitives.half_size[0, :, 2] > 0.9 * flat.height


def _box(flat: Flat, slot: int) -> Box:
    table = flat.primitives
    return Box(
        "pillar" if table.semantic[0, slot] == PILLAR else "wall", table.center[0, slot].astype(np.float64),
        2.0 * table.half_size[0, slot].astype(np.float64), float(np.degrees(table.yaw[0, slot])),
    )  # fmt: skip
