"""Sensors: which directions they look in, how far they reach, and those known by name.

Sensor frame: x forward, y left, z up. Angles are in degrees. Rays are row-major from the top left, as one sees them
looking forward. P rays.
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from warp_scanner.scenes import scenes
from warp_scanner.sensors import sensor_files
from warp_scanner.sensors.imperfections import Imperfections

ANY_RANGE = (0.0, np.inf)
RAY_LIMIT = 2**26  # of one scan; beyond it a typing error is likelier than a sensor


@dataclasses.dataclass(frozen=True)
class Pinhole:
    """A depth camera without distortion; rays go through the centres of its pixels."""

    width: int
    height: int
    horizontal_fov: float = 80.0  # [deg] between the outer edges of the first and the last column
    vertical_fov: float = 55.0  # [deg]
    range_limits: tuple[float, float] = ANY_RANGE  # [m] along the ray; both ends are still measured
    imperfections: Imperfections = Imperfections()

    def __post_init__(self):
        _check_counts(self, "width", "height")
        _check_range_limits(self.range_limits)
        for name in ("horizontal_fov", "vertical_fov"):
            if not 0.0 < getattr(self, name) < 180.0:
                raise ValueError(f"sensor {name} must be between 0 and 180 degrees, got {getattr(self, name)}")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height, self.width

    @property
    def spacing(self) -> tuple[float, float]:
        """Largest angle [deg] between neighbouring rows and between neighbouring columns: that at the axis."""
        return tuple(
            float(np.degrees(2.0 * np.tan(np.radians(fov) / 2) / count))
            for fov, count in ((self.vertical_fov, self.height), (self.horizontal_fov, self.width))
        )

    @property
    def full_turn(self) -> bool:
        """Whether the last column is next to the first: never."""
        return False

    @property
    def azimuths(self) -> tuple[float, float]:
        """Right and left edge of the view [deg], counter-clockwise from forward."""
        return -self.horizontal_fov / 2, self.horizontal_fov / 2

    def resampled(self, columns: int, rows: int) -> "Pinhole":
        """The same view in another number of pixels."""
        return dataclasses.replace(self, width=columns, height=rows)

    def sees(self, toward: np.ndarray) -> np.ndarray:
        """(...) bool: whether directions (..., 3) in the sensor frame, of any length, lie in the view."""
        x, y, z = np.moveaxis(toward, -1, 0)
        wide, high = (np.tan(np.radians(fov) / 2) for fov in (self.horizontal_fov, self.vertical_fov))
        return (x > 0) & (np.abs(y) <= wide * x) & (np.abs(z) <= high * x)

    def directions(self) -> np.ndarray:
        """Unit ray directions (P, 3) float32 in the sensor frame."""
        u, v = (
            np.tan(np.radians(fov) / 2) * (1.0 - (2.0 * np.arange(count) + 1.0) / count)
            for fov, count in ((self.horizontal_fov, self.width), (self.vertical_fov, self.height))
        )
        y, z = np.meshgrid(u, v)
        directions = np.stack([np.ones_like(y), y, z], axis=-1).reshape(-1, 3)
        return (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)


@dataclasses.dataclass(frozen=True)
class Spinning:
    """A scanner that turns about z and measures a column of elevations at every step.

    The elevations are given one by one, or as `channels` that are evenly spaced over `elevation_range`, both ends
    included. A row is an elevation, from the top; columns follow from left to right, as a camera's do.
    """

    azimuth_steps: int  # columns
    channels: int = 0
    elevation_range: tuple[float, float] = (0.0, 0.0)  # [deg] lowest and highest channel
    elevations: tuple[float, ...] = ()  # [deg] falling; instead of the two above
    azimuth_range: tuple[float, float] = (-180.0, 180.0)  # [deg] right and left edge, counter-clockwise from forward
    range_limits: tuple[float, float] = ANY_RANGE  # [m] both ends are still measured
    imperfections: Imperfections = Imperfections()

    def __post_init__(self):
        if bool(self.elevations) == bool(self.channels):
            given = f"{self.channels} channels and {len(self.elevations)} elevations"
            raise ValueError(f"sensor needs either elevations, or at least 1 of channels, got {given}")
        _check_counts(self, "azimuth_steps", *(() if self.elevations else ("channels",)))
        _check_range_limits(self.range_limits)
        low, high = self.elevation_range
        # Written so that NaN fails too.
        if not -90.0 <= low <= high <= 90.0 or (low == high) != (self.channels < 2):
            raise ValueError(f"sensor elevation_range must be (low, high) within -90 and 90 degrees, got {low}, {high}")
        if not np.all(np.abs(self.elevations) <= 90.0) or not np.all(np.diff(self.elevations) < 0.0):
            raise ValueError(f"sensor elevations must fall and lie within -90 and 90 degrees, got {self.elevations}")
        right, left = self.azimuth_range
        if not -360.0 <= right < left <= 360.0 or left - right > 360.0:
            raise ValueError(f"sensor azimuth_range must be (right, left) up to 360 degrees apart, got {right}, {left}")

    @property
    def rows(self) -> np.ndarray:
        """Elevations [deg] from the top, (rows,) float64."""
        if self.elevations:
            return np.array(self.elevations, np.float64)
        return np.linspace(*self.elevation_range[::-1], self.channels)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.elevations) or self.channels, self.azimuth_steps

    @property
    def spacing(self) -> tuple[float, float]:
        """Largest angle [deg] between neighbouring rows and between neighbouring columns."""
        between_rows = float(-np.diff(self.rows).min()) if self.shape[0] > 1 else 0.0
        return between_rows, (self.azimuth_range[1] - self.azimuth_range[0]) / self.azimuth_steps

    @property
    def full_turn(self) -> bool:
        """Whether the last column is next to the first."""
        return self.azimuth_range[1] - self.azimuth_range[0] == 360.0

    @property
    def azimuths(self) -> tuple[float, float]:
        """Right and left edge of the view [deg], counter-clockwise from forward."""
        return self.azimuth_range

    def resampled(self, columns: int, rows: int) -> "Spinning":
        """The same view in another number of rays, evenly spaced; a lone channel stays alone."""
        low, high = float(self.rows[-1]), float(self.rows[0])
        channels = rows if low < high else 1
        ends = (low, high)
        return dataclasses.replace(self, azimuth_steps=columns, channels=channels, elevation_range=ends, elevations=())

    def sees(self, toward: np.ndarray) -> np.ndarray:
        """(...) bool: whether directions (..., 3) in the sensor frame, of any length, lie in the view.

        Half a row and half a column around the outermost rays still count, as each ray stands for that much.
        """
        x, y, z = np.moveaxis(toward, -1, 0)
        right, left = self.azimuth_range
        turn = np.mod(np.degrees(np.arctan2(y, x)) - right, 360.0)
        elevation, half = np.degrees(np.arctan2(z, np.hypot(x, y))), self.spacing[0] / 2
        return (turn <= left - right) & (elevation >= self.rows[-1] - half) & (elevation <= self.rows[0] + half)

    def directions(self) -> np.ndarray:
        """Unit ray directions (P, 3) float32 in the sensor frame."""
        right, left = np.radians(self.azimuth_range)
        azimuth = left - (left - right) * (np.arange(self.azimuth_steps) + 0.5) / self.azimuth_steps
        azimuth, elevation = np.meshgrid(azimuth, np.radians(self.rows))
        level = np.cos(elevation)
        directions = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)
        return directions.reshape(-1, 3).astype(np.float32)


Sensor = Pinhole | Spinning
KINDS: dict[str, type] = {"pinhole": Pinhole, "spinning": Spinning}  # as sensor files name them


def _check_counts(sensor: Sensor, *names: str) -> None:
    for name in names:
        if getattr(sensor, name) < 1:
            raise ValueError(f"sensor {name} must be at least 1, got {getattr(sensor, name)}")
    if sensor.shape[0] * sensor.shape[1] > RAY_LIMIT:
        raise ValueError(f"sensor must have at most {RAY_LIMIT} rays, got {sensor.shape[0]} x {sensor.shape[1]}")


def _check_range_limits(limits: tuple[float, float]) -> None:
    # Written so that NaN fails too.
    if not 0.0 <= limits[0] < limits[1]:
        raise ValueError(f"sensor range_limits must be (low, high) with 0 <= low < high, got {limits}")


# Stereo pair of the OAK-D Pro: 80 x 55 degrees, 1280 x 800, 7.5 cm baseline, no depth nearer than 0.2 m (Luxonis,
# product page), and by its formula none beyond (baseline / 2) / tan(80 degrees / 1280).
OAK_D_PRO = Pinhole(1280, 800, range_limits=(0.2, 34.4))
OAK_D_PRO_SMALL = dataclasses.replace(OAK_D_PRO, width=320, height=200)
# Velodyne VLP-16: 16 channels from -15 to +15 degrees, 0.2 degrees at 10 turns a second, 100 m (data sheet 63-9229);
# nearer than about half a metre it returns nothing of use.
VELODYNE_16 = Spinning(1800, 16, (-15.0, 15.0), range_limits=(0.5, 100.0))
# Ouster OS1-64 of 45 degrees, 1024 columns, 0.3 to 120 m on a surface of 80 % (OS1 data sheet, second generation).
OUSTER_64 = Spinning(1024, 64, (-22.5, 22.5), range_limits=(0.3, 120.0))
# A terrestrial scanner, all round and over the top, 0.6 to 70 m as the Faro Focus S70. Here one ray every 0.2 degrees,
# 1.62 million; such scanners go down to some 0.01.
TLS = Spinning(1800, 900, (-89.9, 89.9), range_limits=(0.6, 70.0))

# How the devices err. Numbers of makers where they give them; chances of dropouts, mixtures and gross errors, biases of
# dark surfaces, and how far elements differ in what they send back, are our estimates.
_REAL = {
    # Disparity wrong by a quarter of a pixel: r^2 / (f b) / 4 with f = 763 pixels and b = 0.075 m. That is 1.7 % at 4 m
    # and 3.1 % at 7 m, where Luxonis states less than 2 and 4 %. What looks alike is matched wrongly now and then.
    "oak-d-pro": Imperfections(
        noise_per_square=0.0044, grazing_dropout=0.8, grazing_start=70.0, mixed_chance=0.5, gross_chance=0.001
    ),
    # Up to 3 cm, typical, read as two standard deviations; steps of 2 mm (manual 63-9243). Biases stay within that.
    "velodyne-16": Imperfections(
        noise=0.015, grazing_dropout=0.5, grazing_start=75.0, mixed_chance=0.3, mixed_angle=0.5, quantum=0.002,
        noise_by_light=0.0002, dark_bias=0.01, slant_bias=0.003, reflectivity_spread=0.3, gross_chance=0.0001,
    ),
    # Precision 0.7 cm near by, up to 5 cm far away; one false return in 10,000, no bias of matt surfaces. By light: a
    # surface of 10 % gets 1 cm more at 10 m, about as it reaches a third as far as one of 80 % (OS1 data sheet).
    "ouster-64": Imperfections(
        noise=0.007, noise_per_metre=0.0004, grazing_dropout=0.5, grazing_start=75.0,
        mixed_chance=0.3, mixed_angle=0.5, quantum=0.001,
        noise_by_light=0.0003, reflectivity_spread=0.3, gross_chance=0.0001,
    ),
    # Ranging noise 0.3 mm on bright (90 %), about 0.5 mm on dark surfaces (10 %) at 10 m: the squares of both tell what
    # is by light. Ranging error 1 mm at most. Mixed pixels are its common flaw.
    "tls": Imperfections(
        noise=0.00026, grazing_dropout=0.3, grazing_start=80.0, mixed_chance=0.3, mixed_angle=0.5,
        noise_by_light=0.0000134, dark_bias=0.0005, slant_bias=0.0003, reflectivity_spread=0.3, gross_chance=0.0001,
    ),
}  # fmt: skip
_REAL["oak-d-pro-small"] = _REAL["oak-d-pro"]
PRESETS: dict[str, Sensor] = {
    "oak-d-pro": OAK_D_PRO,
    "oak-d-pro-small": OAK_D_PRO_SMALL,
    "velodyne-16": VELODYNE_16,
    "ouster-64": OUSTER_64,
    "tls": TLS,
}
# A real one does not look into its tripod: 300 degrees, from 60 below the horizon on one side to the same on the other.
_MOUNTED = PRESETS | {"tls": dataclasses.replace(TLS, channels=750, elevation_range=(-59.9, 89.9))}
# Most of the light goes through glass; how much comes back as a return is our estimate.
_GLASS = ((scenes.WINDOW, 0.6),)
PRESETS |= {
    f"{name}-real": dataclasses.replace(_MOUNTED[name], imperfections=dataclasses.replace(errors, class_dropout=_GLASS))
    for name, errors in _REAL.items()
}


def sensor_named(name: str | Path) -> Sensor:
    """A sensor by the name of a preset, or by the path of a TOML file.

    A preset is ideal within its range limits; with `-real` behind its name it errs as such devices do. The file says
    `kind = "pinhole"` or `kind = "spinning"` and any fields of that class; a table `imperfections` holds fields of
    Imperfections, in it a table `class_dropout` a chance for each class, by its name or number.

    Raises:
        ValueError: neither a preset nor a readable file; not TOML; an unknown key, or a value of the wrong type or out
            of range. One line that names the file and the key.
    """
    if str(name) in PRESETS:
        return PRESETS[str(name)]
    if not Path(name).is_file():
        raise ValueError(f"{name}: expected a sensor file or one of {', '.join(PRESETS)}")
    return sensor_files.read(Path(name), KINDS)


def sensor_of(table: dict[str, Any], where: str) -> Sensor:
    """A sensor from a table as sensor files hold it; `where` opens the messages of errors.

    Raises:
        ValueError: as `sensor_named`.
    """
    return sensor_files.parse(table, KINDS, where)
