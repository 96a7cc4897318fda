"""Where scans were taken from, as users and files say it. World frame: metres, z up."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmm.inputs import InputError

FARTHEST = 1e9  # [m] coordinates beyond this are taken for mistakes
OWN = "own"  # in place of a pose: that of the scan's file, or the estimated one
FORM = "X,Y,Z,YAW[,PITCH], finite, pitch within 90 degrees"
JSON_FORM = (
    'expected {"position": [x, y, z], "yaw": degrees, "pitch": degrees}, or a list of those and of nulls for own'
)


class GivenPose(NamedTuple):
    """A place and where a sensor looks there."""

    position: np.ndarray  # (3,) float64 [m] world
    yaw: float  # [deg] counter-clockwise from +x
    pitch: float  # [deg] upwards

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) float64 sensor frame (x forward, y left, z up) to world: first pitch, then yaw."""
        return Rotation.from_euler("ZY", [self.yaw, -self.pitch], degrees=True).as_matrix()


def read_poses(words: list[str]) -> list[GivenPose | None]:
    """The poses that the values of --pose give: numbers, OWN, or JSON files that hold one pose or a list.

    None stands for the scan's own pose: that of its file, or the estimated one.

    Raises:
        InputError: neither, or not of the form.
    """
    found = []
    for word in words:
        path = Path(word)
        if path.suffix.lower() == ".json":
            found += _from_json(path)
        else:
            found.append(None if word == OWN else parse_pose(word, f"{FORM}, or {OWN}"))
    return found


def parse_pose(text: str, form: str = FORM) -> GivenPose:
    """X,Y,Z,YAW[,PITCH] as a pose; `form` says what was expected.

    Raises:
        InputError: it is not of that form.
    """
    try:
        values = [float(value) for value in text.split(",")]
    except ValueError:
        values = []
    return _checked(values, "--pose", repr(text), form)


def _from_json(path: Path) -> list[GivenPose | None]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"--pose: {path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"--pose: {path}: {JSON_FORM}, got no valid JSON") from error
    entries = content if isinstance(content, list) else [content]
    if not entries:
        raise InputError(f"--pose: {path}: {JSON_FORM}, got none")
    return [None if entry is None and entries is content else _entry(path, entry) for entry in entries]


def _entry(path: Path, entry: Any) -> GivenPose:
    came = json.dumps(entry)[:80]
    is_known = isinstance(entry, dict) and set(entry) <= {"position", "yaw", "pitch"}  # "Yaw" is no yaw of 0
    if not is_known or not isinstance(entry.get("position"), list) or len(entry["position"]) != 3:
        raise InputError(f"--pose: {path}: {JSON_FORM}, got {came}")
    numbers = [*entry["position"], entry.get("yaw", 0.0), entry.get("pitch", 0.0)]
    if any(isinstance(number, bool) or not isinstance(number, int | float) for number in numbers):
        raise InputError(f"--pose: {path}: {JSON_FORM}, got {came}")
    try:
        values = [float(number) for number in numbers]
    except OverflowError:  # JSON bounds no integer
        raise InputError(f"--pose: {path}: {JSON_FORM}, got {came}") from None
    return _checked(values, f"--pose: {path}", came)


def _checked(values: list[float], where: str, came: str, form: str = FORM) -> GivenPose:
    if len(values) not in (4, 5) or not np.isfinite(values).all() or (len(values) == 5 and abs(values[4]) > 90.0):
        raise InputError(f"{where}: expected {form}, got {came}")
    if max(abs(value) for value in values[:3]) > FARTHEST:
        raise InputError(f"{where}: expected X, Y and Z within {FARTHEST:g} m, got {came}")
    return GivenPose(np.array(values[:3]), values[3], values[4] if len(values) == 5 else 0.0)
