"""What stands in an element's place and reaches less high is something else: rays by the height at which they meet it.

K rays of one scan that should meet some face, E elements, n of them met. Metres, z up.

A barrel where a column was torn down ends rays where the column would, and may fit its shape. Above it rays go on. Of
an element that stands none do, however much of it furniture hides: what is hidden tells nothing. Half a column in its
place is its own, unless what looks like its face goes on beside it: then it is the front of a cabinet.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from jaxmm.deviations.meetings import Meetings
from jaxmm.rays.evidence import BASE_MARGIN
from jaxmm.vectors import lengths
from warp_scanner.scenes.building import Triangles, element_bounds
from warp_scanner.scenes.scenes import DOOR, WINDOW

BANDS, PARTS = 20, 6  # of the height of an element, and of its length, in which rays are counted
THROUGH, UPON, LIES = range(3)  # clearly behind the face; about it; and of these, where the face is
BEHIND, GROWS = 0.15, 0.02  # [m] behind a face, and more for each metre of range: there a ray went through
LEAST_HEIGHT = 1.0  # [m] of an element that is asked about
END = 0.1  # [m] from its foot or head: what ends there may be the floor or the ceiling
LEAST_RAYS, LEAST_BANDS = 20, 2  # that pass above what stands there
PASSED, OF_BAND = 0.9, 0.8  # least share of the rays above it that pass, and of those at each height
ACROSS = 0.75  # least share of the length of a wall, over which some pass
SLENDER, HEAD = 1.2, 0.85  # [m] longest edge in plan of what no window is cut into; else they must pass so high up
ALIKE = 0.8  # share of the rays below that end where the face is, from which on it is the element's own lower part
BESIDE, STRIPS = (0.03, 0.18), 3  # [m] off the edges of a face, in how many strips, its plane is looked for beside it
GOES_ON = 0.3  # least share of the face's own rays, as many for the width of each strip: a side meets the plane in one
LEAST_BESIDE = 3  # rays in each strip


class Heights(NamedTuple):
    """Rays at each height of the elements that they should meet; small, whatever the scan."""

    row: np.ndarray  # (n,) int, ascending
    rays: np.ndarray  # (n, BANDS, PARTS, 3) int32: from foot to head, along its length; THROUGH, UPON, LIES
    goes_on: np.ndarray  # (n,) bool: what ends where a face is goes on in its plane beside it, where nothing should be


class _Frame(NamedTuple):
    """Elements as they stand: where their feet are, and which way they are long."""

    low: np.ndarray  # (E,) [m]
    height: np.ndarray  # (E,) [m]
    way: np.ndarray  # (E, 2) unit vectors in plan
    start: np.ndarray  # (E,) [m] along it
    length: np.ndarray  # (E,) [m]


def heights_of(triangles: Triangles, met: Meetings) -> Heights:
    """Count the rays of one scan.

    Those that end before a face tell nothing of its element, nor do those that end about its foot or head.
    """
    frame = _frame_of(triangles)
    row = met.element.astype(np.int64)
    way = met.end - met.sensor
    # Along a ray, what it is off across the face grows with the incidence.
    cosine = np.abs(np.einsum("kc,kc->k", met.normal, way)) / lengths(way)
    place = met.end + way * (met.off / (cosine * met.reach))[:, None]
    low, height = frame.low[row], frame.height[row]
    through = met.off < -(BEHIND + GROWS * met.reach)
    inner = (met.end[:, 2] > low + END) & (met.end[:, 2] < low + height - END)
    upon = (np.abs(met.off) <= BEHIND) & inner
    chosen = (through | upon) & (height >= LEAST_HEIGHT)
    known, number = np.unique(row[chosen], return_inverse=True)
    band = _cell((place[:, 2] - low)[chosen] / height[chosen], BANDS)
    along = np.einsum("kc,kc->k", place[chosen, :2], frame.way[row[chosen]]) - frame.start[row[chosen]]
    cell = (number * BANDS + band) * PARTS + _cell(along / frame.length[row[chosen]], PARTS)
    counts = [
        np.bincount(cell, each[chosen], len(known) * BANDS * PARTS)
        for each in (through, upon, upon & (np.abs(met.off) <= BASE_MARGIN))
    ]
    rays = (np.stack(counts, axis=-1).astype(np.int32) * np.int32(met.every)).reshape(len(known), BANDS, PARTS, 3)
    lies = upon & (np.abs(met.off) <= BASE_MARGIN)
    return Heights(known, rays, _goes_on(triangles, met, lies, known, rays))


def passed_above(triangles: Triangles, shown: Iterable[Heights], *, in_place: bool) -> np.ndarray:
    """(E,) bool: elements in whose place something stands that reaches less high, for rays pass above it.

    Of a long element they must pass over most of its length, and up to its head: windows are cut into walls.

    Args:
        triangles: of the elements.
        shown: by each scan.
        in_place: what is below may be the element's own lower part, half built or torn down; then it is not among them.
    """
    frame, count = _frame_of(triangles), len(triangles.semantic)
    rays: dict[int, np.ndarray] = {}
    wider: set[int] = set()
    for one in shown:
        wider.update(one.row[one.goes_on].tolist())
        for row, own in zip(one.row.tolist(), one.rays, strict=True):
            rays[row] = rays.get(row, 0) + own.astype(np.int64)
    found = np.zeros(count, bool)
    for row, own in rays.items():
        if triangles.semantic[row] not in (DOOR, WINDOW):
            found[row] = _is_passed(own, bool(frame.length[row] < SLENDER), in_place and row not in wider)
    return found


def _goes_on(triangles: Triangles, met: Meetings, lies: np.ndarray, known: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(n,) bool of the elements `known` (n,): whether something that the model lacks lies in the plane of a face of
    theirs, and goes on beside it.

    Asked of elements that are slender, and of which rays (n, BANDS, PARTS, 3) end on no more than a lower part. `lies`
    (K,) says which rays of all end where the face is that they should meet.
    """
    found, new = np.zeros(len(known), bool), met.off > BEHIND  # before all that the model has there
    end, start = met.end[new], np.searchsorted(met.element, known)
    low = rays[..., UPON].sum(axis=2)[:, -2:].sum(axis=1) == 0
    for number in np.flatnonzero(low & (rays[..., LIES].sum(axis=(1, 2)) >= LEAST_RAYS)):
        own = slice(start[number], np.searchsorted(met.element, known[number], side="right"))
        corners = triangles.vertices[triangles.faces[triangles.element == known[number]].ravel()]
        if np.ptp(corners[:, :2], axis=0).max() < SLENDER:
            found[number] = any(
                _is_part(end, met.end[own][mine], met.normal[own][mine], corners)
                for group in np.unique(met.group[own][lies[own]])
                if (mine := lies[own] & (met.group[own] == group)).sum() >= LEAST_RAYS
            )
    return found


def _is_part(others: np.ndarray, own: np.ndarray, normal: np.ndarray, corners: np.ndarray) -> bool:
    """Whether a face is part of a wider one: its own ends and normals (k, 3), those of other rays, corners (c, 3)."""
    way = normal.mean(axis=0)
    along = np.array([-way[1], way[0], 0.0]) / max(np.hypot(*way[:2]), 1e-9)
    flat = np.abs((others - own.mean(axis=0)) @ way) <= BASE_MARGIN
    low, high = np.quantile(own[:, 2], (0.02, 0.98))
    place = others[flat & (others[:, 2] >= low) & (others[:, 2] <= high)] @ along
    left, right = (corners @ along).min(), (corners @ along).max()
    least = max(LEAST_BESIDE, GOES_ON * len(own) * (BESIDE[1] - BESIDE[0]) / STRIPS / max(right - left, 1e-6))
    sides = (np.histogram(beyond, STRIPS, BESIDE)[0] for beyond in (place - right, left - place))
    return any(bool((side >= least).all()) for side in sides)


def _is_passed(rays: np.ndarray, slender: bool, in_place: bool) -> bool:
    """Whether rays (BANDS, PARTS, 3) pass above what stands in the place of one element."""
    through, upon = rays[..., THROUGH].sum(axis=1), rays[..., UPON].sum(axis=1)
    told = through + upon
    above = [through[band:].sum() >= PASSED * told[band:].sum() for band in range(BANDS)]
    stopped = np.flatnonzero((through < OF_BAND * told) | ~np.array(above))
    cut = int(stopped[-1]) + 1 if len(stopped) else 0
    bands = np.flatnonzero(through[cut:] > 0) + cut
    if through[cut:].sum() < LEAST_RAYS or len(bands) < LEAST_BANDS:
        return False
    across = np.mean(rays[cut:, :, THROUGH].sum(axis=0) > 0)
    if not slender and (across < ACROSS or bands[-1] + 1 < HEAD * BANDS):
        return False
    below = rays[:cut].sum(axis=(0, 1))
    return not (in_place and below[LIES] >= ALIKE * max(below[THROUGH] + below[UPON], 1))


def _frame_of(triangles: Triangles) -> _Frame:
    low, high = (bound.astype(np.float64) for bound in element_bounds(triangles))
    count, element = len(triangles.semantic), np.repeat(triangles.element, 3)
    corner = triangles.vertices[triangles.faces.ravel()][:, :2].astype(np.float64)
    many = np.maximum(np.bincount(element, minlength=count), 1)
    middle = np.stack([np.bincount(element, corner[:, axis], count) / many for axis in range(2)], axis=1)
    x, y = (corner - middle[element]).T
    xx, yy, xy = (np.bincount(element, product, count) for product in (x * x, y * y, x * y))
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    along = np.einsum("nc,nc->n", corner, way[element])
    start, end = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(start, element, along)
    np.maximum.at(end, element, along)
    with np.errstate(invalid="ignore"):  # of elements without triangles
        return _Frame(low[:, 2], high[:, 2] - low[:, 2], way, start, np.maximum(end - start, 1e-6))


def _cell(share: np.ndarray, count: int) -> np.ndarray:
    return np.clip((share * count).astype(np.int64), 0, count - 1)
