"""What the rays of a scan would say of one object if nothing else stood there.

P rays of one scan. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.learning.boxes import Box, long_axis
from jaxmm.rays.evidence import BASE_MARGIN
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.verdicts.verdicts import Told, VerdictSettings, is_seen
from warp_scanner.scenes.scenes import BOX, CYLINDER, Primitives
from warp_scanner.sensors.scan import Rays, cast_rays
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles

APART = 0.1  # [m] ranges must differ by more for a ray to tell
OFF = 0.25  # [m] a fitted box may be off by
ENDS = 0.15  # [m] of its height next to its lower and its upper end
BESIDE = 0.06  # [m] along a face, thinned to 0.1 m: so near to a place where it is seen it is seen, too
BESIDE_POSE = 0.05  # [m] by which an estimated pose may be off
CORE = 0.6  # of a box's edges: rays through this much of it cannot have grazed it by a misfit


class Alone(NamedTuple):
    """Rays that would meet an object if it stood alone, by what they did."""

    would_meet: int
    tell: int  # of those, that show that it is new, or gone
    deny: int  # of those, that show the contrary
    through: int = 0  # of these, that pass below or above what is seen of its face: a wall has openings

    @property
    def standing(self) -> float:
        """Of a removed element: share of the rays that tell of it, that deny it; 0 where none tells."""
        return self.deny / max(self.tell + self.deny, 1)


class Boxes(NamedTuple):
    """What scans are asked about some boxes."""

    boxes: tuple[Box, ...]
    faces: tuple[np.ndarray | None, ...]  # of each, as `of_box` wants it
    change: str  # of boxes.MISMATCH_TYPES
    is_past: bool  # whether what is expected is what remains without what is gone


def all_of(parts: Sequence[Alone]) -> Alone:
    """What is said of several elements as one."""
    return Alone(*(sum(counts) for counts in zip(*parts, strict=True)))


def of_element(scene: TriangleScene, element: int, rays: ScanRays) -> Alone:
    """An element of the prior that is held for removed: rays beyond it tell, rays that end right on it deny.

    Where another element of the prior has a surface at the same place, as beside a corner or below a floor, a ray that
    ends there says nothing of this one.
    """
    only = np.arange(len(scene.triangles.semantic)) == element
    reach = cast_triangles(scene, Rays(rays.position[None], rays.direction), only).distance[0]
    meets = np.isfinite(reach) & (reach <= rays.limit)
    apart = rays.distance[meets] - reach[meets]
    back = np.isfinite(apart)
    ends = np.flatnonzero(meets)[np.abs(apart) <= BASE_MARGIN]
    others = cast_triangles(scene, Rays(rays.position[None], rays.direction[ends]), ~only).distance[0]
    own = np.abs(rays.distance[ends] - others) > BASE_MARGIN
    return Alone(int(meets.sum()), int((back & (apart > APART)).sum()), int(own.sum()))


def for_sure(scene: TriangleScene, rays: ScanRays, told: Told, limits: VerdictSettings) -> Told:
    """What a scan tells, without what looks removed only from exactly where its pose, if estimated, has it.

    An element at the edge of the view, or behind that of another thing, is met or not by where the sensor was.
    """
    counts, logit = told.rays.copy(), told.logit.copy()
    for row in np.flatnonzero(is_seen(told.rays, limits) & (told.logit > 0.0)):
        if _fewest_beyond(scene, int(row), rays) < limits.least_rays:
            counts[row], logit[row] = 0, np.nan
    return told._replace(rays=counts, logit=logit)


def _fewest_beyond(scene: TriangleScene, element: int, rays: ScanRays) -> int:
    """Rays beyond an element, from BESIDE_POSE to the left or to the right of the sensor: of both the fewer."""
    corners = scene.triangles.vertices[scene.triangles.faces[scene.triangles.element == element]].reshape(-1, 3)
    x, y = (corners.min(axis=0) + corners.max(axis=0))[:2] / 2 - rays.position[:2]
    aside = BESIDE_POSE * np.array([-y, x, 0.0]) / max(float(np.hypot(x, y)), 1e-6)
    return min(of_element(scene, element, rays._replace(position=rays.position + way * aside)).tell for way in (-1, 1))


def of_box(box: Box, expected: np.ndarray, rays: ScanRays, face: np.ndarray | None = None) -> Alone:
    """A new object: rays that end on it before the prior tell, rays through its core deny.

    Args:
        box: where it stands.
        expected: (P,) [m] what the rays should have met without it.
        rays: of the scan.
        face: (n,) ascending places [m] where it is seen, along its longer edge, counted from its centre; None: a ray
            that passes is never one through an opening.
    """
    reach = _reach(box, 1.0, rays)
    meets = np.isfinite(reach) & (reach <= rays.limit)
    on_it = np.abs(rays.distance[meets] - reach[meets]) <= OFF
    before = rays.distance[meets] + APART < expected[meets]
    core = _reach(box, CORE, rays)
    with np.errstate(invalid="ignore"):
        beyond = np.isfinite(core) & np.isfinite(rays.distance) & (rays.distance > core + OFF + max(box.dimensions[:2]))
    through = 0
    if face is not None and len(face):
        at_core = rays.position + rays.direction[beyond] * core[beyond, None].astype(np.float64)
        place = (at_core - np.asarray(box.center))[:, :2] @ long_axis(box.dimensions, box.rotation)
        after = np.searchsorted(face, place)
        near = np.minimum(place - face[np.maximum(after - 1, 0)], face[np.minimum(after, len(face) - 1)] - place)
        through = int(np.sum(np.abs(near) <= BESIDE))
    return Alone(int(meets.sum()), int((on_it & before).sum()), int(beyond.sum()), through)


def of_boxes(asked: Boxes, expected: np.ndarray, rays: ScanRays) -> list[Alone]:
    """What a scan says of each of some boxes, by rays and what they should have met (P,) [m]."""
    if asked.change == "removed":
        return [of_gone_box(box, rays) for box in asked.boxes]
    return [of_box(box, expected, rays, face) for box, face in zip(asked.boxes, asked.faces, strict=True)]


def of_gone_box(box: Box, rays: ScanRays) -> Alone:
    """An object fitted to points of a prior without elements: rays beyond its core tell, rays that end on it deny."""
    reach, core = _reach(box, 1.0, rays), _reach(box, CORE, rays)
    # What goes on around its ends, floor and ceiling or a wall in its line, says nothing of it.
    inner = _reach(box._replace(dimensions=np.asarray(box.dimensions) - [0.0, 0.0, 2 * ENDS]), CORE, rays)
    meets = np.isfinite(reach) & (reach <= rays.limit)
    back = np.isfinite(rays.distance)
    with np.errstate(invalid="ignore"):
        beyond = np.isfinite(core) & back & (rays.distance > core + APART + min(box.dimensions[:2]))
        on_it = np.isfinite(inner) & meets & (np.abs(rays.distance - reach) <= APART)
    return Alone(int(meets.sum()), int(beyond.sum()), int(on_it.sum()))


def ranges_to(boxes: Sequence[Box], position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Ranges (B, P) float32 [m] from a place (3,) along unit vectors (P, 3) to each box alone; inf = passes it."""
    half = np.array([one.dimensions for one in boxes], np.float32).reshape(-1, 1, 3) / 2
    is_round = np.array([[one.shape == "round"] for one in boxes], bool).reshape(-1, 1)
    half[..., :2] = np.where(is_round[..., None], half[..., :2].mean(axis=-1, keepdims=True), half[..., :2])
    alone = Primitives(
        np.where(is_round, CYLINDER, BOX).astype(np.uint8),
        np.array([one.center for one in boxes], np.float32).reshape(-1, 1, 3), half,
        np.radians(np.array([[one.rotation] for one in boxes], np.float32)).reshape(-1, 1),
        np.zeros(is_round.shape, np.int32), np.ones(is_round.shape, np.uint8),
    )  # fmt: skip
    places = np.tile(np.asarray(position, np.float32), (len(boxes), 1))
    return cast_rays(alone, None, Rays(places, direction)).distance


def _reach(box: Box, share: float, rays: ScanRays) -> np.ndarray:
    """Ranges (P,) [m] to a box whose horizontal edges are shrunk to a share; inf = passes it."""
    shrunk = box._replace(dimensions=np.asarray(box.dimensions, np.float64) * [share, share, 1.0])
    return ranges_to([shrunk], rays.position, rays.direction)[0]
