"""Scans whose pose is searched in the building: from a file's points, in whatever frame, to a scan in its place.

N points of a scan.
"""

import numpy as np

from jaxmm.formats.cloud_frames import of_sensor
from jaxmm.formats.poses import OPTICAL
from jaxmm.formats.readers import PointScan
from jaxmm.formats.units import UNITS, height
from jaxmm.inputs import Misfit
from jaxmm.rays.scan_rays import even_draw
from jaxmm.verdicts.alignment import STOREY, TALL_ROOM
from jaxmm.verdicts.pose_search import search
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.scan_frames import FRAMES, MEANINGS, STILL, Motion, OwnScan, by_sight, is_untold, to_sensor


def searched_scan(prior: Prior, scan: PointScan, frame: str | None, unit: float | None) -> OwnScan:
    """A scan at the only place in the building that it fits; its own frame is then the sensor's, in metres.

    Args:
        prior: of elements.
        scan: as read; a pose in its file only tells where its zero and axes are.
        frame: "optical" where z is forward, x right and y down in the file; else the sensor's, of which z is up.
            None: where the file says a pose and not what it is of, what hides what tells, or else which of both fits.
        unit: [m] of its points; None: metres, or what a scan higher than any room is likeliest in.

    Raises:
        Misfit: it fits none, or several, which the line names.
    """
    if frame is not None or not is_untold(scan):
        return _searched(prior, scan, frame or "world", unit)
    seen, told = by_sight(scan.points, scan.position)
    if seen is not None:
        found = _searched(prior, scan, FRAMES[seen], unit)
        return found._replace(notes=(f"{MEANINGS[seen]}: {told}", *found.notes))
    found, why = {}, []
    for way, either in enumerate(FRAMES[:2]):
        try:
            found[way] = _searched(prior, scan, either, unit)
        except Misfit as error:
            why.append(error)
    if not found:
        raise why[0]
    if len(found) > 1:
        raise Misfit(
            "--pose search: nothing tells whether its points are in the world's frame or in the sensor's, as its file "
            "says a pose and it fits a place either way; give --frame world or --frame sensor"
        )
    ((way, only),) = found.items()
    return only._replace(notes=(f"{MEANINGS[way]}: so it fits a place, else none", *only.notes))


def _searched(prior: Prior, scan: PointScan, frame: str, unit: float | None) -> OwnScan:
    """A scan in one frame at the only place that it fits; Misfit where there is none."""
    motion = to_own_frame(scan, frame)
    points = motion.of(even_draw(scan.points))  # a search asks for no more of them
    unit, told = (unit, ()) if unit is not None else _likeliest_unit(points)
    try:
        found = search(prior, points * unit)
    except Misfit as error:
        hint = f"; it was read in {UNITS[unit]}, see --unit" if told else ""
        raise Misfit(f"--pose search: {error}{hint}") from error
    place = found.place
    note = (
        f"its pose was searched: {found.tried} places tried, it matches {place.fit:.0%} there and at most "
        f"{found.elsewhere:.0%} elsewhere"
    )
    if place.gone:
        note += f"; {place.gone} of the elements in view counted as gone for it"
    motion = motion.then(Motion(unit * np.eye(3)))
    position = place.position + prior.origin
    unseen = of_sensor(scan.unseen) if (scan.frame or frame) == "optical" else scan.unseen
    return OwnScan(
        scan.points, position, place.rotation, "searched", True, notes=(*told, note), motion=motion, unseen=unseen
    )


def to_own_frame(scan: PointScan, frame: str) -> Motion:
    """Of its points (N, 3) to the sensor's frame, in the file's unit.

    A pose in the file took them to the world, or is that of a sensor whose points are in the world, unless `frame` says
    that they are in the sensor's.
    """
    motion, frame = STILL, scan.frame or frame
    if scan.position is not None and (scan.in_world or frame == "world"):
        motion = to_sensor(scan)
    return motion.then(Motion(OPTICAL)) if frame == "optical" else motion


def _likeliest_unit(points: np.ndarray) -> tuple[float, tuple[str, ...]]:
    rise = height(points)
    if rise <= TALL_ROOM:
        return 1.0, ()
    unit = min(UNITS, key=lambda one: abs(np.log(rise * one / STOREY)))
    return unit, (f"it is as high as a room in {UNITS[unit]}, and was read so",)
