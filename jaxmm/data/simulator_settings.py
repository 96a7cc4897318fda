"""The simulator's settings out of those of a run: which rooms, which sensor, what stands where, what errs."""

import dataclasses
import functools
from pathlib import Path
from typing import Any, NamedTuple

from jaxmm.config import CONDITIONS, MULTI_SCENARIOS, SCENARIOS, Config, ConfigError, load
from warp_scanner.rooms.pairs import PRESETS, PairConfig
from warp_scanner.rooms.rooms import RoomConfig
from warp_scanner.sensors.imperfections import Imperfections
from warp_scanner.sensors.sensors import PRESETS as SENSORS
from warp_scanner.sensors.sensors import Pinhole, Sensor, sensor_of

MULTI = "multi"  # the scenes of MULTI_SCENARIOS in turn
_OWN = {"seed", "scenario", "condition", "room", "sensor"}  # fields of a PairConfig that `scan` does not set as such

_UNITS = dict.fromkeys(("noise", "quantum", "mixed_step", "position_error", "range_noise", "range_noise_spread"), " m")
_UNITS |= dict.fromkeys(("grazing_start", "mixed_angle", "angle_error"), " degrees") | {"noise_per_square": " per m"}
_ERRORS = ("range_noise", "range_noise_spread", "position_error", "angle_error")


class CloudSource(NamedTuple):
    """Which clouds: the side and object type of one model, out of scenes of a kind."""

    scenario: str  # whose model the clouds are for: it fixes the side that is scored, and the object type
    scene: str  # one of config.SCENES, or MULTI
    condition: str  # "clean" | "occluded"
    seed: int


def load_config(path: Path) -> Config:
    """Read settings and check them all, those of the simulator too.

    Raises:
        ConfigError: see `config.load` and `pair_config`; the line names the file.
    """
    config = load(path)
    try:
        _any_pair(config)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    return config


@functools.lru_cache(maxsize=64)  # asked several times for each kind of pairs, and every field is checked
def pair_config(config: Config, source: CloudSource) -> PairConfig:
    """The simulator's settings for one kind of pair.

    `scan.preset` names where they start from; the other keys of `scan`, and those of `room`, say what differs.

    Raises:
        ConfigError: a setting is unknown, of the wrong type or out of range, or the sensor is not in the room.
    """
    scan = config.scan.thawed()
    preset = scan.pop("preset", "thesis")
    if preset not in PRESETS:
        raise ConfigError(f"scan: preset: expected one of {', '.join(PRESETS)}, got {preset!r}")
    start = PRESETS[preset]
    sensor = _sensor(scan, start.sensor)
    known = {field.name: getattr(start, field.name) for field in dataclasses.fields(start) if field.name not in _OWN}
    values = _checked(scan, known, "scan", ("preset", "sensor", "width", "height"))
    room = _room(config, start.room)
    try:
        return dataclasses.replace(
            start, seed=source.seed, scenario=source.scene, condition=source.condition, room=room, sensor=sensor,
            **values,
        )  # fmt: skip
    except ValueError as error:
        raise ConfigError(f"scan: {error}") from error


def scene_of(scene: str, room: int) -> str:
    """What MULTI stands for in room number `room`; other scenes are what they are."""
    return MULTI_SCENARIOS[room % len(MULTI_SCENARIOS)] if scene == MULTI else scene


def ray_count(config: Config) -> int:
    """Rays of one scan."""
    rows, columns = _any_pair(config).sensor.shape
    return rows * columns


def errors_of(config: Config) -> str:
    """In words, how the robot scans err."""
    pair = _any_pair(config)
    errors = dataclasses.asdict(pair.sensor.imperfections)
    default = dataclasses.asdict(Imperfections())
    told = [
        f"{name} {value:g}{_UNITS.get(name, '')}"
        for name, value in errors.items()
        if name != "class_dropout" and value != default[name]
    ]
    told += ["dropout by class"] * bool(errors["class_dropout"])
    told += [f"{name} {getattr(pair, name):g}{_UNITS.get(name, '')}" for name in _ERRORS if getattr(pair, name)]
    told += [f"in {pair.erring_share:g} of the rooms only"] if told and pair.erring_share < 1.0 else []
    return ", ".join(told) or "none"


def _any_pair(config: Config) -> PairConfig:
    return pair_config(config, CloudSource(SCENARIOS[0], SCENARIOS[0], CONDITIONS[0], config.data.train_seed))


def _sensor(scan: dict[str, Any], start: Sensor) -> Sensor:
    """The sensor that `scan` describes; its keys are taken out of there."""
    given = scan.pop("sensor", None)
    pixels = {name: scan.pop(name) for name in ("width", "height") if name in scan}
    try:
        if isinstance(given, dict):
            start = sensor_of(given, "sensor")
        elif given is not None:
            if given not in SENSORS:
                raise ValueError(f"sensor: expected a table or one of {', '.join(SENSORS)}, got {given!r}")
            start = SENSORS[given]
        for name, count in pixels.items():
            if type(count) is not int:
                raise ValueError(f"{name}: expected int, got {count!r}")
            if not isinstance(start, Pinhole):
                raise ValueError(f"{name}: expected only with a pinhole sensor")
        return dataclasses.replace(start, **pixels)
    except ValueError as error:
        raise ConfigError(f"scan: {error}") from error


def _room(config: Config, start: RoomConfig) -> RoomConfig:
    """The preset's rooms, but for what the config's `room` table says."""
    known = {field.name: getattr(start, field.name) for field in dataclasses.fields(start)}
    values = _checked(config.room.thawed(), known, "room", ())
    try:
        return dataclasses.replace(start, **values)
    except ValueError as error:
        raise ConfigError(f"room: {error}") from error


def _checked(values: dict[str, Any], known: dict[str, Any], section: str, more: tuple[str, ...]) -> dict[str, Any]:
    """The values, once each has a known name and looks like what it replaces."""
    for name, value in values.items():
        if name not in known:
            raise ConfigError(f"{section}: unknown {name}; expected some of {', '.join((*more, *known))}")
        if not _alike(value, known[name]):
            raise ConfigError(f"{section}: {name}: expected something like {known[name]!r}, got {value!r}")
    return values


def _alike(value: Any, default: Any) -> bool:
    """Whether a setting has the shape of its default and finite numbers, whole ones where that has whole ones."""
    if isinstance(default, tuple):
        return isinstance(value, tuple) and len(value) == len(default) and all(map(_alike, value, default))
    if isinstance(default, str | bool) or isinstance(value, str | bool):
        return type(value) is type(default)
    return type(value) in (type(default), int) and abs(value) < 2**31
