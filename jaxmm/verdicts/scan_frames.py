"""In which frame the points of a scan are: the world's, the sensor's, or that of its optics.

A file may say a pose, and not whether its points are in the world or in the frame of the sensor: VIEWPOINT of PCD files
is written in both meanings. Then it is told by which of them lies on the prior, or else by what the sensor could see.

N points of a scan. World frame: the prior's, metres, z up.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.formats.cloud_frames import FRAMES, Y_UP_TO_Z_UP, carried_by_file, is_optical, of_sensor
from jaxmm.formats.poses import OPTICAL, GivenPose
from jaxmm.formats.readers import PointScan
from jaxmm.formats.units import (
    FITS,
    ON,
    Distance,
    Fit,
    fit_of,
    scale_in_words,
    thinned,
    unit_that_fits,
)
from jaxmm.inputs import InputError
from jaxmm.rays.scales import LEAST_OFF
from jaxmm.rays.scan_rays import overtaken
from jaxmm.vectors import lengths
from jaxmm.verdicts.priors import MOST_BEHIND, Prior, distance_from

LEAST = 0.2  # share of points that must lie on a prior read another way
CLEARER = 1.25  # times as many points must lie on it as on the prior as it is
ALIKE = 0.05  # share of points, by which a less likely way to read it must fit better
# So many times as many points are hidden behind others, seen from where a scan was not taken from, and so large a share
# of them more.
HIDDEN_MORE, HIDDEN_CLEARLY = 3.0, 0.03
MEANINGS = (
    "its points were taken to be in the world's frame",
    "its points were taken to be in the sensor's frame, and moved by the pose in its file",
)
SWAP_IT = "with x and y swapped, as of columns in which northings stand first"
TURN_IT = "turned from y up to z up, which scans must have, whatever --up says of the prior"


class Motion(NamedTuple):
    """A motion of points, each to linear x + shift."""

    linear: np.ndarray = np.eye(3)  # (3, 3) float64
    shift: np.ndarray = np.zeros(3)  # (3,) float64, in the unit of the points

    def of(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) float64."""
        return points if self is STILL else points @ self.linear.T + self.shift

    def then(self, other: "Motion") -> "Motion":
        """This one, and the other one after it."""
        return Motion(other.linear @ self.linear, other.linear @ self.shift + other.shift)


STILL = Motion()


class OwnScan(NamedTuple):
    """A scan with its pose, before anything is known of its unit."""

    points: np.ndarray  # (N, 3) float64 as they were read, in the file's unit; no moved copy of a large scan is held
    position: np.ndarray | None  # (3,) float64 of the sensor, [m] where it was given, else in the file's unit
    rotation: np.ndarray | None  # (3, 3) float64 sensor frame to world
    source: str  # of the pose: "given", "file", "searched", or "estimated" as long as there is none
    carried: bool  # the points are in the sensor's frame, and it is the given pose that takes them to the world
    stated: np.ndarray | None = None  # (3,) float64 of the sensor in its file, in the file's unit, if another was given
    in_world: bool = False  # it was the pose in the file that took the points to the world
    notes: tuple[str, ...] = ()  # how its pose was searched
    otherwise: "OwnScan | None" = None  # the same, moved by the pose in its file, which does not say if that is right
    motion: Motion = STILL  # of its points, in the file's unit: from the file's frame to its own
    unseen: np.ndarray | None = None  # (K, 3) float32 unit vectors, in the sensor's frame, that brought nothing back

    @property
    def thin(self) -> np.ndarray:
        """Some thousand of its points (n, 3) in its own frame, in the file's unit."""
        return self.motion.of(thinned(self.points))

    def world(self, points: np.ndarray, unit: float = 1.0) -> np.ndarray:
        """Some of its points (n, 3) as they were read [unit], in the frame that the scan is said to be in [m]."""
        points = self.motion.of(points)
        return self.carry(points if unit == 1.0 else points * unit)

    def carry(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) [m] in its own frame, in the one that it is said to be in."""
        return points @ self.rotation.T + self.position if self.carried else points

    def to(self, distance: Distance) -> Distance:
        """The distance from points in its own frame [m]."""
        return lambda points, reach: distance(self.carry(points), reach)

    def ways(self) -> tuple["OwnScan", ...]:
        """Itself, and what else it may be."""
        return (self,) if self.otherwise is None else (self, self.otherwise)


class MapGrid(NamedTuple):
    """The way back from a map grid to the frame of a building."""

    shift: np.ndarray  # (3,) float64 [m] of the frame's zero on the map
    linear: np.ndarray  # (3, 3) float64 from the map
    turn: np.ndarray  # (3, 3) float64: the rotation in it

    def back(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) [m] from the map; subtracted first, so that nothing is lost of national grids."""
        return (points - self.shift) @ self.linear.T


def map_grid(prior: Prior) -> MapGrid | None:
    """The one that a building is on; None where its file tells none."""
    if not prior.has_elements or prior.building.to_map is None:
        return None
    to_map = prior.building.to_map
    linear = np.linalg.inv(to_map[:3, :3])
    left, _, right = np.linalg.svd(linear)
    return MapGrid(to_map[:3, 3], linear, left @ right)


def own_scan(scan: PointScan, given: GivenPose | None, frame: str | None) -> OwnScan:
    """A scan in the frame that it is said to be in.

    Args:
        scan: as read.
        given: its pose, which counts more than that of the file.
        frame: "world", or "sensor" where the file's points are in the sensor's frame. Then the given pose takes them
            to the world, or else the file's own; where the reader did so already (`in_world`), that is undone for a
            given one. "optical" is the same of points whose z is forward, x right and y down; a rotation that the file
            says is then that of this frame. None: the world's, `otherwise` moved there by a pose in the file that does
            not say for which of both it is meant. A frame that the format itself tells counts more.

    Raises:
        InputError: points in the sensor's frame without any pose.
    """
    frame = scan.frame or frame
    if frame is None and is_untold(scan):
        moved = _as_seen(carried_by_file(scan._replace(points=thinned(scan.points))))._replace(points=scan.points)
        other = _own_scan(moved, given, "world", Motion(scan.rotation, scan.position))
        return _own_scan(_as_seen(scan), given, "world", STILL)._replace(otherwise=other)
    if frame == "optical":
        scan, motion = _as_sensor(scan)
        return _own_scan(scan, given, frame, motion)
    return _own_scan(scan, given, frame or "world", STILL)


def _own_scan(scan: PointScan, given: GivenPose | None, frame: str, motion: Motion) -> OwnScan:
    """As of `own_scan`: the file's points are in that frame after a motion, as the scan's pose is already."""
    if given is not None:
        given = given.seen_from(frame)
        position, rotation, source = given.position, given.rotation, "given"
    elif scan.position is not None:
        position, rotation, source = scan.position, scan.rotation, "file"
    else:
        position, rotation, source = None, None, "estimated"
    carried = False
    if frame != "world":
        if position is None:
            raise InputError("points in the sensor's frame need a pose; give it with --pose")
        carried = source == "given"
        if carried and scan.in_world:
            motion = motion.then(to_sensor(scan))
        elif not carried and not scan.in_world:
            motion = motion.then(Motion(rotation, position))
    stated, unseen = scan.position if source == "given" and frame == "world" else None, scan.unseen
    if unseen is not None and stated is not None:  # its points stay as the pose in the file has them, and so do these
        unseen = (unseen @ (scan.rotation.T @ rotation)).astype(np.float32)
    return OwnScan(
        scan.points, position, rotation, source, carried, stated, scan.in_world, motion=motion, unseen=unseen
    )  # fmt: skip


def to_sensor(scan: PointScan) -> Motion:
    """From the world to the frame of a scan's sensor, of which the file says where it is."""
    return Motion(scan.rotation.T, -scan.position @ scan.rotation)


def is_untold(scan: PointScan) -> bool:
    """Whether its file says a pose, and not whether its points are in the world or in the sensor's frame."""
    return scan.position is not None and not scan.in_world


def by_sight(points: np.ndarray, position: np.ndarray) -> tuple[int | None, str]:
    """In which frame points (N, 3) are, 0 the world's or 1 the sensor's, as what hides what tells; None: nothing tells.

    In the world they were seen from the `position` (3,) in their file, in the sensor's frame from its zero. A phrase
    says how many are hidden from there.
    """
    hidden = overtaken(points, position), overtaken(points, np.zeros(3))
    best = int(np.argmin(hidden))
    least, most = hidden[best], hidden[1 - best]
    told = f"so others hide {least:.0%} of them from the sensor, else {most:.0%}"
    clearly = least <= MOST_BEHIND and most > max(HIDDEN_MORE * least, least + HIDDEN_CLEARLY)
    return (best, told) if clearly else (None, "")


def as_it_fits(
    scan: OwnScan, distances: Sequence[Distance], unit: float | None
) -> tuple[OwnScan, tuple[str, ...], tuple[str, ...]]:
    """A scan in the one of its `ways` that is right, with notes and doubts about that.

    Args:
        scan: as its file has it, or else moved by the pose in the file.
        distances: to the prior, in each frame that the scan may be in.
        unit: [m] of its points if it is known.
    """
    if scan.otherwise is None:
        return scan, (), ()
    ways = scan.ways()
    on = [max(fit_of(one.thin, one.to(distance), unit).on for distance in distances) for one in ways]
    best = int(np.argmax(on))
    if on[best] >= LEAST and on[best] > max(CLEARER * on[1 - best], on[1 - best] + ALIKE):
        return (
            ways[best],
            (f"{MEANINGS[best]}: so {on[best]:.0%} of them lie on the prior, else {on[1 - best]:.0%}",),
            (),
        )
    seen, told = by_sight(scan.points, scan.position if scan.source == "file" else scan.stated)
    if seen is not None:
        return ways[seen], (f"{MEANINGS[seen]}: {told}; the prior does not tell",), ()
    moved = lengths(ways[1].thin - ways[0].thin) * (unit or 1.0)
    if np.median(moved) < ON:
        return scan, (f"{MEANINGS[0]}; that in its file hardly moves them",), ()
    told = f"as they are {on[0]:.0%} of them lie on the prior, moved by the pose in its file {on[1]:.0%}"
    return scan, (), (f"nothing tells in which frame its points are: {told}; they are taken as they are (--frame)",)


def frame_that_fits(
    prior: Prior,
    scan: PointScan,
    given: GivenPose | None,
    frame: str | None,
    unit: float | None,
    least: float | None = None,
) -> str:
    """How else far more of a scan would lie on the prior, from the same pose, in words; "" for not at all.

    Read otherwise, or at another size.

    Args:
        prior: what it should lie on.
        scan: as read.
        given: its pose.
        frame: as stated, see `own_scan`.
        unit: [m] of its points if it is known.
        least: share of its points that must lie on the prior then, as it is read in another frame; None: LEAST, and
            the size is asked about, too.
    """
    fits, scan = {}, scan._replace(points=thinned(scan.points))
    distance, grid = distance_from(prior), map_grid(prior)
    distances = (distance, *(() if grid is None else (lambda points, reach: distance(grid.back(points), reach),)))
    ways = own_scan(scan, given, frame).ways()
    stated = max((_fit_on(one, distances, unit) for one in ways), key=_on)
    for other in FRAMES if scan.frame is None else ():  # else the format tells it
        try:
            own = own_scan(scan, given, other)
        except InputError:  # without a pose there are no other frames
            continue
        fits[f"with --frame {other}"] = _fit_on(own, distances, unit)
    if frame in (None, "world") and scan.frame is None:
        for how, points in ((TURN_IT, scan.points @ Y_UP_TO_Z_UP), (SWAP_IT, scan.points[:, [1, 0, 2]])):
            own = own_scan(scan._replace(points=points), given, "world")
            fits[how] = _fit_on(own, distances, unit)
    if least is None:
        size = max((unit_that_fits(one.thin, one.to(way)) for one in ways for way in distances), key=_on)
        factor = size.unit / (unit or 1.0)
        others = max(fit.upright for fit in (stated, *fits.values()))
        if size.upright >= FITS and abs(factor - 1.0) > LEAST_OFF and size.upright > CLEARER * others:
            return scale_in_words(factor, unit or 1.0)
    best = max(fits, key=lambda name: fits[name].on, default="")
    shares = {name: fit.on for name, fit in fits.items()}
    if not best or shares[best] <= max(least or LEAST, 2.0 * stated.on):
        return ""
    optical = "with --frame optical"
    if best == "with --frame sensor" and shares[best] - shares[optical] < ALIKE:  # the same place in both
        own = to_sensor(scan).of(scan.points) if scan.in_world else scan.points
        return optical if is_optical(own, scan.rotation if given is None else given.rotation) else best
    return best


def _fit_on(scan: OwnScan, distances: Sequence[Distance], unit: float | None) -> Fit:
    """How a scan lies on the nearer of some priors."""
    return max((fit_of(scan.thin, scan.to(distance), unit) for distance in distances), key=_on)


def _on(fit: Fit) -> float:
    return fit.on


def _as_sensor(scan: PointScan) -> tuple[PointScan, Motion]:
    """A scan whose own frame is optical, as if it were the sensor's once a motion took its points there."""
    rotation = None if scan.rotation is None else scan.rotation @ OPTICAL.T
    # In the world only the rotation is still of that frame.
    return scan._replace(rotation=rotation, unseen=of_sensor(scan.unseen)), STILL if scan.in_world else Motion(OPTICAL)


def _as_seen(scan: PointScan) -> PointScan:
    """A scan in the world, with the pose of the sensor where that in its file may be of its optics."""
    if is_optical(to_sensor(scan).of(thinned(scan.points)), scan.rotation):
        return scan._replace(rotation=scan.rotation @ OPTICAL.T)
    return scan
