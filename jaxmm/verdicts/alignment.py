"""How scans and prior come to lie on each other: frames, units, axes and map grids.

What nobody said is told by trying, and said: a scan lies on the prior one way, and no other way as well.

N points of a scan. World frame: the prior's, metres, z up.
"""

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from jaxmm.formats.cloud_frames import FRAMES, Y_UP_TO_Z_UP, is_before
from jaxmm.formats.poses import OPTICAL
from jaxmm.formats.raw_scans import IN_CACHE
from jaxmm.formats.units import LEAST_OVERLAP, NEAR, ON, TALLEST, UNITS, Distance, fit_of, height, thinned
from jaxmm.inputs import InputError, Misfit
from jaxmm.verdicts.placement import FAR_SHIFT
from jaxmm.verdicts.priors import Y_UP, Prior, distance_from, read_prior
from jaxmm.verdicts.scan_frames import ALIKE, CLEARER, LEAST, MEANINGS, MapGrid, OwnScan, as_it_fits, by_sight, map_grid
from warp_scanner.buildings.model_files import Model
from warp_scanner.launches import share_out, thread_count
from warp_scanner.lengths import length_in_words

SURE = 0.8  # share of points on the prior, from which no other way to read it is tried
ON_A_MAP, TALL_ROOM = 5000.0, 50.0  # [m] a scan so far away is on a map grid; so high, it is in a small unit
FAR_FROM_FILE = 0.5  # [m] from which on a given pose contradicts that of the file
OF_OPTICS = "in an optical frame (x right, y down, z forward)"
LYING = f"prior and scan lie before the z axis, as {OF_OPTICS}: if so, give --prior-frame optical and --frame optical"
ON_GRID = "it lies on the map grid that the prior's IfcMapConversion leads to, and was moved into the prior's own frame"
CHECK = (
    "check that both are in one frame (--frame, --prior-frame), and their units (--unit, --prior-unit) and axes (--up)"
)
SPANS = 100.0  # spans of a scan that it lies away, from which on no unit explains it
EVERY = 100  # points, of which one tells the middle of all
STOREY = 3.0  # [m] about as high as scans are
# So many times as high as a whole prior no scan of it is, unless it lies on the scan with so large a share of itself:
# read in too small a unit, a prior is near all of a scan, and most of it hangs in the air.
HIGHER, MET = 2.0, 0.5
AT_ONCE = 32 * IN_CACHE  # points of one thread
MOST_MET = 100_000  # points of a scan that a prior may lie on


class LaidScan(NamedTuple):
    """A scan where it lies on the prior, or is believed to."""

    own: np.ndarray  # (N, 3) float64 points as they were read, in the file's frame and unit
    way: Callable[[np.ndarray], np.ndarray]  # takes some of them (n, 3) to the world [m]
    pose: tuple[np.ndarray, np.ndarray] | None  # position (3,) [m] and rotation (3, 3); None: to be estimated
    source: str
    notes: tuple[str, ...]  # what was told by trying
    doubts: tuple[str, ...] = ()  # that its pose contradicts its file
    unseen: np.ndarray | None = None  # (K, 3) float32 unit vectors, in the sensor's frame, that brought nothing back
    unit: float = 1.0  # [m] of the file's points

    @property
    def points(self) -> np.ndarray:
        """(N, 3) float64 [m] world."""
        return self.way(self.own)

    def offsets(self, origin: np.ndarray) -> np.ndarray:
        """(N, 3) float32 [m] from an origin (3,) in the world, block by block: of a large scan no copies are held."""
        found = np.zeros(self.own.shape, np.float32)

        def move(first: int, size: int) -> None:
            for start in range(first, first + size, IN_CACHE):
                block = slice(start, min(start + IN_CACHE, first + size))
                found[block] = self.way(self.own[block]) - origin

        share_out(move, len(found), thread_count(None), AT_ONCE)
        return found


def lay(prior: Prior, scan: OwnScan, unit: float | None) -> LaidScan:
    """A scan in metres, in the prior's frame: as it is, or back from the map grid if it lies on the prior only then.

    If its file says a pose and not what that is of, it is told here.

    Args:
        prior: what it lies on.
        scan: in its own frame and unit.
        unit: [m] if it is known.

    Raises:
        InputError: it does not lie on the prior, in no unit.
    """
    grid, distance, on_map = map_grid(prior), distance_from(prior), False
    on_grid = None if grid is None else lambda points, reach: distance(grid.back(points), reach)
    untold = scan.otherwise is not None
    scan, meant, doubts = as_it_fits(scan, [distance] if on_grid is None else [distance, on_grid], unit)
    fit = fit_of(scan.thin, scan.to(distance), unit)
    if fit.share < LEAST_OVERLAP and grid is not None:
        mapped = fit_of(scan.thin, scan.to(on_grid), unit)
        fit, on_map = (mapped, True) if mapped.share >= LEAST_OVERLAP else (fit, False)
    if fit.share < LEAST_OVERLAP and unit is None:
        raise Misfit(
            f"expected a scan of the prior's place, got {fit.share:.1%} of its points within {NEAR:g} m of it"
            + (", moved there by the pose in its file or not; " if untold else "; ")
            + _elsewhere(prior, scan, grid)
        )
    own, some = scan.points, scan.world(scan.points[::EVERY], fit.unit)
    way = _way(scan, fit.unit)
    position = scan.position * fit.unit if scan.source == "file" else scan.position
    pose = None if position is None else (position, scan.rotation)
    notes = (f"it fits the prior in {UNITS[fit.unit]}, and was read so",) if unit is None and fit.unit != 1.0 else ()
    notes = (*meant, *notes)
    if prior.optical and _looks_along_z(some, position):
        doubts = (*doubts, LYING)
    stated = None if scan.stated is None else (grid.back if on_map else np.asarray)(scan.stated * fit.unit)
    if on_map:
        if pose is not None and (scan.source == "file" or _nearer(position, some, grid.back(some))):
            pose = grid.back(position), grid.turn @ scan.rotation
        way, notes = (lambda points, before=way: grid.back(before(points))), (*notes, ON_GRID)
    return _compared(LaidScan(own, way, pose, scan.source, notes, doubts, scan.unseen, fit.unit), stated, scan.in_world)


def _looks_along_z(points: np.ndarray, position: np.ndarray | None) -> bool:
    """Whether all points (n, 3) of a scan lie before the z axis at its place (3,); None: at zero."""
    before_x, before_z = is_before(points if position is None else points - position)
    return before_z and not before_x


def _way(scan: OwnScan, unit: float) -> Callable[[np.ndarray], np.ndarray]:
    """Takes points of a scan (n, 3) as they were read, in a unit [m], to the frame that it is said to be in."""
    return lambda points: scan.world(points, unit)


def _elsewhere(prior: Prior, scan: OwnScan, grid: MapGrid | None) -> str:
    """What to do about a scan that lies nowhere on the prior: one that is far away may be on a map grid."""
    places = _places(prior)
    points = scan.carry(scan.thin)
    away = float(np.abs(np.median(points, axis=0) - prior.origin - np.median(places, axis=0)).max())
    tall = height(points) > TALL_ROOM
    # In millimetres a room is tall and far away, but no further than some times its own span.
    untold = (points,) if prior.file is not None and prior.file.kind == "ifc" else (points, places)
    small = any(height(some) > TALL_ROOM and away < SPANS * np.ptp(some, axis=0).max() for some in untold)
    if away < ON_A_MAP or small:
        return CHECK
    why = ""
    if prior.file is not None and prior.file.kind == "ifc":
        leads = "" if grid is None else ", ".join(f"{value:.2f}" for value in grid.shift)
        why = "; the prior has no IfcMapConversion" if grid is None else f"; its IfcMapConversion leads to {leads} m"
    high = f"; it is {length_in_words(height(points))} high: check its unit (--unit), too" if tall else ""
    return f"it is {length_in_words(away)} away, as on a map grid: bring both into one frame{why}{high}"


def _compared(laid: LaidScan, stated: np.ndarray | None, in_world: bool) -> LaidScan:
    """With what is to be said of a given pose that is far from the place (3,) [m] that the scan's file states.

    It is in doubt where the file's took the points to where they are, and is very far; else one of both may be a
    little off, or the file's be a mere remark. How both are turned is not compared: scanners look around, and users
    give them any yaw.
    """
    off = 0.0 if stated is None else float(np.linalg.norm(laid.pose[0] - stated))
    if off <= FAR_SHIFT:
        return laid
    if off <= FAR_FROM_FILE:
        return laid._replace(notes=(*laid.notes, f"the file's own pose is {length_in_words(off)} from the given one"))
    told = f"its pose as given is {length_in_words(off)} from the one in its file"
    return laid._replace(doubts=(*laid.doubts, told)) if in_world else laid._replace(notes=(*laid.notes, told))


def fitting_prior(path: Path | Model, options: Any, scans: list[OwnScan], unit: float | None) -> Prior:
    """The prior; of a mesh or cloud whose axes and unit nobody told, the way to read it in which the scans lie on it.

    Args:
        path: its file, or the files of a model.
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
    rise = min(height(scan.thin) for scan in scans)
    # Only the ratio of both units shows in how they fit; a scan as high as a mountain has that of the prior.
    tall = unit is None and options.unit == 1.0 and rise > TALLEST
    as_it_is = max(_share_on(scans, distance, known) for known in (UNITS if tall else (unit,)))
    if prior.untold is not None:
        prior, was = _told_by_sight(path, options, prior, scans, as_it_is, unit), prior
        if prior is not was:
            return prior
    if as_it_is >= SURE:
        return prior
    units = [(1.0, unit)]  # of the prior, and of the scans
    if tall:  # exact ones fit in every unit alike: the likeliest first
        units = [(one, one) for one in sorted(UNITS, key=lambda one: abs(np.log(rise * one / STOREY)))]
    elif options.unit == 1.0:
        units += [(one, unit or 1.0) for one in UNITS]
    best, factor, how = as_it_is, 1.0, _Way(options)
    for other in _ways(path, options, prior):
        for length, known in units:
            on = _share_on(scans, _read_as(distance, other, length), known)
            if on <= best + ALIKE:
                continue
            low = known is not None and rise * known > HIGHER * length * _height_of(prior, other)
            if low and _share_met(prior, other, length, scans, known) < MET:
                continue
            best, factor, how = on, length, other
    if best < max(LEAST_OVERLAP if tall else LEAST, CLEARER * as_it_is):
        return prior
    notes = []
    if how.options.y_up != options.y_up:
        up = "y" if how.options.y_up else "z"
        notes.append(f"{path.name} fits the scans with {up} up, and was read that way; --up says which axis it is")
    if how.options.frame != options.frame:
        notes.append(
            f"{path.name}: {MEANINGS[1]}: so {best:.0%} of the scans lies on it, else {as_it_is:.0%}"
            if how.options.frame == "sensor"
            else f"{path.name} fits the scans {OF_OPTICS}, and was read so; --prior-frame says its frame"
        )
    if factor != 1.0:
        notes.append(f"{path.name} fits the scans in {UNITS[factor]}, and was read so; --prior-unit says its unit")
    read = read_prior(path, dataclasses.replace(how.options, unit=options.unit * factor))
    return read._replace(notes=(*read.notes, *notes))


def prior_frame_that_fits(path: Path | Model, options: Any, scans: list[OwnScan], unit: float | None) -> str:
    """In which other frame than the stated one scans lie on a cloud that is a prior, in words; "" for none.

    Args:
        path: its file.
        options: buildings.ReadOptions, as it was read, with the frame stated.
        scans: at least one, that do not fit it.
        unit: [m] of the scans if it is known.
    """
    shares = {}
    for frame in FRAMES:
        try:
            other = read_prior(path, dataclasses.replace(options, frame=frame))
        except InputError:  # its file tells another
            continue
        shares[frame] = _share_on(scans, distance_from(other), unit)
    best = max(shares, key=shares.get)
    return f"with --prior-frame {best}" if shares[best] > max(LEAST, 2.0 * shares[options.frame]) else ""


class _Way(NamedTuple):
    """A way to read a prior, and how points (N, 3) go from there to where they are as it was read."""

    options: Any  # buildings.ReadOptions
    turn: np.ndarray = np.eye(3)  # of rows, after the shift
    shift: np.ndarray = np.zeros(3)  # [m] taken off before


def _places(prior: Prior) -> np.ndarray:
    """(n, 3) [m] offsets of its points, or of its corners."""
    return prior.cloud if prior.building is None else prior.building.triangles.vertices


def _height_of(prior: Prior, way: _Way) -> float:
    """[m] of a prior from its lowest to its highest point, were it read that way."""
    places = _places(prior)
    return float(np.ptp(places @ way.turn.T[:, 2])) if len(places) else 0.0


def _share_met(prior: Prior, way: _Way, length: float, scans: list[OwnScan], unit: float) -> float:
    """Share of a prior that lies on points of scans, which are in a unit [m], were it read another way."""
    some = [scan.points[:: max(1, len(scan.points) // MOST_MET)] for scan in scans]
    tree = cKDTree(np.concatenate([scan.world(points, unit) for scan, points in zip(scans, some, strict=True)]))
    places = (thinned(_places(prior)) + prior.origin) @ way.turn.T + way.shift
    return float(np.mean(tree.query(places * length, distance_upper_bound=ON)[0] <= ON))


def _ways(path: Path | Model, options: Any, prior: Prior) -> Iterator[_Way]:
    """As it was read, then with the other axis up, then of optics, or moved by a pose in its file that may be meant so.

    What was told of it is left as it is.
    """
    yield _Way(options)
    if options.y_up is None and options.frame != "optical":
        y_up = path.suffix.lower() not in Y_UP
        yield _Way(dataclasses.replace(options, y_up=y_up), Y_UP_TO_Z_UP.T if y_up else Y_UP_TO_Z_UP)
    if prior.untold is not None:
        yield _carried(options, prior)
    elif prior.frameless and options.y_up is None:
        yield _Way(dataclasses.replace(options, frame="optical"), OPTICAL)


def _carried(options: Any, prior: Prior) -> _Way:
    upright = Y_UP_TO_Z_UP if options.y_up else np.eye(3)  # so its points were turned as if they were of the world
    return _Way(dataclasses.replace(options, frame="sensor"), prior.untold[1] @ upright, prior.untold[0])


def _told_by_sight(
    path: Path | Model, options: Any, prior: Prior, scans: list[OwnScan], as_it_is: float, unit: float | None
) -> Prior:
    """A cloud on which the scans lie alike whether the pose in its file moves it or not, in the way that it was seen.

    So it is of clouds of one sensor that does not move: they lie on each other either way, but may be on their side.
    """
    way = _carried(options, prior)
    on = _share_on(scans, _read_as(distance_from(prior), way, 1.0), unit)
    if min(on, as_it_is) < SURE or abs(on - as_it_is) > ALIKE:
        return prior
    seen, told = by_sight(prior.cloud.astype(np.float64) + prior.origin, prior.untold[0])
    if seen == 1:
        prior = read_prior(path, way.options)
    told = f"{MEANINGS[seen or 0]}: {told or 'nothing tells whether the pose in its file should move them'}"
    return prior._replace(notes=(*prior.notes, f"{path.name}: {told}"))


def _read_as(distance: Distance, way: _Way, length: float) -> Distance:
    """The distance to a prior, were it read another way: moved, and with a unit `length` times as long.

    Nothing is read for it: the scan is taken to where it would lie on the prior as it was read.
    """
    return lambda points, reach: distance((points / length - way.shift) @ way.turn, reach / length) * length


def _share_on(scans: list[OwnScan], distance: Distance, unit: float | None) -> float:
    """Share of points on the prior, over all scans alike, each in the unit that it fits in best."""
    shares = [max(fit_of(one.thin, one.to(distance), unit).on for one in scan.ways()) for scan in scans]
    return float(np.mean(shares))


def _nearer(position: np.ndarray, points: np.ndarray, others: np.ndarray) -> bool:
    """Whether a position is nearer to the middle of some points (N, 3) than to that of others."""
    near, far = (np.linalg.norm(position - np.median(some, axis=0)) for some in (points, others))
    return bool(near < far)
