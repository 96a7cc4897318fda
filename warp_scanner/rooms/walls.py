"""Interior walls on crossing lines, the doors cut into them, and the door leaves.

R rooms, N pieces of wall, L lines in each direction. World frame: metres, z up.
"""

import dataclasses
from math import pi
from typing import NamedTuple

import numpy as np

from warp_scanner import draws
from warp_scanner.rooms import footprints
from warp_scanner.rooms.footprints import Footprints
from warp_scanner.rooms.settings import Range
from warp_scanner.rooms.shells import Site
from warp_scanner.scenes.scenes import BOX, DOOR, WALL, Primitives, Tags, join, solids


@dataclasses.dataclass(frozen=True)
class WallConfig:
    """Ranges that interior walls and doors are drawn from, uniformly; the defaults are the thesis's."""

    wall_count_x: tuple[int, int] = (0, 2)  # walls across x; both ends included
    wall_count_y: tuple[int, int] = (0, 2)
    wall_least_spacing: float = 1.5  # [m] a room with less space for each wall gets fewer
    wall_thickness: Range = (0.1, 0.3)
    wall_density: Range = (0.7, 1.0)  # chance that a piece between two crossings is built
    wall_randomness: Range = (0.0, 0.8)  # offset from the regular place, in spacings, end to end
    wall_rotation: Range = (0.0, 0.0)  # [rad] turn of the walls across x, and of those across y, to either side
    door_share: float = 0.8  # chance that a piece of wall that is long enough has a door
    door_width: Range = (0.7, 1.3)
    door_height: float = 2.1
    door_rotation: Range = (pi, 1.75 * pi)  # [rad], pi is closed

    @property
    def line_count(self) -> int:
        """Lines of walls in each direction that a room has slots for."""
        return max(2, self.wall_count_x[1], self.wall_count_y[1])

    @property
    def piece_count(self) -> int:
        """Pieces of wall that a room has slots for: each line is cut where it crosses the others."""
        return 2 * self.line_count * (self.line_count + 1)


class Walls(NamedTuple):
    """Interior wall pieces, all (R, N): those across x run along y and the other way round."""

    across_x: np.ndarray  # bool
    place: np.ndarray  # [m] where the line crosses the axis that the wall is across
    turn: np.ndarray  # [rad] of the line, counter-clockwise
    low: np.ndarray  # [m] where it begins along its line
    high: np.ndarray
    thickness: np.ndarray  # (R, 1)
    valid: np.ndarray


def draw_walls(config: WallConfig, site: Site) -> Walls:
    """Lines across x and y at jittered regular places, cut where they cross and thinned by the density."""
    count, key = config.line_count, site.key
    slots = count * (count + 1)
    thickness = draws.between(key, "wall thickness", config.wall_thickness, 1)
    randomness = draws.between(key, "wall randomness", config.wall_randomness, 1)
    density = draws.between(key, "wall density", config.wall_density, 1)
    angle = draws.between(key, "wall rotation", config.wall_rotation, 2)
    angle = np.where(draws.uniform(key, "wall rotation side", 2) < 0.5, 0.0 - angle, angle)  # never a negative zero
    lines = [_lines(config, site, axis, randomness) for axis in (0, 1)]

    pieces = []
    for axis in (0, 1):
        turn, other_turn = angle[:, axis, None], angle[:, 1 - axis, None]
        (line_count, place), (cut_count, cut_place) = lines[axis], lines[1 - axis]
        begin, end = _line_ends(site, axis, (place, turn), thickness)
        # Where each line crosses those of the other direction; the signs are those of a left-handed swap of axes.
        tilt = (turn, other_turn) if axis == 0 else (-turn, -other_turn)
        cuts = (cut_place[:, None] + (place * np.tan(tilt[1]))[..., None]) / (
            np.cos(tilt[0]) + np.sin(tilt[0]) * np.tan(tilt[1])
        )[..., None]
        number = np.arange(count + 1)
        # Half the width of the other wall as this one meets it, corners of its end included.
        skew = other_turn - turn
        half = (0.5 * thickness * (1.0 / np.cos(skew) + np.tan(np.abs(skew))))[..., None]
        # A wall across x owns the square where two walls cross, so that no two pieces share a volume.
        low = np.concatenate([begin[..., None], cuts + (-half if axis == 0 else half)], axis=2)
        high = np.concatenate([cuts - half, end[..., None]], axis=2)
        high = np.where(number < cut_count[:, :, None], high, end[..., None])
        low, high = np.maximum(low, begin[..., None]), np.minimum(high, end[..., None])
        exists = (np.arange(count) < line_count)[:, :, None] & (number <= cut_count)[:, None, :]
        kept = draws.uniform(key, f"wall kept {axis}", slots).reshape(exists.shape) < density[:, :, None]
        shape = (len(key), slots)
        pieces.append(
            (
                np.full(shape, axis == 0),
                np.repeat(place, count + 1, axis=1),
                np.broadcast_to(turn, shape),
                low.reshape(shape),
                high.reshape(shape),
                (exists & kept).reshape(shape),
            )
        )
    across_x, place, turn, low, high, valid = (np.concatenate(fields, axis=1) for fields in zip(*pieces, strict=True))
    return Walls(across_x, place, turn, low, high, thickness, valid & (high - low > 0.05))


def _lines(config: WallConfig, site: Site, axis: int, randomness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How many lines each room has across an axis (R, 1), and where they cross it (R, L)."""
    low, high = (config.wall_count_x, config.wall_count_y)[axis]
    size = site.size[:, axis, None]
    count = low + np.floor(draws.uniform(site.key, f"wall count {axis}", 1) * (high - low + 1))
    count = np.minimum(count, np.maximum(np.floor(size / config.wall_least_spacing) - 1, 0))
    spacing = size / (count + 1)
    jitter = randomness * spacing * (draws.uniform(site.key, f"wall place {axis}", config.line_count) - 0.5)
    return count, -size / 2 + spacing * np.arange(1, config.line_count + 1) + jitter


def _line_ends(site: Site, axis: int, line: tuple, thickness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where lines of that thickness begin and end (R, L) so that no corner leaves the shell or enters its corner."""
    place, turn = line
    sine, cosine = np.sin(turn), np.cos(turn)
    # Own axis and the other one: where the line is at 0, how fast it moves, how far the thickness reaches.
    own = (place, -sine if axis == 0 else sine, cosine)
    other = (np.zeros_like(place), cosine, np.abs(sine))
    begin, end = np.full_like(place, -np.inf), np.full_like(place, np.inf)
    enter, leave = begin.copy(), end.copy()
    for (start, speed, reach), along in ((own, axis), (other, 1 - axis)):
        half = site.size[:, along, None] / 2
        low, high = _crossings(start, speed, (-half, half), -0.5 * thickness * reach)
        begin, end = np.maximum(begin, low), np.minimum(end, high)
        middle, edge = site.corner.center[..., along], site.corner.half_size[..., along]
        low, high = _crossings(start, speed, (middle - edge, middle + edge), 0.5 * thickness * reach)
        enter, leave = np.maximum(enter, low), np.minimum(leave, high)
    blocked = site.corner.valid & (enter < leave)
    before = np.minimum(enter, end) - begin > end - np.maximum(leave, begin)
    new_end = np.where(blocked & before, np.minimum(enter, end), end)
    new_begin = np.where(blocked & ~before, np.maximum(leave, begin), begin)
    built = new_begin < new_end
    return np.where(built, new_begin, 0.0), np.where(built, new_end, 0.0)


def _crossings(start: np.ndarray, speed: np.ndarray, limits: tuple, margin: np.ndarray) -> tuple:
    """Interval of u in which `start + speed * u` lies within the limits widened by a margin."""
    low, high = limits[0] - margin, limits[1] + margin
    still = np.abs(speed) < 1e-12
    safe = np.where(still, 1.0, speed)
    first, second = (low - start) / safe, (high - start) / safe
    within = (start >= low) & (start <= high)
    return (
        np.where(still, np.where(within, -np.inf, np.inf), np.minimum(first, second)),
        np.where(still, np.where(within, np.inf, -np.inf), np.maximum(first, second)),
    )


def _on_wall(walls: Walls, along: np.ndarray, offset: np.ndarray | float) -> list[np.ndarray]:
    """World x and y of a point at `along` on the line of a wall, `offset` from its middle plane."""
    sine, cosine = np.sin(walls.turn), np.cos(walls.turn)
    across = walls.place + offset * cosine - np.where(walls.across_x, along, -along) * sine
    onward = along * cosine + np.where(walls.across_x, offset, -offset) * sine
    return [np.where(walls.across_x, across, onward), np.where(walls.across_x, onward, across)]


def wall_footprints(walls: Walls) -> Footprints:
    """The pieces as rectangles, doors closed up."""
    center = np.stack(_on_wall(walls, (walls.low + walls.high) / 2, 0.0), axis=-1)
    half = np.stack(
        [(walls.high - walls.low) / 2, np.broadcast_to(walls.thickness / 2, walls.low.shape)],
        axis=-1,
    )
    return Footprints(center, half, np.where(walls.across_x, pi / 2, 0.0) + walls.turn, walls.valid)


def cut_doors(
    config: WallConfig, site: Site, built: tuple[Walls, Footprints], element: int
) -> tuple[Primitives, Primitives, Footprints]:
    """Wall pieces cut open by doors, and the door leaves: (wall primitives, leaf primitives, leaf footprints)."""
    walls, wall_marks = built
    count, key = walls.valid.shape[1], site.key
    number = np.arange(count)
    width = draws.between(key, "door width", config.door_width, count)
    slack = walls.high - walls.low - width - 0.4  # at least 0.2 m of wall remains on either side
    opened = walls.valid & (slack > 0) & (draws.uniform(key, "door", count) < config.door_share)
    start = walls.low + 0.2 + draws.uniform(key, "door place", count) * np.maximum(slack, 0.0)
    start = np.where(opened, start, walls.high)
    stop = np.where(opened, start + width, walls.high)

    height, floor = site.size[:, 2, None], -site.size[:, 2, None] / 2
    wall_tags = Tags(BOX, element + number, WALL)

    def piece(valid, low, high, bottom):
        along, across, up = (high - low) / 2, walls.thickness / 2, (height - bottom) / 2
        half = [np.where(walls.across_x, across, along), np.where(walls.across_x, along, across), up]
        center = [*_on_wall(walls, (low + high) / 2, 0.0), floor + bottom + up]
        return solids(valid, center, half, walls.turn, wall_tags)

    pieces = join(
        piece(walls.valid, walls.low, start, 0.0),
        piece(opened, stop, walls.high, 0.0),
        piece(opened, start, stop, config.door_height),
    )
    leaf_marks = _leaves(config, key, walls, (opened, start, stop))
    leaf_marks = leaf_marks._replace(valid=leaf_marks.valid & site.within(leaf_marks))
    # A leaf may stand as close to walls as its own, but keeps the clearance to other leaves.
    solid = footprints.join(wall_marks, site.corner)
    leaf_marks = leaf_marks._replace(valid=footprints.settle(leaf_marks, solid, 0.005, site.clearance))
    leaf_half = [leaf_marks.half_size[..., 0], leaf_marks.half_size[..., 1], config.door_height / 2 - 0.01]
    leaf_center = [leaf_marks.center[..., 0], leaf_marks.center[..., 1], floor + config.door_height / 2]
    tags = Tags(BOX, element + count + number, DOOR)
    return pieces, solids(leaf_marks.valid, leaf_center, leaf_half, leaf_marks.yaw, tags), leaf_marks


def _leaves(config: WallConfig, key: np.ndarray, walls: Walls, opening: tuple) -> Footprints:
    """Door leaves turned about hinges that stand just off the wall's face, so that no angle cuts into the wall."""
    opened, start, stop = opening
    count = opened.shape[1]
    turn = draws.between(key, "door rotation", config.door_rotation, count)
    end = np.where(draws.uniform(key, "door hinge", count) < 0.5, -1.0, 1.0)  # which end of the opening
    face = np.where(draws.uniform(key, "door face", count) < 0.5, -1.0, 1.0)  # which side of the wall
    half_thickness = 0.02
    half_width = (stop - start) / 2 - half_thickness
    along, across = end * np.cos(turn), -face * np.sin(turn)
    middle = (start + stop) / 2 + end * half_width + along * half_width
    center = _on_wall(walls, middle, face * (walls.thickness / 2 + 0.03) + across * half_width)
    yaw = np.where(walls.across_x, np.arctan2(along, across), np.arctan2(across, along)) + walls.turn
    half = np.stack([half_width, np.full_like(half_width, half_thickness)], axis=-1)
    return Footprints(np.stack(center, axis=-1), half, yaw, opened)
