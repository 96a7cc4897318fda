"""A building becomes pairs of scans that differ in one wall or column, with the truth about every ray.

Removed: one of the building's own walls or columns is left out of reality. Missing: it is left out of the prior, where
it stands in reality. Added: a box or a cylinder, or a copy of one of the building's own, stands free in reality only.
Furniture stands in the occluded reality only. All of it shares one mesh, out of which each scan picks what is there.
Positions are offsets from the building's origin, metres, z up; R pairs.

A point of the prior is testable where the robot's ray returns from beyond it, by more than the margin: a ray that does
not return tells nothing. A point of the robot's is testable where the prior's range, infinite where the prior has
nothing, exceeds it by more than the margin. Both are told from ranges without noise.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from warp_scanner import draws
from warp_scanner.buildings.changes import Change, added_object, furniture_around, of_element, removable
from warp_scanner.buildings.positions import draw_positions, storeys_between
from warp_scanner.rooms.pairs import Pairs, joined
from warp_scanner.rooms.scenarios import CONDITIONS, SCENARIOS, TrueBox
from warp_scanner.rooms.settings import check_seed
from warp_scanner.rooms.standing import Standing
from warp_scanner.scenes.building import Building, bounds, element_bounds, fixed
from warp_scanner.scenes.building_edits import join
from warp_scanner.scenes.scenes import NOTHING, PILLAR, WALL, Primitives
from warp_scanner.sensors.imperfections import imperfect
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sense import rays_of, with_noise, within_reach
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, Sensor
from warp_scanner.sensors.surface import incidence_of
from warp_scanner.sensors.triangles import TriangleScene, cast_faces, cast_triangles, face_normals, prepare

MISSING = ("pillar_missing", "wall_missing")  # of the prior, see `without`
_ATTEMPTS = 200
# Shape beyond (R, M) and dtype of every field of a TrueBox.
_BOX_FIELDS = (((3,), np.float32), ((3,), np.float32), ((), np.float32), ((), np.uint8), ((), np.int8), ((), np.int32),
               ((), np.int32))  # fmt: skip
# A building's prior is a mesh: nobody but its caller has it.
_NO_PRIMITIVES = Primitives(
    np.zeros((1, 0), np.uint8), np.zeros((1, 0, 3), np.float32), np.zeros((1, 0, 3), np.float32),
    np.zeros((1, 0), np.float32), np.zeros((1, 0), np.int32), np.zeros((1, 0), np.uint8),
)  # fmt: skip
_RING = 360  # rays around a sensor that look for something to remove


@dataclasses.dataclass(frozen=True)
class BuildingPairConfig:
    """Which pairs of a building to make; lengths in metres."""

    seed: int = 0
    scenario: str = "pillar_added"  # one of scenarios.SCENARIOS or of MISSING, or "unchanged"
    condition: str = "clean"  # or "occluded"
    sensor: Sensor = OAK_D_PRO_SMALL  # errs in the robot scan only; the DT scan shares its reach
    standing: Standing = Standing()
    storey: int | None = None  # row of the building's storey table; None draws from all
    copied_share: float = 0.3  # share of added objects whose shape is copied from one of the building's own
    range_noise: float = 0.0  # standard deviation of the robot's ranges, on top of the sensor's own
    testable_margin: float = 0.1  # ranges must differ by more than this to tell prior and reality apart
    minimum_share: float = 0.001  # least share of the rays that hit the changed object in the clean scene, within reach

    def __post_init__(self):
        known = (*SCENARIOS, *MISSING, "unchanged")
        if self.scenario not in known:
            raise ValueError(f"scenario must be one of {known}, got {self.scenario!r}")
        if self.condition not in CONDITIONS:
            raise ValueError(f"condition must be one of {CONDITIONS}, got {self.condition!r}")
        check_seed(self.seed)
        for name in ("range_noise", "testable_margin"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be at least 0 and finite, got {getattr(self, name)}")
        for name in ("copied_share", "minimum_share"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must be between 0 and 1, got {getattr(self, name)}")

    @property
    def of_building(self) -> bool:
        """Whether what changes is one of the building's own elements."""
        return self.scenario.endswith(("removed", "missing"))

    @property
    def semantic(self) -> int:
        """Class of the changed object."""
        return {"pillar": PILLAR, "wall": WALL}.get(self.scenario.partition("_")[0], NOTHING)


class _Site(NamedTuple):
    """The building, and what of it could be removed."""

    building: Building
    scene: TriangleScene
    removable: np.ndarray  # (N,) rows of elements; empty where none of them changes
    low: np.ndarray  # (N, 3) [m] their bounding boxes
    high: np.ndarray


class _Attempt(NamedTuple):
    """One view with everything that may stand in it."""

    scene: TriangleScene
    in_prior: np.ndarray  # (E,) bool
    in_real: np.ndarray
    changed: int  # element or -1
    change: Change | None


def make_building_pairs(
    building: Building, config: BuildingPairConfig, index: np.ndarray, threads: int | None = None
) -> Pairs:
    """Pairs of the given numbers; a pure function of (building, config, index) for every single pair.

    The two conditions of one index share pose and changed object. Elements of the scans are rows of the building's
    table, of a missing one too; an added object has the id after the last, furniture the ids after that. Positions are
    offsets from the building's origin.

    Args:
        building: from read_building.
        config: what to make.
        index: (R,) numbers, at least 0.
        threads: how many to use; by default one for each core it may run on.

    Raises:
        ValueError: index is not (R,) or holds a negative number; the building has no such storey; something is to be
            removed, or missing, that it lacks.
        RuntimeError: no place where a sensor sees a change.
    """
    index = np.asarray(index)
    if index.ndim != 1 or not np.issubdtype(index.dtype, np.integer) or np.any(index < 0):
        raise ValueError(f"index must be (R,) integers of at least 0, got {index.dtype} {index.shape}")
    site = _site(building, config)
    if not len(index):
        one = _make_pair(site, config, (0, threads))
        return Pairs(*(_nobody(field) if name != "directions" else field for name, field in one._asdict().items()))
    return joined([_make_pair(site, config, (int(number), threads)) for number in index])


def _site(building: Building, config: BuildingPairConfig) -> _Site:
    count = len(building.storeys.name)
    if config.storey is not None and config.storey not in range(count):
        raise ValueError(
            f"storey must be a row of the building's {count} storeys, 0 to {count - 1}, got {config.storey}"
        )
    low, high = element_bounds(building.triangles)
    rows = np.zeros(0, int)
    if config.of_building:
        rows = removable(building, config.semantic)
        if not len(rows):
            kind = config.scenario.partition("_")[0]
            raise ValueError(f"scenario {config.scenario} needs a {kind} at least 1 m high; this building has none")
        if config.storey is not None:
            # What reaches into the storey is what is likely seen from there.
            there = [config.storey in storeys_between(building, low[row, 2], high[row, 2]) for row in rows]
            rows = rows[there] if any(there) else rows
    return _Site(building, prepare(building.triangles), rows, low[rows], high[rows])


def _nobody(field):
    return type(field)(*map(_nobody, field)) if isinstance(field, tuple) else field[:0]


def _make_pair(site: _Site, config: BuildingPairConfig, which: tuple[int, int | None]) -> Pairs:
    number, threads = which
    low, high = bounds(site.building.triangles)
    extent = (high - low).astype(np.float32)[None]
    for attempt in range(_ATTEMPTS):
        key = draws.keys(config.seed, np.array([number]), attempt)
        near = None
        if len(site.removable):
            # A column in a large building is seen from few of its places: look for one near it.
            target = int(draws.uniform(key, "sensor near", 1)[0, 0] * len(site.removable))
            near = (site.low[target], site.high[target])
        pose, found = draw_positions(site.building, site.scene, config.standing, key, config.storey, near)
        if not found[0]:
            continue
        if len(site.removable) and (pose := _facing(site, config, pose, key)) is None:
            continue
        rays = rays_of(config.sensor, pose)
        trial = _attempt(site, config, (key, pose, rays, threads))
        if trial is not None:
            return _scanned(config, trial, (number, pose, rays, threads, extent))
    why = "too little free space, or nothing of the kind in sight"
    raise RuntimeError(f"no {config.scenario} pair for index {number} in {_ATTEMPTS} attempts: {why}")


def _facing(site: _Site, config: BuildingPairConfig, pose: Pose, key: np.ndarray) -> Pose | None:
    """The pose turned so that something that can be removed is in view; None where nothing around it is."""
    angle = np.arange(_RING) * (2.0 * np.pi / _RING)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1).astype(np.float32)
    element = within_reach(cast_triangles(site.scene, Rays(pose.position, ring)), config.sensor).element[0]
    seen = np.intersect1d(element, site.removable)
    if not len(seen):
        return None
    which, where, beside = draws.uniform(key, "facing", 3)[0]
    rays = np.flatnonzero(element == seen[int(which * len(seen))])
    right, left = config.sensor.azimuths
    yaw = np.degrees(angle[rays[int(where * len(rays))]]) - (right + left) / 2 + (beside - 0.5) * (left - right) * 0.7
    return pose._replace(yaw=np.array([(yaw + 180.0) % 360.0 - 180.0], np.float32))


def _attempt(site: _Site, config: BuildingPairConfig, view: tuple) -> _Attempt | None:
    """The scene around one pose, or None where the change could not be placed or seen."""
    (building, scene), (key, pose, rays, threads) = site[:2], view
    own = len(building.elements.guid)
    prior = within_reach(cast_triangles(scene, rays, threads=threads), config.sensor)
    if not np.isfinite(prior.distance).any():
        return None
    least = max(1, int(np.ceil(config.minimum_share * prior.distance.size)))
    triangles, changed, change = building.triangles, -1, None
    if config.of_building:
        seen = np.bincount(prior.element[prior.element >= 0], minlength=own)
        candidates = [number for number in site.removable if seen[number] >= least]
        if not candidates:
            return None
        changed = candidates[int(draws.uniform(key, "change element", 1)[0, 0] * len(candidates))]
        change = of_element(building, changed)
    elif config.scenario.endswith("added"):
        change = added_object(building, scene, (config.semantic, config.copied_share), (pose, config.sensor), key)
        if change is None:
            return None
        changed, triangles = own, join(triangles, change.triangles)
    before = len(triangles.semantic)
    if config.condition == "occluded":
        floor = _floor_below(scene, pose, config.standing)
        furniture = furniture_around(scene, pose, floor, change, key)
        triangles = triangles if furniture is None else join(triangles, furniture)
    count = len(triangles.semantic)
    in_prior, in_real = np.arange(count) < own, np.ones(count, bool)
    if config.of_building:
        (in_real if config.scenario.endswith("removed") else in_prior)[changed] = False
    full = prepare(triangles) if count > own else scene
    if config.scenario.endswith("added"):
        clean = within_reach(cast_triangles(full, rays, np.arange(count) < before, threads), config.sensor)
        if np.sum(clean.element == changed) < least:
            return None
    return _Attempt(full, in_prior, in_real, changed, change)


def _floor_below(scene: TriangleScene, pose: Pose, standing: Standing) -> float:
    """Height [m] of what the sensor stands above; of a file without floors, of where one would be."""
    down = np.array([[0.0, 0.0, -1.0]], np.float32)
    drop = float(cast_triangles(scene, Rays(pose.position, down), fixed(scene.triangles)).distance[0, 0])
    low, high = standing.height_range
    return float(pose.position[0, 2]) - (drop if drop <= high + 0.1 else (low + high) / 2)


def _scanned(config: BuildingPairConfig, trial: _Attempt, view: tuple) -> Pairs:
    """Both scans and the truth of one pair."""
    number, pose, rays, threads, extent = view
    endless = cast_triangles(trial.scene, rays, trial.in_prior, threads)
    whole, face = cast_faces(trial.scene, rays, trial.in_real, threads)
    dt, robot = within_reach(endless, config.sensor), within_reach(whole, config.sensor)
    removed = config.scenario.endswith("removed")
    changed_dt = (dt.element == trial.changed) if removed else np.zeros(dt.element.shape, bool)
    changed_robot = (
        (robot.element == trial.changed) if trial.changed >= 0 and not removed else np.zeros_like(changed_dt)
    )
    margin = np.float32(config.testable_margin)
    # A robot ray without a return tells nothing; where the prior has nothing, its range is infinite.
    testable_dt = np.isfinite(robot.distance) & (dt.distance + margin < robot.distance)
    testable_robot = robot.distance + margin < endless.distance
    fraction = np.zeros((1, int(trial.changed >= 0)), np.float32)
    if trial.changed >= 0:
        only = np.arange(len(trial.in_prior)) == trial.changed
        alone = within_reach(cast_triangles(trial.scene, rays, only, threads), config.sensor)
        found = np.sum((changed_dt & testable_dt) | (changed_robot & testable_robot))
        fraction[0, 0] = found / max(int(np.isfinite(alone.distance).sum()), 1)
    incidence = incidence_of(face_normals(trial.scene.triangles, face), rays)
    which = (config.seed, np.array([number]))
    noisy = imperfect(robot, incidence, config.sensor, *which)
    noisy = with_noise(noisy, config.sensor, np.array([config.range_noise]), which)
    return Pairs(
        pose, rays.direction, dt, noisy, changed_dt, changed_robot, testable_dt, testable_robot, fraction,
        _box(trial.change, trial.changed, -1 if removed else 1), pose, extent, _NO_PRIMITIVES,
    )  # fmt: skip


def _box(change: Change | None, element: int, direction: int) -> TrueBox:
    """The changed object of one room; without a column where nothing changed."""
    if change is None:
        return TrueBox(*(np.zeros((1, 0, *more), dtype) for more, dtype in _BOX_FIELDS))
    values = (change.center, change.size, change.yaw, change.semantic, direction, element, -1)
    return TrueBox(
        *(np.asarray(value, dtype)[None, None] for value, (_, dtype) in zip(values, _BOX_FIELDS, strict=True))
    )
