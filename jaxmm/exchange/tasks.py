"""What stands in which scene of an exported benchmark: a pure function of settings and number."""

import dataclasses
from pathlib import Path
from typing import NamedTuple

from jaxmm.config import MULTI_SCENARIOS, SCENARIOS, UNCHANGED, bounded, build, read_toml
from warp_scanner import draws
from warp_scanner.sensors.sensors import PRESETS as SENSORS

TRAIN, VALIDATION, TEST = SPLITS = ("train", "validation", "test")
TURN = (TRAIN, TRAIN, TRAIN, VALIDATION, TEST)  # splits of five scenes in a row
SEVERAL = "several"  # the scenes of MULTI_SCENARIOS in turn
KINDS = (*SCENARIOS, UNCHANGED, SEVERAL, *SCENARIOS, UNCHANGED, SEVERAL, SEVERAL)  # of scenes of a split in a row
REAL = "-real"  # behind the name of a sensor that errs


@dataclasses.dataclass(frozen=True)
class ExportSettings:
    """What an exported benchmark is drawn from."""

    seed: int = bounded(2026, 0, 2**31)  # of the training scenes; the two that follow are of the other splits
    sensors: tuple[str, ...] = ("oak-d-pro-small", "ouster-64", "velodyne-16")
    occluded_share: float = bounded(0.5, 0.0, 1.0)  # of the scenes: with furniture that the model does not know
    erring_share: float = bounded(0.5, 0.0, 1.0)  # of the scenes: the sensor errs as built
    lost_share: float = bounded(0.25, 0.0, 1.0)  # of the scenes of rooms: the robot is not quite where it believes
    position_error: float = bounded(0.02, 0.0, 0.3)  # [m] standard deviation of each coordinate, of those
    angle_error: float = bounded(0.3, 0.0, 10.0)  # [deg] of yaw and of pitch, of those

    def __post_init__(self):
        known = [name for name in SENSORS if not name.endswith(REAL)]
        if not self.sensors or set(self.sensors) - set(known):
            raise ValueError(f"sensors must be some of {', '.join(known)}, got {', '.join(self.sensors) or 'none'}")


class Task(NamedTuple):
    """One scene."""

    name: str  # its number, of six digits
    split: str  # one of SPLITS
    number: int  # among the scenes of its split
    seed: int
    scene: str  # one of config.SCENES: what changed
    condition: str  # "clean" | "occluded"
    sensor: str  # a key of SENSORS
    lost: bool  # whether the pose errs; of rooms only
    building: int | None  # row of the table of building files; None: a generated room

    @property
    def hurdles(self) -> int:
        """How many of three things make it hard: furniture, a sensor that errs, a pose that errs."""
        return (self.condition == "occluded") + self.sensor.endswith(REAL) + self.lost


def load_export_settings(path: Path | None) -> ExportSettings:
    """Settings from a TOML file, or the defaults.

    Raises:
        ConfigError: the file is missing or no TOML, or a setting is unknown, of the wrong type, or out of range.
    """
    if path is None:
        return ExportSettings()
    return build(ExportSettings, read_toml(path), str(path))


def task_of(settings: ExportSettings, index: int, buildings: int = 0) -> Task:
    """The scene of number `index`, at least 0.

    Args:
        settings: what it is drawn from.
        index: its number. More scenes change none of those before.
        buildings: how many building files there are. Each belongs to one split, in turn, and every second scene of a
            split that has some is in one of them.
    """
    split = TURN[index % len(TURN)]
    number = index // len(TURN) * TURN.count(split) + TURN[: index % len(TURN)].count(split)
    seed = settings.seed + SPLITS.index(split)
    key = draws.keys(seed, [number])
    occluded, errs, lost, which = draws.uniform(key, "benchmark scene", 4)[0]
    kind = KINDS[number % len(KINDS)]
    scene = MULTI_SCENARIOS[number // len(KINDS) % len(MULTI_SCENARIOS)] if kind == SEVERAL else kind
    building = _building_of(split, number, buildings)
    if building is not None and kind == SEVERAL:  # of a building one thing changes at a time
        scene = SCENARIOS[number // len(KINDS) % len(SCENARIOS)]
    return Task(
        name=f"{index:06d}",
        split=split,
        number=number,
        seed=seed,
        scene=scene,
        condition="occluded" if occluded < settings.occluded_share else "clean",
        sensor=settings.sensors[int(which * len(settings.sensors))] + REAL * int(errs < settings.erring_share),
        lost=bool(lost < settings.lost_share) and building is None,
        building=building,
    )


def split_of_building(row: int) -> str:
    """The split that a building file belongs to: one building is never on two sides."""
    return (TRAIN, TEST, VALIDATION)[row % 3]


def _building_of(split: str, number: int, buildings: int) -> int | None:
    own = [row for row in range(buildings) if split_of_building(row) == split]
    return own[number // 2 % len(own)] if own and number % 2 else None
