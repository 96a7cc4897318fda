"""From points with two probabilities to objects: which walls and pillars stand there, how large, and how surely.

probable points -> clusters -> upright faces and shafts -> faces of one wall joined -> candidates -> nothing, a pillar
or a wall -> boxes. N points of one side of some scans, S scans. World frame: metres, z up. An object is an upright
prism, turned by any angle, and reaches from floor to ceiling unless one sees that it does not. What is low, and seen to
end below the ceiling, is furniture, whatever its points look like.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.learning.boxes import Box
from jaxmm.learning.upright_shapes import turn_of
from jaxmm.objects.candidates import Candidate, candidates_of
from jaxmm.objects.clues import CLUES, ONTO, Opinions, Surroundings, clues_of
from jaxmm.objects.face_ends import Look, as_all_rays_show
from jaxmm.objects.face_finish import Rays
from jaxmm.objects.familiar_sizes import by_length, by_section, by_size, by_width
from jaxmm.objects.furniture_filter import upright
from jaxmm.objects.judge import ObjectJudge, default_judge, judge_objects
from jaxmm.objects.main_directions import grid_near, off_grid
from jaxmm.objects.object_heights import levels_of
from jaxmm.objects.patches import Sight, sensors_of
from jaxmm.objects.pieces import pieces_of
from jaxmm.objects.sections import Section, sections_of
from jaxmm.objects.solids import SolidSettings, solid_of, without_splinters
from jaxmm.objects.usual_sizes import habits_around
from jaxmm.objects.view_window import view_of
from jaxmm.objects.wall_joining import joined
from jaxmm.objects.walls import KnownBuilding, Solid


class Judged(NamedTuple):
    """One side of one scan or several, thinned to about one point a voxel of 0.1 m, and what the networks say of it."""

    points: np.ndarray  # (N, 3) [m] world, or offsets from some origin
    pillar: np.ndarray  # (N,) P(of a changed pillar)
    wall: np.ndarray  # (N,) P(of a changed wall)
    apart: np.ndarray  # (N,) [m] to the surface of the other side
    sensor: np.ndarray  # (S, 3) [m] where the scans were taken from, in the frame of the points
    floor: float  # [m]
    ceiling: float
    scan: np.ndarray | None = None  # (N,) int which of the S saw each point; where None, the nearest may have
    # (S,) all of each scan, which may be loaded when asked for, needs `scan`; where None, those to the points are all
    rays: Sequence[Rays] | None = None
    levels: np.ndarray | None = None  # (N, 2) [m] floor and ceiling of each point; where None, those above are of all


class Examined(NamedTuple):
    """The candidates of a side, before anyone says what they are."""

    sight: Sight
    looks: list[Look]  # the same, scan by scan; none without a candidate
    candidates: list[Candidate]
    clues: np.ndarray  # (C, F) of clues.CLUES


class Found(NamedTuple):
    """One object."""

    box: Box  # its probability is that it is real
    members: np.ndarray  # (n,) int of the points that it was fitted to, in order
    measured: tuple[bool, bool, bool] = (True, True, True)  # of its dimensions, whether they are seen, not assumed
    type_probability: float = 1.0  # that it is of its type, if it is real


@dataclasses.dataclass(frozen=True)
class ObjectSettings(SolidSettings):
    """How points become objects; chosen on validation rooms, as were the settings of the steps. Lengths in metres."""

    threshold: float = 0.3  # a point is looked at from this probability on; whether its object is real is told by all
    threshold_apart: float = 0.08  # and from this one on where it is farther than ONTO from the other side's surface
    least_apart: float = 0.0  # points closer to the other side's surface are none of an object
    surface_margin: float = 0.05  # points this near to floor or ceiling are none either
    least_type: float = 0.1  # a real object is tried as a pillar, or a wall, from this probability of being one on
    rarer: float = 3.0  # how many times rarer changes are than in the rooms that the judge of objects learnt from

    def __post_init__(self):
        if not 0.0 <= self.threshold <= 1.0:
            raise ValueError(f"threshold must lie in [0, 1], got {self.threshold}")
        if not 0.0 <= self.least_type <= 0.5:  # beyond, what is likelier one of both would be neither
            raise ValueError(f"least_type must lie in [0, 0.5], got {self.least_type}")
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not np.all(np.asarray(value) >= 0.0):  # also false for NaN
                raise ValueError(f"{field.name} must not be negative, got {value}")
        if self.link <= 0.0 or self.tolerance <= 0.0:
            raise ValueError(f"link and tolerance must be positive, got {self.link} and {self.tolerance}")


def find_objects(
    judged: Judged,
    settings: ObjectSettings | None = None,
    known: KnownBuilding | None = None,
    judge: ObjectJudge | None = None,
    allows: Callable[[list[Found]], list[bool]] | None = None,
) -> list[Found]:
    """Find the walls and pillars among the points that the networks hold for changed.

    Args:
        judged: all points of one side; those that did not change tell where nothing stands.
        settings: by default those that were best in validation rooms.
        known: sizes of the building's walls and columns, which are taken on where they fit, and tell the type; and its
            surface.
        judge: what tells pillars, walls and neither apart; by default the one that is shipped.
        allows: which of some objects something else, such as the rays, allows: all are asked for at once. One that is
            not is tried as the other type, and else takes no points from others.

    Returns:
        Objects, the surest first, unlikely ones too. Their order and content do not depend on the order of the points.

    Raises:
        ValueError: shapes that disagree, values that are not finite, probabilities outside [0, 1], or a ceiling that
            is not above the floor.
    """
    settings, known = settings or ObjectSettings(), known or KnownBuilding()
    sight, looks, candidates, clues = examine(judged, settings, known)
    share = judge_objects(judge or default_judge(), clues)
    sections = sections_of(judged.rays or (), [sight.points[one.members] for one in candidates] if judged.rays else [])
    made = []
    for number, (one, odds) in enumerate(zip(candidates, share, strict=True)):
        shown = (one, as_all_rays_show(sight, looks, one, settings.tolerance))
        section = sections[number] if sections else None
        made.append(list(_solids(sight, section, shown, odds, settings, known)))
    every = [_found(sight, solid, settings) for solids in made for solid in solids]
    fits = iter([True] * len(every) if allows is None else allows(every))
    allowed = [one for solids in made for one in _likeliest(solids, [next(fits) for _ in solids])]
    found = [_found(sight, one, settings) for one in without_splinters(sight, allowed, settings)]
    return sorted(found, key=lambda one: (-one.box.probability, *one.box.center))


def _likeliest(solids: list[Solid], allowed: list[bool]) -> list[Solid]:
    """The first of those that are allowed, if any: what is refused as the other type is of this one."""
    refused = sum(solid.type_probability for solid, fits in zip(solids, allowed, strict=True) if not fits)
    first = next((solid for solid, fits in zip(solids, allowed, strict=True) if fits), None)
    if first is None:
        return []
    return [first._replace(type_probability=min(first.type_probability / max(1.0 - refused, 1e-6), 1.0))]


def _solids(
    sight: Sight,
    section: Section | None,
    shown: tuple[Candidate, Candidate],
    share: np.ndarray,
    settings: ObjectSettings,
    known: KnownBuilding,
) -> Iterator[Solid]:
    """A candidate as what it is likelier, then as the other: what the rays refuse as a pillar may be a thin wall.

    None where the likelier tells nothing of its shape. It is `shown` by thinned points, and by all rays.
    """
    thinned, one = shown
    seen = sight.around(one.members)

    @functools.cache
    def made(is_wall: bool) -> Solid | None:
        return solid_of(seen, one, is_wall, settings, known, thinned, None if is_wall else section)

    share = by_length(by_width(share, one, known, settings), sight.points[one.members, :2], known, settings)
    if made(False) is not None:
        share = by_section(share, section, known, settings)
    if known.columns or known.short_walls:
        share = by_size(share, one, made(False), known, settings, lambda: _off_grid(seen, made(True), known))
    nothing, pillar, wall = share
    real = 1.0 - nothing
    probability = float(real / (real + settings.rarer * nothing))
    for is_wall in (bool(wall > pillar), bool(wall <= pillar)):
        of_type = float((wall if is_wall else pillar) / max(real, 1e-9))
        if of_type < settings.least_type:
            continue
        solid = made(is_wall)
        if solid is None:
            return
        yield solid._replace(probability=probability, type_probability=of_type)


def _off_grid(sight: Sight, wall: Solid | None, known: KnownBuilding) -> float:
    """The angle [deg] between a wall and the building around it; 0 where nobody knows."""
    if wall is None or known.uprights is None:
        return 0.0
    grid = grid_near(known.uprights, wall.center, sight.floor, sight.ceiling)
    return 0.0 if grid is None else float(off_grid(turn_of(wall.along), grid))


def examine(judged: Judged, settings: ObjectSettings, known: KnownBuilding | None = None) -> Examined:
    """What may be an object, and what tells whether it is one.

    Args:
        judged: all points of one side.
        settings: what is a candidate.
        known: of the building, whose own walls and columns tell how things stand in it, and how large they are; None
            where nobody knows.

    Raises:
        ValueError: as `find_objects`.
    """
    known = known or KnownBuilding()
    sight, opinions = _checked(judged)
    probability, z = np.maximum(opinions.pillar, opinions.wall), sight.points[:, 2]
    floor, ceiling = (sight.floor, sight.ceiling) if sight.levels is None else sight.levels.T
    inside = (z > floor + settings.surface_margin) & (z < ceiling - settings.surface_margin)
    needed = np.where(opinions.apart > ONTO, min(settings.threshold_apart, settings.threshold), settings.threshold)
    chosen = inside & (probability >= needed) & (opinions.apart >= settings.least_apart)
    loose = inside & ~chosen & (opinions.apart > ONTO)
    found = pieces_of(sight, np.flatnonzero(chosen), np.flatnonzero(loose), settings)
    pieces = joined(sight, upright(sight, found, settings), settings)
    candidates = candidates_of(sight, pieces, settings)

    @functools.cache
    def around(x: float, y: float) -> Surroundings:
        return _surroundings(known, np.array([x, y]), sight)

    looks = _looks(judged, sight) if candidates else []
    clues = [clues_of(sight, looks, one, opinions, around(*one.first.origin[:2]), settings) for one in candidates]
    return Examined(sight, looks, candidates, np.array(clues).reshape(-1, len(CLUES)))


def _surroundings(known: KnownBuilding, place: np.ndarray, sight: Sight) -> Surroundings:
    """What a building is like around a place (2,) [m]."""
    grid = None if known.uprights is None else grid_near(known.uprights, place, sight.floor, sight.ceiling)
    return Surroundings(grid, habits_around(known.own, place, grid))


def _looks(judged: Judged, sight: Sight) -> list[Look]:
    """Each scan by itself. Where nobody knows which saw a point, nobody knows where its view ends either."""
    sensors = np.asarray(judged.sensor, np.float64)
    if judged.scan is None and len(sensors) > 1:
        return [Look(sight, None, functools.partial(_rays_to, sight))]
    looks = []
    for number, sensor in enumerate(sensors):
        own = np.asarray(judged.scan) == number if judged.scan is not None else np.ones(len(sight.points), bool)
        if own.any():
            points = sight.points[own]
            mine = sight._replace(points=points, origin=np.broadcast_to(sensor, points.shape), levels=None)
            rays = functools.partial(
                *((judged.rays.__getitem__, number) if judged.rays is not None else (_rays_to, mine))
            )
            looks.append(Look(mine, view_of(mine.points, sensor), rays))
    return looks


def _rays_to(sight: Sight) -> Rays:
    return Rays(sight.origin, sight.points - sight.origin, np.ones(len(sight.points)))


def _found(sight: Sight, solid: Solid, settings: ObjectSettings) -> Found:
    low, high, upright = levels_of(sight.around(solid.members), solid, settings)
    turn = float(np.degrees(turn_of(solid.along)))
    box = Box(
        solid.object_type,
        np.array([*solid.center, (low + high) / 2]),
        np.array([*solid.edges, high - low]),
        (turn + 90.0) % 180.0 - 90.0,
        solid.shape,
        solid.probability,
        len(solid.members),
    )
    return Found(box, solid.members, (*solid.measured, upright), solid.type_probability)


def _checked(judged: Judged) -> tuple[Sight, Opinions]:
    points, sensors = np.asarray(judged.points, np.float64), np.asarray(judged.sensor, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points must be (N, 3), got {points.shape}")
    if sensors.ndim != 2 or sensors.shape[1] != 3 or not len(sensors):
        raise ValueError(f"sensor must be (S >= 1, 3), got {sensors.shape}")
    if not np.isfinite(points).all() or not np.isfinite(sensors).all():
        raise ValueError("points and sensor must be finite")
    for name in ("pillar", "wall", "apart"):
        if np.shape(getattr(judged, name)) != (len(points),):
            raise ValueError(f"{name} must be ({len(points)},), got {np.shape(getattr(judged, name))}")
    opinions = Opinions(*(np.asarray(one, np.float64) for one in (judged.pillar, judged.wall, judged.apart)))
    if not all(np.all((one >= 0.0) & (one <= 1.0)) for one in opinions[:2]):  # also false for NaN
        raise ValueError("pillar and wall must lie in [0, 1], got values outside it")
    if not np.all(opinions.apart >= 0.0):  # also false for NaN
        raise ValueError("apart must not be negative or NaN")
    if judged.scan is not None:
        scan = np.asarray(judged.scan)
        if scan.shape != (len(points),) or not np.all((scan >= 0) & (scan < len(sensors))):
            raise ValueError(f"scan must be ({len(points)},) of 0 to {len(sensors) - 1}, got {scan.shape}")
    levels = None if judged.levels is None else np.asarray(judged.levels, np.float64)
    if levels is not None and (levels.shape != (len(points), 2) or not np.isfinite(levels).all()):
        raise ValueError(f"levels must be ({len(points)}, 2) and finite, got {levels.shape}")
    if judged.rays is not None:
        _check_rays(judged.rays, sensors, judged.scan)
    if not judged.floor < judged.ceiling:
        raise ValueError(f"floor must lie below ceiling, got {judged.floor} and {judged.ceiling}")
    origin = sensors_of(points, sensors, judged.scan)
    return Sight(points, origin, float(judged.floor), float(judged.ceiling), levels), opinions


def _check_rays(rays: Sequence[Rays], sensors: np.ndarray, scan: np.ndarray | None) -> None:
    if len(rays) != len(sensors) or (scan is None and len(sensors) > 1):
        known = "" if scan is not None else " whose points are known"
        raise ValueError(f"rays must be those of {len(sensors)} scans{known}, got those of {len(rays)}")
    for one, sensor in zip(rays, sensors, strict=True):
        if not np.array_equal(one.origin, sensor):
            raise ValueError(f"rays must start at the sensor of their scan, {sensor}, got {one.origin}")
        if one.direction.shape != (len(one.distance), 3) or not np.isfinite(one.direction).all():
            raise ValueError(f"directions of rays must be finite, ({len(one.distance)}, 3), got {one.direction.shape}")
        if not np.all(one.distance >= 0.0):  # also false for NaN
            raise ValueError("distances of rays must not be negative or NaN")
