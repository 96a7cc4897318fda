"""Sensors described in TOML files: every key and value is checked, and an error is one line that names file and key.

kind = "spinning"              # or "pinhole", with width, height, horizontal_fov, vertical_fov
azimuth_steps = 2048
channels = 32                  # or elevations = [...], in degrees and falling
elevation_range = [-22.5, 22.5]
range_limits = [0.3, 90]
[imperfections]
noise = 0.01
[imperfections.class_dropout]
door = 0.05                    # by the name or the number of a semantic class
"""

import dataclasses
import tomllib
import typing
from pathlib import Path
from typing import Any

from warp_scanner.scenes import scenes

CLASSES = {name: number for number, name in enumerate(scenes.CLASS_NAMES) if number != scenes.NOTHING}


def read(path: Path, kinds: dict[str, type]) -> Any:
    """An object of the settings class that the file's key `kind` names, with the fields that the file gives.

    Raises:
        ValueError: see sensors.sensor_named.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise ValueError(f"{path}: cannot read the sensor: {reason}") from error
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # numbers of too many digits, and lists nested too deeply
        raise ValueError(f"{path}: not valid TOML: {' '.join(str(error).split())}") from error
    return parse(values, kinds, str(path))


def parse(values: dict[str, Any], kinds: dict[str, type], where: str) -> Any:
    """As `read`, from a table that was read already; `where` opens the messages of errors."""
    kind = values.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise ValueError(f"{where}: kind must be one of {', '.join(kinds)}, got {kind!r}")
    return _build(kinds[kind], {key: value for key, value in values.items() if key != "kind"}, where, "")


def _build(kind: type, values: dict[str, Any], path: str, section: str) -> Any:
    """An object of the settings class `kind`; `section` is where in the file its values stand."""
    fields = {field.name: field for field in dataclasses.fields(kind)}
    if unknown := values.keys() - fields.keys():
        names = ", ".join(section + name for name in sorted(unknown))
        raise ValueError(f"{path}: unknown {names}; expected some of {', '.join(fields)}")
    needed = [name for name, field in fields.items() if field.default is dataclasses.MISSING]
    if missing := [section + name for name in needed if name not in values]:
        raise ValueError(f"{path}: missing {', '.join(missing)}")
    converted = {key: _typed(fields[key].type, value, path, section + key) for key, value in values.items()}
    try:
        return kind(**converted)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _typed(kind: Any, value: Any, path: str, key: str) -> Any:
    """The value as the type of its field, or an error."""
    where, inner = f"{path}: {key}", typing.get_args(kind)
    by_class = bool(inner) and typing.get_origin(inner[0]) is tuple
    if dataclasses.is_dataclass(kind) or by_class:
        if not isinstance(value, dict):
            raise ValueError(f"{where}: expected a table, got {value!r}")
        if not by_class:
            return _build(kind, value, path, f"{key}.")
        pairs = ((_class_of(name, where), _typed(float, item, path, f"{key}.{name}")) for name, item in value.items())
        return tuple(sorted(pairs))
    if inner:
        any_count = inner[-1] is ...
        if not isinstance(value, list | tuple) or not (any_count or len(value) == len(inner)):
            expected = "numbers" if any_count else f"{len(inner)} numbers"
            raise ValueError(f"{where}: expected a list of {expected}, got {value!r}")
        return tuple(_typed(inner[0], item, path, key) for item in value)
    # A float may not hold a whole number of hundreds of digits.
    if type(value) not in (int, kind) or (type(value) is int and abs(value) >= 2**63):
        raise ValueError(f"{where}: expected {'a whole number' if kind is int else 'a number'}, got {value!r}")
    return kind(value)


def _class_of(name: str, where: str) -> int:
    if name.isdecimal() and len(name) <= 3:
        return int(name)
    if name not in CLASSES:
        raise ValueError(f"{where}: unknown class {name}; expected a number or some of {', '.join(CLASSES)}")
    return CLASSES[name]
