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
4. *Bias*: a weak return is timed late, so dark surfaces seem farther (Pfeifer et al. 2007, "Investigating terrestrial
   laser scanning intensity data: quality and functional relations", Optical 3-D Measurement Techniques VIII); here
   in proportion to the light that a surface keeps. On a slanting one the beam is drawn out and its farther half
   returns later: as 1 / cos(incidence) - 1, up to 80 degrees.
5. *Noise*: Gaussian, sigma(r) = a + b r + c r^2 at the range r. Time of flight has mostly a, some b; triangulation and
   stereo have c, as depth goes with the inverse of disparity (Khoshelham and Elberink 2012, Sensors 12: for the first
   Kinect c = 0.001425 / m). Where little light comes back there is more: k / sqrt(intensity) is added in squares, as
   of counted photons (Wujanz et al. 2017, "Intensity-based stochastic model for terrestrial laser scanners", ISPRS J.
   125, fit such a power to measured scans). Intensity is as in surface.intensity_of: 1 of a white surface, 1 m away.
6. *Gross errors*: the device takes something else for the return, at a range anywhere.
7. *Quantisation*: the device reports multiples of a step.
8. *Gate*: what comes out beyond the range limits is not reported.

Every draw is keyed by (seed, room, effect), so a room has the same errors whatever the batch, and switching one effect
on leaves the draws of the others as they are. R rooms, P rays.
"""

import dataclasses
from typing import Protocol

import numpy as np

from warp_scanner import draws
from warp_scanner.sensors.scan import Scan
from warp_scanner.sensors.surface import REFLECTIVITY, UNKNOWN_REFLECTIVITY

LEAST_LIGHT = 0.02  # share that the darkest surfaces send back
MOST_SLANT = 80.0  # [deg] beyond which slant adds no more; dropout goes on
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
    noise_by_light: float = 0.0  # [m] standard deviation at intensity 1, more in inverse proportion to its square root
    dark_bias: float = 0.0  # [m] by which a surface that sends back no light seems farther than a white one
    slant_bias: float = 0.0  # [m] by which a surface at 60 degrees of incidence seems farther
    reflectivity_spread: float = 0.0  # elements send back up to this share more or less light than is usual
    gross_chance: float = 0.0  # that a range is a gross error
    gross_reach: float = 10.0  # [m] up to which gross errors come, if the sensor reaches so far

    def __post_init__(self):
        lengths = (
            "noise", "noise_per_metre", "noise_per_square", "mixed_step", "mixed_angle", "quantum", "noise_by_light",
            "dark_bias", "slant_bias", "gross_reach",
        )  # fmt: skip
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
        chances |= {name: getattr(self, name) for name in ("grazing_dropout", "mixed_chance", "gross_chance")}
        chances |= {"reflectivity_spread": self.reflectivity_spread}
        for name, chance in chances.items():
            if not 0.0 <= chance <= 1.0:
                raise ValueError(f"imperfections.{name} must be a chance between 0 and 1, got {chance}")

    @property
    def noisy(self) -> bool:
        """Whether any part of the noise is there."""
        return max(self.noise, self.noise_per_metre, self.noise_per_square, self.noise_by_light) > 0.0

    @property
    def by_incidence(self) -> bool:
        """Whether the angles at which rays meet surfaces count."""
        return max(self.grazing_dropout, self.noise_by_light, self.slant_bias) > 0.0

    def sigma(self, distance: np.ndarray) -> np.ndarray:
        """Standard deviation [m] of ranges [m], in their shape and dtype, but for what is by light."""
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
        incidence: (R, P) [rad] from surface.incidence_of; None will do unless the sensor errs `by_incidence`.
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
    if errors.by_incidence and np.shape(incidence) != scan.distance.shape:
        what = "grazing dropout, and for errors by light or slant"
        raise ValueError(f"incidence must be {scan.distance.shape} for {what}, got {np.shape(incidence)}")
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
    effects = [errors.grazing_dropout, errors.mixed_chance, errors.gross_chance, errors.dark_bias, errors.slant_bias]
    effects += [errors.quantum, *(chance for _, chance in errors.class_dropout)]
    return sensor.range_limits == (0.0, np.inf) and not errors.noisy and not any(effects)


def _imperfect(scan: Scan, incidence: np.ndarray | None, sensor: RangeSensor, key: np.ndarray) -> Scan:
    errors, count = sensor.imperfections, scan.distance.shape[1]
    reached = np.where(_within(scan.distance, sensor.range_limits), scan.distance, np.float32(np.inf))
    lost = _is_lost(scan.semantic, incidence, errors, key)
    measured = _mixed(reached, sensor, key) if errors.mixed_chance > 0.0 else reached
    by_light = max(errors.noise_by_light, errors.dark_bias) > 0.0
    light = _reflectivity(scan, errors, key) if by_light else None
    if max(errors.dark_bias, errors.slant_bias) > 0.0:
        measured = measured + _bias(light, incidence, errors)
    if errors.noisy:
        # A miss has no range that the noise could go by.
        sigma = errors.sigma(np.where(np.isfinite(measured), measured, np.float32(0.0)))
        if errors.noise_by_light > 0.0:
            sigma = np.hypot(sigma, _sigma_by_light(reached, light, incidence, errors))
        measured = measured + sigma * draws.normal(key, "range noise", count)
    if errors.gross_chance > 0.0:
        measured = _with_gross_errors(measured, sensor, key)
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


def _reflectivity(scan: Scan, errors: Imperfections, key: np.ndarray) -> np.ndarray:
    """(R, P) float32 share of the light that the surface of each ray sends back; each element has its own."""
    usual = np.full(256, UNKNOWN_REFLECTIVITY, np.float32)
    usual[list(REFLECTIVITY)] = list(REFLECTIVITY.values())
    share = usual[scan.semantic]
    if errors.reflectivity_spread > 0.0:
        number = np.maximum(scan.element, 0)
        draw = draws.uniform(key, "reflectivity", int(number.max()) + 1)
        share = share * (1.0 + errors.reflectivity_spread * (2.0 * np.take_along_axis(draw, number, 1) - 1.0))
    return np.clip(share, LEAST_LIGHT, 1.0).astype(np.float32)


def _bias(light: np.ndarray | None, incidence: np.ndarray | None, errors: Imperfections) -> np.ndarray | np.float32:
    """[m] by which ranges come out too far."""
    bias = np.float32(0.0)
    if light is not None:
        bias = bias + np.float32(errors.dark_bias) * (np.float32(1.0) - light)
    if errors.slant_bias > 0.0:
        slant = 1.0 / np.cos(np.minimum(np.nan_to_num(incidence), np.radians(MOST_SLANT))) - 1.0
        bias = bias + (errors.slant_bias * slant).astype(np.float32)
    return bias


def _sigma_by_light(
    distance: np.ndarray, light: np.ndarray, incidence: np.ndarray, errors: Imperfections
) -> np.ndarray:
    """(R, P) float32 [m] the part of the noise that grows as less light comes back; 0 of misses."""
    slant = np.minimum(np.nan_to_num(incidence), np.radians(MOST_SLANT))
    intensity = light * np.cos(slant) / np.square(np.where(np.isfinite(distance), distance, np.float32(1.0)))
    with np.errstate(divide="ignore"):  # at the sensor itself there is light without end
        sigma = errors.noise_by_light / np.sqrt(intensity)
    return np.where(np.isfinite(distance), sigma, 0.0).astype(np.float32)


def _with_gross_errors(measured: np.ndarray, sensor: RangeSensor, key: np.ndarray) -> np.ndarray:
    """Ranges (R, P), some of which are anything within the sensor's reach; misses stay misses."""
    errors, count = sensor.imperfections, measured.shape[1]
    low, high = sensor.range_limits[0], min(sensor.range_limits[1], errors.gross_reach)
    anywhere = low + max(high - low, 0.0) * draws.uniform(key, "gross range", count)
    wrong = np.isfinite(measured) & (draws.uniform(key, "gross", count) < errors.gross_chance)
    return np.where(wrong, anywhere.astype(np.float32), measured)


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
