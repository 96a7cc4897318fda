"""What a real sensor does to the ranges of an ideal one.

The effects come in the order in which a measurement meets them:

1. *Reach*: a surface nearer or farther than the sensor's range limits returns nothing.
2. *Dropout*: too little light comes back. The chance grows from a stated incidence to grazing, as a rough surface sends
   back in proportion to the cosine of the incidence (Soudarissanane et al. 2011, "Scanning geometry: influencing factor
   on the quality of terrestrial laser scanning points", ISPRS J. 66); and every semantic class has a chance of its own
   (glass lets light through, dark or shiny surfaces send little back).
3. *Mixed pixels*: a beam has a width. At an edge part of it falls on the neighbour's surface, and the range comes to
   lie between the two (Hebert and Krotkov 1992, "3-D measurements from imaging laser radars: how good are they?").
   The centre of the beam is on its own surface, so the other one's share stays below one half. The ray keeps the
   element and class that its centre hit.
4. *Noise*: Gaussian, sigma(r) = a + b r + c r^2 at the range r. Time of flight has mostly a, some b; triangulation and
   stereo have c, as depth goes with the inverse of disparity (Khoshelham and Elberink 2012, Sensors 12).
5. *Quantisation*: the device reports multiples of a step.
6. *Gate*: what comes out beyond the range limits is not reported.

Every draw is keyed by (seed, room, effect), so a room has the same errors whatever the batch, and switching one effect
on leaves the draws of the others as they are. R rooms, P rays.
"""

import dataclasses
from typing import Protocol

import numpy as np

from warp_scanner import draws
from warp_scanner.sensors.scan import Scan

_RAYS_AT_ONCE = 2**17  # bounds the memory of the draws and keeps them in the cache


@dataclasses.dataclass(frozen=True)
class Imperfections:
    """How a sensor errs; the default is an ideal sensor."""

    noise: float = 0.0  # [m] the constant part of the standard deviation of a range
    noise_per_metre: float = 0.0  # the part that grows with the range
    noise_per_square: float = 0.0  # [1/m] the part that grows with its square
    grazing_dropout: float = 0.0  # chance that a ray along the surface returns nothing
    grazing_start: float = 60.0  # [deg] incidence at which that chance begins to rise from 0, linearly
    class_dropout: tuple[tuple[int, float], ...] = ()  # (semantic class, chance that a ray that hits it is lost)
    mixed_chance: float = 0.0  # that the range at an edge is a mixture
    mixed_step: float = 0.1  # [m] neighbouring ranges that differ by more are an edge
    mixed_angle: float = 1.0  # [deg] rays farther apart share no beam, so they never mix
    quantum: float = 0.0  # [m] ranges are multiples of it; 0: any

    def __post_init__(self):
        lengths = ("noise", "noise_per_metre", "noise_per_square", "mixed_step", "mixed_angle", "quantum")
        for name in lengths:
            # Written so that NaN fails too.
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f"imperfections.{name} must be at least 0 and finite, got {getattr(self, name)}")
        if self.quantum != 0.0 and not 1e-6 <= self.quantum <= 10.0:
            raise ValueError(f"imperfections.quantum must be 0 or within 1e-6 and 10 m, got {self.quantum}")
        if not 0.0 <= self.grazing_start < 90.0:
            raise ValueError(f"imperfections.grazing_start must be in [0, 90) degrees, got {self.grazing_start}")
        classes = [kind for kind, _ in self.class_dropout]
        if len(set(classes)) < len(classes) or not all(0 <= kind <= 255 for kind in classes):
            raise ValueError(f"imperfections.class_dropout must name classes of 0 to 255 once each, got {classes}")
        chances = {f"class_dropout of class {kind}": chance for kind, chance in self.class_dropout}
        chances |= {name: getattr(self, name) for name in ("grazing_dropout", "mixed_chance")}
        for name, chance in chances.items():
            if not 0.0 <= chance <= 1.0:
                raise ValueError(f"imperfections.{name} must be a chance between 0 and 1, got {chance}")

    @property
    def noisy(self) -> bool:
        """Whether any part of the noise is there."""
        return max(self.noise, self.noise_per_metre, self.noise_per_square) > 0.0

    def sigma(self, distance: np.ndarray) -> np.ndarray:
        """Standard deviation [m] of ranges [m], in their shape and dtype."""
        a, b, c = (
            np.asarray(value, distance.dtype) for value in (self.noise, self.noise_per_metre, self.noise_per_square)
        )
        return a + distance * (b + c * distance)


class RangeSensor(Protocol):
    """What has to be known of a sensor: sensors.Pinhole and sensors.Spinning know it."""

    range_limits: tuple[float, float]  # [m]
    imperfections: Imperfections
    shape: tuple[int, int]  # rows and columns of its rays
    spacing: tuple[float, float]  # [deg] largest angle between neighbouring rows, between neighbouring columns
    full_turn: bool  # the last column is next to the first


def imperfect(scan: Scan, incidence: np.ndarray | None, sensor: RangeSensor, seed: int, index: np.ndarray) -> Scan:
    """The scan as the sensor would report it; see the module for the effects and their order.

    Args:
        scan: ideal first hits, (R, P), rays in the order of the sensor's directions.
        incidence: (R, P) [rad] from surface.incidence_of; None will do unless the sensor has grazing dropout.
        sensor: its range limits and imperfections; an ideal sensor without limits returns `scan` itself.
        seed: of the draws; with `index` it fixes every error. Two scans of a room err alike unless their seeds differ.
        index: (R,) room numbers.

    Returns:
        A scan of the same shape. A lost ray is a miss: (inf, -1, 0).

    Raises:
        ValueError: the shapes disagree, or incidence is needed and missing.
    """
    errors = sensor.imperfections
    room_count, ray_count = scan.distance.shape
    if ray_count != sensor.shape[0] * sensor.shape[1]:
        raise ValueError(f"scan must have the sensor's {sensor.shape[0]} x {sensor.shape[1]} rays, got {ray_count}")
    if np.shape(index) != (room_count,):
        raise ValueError(f"index must be ({room_count},), one for each room, got {np.shape(index)}")
    if errors.grazing_dropout > 0.0 and np.shape(incidence) != scan.distance.shape:
        raise ValueError(f"incidence must be {scan.distance.shape} for grazing dropout, got {np.shape(incidence)}")
    if _is_ideal(sensor) or scan.distance.size == 0:
        return scan
    size = max(1, _RAYS_AT_ONCE // ray_count)
    parts = []
    for start in range(0, room_count, size):
        rooms = slice(start, start + size)
        angles = None if incidence is None else incidence[rooms]
        key = draws.keys(seed, np.asarray(index)[rooms])
        parts.append(_imperfect(scan._replace(**{k: v[rooms] for k, v in scan._asdict().items()}), angles, sensor, key))
    return Scan(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def _is_ideal(sensor: RangeSensor) -> bool:
    errors = sensor.imperfections
    chances = [errors.grazing_dropout, errors.mixed_chance, *(chance for _, chance in errors.class_dropout)]
    return sensor.range_limits == (0.0, np.inf) and not errors.noisy and not any(chances) and errors.quantum == 0.0


def _imperfect(scan: Scan, incidence: np.ndarray | None, sensor: RangeSensor, key: np.ndarray) -> Scan:
    errors, count = sensor.imperfections, scan.distance.shape[1]
    reached = np.where(_within(scan.distance, sensor.range_limits), scan.distance, np.float32(np.inf))
    lost = _is_lost(scan.semantic, incidence, errors, key)
    measured = _mixed(reached, sensor, key) if errors.mixed_chance > 0.0 else reached
    if errors.noisy:
        # A miss has no range that the noise could go by.
        sigma = errors.sigma(np.where(np.isfinite(measured), measured, np.float32(0.0)))
        measured = measured + sigma * draws.normal(key, "range noise", count)
    if errors.quantum > 0.0:
        # In double precision, so that what is stored is the multiple itself, rounded once.
        measured = (np.round(measured.astype(np.float64) / errors.quantum) * errors.quantum).astype(np.float32)
    gone = lost | ~_within(measured, sensor.range_limits)
    return Scan(
        np.where(gone, np.float32(np.inf), measured),
        np.where(gone, np.int32(-1), scan.element),
        np.where(gone, np.uint8(0), scan.semantic),
    )


def _within(distance: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    low, high = np.float32(limits)
    return (distance >= low) & (distance <= high) & np.isfinite(distance)


def _is_lost(semantic: np.ndarray, incidence: np.ndarray | None, errors: Imperfections, key: np.ndarray) -> np.ndarray:
    """(R, P) bool: too little light comes back."""
    chance_of_class = np.zeros(256, np.float32)
    for kind, chance in errors.class_dropout:
        chance_of_class[kind] = chance
    if not np.any(chance_of_class) and errors.grazing_dropout == 0.0:
        return np.zeros(semantic.shape, bool)
    kept = 1.0 - chance_of_class[semantic]
    if errors.grazing_dropout > 0.0:
        start = np.radians(errors.grazing_start)
        steepness = np.clip((np.nan_to_num(incidence) - start) / (np.pi / 2 - start), 0.0, 1.0)
        kept = kept * (1.0 - errors.grazing_dropout * steepness)
    return draws.uniform(key, "dropout", semantic.shape[1]) >= kept


def _mixed(distance: np.ndarray, sensor: RangeSensor, key: np.ndarray) -> np.ndarray:
    """Ranges (R, P), some of those at edges moved towards the neighbour that differs most."""
    errors, count = sensor.imperfections, distance.shape[1]
    image = distance.reshape(-1, *sensor.shape)
    there = np.isfinite(image)
    image = np.where(there, image, np.float32(0.0))
    step = np.zeros_like(image)  # from the own range to that of the neighbour that differs most
    for axis, spacing in ((1, sensor.spacing[0]), (2, sensor.spacing[1])):
        if spacing > errors.mixed_angle:
            continue
        for shift in (1, -1):
            difference = np.roll(image, shift, axis) - image
            valid = there & np.roll(there, shift, axis)
            if axis == 1 or not sensor.full_turn:
                # What was rolled in from the other end is no neighbour.
                np.moveaxis(valid, axis, 0)[0 if shift == 1 else -1] = False
            step = np.where(valid & (np.abs(difference) > np.abs(step)), difference, step)
    step = step.reshape(distance.shape)
    mixes = (np.abs(step) > errors.mixed_step) & (draws.uniform(key, "mixed", count) < errors.mixed_chance)
    share = 0.5 * draws.uniform(key, "mixed share", count).astype(np.float32)
    return np.where(mixes, distance + share * step, distance)
