"""Models drawn from scans: their floor is the floor, what rays pass is not in them, and what they lack lacks."""

import numpy as np
import pytest

from benchmarks.views.drawn_models import Block, drawn, left_out, levels_of, table_of
from jaxmm.verdicts.building_evidence import passes
from jaxmm.verdicts.priors import prior_of_building
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.rooms.flats import make_flat, seen_by_tilting
from warp_scanner.scenes.scenes import FURNITURE, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles


def _sheet(rng, low, high, count):
    """Points (count, 3) spread evenly between two corners."""
    return rng.uniform(low, high, (count, 3))


def test_floor_and_ceiling_are_where_they_spread_and_not_where_most_points_are():
    rng = np.random.default_rng(0)
    floor = _sheet(rng, (-3, -3, -0.005), (3, 3, 0.005), 3000)
    ceiling = _sheet(rng, (-3, -3, 2.495), (3, 3, 2.505), 3000)
    table = _sheet(rng, (-0.4, -0.4, 0.735), (0.4, 0.4, 0.745), 30_000)  # near the sensor
    walls = np.concatenate([_sheet(rng, (x, -3, 0), (x + 0.01, 3, 2.5), 2000) for x in (-3.0, 3.0)])
    assert levels_of(np.concatenate([floor, ceiling, table, walls])) == pytest.approx((0.0, 2.5), abs=0.02)


def _wall(x: float, length: float, semantic: int = WALL) -> Block:
    return Block(np.array([x, 0.0, 1.25]), np.array([length, 0.1, 2.5]), np.pi / 2, semantic, 500)


def test_what_is_left_out_is_the_shortest_that_nothing_else_stands_for_and_reaches_the_ceiling():
    rng = np.random.default_rng(1)
    short, twin, low = _wall(1.0, 1.0), _wall(1.08, 1.1), _wall(2.0, 0.9)
    middle, long = _wall(3.0, 1.5), _wall(4.0, 2.0)
    on = [
        _sheet(rng, (x - 0.01, -length / 2, 0.0), (x, length / 2, top), 2000)
        for x, length, top in ((1.0, 1.0, 2.5), (2.0, 0.9, 1.2), (3.0, 1.5, 2.5), (4.0, 2.0, 2.5))
    ]
    found = left_out([short, twin, low, middle, long], np.concatenate(on))
    assert [one.size[0] for one in found] == [1.5, 2.0]
    found = left_out([short, low, middle, long], np.concatenate(on))
    assert [one.size[0] for one in found] == [1.0, 1.5]
    held = left_out([short, _wall(1.0, 1.0, FURNITURE), middle, long], np.concatenate(on))
    assert [one.size[0] for one in held] == [1.5, 2.0]


def test_a_scan_hardly_passes_through_what_was_drawn_from_it():
    rng = np.random.default_rng((45, 1))
    flat = make_flat(rng)
    points = seen_by_tilting(rng, flat).points
    blocks = [one for one in drawn(points, flat.place, (0.0, flat.height)) if one.semantic == FURNITURE]
    table = table_of(blocks, np.arange(len(blocks), dtype=np.int32))
    prior = prior_of_building(building_of_room(table, 0)[0])
    direction = points - flat.place
    distance = np.linalg.norm(direction, axis=1)
    place = (flat.place - prior.origin)[None].astype(np.float32)
    rays = Rays(place, (direction / distance[:, None]).astype(np.float32))
    assert len(blocks) > 5
    assert np.mean(passes(distance, cast_triangles(prior.scene, rays).distance[0])) < 0.03
