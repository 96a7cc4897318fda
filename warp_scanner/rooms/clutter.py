"""What else stands about in rooms: cabinets along the walls, cartons and people anywhere.

R rooms, N pieces of a kind. World frame: metres, z up.
"""

import dataclasses
from math import pi
from typing import NamedTuple

import numpy as np

from warp_scanner import draws
from warp_scanner.rooms.footprints import Footprints
from warp_scanner.rooms.furniture import at
from warp_scanner.rooms.settings import Range
from warp_scanner.rooms.shells import Site
from warp_scanner.scenes.scenes import BOX, CABINET, CARTON, CYLINDER, PERSON, Primitives, Tags, join, solids

_PERSON_HALF_SIZE = (0.15, 0.26)  # [m] from back to front, and across the shoulders


@dataclasses.dataclass(frozen=True)
class ClutterConfig:
    """Ranges that clutter is drawn from, uniformly. The thesis has none, so the limits are 0. Lengths in metres."""

    cabinet_limit: int = 0  # places tried, at most; each room draws how many from 0 to this
    cabinet_width: Range = (0.4, 1.4)
    cabinet_depth: Range = (0.3, 0.6)
    cabinet_height: Range = (0.7, 2.2)
    carton_limit: int = 0
    carton_size: Range = (0.2, 0.7)  # each edge; some carry a second one half as large
    person_limit: int = 0
    person_height: Range = (1.5, 1.95)


class ClutterMarks(NamedTuple):
    """Where the clutter of R rooms may stand."""

    cabinets: Footprints
    cartons: Footprints
    people: Footprints


def spread_clutter(config: ClutterConfig, site: Site, place_key: np.ndarray) -> ClutterMarks:
    """Places drawn at random, whether things fit or not; `place_key` (R,) gives them, the site's keys the sizes."""
    key, count = site.key, config.cabinet_limit
    half = [draws.between(key, f"cabinet {edge}", getattr(config, f"cabinet_{edge}"), count) / 2
            for edge in ("depth", "width")]  # fmt: skip
    half = np.stack(half, axis=-1)
    side = np.floor(4 * draws.uniform(place_key, "cabinet side", count))
    across = (side % 2).astype(int)  # the axis that the wall behind it is across
    room = np.broadcast_to(site.size[:, None, :2] / 2, (*across.shape, 2))
    # A hair more than the clearance to the wall behind.
    reach = np.take_along_axis(room, across[..., None], axis=2)[..., 0] - half[..., 0] - site.clearance - 1e-6
    slack = np.take_along_axis(room, 1 - across[..., None], axis=2)[..., 0] - half[..., 1]
    along = slack * (2.0 * draws.uniform(place_key, "cabinet place", count) - 1.0)
    away = np.where(side < 2, -reach, reach)
    center = np.stack([np.where(across == 0, away, along), np.where(across == 0, along, away)], axis=-1)
    cabinets = Footprints(center, half, across * (pi / 2), _as_many(place_key, "cabinet", count))

    edges = [draws.between(key, f"carton size {axis}", config.carton_size, config.carton_limit) for axis in (0, 1)]
    cartons = _anywhere(site, place_key, "carton", np.stack(edges, axis=-1) / 2)
    bodies = np.broadcast_to(np.array(_PERSON_HALF_SIZE), (len(key), config.person_limit, 2))
    return ClutterMarks(cabinets, cartons, _anywhere(site, place_key, "person", bodies))


def _as_many(key: np.ndarray, name: str, limit: int) -> np.ndarray:
    """(R, limit) bool: as many of the first slots as the room draws from 0 to the limit."""
    return np.arange(limit) < np.floor(draws.uniform(key, f"{name} count", 1) * (limit + 1))


def _anywhere(site: Site, key: np.ndarray, name: str, half: np.ndarray) -> Footprints:
    count = half.shape[1]
    spread = [draws.uniform(key, f"{name} place {axis}", count) - 0.5 for axis in (0, 1)]
    yaw = draws.between(key, f"{name} yaw", (0.0, 2.0 * pi), count)
    return Footprints(np.stack(spread, axis=-1) * site.size[:, None, :2], half, yaw, _as_many(key, name, count))


def build_clutter(
    config: ClutterConfig, site: Site, marks: ClutterMarks, element: int
) -> tuple[Primitives, Primitives, Primitives]:
    """Cabinets, cartons and people on valid marks; `element` is the id of the first cabinet, the others follow."""
    floor = -site.size[:, 2, None] / 2
    cartons_from = element + config.cabinet_limit
    return (
        _cabinets(config, site.key, (marks.cabinets, floor), element),
        _cartons(config, site.key, (marks.cartons, floor), cartons_from),
        _people(config, site.key, (marks.people, floor), cartons_from + config.carton_limit),
    )


def _cabinets(config: ClutterConfig, key: np.ndarray, where: tuple[Footprints, np.ndarray], element: int) -> Primitives:
    marks, floor = where
    count = marks.valid.shape[1]
    up = draws.between(key, "cabinet height", config.cabinet_height, count) / 2
    half = [marks.half_size[..., 0], marks.half_size[..., 1], up]
    tags = Tags(BOX, element + np.arange(count), CABINET)
    return solids(marks.valid, at(marks, 0.0, 0.0, floor + up), half, marks.yaw, tags)


def _cartons(config: ClutterConfig, key: np.ndarray, where: tuple[Footprints, np.ndarray], element: int) -> Primitives:
    marks, floor = where
    count = marks.valid.shape[1]
    up = draws.between(key, "carton height", config.carton_size, count) / 2
    stacked = marks.valid & (draws.uniform(key, "carton stacked", count) < 0.3)
    x, y = marks.half_size[..., 0], marks.half_size[..., 1]
    tags = Tags(BOX, element + np.arange(count), CARTON)
    return join(
        solids(marks.valid, at(marks, 0.0, 0.0, floor + up), [x, y, up], marks.yaw, tags),
        solids(stacked, at(marks, 0.0, 0.0, floor + 2.5 * up), [x / 2, y / 2, up / 2], marks.yaw, tags),
    )


def _people(config: ClutterConfig, key: np.ndarray, where: tuple[Footprints, np.ndarray], element: int) -> Primitives:
    """Standing people: two legs, a trunk and a head, at the usual shares of the height."""
    marks, floor = where
    count = marks.valid.shape[1]
    height = draws.between(key, "person height", config.person_height, count)
    tags = [Tags(kind, element + np.arange(count), PERSON) for kind in (CYLINDER, BOX, CYLINDER)]
    x, y = _PERSON_HALF_SIZE
    legs = [
        solids(
            marks.valid, at(marks, 0.0, side * 0.1, floor + 0.24 * height), [0.07, 0.07, 0.24 * height], 0.0, tags[0]
        )
        for side in (-1.0, 1.0)
    ]
    trunk_half = [x, y, 0.185 * height]
    trunk = solids(marks.valid, at(marks, 0.0, 0.0, floor + 0.665 * height), trunk_half, marks.yaw, tags[1])
    head = solids(marks.valid, at(marks, 0.0, 0.0, floor + 0.925 * height), [0.1, 0.1, 0.075 * height], 0.0, tags[2])
    return join(*legs, trunk, head)
