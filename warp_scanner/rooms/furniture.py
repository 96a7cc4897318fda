"""Tables and chairs: where they can stand, and the primitives they are made of.

R rooms, N pieces of a kind. World frame: metres, z up.
"""

import dataclasses
from math import pi
from typing import NamedTuple

import numpy as np

from warp_scanner import draws
from warp_scanner.rooms.footprints import Footprints
from warp_scanner.rooms.settings import Range
from warp_scanner.rooms.shells import Site
from warp_scanner.scenes.scenes import BOX, CHAIR, CYLINDER, TABLE, Primitives, Tags, join, solids


@dataclasses.dataclass(frozen=True)
class FurnitureConfig:
    """Ranges that furniture is drawn from, uniformly; the defaults are the thesis's. Lengths in metres."""

    table_spacing: Range = (1.0, 5.0)
    table_size: Range = (0.5, 0.9)
    table_height: float = 1.0
    table_leg_radius: Range = (0.05, 0.12)
    table_limit: int = 20  # places tried, at most
    chair_spacing: Range = (1.0, 5.0)
    chair_seat_size: Range = (0.4, 0.55)
    chair_height: Range = (0.8, 1.2)  # top of the back rest, unless the seat would come below 0.35 m
    chair_leg_width: Range = (0.05, 0.1)
    chair_back_height: Range = (0.3, 0.8)
    chair_limit: int = 24
    furniture_randomness: Range = (0.0, 0.8)  # offset from the regular place, in spacings, end to end


class Marks(NamedTuple):
    """Where the furniture of R rooms may stand."""

    tables: Footprints
    chairs: Footprints


def spread_furniture(config: FurnitureConfig, site: Site, place_key: np.ndarray) -> Marks:
    """Tables and chairs at random places of their grids, turned at random, whether they fit or not.

    Args:
        config: the ranges.
        site: the shells; their keys give the sizes.
        place_key: (R,) from draws.keys gives the places, so that the same furniture can stand elsewhere.
    """
    tables = _spread(config, site, place_key, ("table", config.table_spacing, config.table_limit))
    edges = [draws.between(site.key, f"table size {axis}", config.table_size, config.table_limit) for axis in (0, 1)]
    tables = tables._replace(half_size=np.stack(edges, axis=-1) / 2)
    chairs = _spread(config, site, place_key, ("chair", config.chair_spacing, config.chair_limit))
    seat = draws.between(site.key, "chair seat", config.chair_seat_size, config.chair_limit)
    return Marks(tables, chairs._replace(half_size=np.stack([seat, seat], axis=-1) / 2))


def build_furniture(config: FurnitureConfig, site: Site, marks: Marks, element: int) -> tuple[Primitives, Primitives]:
    """Tables and chairs on the valid marks; `element` is the id of the first table, chairs follow the last."""
    floor = -site.size[:, 2, None] / 2
    return (
        _tables(config, site.key, (marks.tables, floor), element),
        _chairs(config, site.key, (marks.chairs, floor), element + config.table_limit),
    )


def _spread(config: FurnitureConfig, site: Site, key: np.ndarray, kind: tuple) -> Footprints:
    """Footprints without a size yet, at randomly chosen places of a grid."""
    name, spacing, limit = kind
    grid = draws.Grid(site.greatest, spacing, config.furniture_randomness, site.size[:, :2])
    place, exists = chosen_places(key, name, grid, limit)
    yaw = draws.between(key, f"{name} yaw", (0.0, 2.0 * pi), limit)
    return Footprints(place, np.zeros_like(place), yaw, exists)


def chosen_places(key: np.ndarray, name: str, grid: draws.Grid, limit: int) -> tuple[np.ndarray, np.ndarray]:
    """At most `limit` places of a jittered grid, chosen at random: (R, limit, 2) [m], and which of them exist."""
    place, exists = draws.places(key, name, grid)
    order = draws.uniform(key, f"{name} order", exists.shape[1])
    chosen = np.argsort(np.where(exists, order, 2.0), axis=1, kind="stable")[:, :limit]
    missing = limit - chosen.shape[1]
    place = np.pad(np.take_along_axis(place, chosen[..., None], axis=1), ((0, 0), (0, missing), (0, 0)))
    return place, np.pad(np.take_along_axis(exists, chosen, axis=1), ((0, 0), (0, missing)))


def at(marks: Footprints, x: np.ndarray | float, y: np.ndarray | float, z: np.ndarray | float) -> list:
    """World coordinates of a point given in the frame of each piece of furniture."""
    cosine, sine = np.cos(marks.yaw), np.sin(marks.yaw)
    return [marks.center[..., 0] + cosine * x - sine * y, marks.center[..., 1] + sine * x + cosine * y, z]


def _legs(
    marks: Footprints, radius: np.ndarray, height: np.ndarray | float, floor: np.ndarray, tags: Tags
) -> Primitives:
    """Four legs in the corners of each footprint."""
    x, y = (marks.half_size[..., axis] - radius for axis in (0, 1))
    half = [radius, radius, height / 2]
    corners = [(sx * x, sy * y) for sx in (-1, 1) for sy in (-1, 1)]
    return join(*(solids(marks.valid, at(marks, u, v, floor + height / 2), half, marks.yaw, tags) for u, v in corners))


def _tables(config: FurnitureConfig, key: np.ndarray, where: tuple[Footprints, np.ndarray], element: int) -> Primitives:
    (marks, floor), thickness = where, 0.05
    count = marks.valid.shape[1]
    kind = np.where(draws.uniform(key, "table legs round", count) < 0.5, CYLINDER, BOX)
    radius = draws.between(key, "table leg", config.table_leg_radius, count)
    number = element + np.arange(count)
    half = [marks.half_size[..., 0], marks.half_size[..., 1], thickness / 2]
    center = at(marks, 0.0, 0.0, floor + config.table_height - thickness / 2)
    top = solids(marks.valid, center, half, marks.yaw, Tags(BOX, number, TABLE))
    return join(top, _legs(marks, radius, config.table_height - thickness, floor, Tags(kind, number, TABLE)))


def _chairs(config: FurnitureConfig, key: np.ndarray, where: tuple[Footprints, np.ndarray], element: int) -> Primitives:
    (marks, floor), thickness = where, 0.04
    count = marks.valid.shape[1]
    back = draws.between(key, "chair back", config.chair_back_height, count)
    height = draws.between(key, "chair height", config.chair_height, count)
    seat = np.maximum(height - back, 0.35)  # the ranges allow seats on the floor, people do not
    leg = draws.between(key, "chair leg", config.chair_leg_width, count) / 2
    tags = Tags(BOX, element + np.arange(count), CHAIR)
    x, y = marks.half_size[..., 0], marks.half_size[..., 1]
    plate = solids(
        marks.valid, at(marks, 0.0, 0.0, floor + seat - thickness / 2), [x, y, thickness / 2], marks.yaw, tags
    )
    rest_center = at(marks, 0.0, -(y - thickness / 2), floor + seat + back / 2)
    rest = solids(marks.valid, rest_center, [x, thickness / 2, back / 2], marks.yaw, tags)
    return join(plate, _legs(marks, leg, seat - thickness, floor, tags), rest)
