"""How scans and prior come to lie on each other: frames, units, axes and map grids.

What nobody said is told by trying, and said: a scan lies on the prior one way, and no other way as well.

N points of a scan. World frame: the prior's, metres, z up.
"""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmm.formats.poses import OPTICAL, GivenPose
from jaxmm.formats.readers import PointScan
from jaxmm.formats.units import LEAST_OVERLAP, NEAR, TALLEST, UNITS, Distance, fit_of, height, thinned
from jaxmm.inputs import InputError, Misfit
from jaxmm.verdicts.priors import Prior, distance_from, read_prior

FRAMES = ("world", "sensor", "optical")
SURE = 0.8  # share of points on the prior, from which no other way to read it is tried
ON_A_MAP, TALL_ROOM = 5000.0, 50.0  # [m] a scan so far away is on a map grid; so high, it is in a small unit
FAR_FROM_FILE = 0.5  # [m] a given pose may be from that of the file, and nothing is said
ON_GRID = "it lies on the map grid that the prior's IfcMapConversion leads to, and was moved into the prior's own frame"
LEAST = 0.2  # share of points that must lie on a prior read another way
CLEARER = 1.25  # times as many points must lie on it as on the prior as it is
STOREY = 3.0  # [m] about as high as scans are
ALIKE = 0.05  # share of points, by which a less likely way to read it must fit better
Y_UP = (".glb", ".gltf")  # by their standard
Y_UP_TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # of rows


class OwnScan(NamedTuple):
    """A scan with its pose, before anything is known of its unit."""

    points: np.ndarray  # (N, 3) float64, in the file's unit
    position: np.ndarray | None  # (3,) float64 of the sensor, [m] where it was given, else in the file's unit
    rotation: np.ndarray | None  # (3, 3) float64 sensor frame to world
    source: str  # of the pose: "given", "file", "searched", or "estimated" as long as there is none
    carried: bool  # the points are in the sensor's frame, and it is the given pose that takes them to the world
    stated: np.ndarray | None = None  # (3,) float64 of the sensor in its file, in the file's unit, if another was given
    in_world: bool = False  # it was the pose in the file that took the points to the world
    notes: tuple[str, ...] = ()  # how its pose was searched

    def world(self, points: np.ndarray) -> np.ndarray:
        """Some of its points (n, 3) [m], in the frame that the scan is said to be in."""
        return points @ self.rotation.T + self.position if self.carried else points


class LaidScan(NamedTuple):
    """A scan where it lies on the prior, or is believed to."""

    points: np.ndarray  # (N, 3) float64 [m] world
    pose: tuple[np.ndarray, np.ndarray] | None  # position (3,) [m] and rotation (3, 3); None: to be estimated
    source: str
    notes: tuple[str, ...]  # what was told by trying
    doubts: tuple[str, ...] = ()  # that its pose contradicts its file


class MapGrid(NamedTuple):
    """The way back from a map grid to the frame of a building."""

    shift: np.ndarray  # (3,) float64 [m] of the frame's zero on the map
    linear: np.ndarray  # (3, 3) float64 from the map
    turn: np.ndarray  # (3, 3) float64: the rotation in it

    def back(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) [m] from the map; subtracted first, so that nothing is lost of national grids."""
        return (points - self.shift) @ self.linear.T


def own_scan(scan: PointScan, given: GivenPose | None, frame: str) -> OwnScan:
    """A scan in the frame that it is said to be in.

    Args:
        scan: as read.
        given: its pose, which counts more than that of the file.
        frame: "world", or "sensor" where the file's points are in the sensor's frame. Then the given pose takes them
            to the world, or else the file's own; where the reader did so already (`in_world`), that is undone for a
            given one. "optical" is the same of points whose z is forward, x right and y down; a rotation that the file
            says is then that of this frame.

    Raises:
        InputError: points in the sensor's frame without any pose.
    """
    if frame == "optical":
        scan = _as_sensor(scan)
    if given is not None:
        given = given.seen_from(frame)
        position, rotation, source = given.position, given.rotation, "given"
    elif scan.position is not None:
        position, rotation, source = scan.position, scan.rotation, "file"
    else:
        position, rotation, source = None, None, "estimated"
    points, carried = scan.points, False
    if frame != "world":
        if position is None:
            raise InputError("points in the sensor's frame need a pose; give it with --pose")
        if source == "given":
            points, carried = (points - scan.position) @ scan.rotation if scan.in_world else points, True
        elif not scan.in_world:
            points = points @ rotation.T + position
    stated = scan.position if source == "given" and frame == "world" else None
    return OwnScan(points, position, rotation, source, carried, stated, scan.in_world)


def frame_that_fits(prior: Prior, scan: PointScan, given: GivenPose | None, frame: str, unit: float | None) -> str:
    """Another frame than `frame` in which far more of a scan lies on the prior, from the same pose; "" for none."""
    shares, distance = {}, distance_from(prior)
    for other in FRAMES:
        try:
            own = own_scan(scan, given, other)
        except InputError:  # without a pose there are no other frames
            return ""
        shares[other] = fit_of(own.points, _from_scan(own, distance), unit).on
    best = max(shares, key=shares.get)
    return best if best != frame and shares[best] > max(LEAST, 2.0 * shares[frame]) else ""


def _as_sensor(scan: PointScan) -> PointScan:
    """A scan whose own frame is optical, as if it were the sensor's."""
    if scan.in_world:  # only the rotation is still of that frame
        return scan._replace(rotation=scan.rotation @ OPTICAL.T)
    rotation = None if scan.rotation is None else scan.rotation @ OPTICAL.T
    return scan._replace(points=scan.points @ OPTICAL.T, rotation=rotation)


def lay(prior: Prior, scan: OwnScan, unit: float | None) -> LaidScan:
    """A scan in metres, in the prior's frame: as it is, or back from the map grid if it lies on the prior only then.

    Args:
        prior: what it lies on.
        scan: in its own frame and unit.
        unit: [m] if it is known.

    Raises:
        InputError: it does not lie on the prior, in no unit.
    """
    grid, distance, on_map = _map_grid(prior), distance_from(prior), False
    fit = fit_of(scan.points, _from_scan(scan, distance), unit)
    if fit.share < LEAST_OVERLAP and grid is not None:
        mapped = fit_of(scan.points, _from_scan(scan, distance, grid), unit)
        fit, on_map = (mapped, True) if mapped.share >= LEAST_OVERLAP else (fit, False)
    if fit.share < LEAST_OVERLAP and unit is None:
        raise Misfit(
            f"expected a scan of the prior's place, got {fit.share:.1%} of its points within {NEAR:g} m of it; "
            + _elsewhere(prior, scan, grid)
        )
    points = scan.world(scan.points * fit.unit)
    position = scan.position * fit.unit if scan.source == "file" else scan.position
    pose = None if position is None else (position, scan.rotation)
    notes = (f"it fits the prior in {UNITS[fit.unit]}, and was read so",) if unit is None and fit.unit != 1.0 else ()
    stated = None if scan.stated is None else (grid.back if on_map else np.asarray)(scan.stated * fit.unit)
    if on_map:
        moved = grid.back(points)
        if pose is not None and (scan.source == "file" or _nearer(position, points, moved)):
            pose = grid.back(position), grid.turn @ scan.rotation
        points, notes = moved, (*notes, ON_GRID)
    return _compared(LaidScan(points, pose, scan.source, notes), stated, scan.in_world)


def _elsewhere(prior: Prior, scan: OwnScan, grid: MapGrid | None) -> str:
    """What to do about a scan that lies nowhere on the prior: one that is far away may be on a map grid."""
    places = prior.cloud if prior.building is None else prior.building.triangles.vertices
    points = scan.world(thinned(scan.points))
    away = float(np.abs(np.median(points, axis=0) - prior.origin - np.median(places, axis=0)).max())
    if away < ON_A_MAP or height(points) > TALL_ROOM:
        return "check that both are in one frame (--frame), and their units (--unit, --prior-unit) and axes (--up)"
    why = ""
    if prior.file is not None and prior.file.kind == "ifc":
        leads = "" if grid is None else ", ".join(f"{value:.2f}" for value in grid.shift)
        why = "; the prior has no IfcMapConversion" if grid is None else f"; its IfcMapConversion leads to {leads} m"
    return f"it is {away:.0f} m away, as on a map grid: bring both into one frame{why}"


def _compared(laid: LaidScan, stated: np.ndarray | None, in_world: bool) -> LaidScan:
    """With what is to be said of a given pose that is far from the place (3,) [m] that the scan's file states.

    It is in doubt where the file's took the points to where they are; else the file's may be a mere remark.
    """
    off = 0.0 if stated is None else float(np.linalg.norm(laid.pose[0] - stated))
    if off <= FAR_FROM_FILE:
        return laid
    told = f"its pose as given is {off:.1f} m from the one in its file"
    return laid._replace(doubts=(told,)) if in_world else laid._replace(notes=(*laid.notes, told))


def fitting_prior(path: Path, options: Any, scans: list[OwnScan], unit: float | None) -> Prior:
    """The prior; of a mesh or cloud whose axes and unit nobody told, the way to read it in which the scans lie on it.

    Args:
        path: its file.
        options: buildings.ReadOptions, how to read it; a unit of 1 counts as untold.
        scans: all whose pose is not to be searched; without any it is read as told.
        unit: [m] of the scans if it is known.

    Raises:
        InputError: the file cannot be used.
    """
    prior = read_prior(path, options)
    if prior.file.kind == "ifc" or not scans:
        return prior
    distance = distance_from(prior)
    rise = min(height(scan.points) for scan in scans)
    # Only the ratio of both units shows in how they fit; a scan as high as a mountain has that of the prior.
    tall = unit is None and options.unit == 1.0 and rise > TALLEST
    as_it_is = max(_share_on(scans, distance, known) for known in (UNITS if tall else (unit,)))
    if as_it_is >= SURE:
        return prior
    units = [(1.0, unit)]  # of the prior, and of the scans
    if tall:  # exact ones fit in every unit alike: the likeliest first
        units = [(one, one) for one in sorted(UNITS, key=lambda one: abs(np.log(rise * one / STOREY)))]
    elif options.unit == 1.0:
        units += [(one, unit or 1.0) for one in UNITS]
    best, factor, how = as_it_is, 1.0, options
    for other, back in _ways_up(path, options, prior):
        for length, known in units:
            on = _share_on(scans, _read_as(distance, back, length), known)
            if on > best + ALIKE:
                best, factor, how = on, length, other
    if best < max(LEAST_OVERLAP if tall else LEAST, CLEARER * as_it_is):
        return prior
    notes = []
    if how.y_up != options.y_up:
        up = "y" if how.y_up else "z"
        notes.append(f"{path.name} fits the scans with {up} up, and was read that way; --up says which axis it is")
    if factor != 1.0:
        notes.append(f"{path.name} fits the scans in {UNITS[factor]}, and was read so; --prior-unit says its unit")
    read = read_prior(path, dataclasses.replace(how, unit=options.unit * factor))
    return read._replace(notes=(*read.notes, *notes))


def _ways_up(path: Path, options: Any, prior: Prior) -> Iterator[tuple[Any, np.ndarray]]:
    """How to read a prior, and the turn (3, 3) from there to how it was read: as it is, then with the other axis up."""
    yield options, np.eye(3)
    if prior.file.kind == "mesh" and options.y_up is None:
        y_up = path.suffix.lower() not in Y_UP
        yield dataclasses.replace(options, y_up=y_up), Y_UP_TO_Z_UP.T if y_up else Y_UP_TO_Z_UP


def _read_as(distance: Distance, back: np.ndarray, length: float) -> Distance:
    """The distance to a prior, were it read another way: turned, and with a unit `length` times as long.

    Nothing is read for it: the scan is taken to where it would lie on the prior as it was read.
    """
    return lambda points, reach: distance(points @ back / length, reach / length) * length


def _share_on(scans: list[OwnScan], distance: Distance, unit: float | None) -> float:
    """Share of points on the prior, over all scans alike, each in the unit that it fits in best."""
    return float(np.mean([fit_of(scan.points, _from_scan(scan, distance), unit).on for scan in scans]))


def _from_scan(scan: OwnScan, distance: Distance, grid: MapGrid | None = None) -> Distance:
    """The distance from a scan's own points [m]."""
    if grid is None:
        return lambda points, reach: distance(scan.world(points), reach)
    return lambda points, reach: distance(grid.back(scan.world(points)), reach)


def _map_grid(prior: Prior) -> MapGrid | None:
    if not prior.has_elements or prior.building.to_map is None:
        return None
    to_map = prior.building.to_map
    linear = np.linalg.inv(to_map[:3, :3])
    left, _, right = np.linalg.svd(linear)
    return MapGrid(to_map[:3, 3], linear, left @ right)


def _nearer(position: np.ndarray, points: np.ndarray, others: np.ndarray) -> bool:
    """Whether a position is nearer to the middle of some points (N, 3) than to that of others."""
    near, far = (np.linalg.norm(position - np.median(some[::100], axis=0)) for some in (points, others))
    return bool(near < far)
