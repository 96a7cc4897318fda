"""What else a changed object could be, as far as one view tells: things that would bring back the same ranges.

A single face, whose ends are out of view, may be a wall's or a pillar's, or a cabinet's where one sees no more than
2.2 m of it. Nobody can tell such things apart by ranges, only say what is likelier. P rays. World frame: metres, z up.

A thing looks like another where their ranges agree: rays that show the object would show it at the same range, and all
others would pass it, or end before it. Tried are things of the sizes that are drawn, and those that the building has,
that share a face with the object. What has no look-alike among these may have others; so shares of views in which
someone can tell are at most what is said here.
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.learning.boxes import Box
from jaxmm.verdicts.standing_alone import ranges_to
from warp_scanner.buildings.changes import COLUMN_WIDTH, WALL_LENGTH, WALL_THICKNESS, of_element, removable
from warp_scanner.rooms.clutter import ClutterConfig
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.scenes.building import Building
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.poses import rotation_of

CABINET = "cabinet"
SAME = 0.02  # [m] by which ranges may differ
MOST_OTHER = 0.03  # of the rays that show an object, so many may differ
LEAST_ON_FACE = 3  # rays, from which a face is seen
MOST_RAYS = 20_000
AT_ONCE = 256  # things whose ranges are cast together
SIZES, SHIFTS = 10, 7  # of a range of sizes, and of the places along a face


class View(NamedTuple):
    """What one scan shows of an object, without errors of its ranges."""

    position: np.ndarray  # (3,) float64 [m]
    direction: np.ndarray  # (P, 3) float32 unit vectors
    distance: np.ndarray  # (P,) float32 [m]; inf = nothing came back
    shows: np.ndarray  # (P,) bool: ends on the object


class Section(NamedTuple):
    """A size that things of some kind have in plan."""

    kind: str  # "wall" | "pillar" | CABINET
    front: float  # [m] along the face that is seen
    depth: float  # [m]


class _Face(NamedTuple):
    """A side of an object that is seen."""

    axis: int  # of the box, 0 or 1, that it is across
    way: float  # -1 or 1, its direction along that axis
    start: float  # [m] from the middle of the box along the other axis, from where on it is seen
    end: float
    depth: float  # [m] behind the face, to which the object is seen


def view_of(pairs: Pairs) -> View:
    """The first view of some pairs; of a large one every so many rays."""
    turn = rotation_of(pairs.pose.yaw, pairs.pose.pitch)[0]
    every = slice(None, None, max(1, len(pairs.directions) // MOST_RAYS))
    direction = (pairs.directions[every] @ turn.T).astype(np.float32)
    shows = (pairs.changed_robot & pairs.testable_robot)[0, every]
    return View(pairs.pose.position[0].astype(np.float64), direction, pairs.robot.distance[0, every], shows)


def sections_of(building: Building) -> list[Section]:
    """Sizes of a building's own walls and columns, each as it may be seen from either side."""
    found = {
        (kind, *np.round(np.sort(of_element(building, row).size[:2]), 2))
        for kind, semantic in (("wall", WALL), ("pillar", PILLAR))
        for row in removable(building, semantic)
    }
    return [Section(kind, *turned) for kind, *size in sorted(found) for turned in itertools.permutations(size)]


def lookalikes(view: View, true: Box, own: Sequence[Section]) -> set[str]:
    """Kinds of things other than the true one that would bring back the same ranges.

    Args:
        view: what one sees of it.
        true: what it is, upright; only what is rectangular has look-alikes here.
        own: sizes that the building has.
    """
    others = (one for one in _things(view, true, own) if one[0] != true.object_type)
    found: set[str] = set()
    while batch := list(itertools.islice(others, AT_ONCE)):
        kinds, boxes = zip(*batch, strict=True)
        same = _differing(view, boxes) <= MOST_OTHER
        found.update(kind for kind, is_same in zip(kinds, same, strict=True) if is_same)
    return found


def _differing(view: View, boxes: Sequence[Box]) -> np.ndarray:
    """(B,) rays by which each box differs from what is seen, in shares of the rays that show the object."""
    ranges, shows = ranges_to(boxes, view.position, view.direction), view.shows
    apart = np.sum(np.abs(ranges[:, shows] - view.distance[shows]) > SAME, axis=1)
    before = np.sum(ranges[:, ~shows] < view.distance[~shows] - SAME, axis=1)
    return (apart + before) / max(int(shows.sum()), 1)


def _things(view: View, true: Box, own: Sequence[Section]) -> Iterator[tuple[str, Box]]:
    """Kind and box of all that shares a face with an object, and reaches at least as far as one sees it."""
    seen = view.position + view.direction[view.shows] * view.distance[view.shows, None].astype(np.float64)
    axes, center = _axes(true), np.asarray(true.center, np.float64)
    places = (seen - center)[:, :2] @ axes.T
    for face in _faces(places, true):
        for one in (*_drawn(face), *own):
            width = face.end - face.start
            if one.front < width - SAME or one.depth < face.depth - SAME:
                continue
            for shift in np.linspace(0.0, 1.0, SHIFTS) if one.front > width + SAME else (0.5,):
                middle = np.zeros(2)
                middle[1 - face.axis] = face.start - (one.front - width) * shift + one.front / 2
                middle[face.axis] = face.way * (true.dimensions[face.axis] - one.depth) / 2
                edges = np.zeros(2)
                edges[[1 - face.axis, face.axis]] = one.front, one.depth
                for low, high in _heights(one.kind, true, float(seen[:, 2].max())):
                    place = np.array([*(center[:2] + middle @ axes), (low + high) / 2])
                    yield one.kind, Box(one.kind, place, np.array([*edges, high - low]), true.rotation)


def _axes(box: Box) -> np.ndarray:
    """(2, 2) the directions of a box's edges in plan."""
    turn = np.radians(box.rotation)
    return np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])


def _faces(places: np.ndarray, true: Box) -> Iterator[_Face]:
    """The sides of an object on which there are points (n, 2) [m], along its own axes."""
    for axis, way in itertools.product((0, 1), (-1.0, 1.0)):
        behind = true.dimensions[axis] / 2 - way * places[:, axis]
        on_it = np.abs(behind) < SAME
        if on_it.sum() >= LEAST_ON_FACE:
            along = places[on_it, 1 - axis]
            yield _Face(axis, way, float(along.min()), float(along.max()), float(behind.max()))


def _drawn(face: _Face) -> Iterator[Section]:
    """Sizes of what is added to buildings, and of cabinets, that are no narrower than what is seen."""
    width = face.end - face.start

    def sizes(low: float, high: float) -> np.ndarray:
        return np.linspace(max(low, width), high, SIZES) if max(low, width) <= high else np.zeros(0)

    depths = [np.linspace(*range_, 5) for range_ in (WALL_THICKNESS, WALL_LENGTH)]
    for fronts, behind in zip((sizes(*WALL_LENGTH), sizes(*WALL_THICKNESS)), depths, strict=True):
        yield from (Section("wall", *size) for size in itertools.product(fronts, behind))
    yield from (Section("pillar", size, size) for size in sizes(*COLUMN_WIDTH))
    edges = (ClutterConfig.cabinet_width, ClutterConfig.cabinet_depth)
    for along, across in itertools.permutations(edges):
        yield from (Section(CABINET, *size) for size in itertools.product(sizes(*along), np.linspace(*across, 5)))


def _heights(kind: str, true: Box, seen: float) -> Iterator[tuple[float, float]]:
    """Lowest and highest level [m] of a thing: the object's own, but a cabinet ends where one sees it, or above."""
    low, high = (true.center[2] + way * true.dimensions[2] / 2 for way in (-1.0, 1.0))
    if kind != CABINET:
        yield low, high
        return
    least, most = ClutterConfig.cabinet_height
    if seen <= low + most:
        yield low, max(seen, low + least)
        yield low, low + most
