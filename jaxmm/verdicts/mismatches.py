"""From probabilities to mismatches: objects that were added, elements that are gone, and what moved.

S scans, N points of one side of all scans, E elements. Positions are offsets from the prior's origin, world axes:
metres, z up; mismatches come back in the world.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.learning.box_match import footprint
from jaxmm.learning.boxes import Box, fit_boxes, long_axis
from jaxmm.learning.prediction import Side
from jaxmm.learning.upright_shapes import is_round
from jaxmm.objects.clues import ONTO
from jaxmm.objects.face_finish import Rays
from jaxmm.objects.finder import Found, Judged, find_objects
from jaxmm.rays.evidence import SUPPORT, THROUGH
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.verdicts import standing_alone
from jaxmm.verdicts.moved import is_off_its_place, linked, with_more
from jaxmm.verdicts.priors import Prior, shaft_size
from jaxmm.verdicts.results import Mismatch
from jaxmm.verdicts.scan_fusion import Visits, fused
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.standing_alone import Alone, all_of
from jaxmm.verdicts.verdicts import REMOVED, Verdict, of_pieced
from warp_scanner.buildings.changes import joint_change, of_element
from warp_scanner.clouds.sightlines import cells_of
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, WALL
from warp_scanner.sensors.scan import Rays as Casts
from warp_scanner.sensors.triangles import cast_triangles

KINDS = {WALL: "wall", PILLAR: "pillar"}
LEAST_NEW = 0.5  # share of an added object's points that must be farther
LEAST_MET = 8  # rays that tell of an object, below which it is a guess
MOST_DENIED = 0.03  # share of the rays that tell anything, which may look through an object's core
MOST_OPEN = 0.3  # and that may pass through its openings, if it is a wall, below or above what is seen of it
STOREY = 1.5  # [m] between floors of two storeys, at least
LEAST_LOWER = 0.05  # [m] by which a roof is lower than the ceiling that a thing is made up to
SKY = np.radians(1.0)  # of one direction of which nothing comes back: about a voxel of 0.1 m at 6 m


class Looked(NamedTuple):
    """One scan after all was asked of it."""

    rays: ScanRays
    expected: np.ndarray  # (P,) [m] what its rays should have met, inf = nothing
    added: Side  # the robot's points
    removed: Side  # the prior's
    levels: tuple[float, float]  # heights of floor and ceiling [m]
    notes: tuple[str, ...] = ()  # what is to be said of how it was compared


def mismatches_of(
    prior: Prior,
    looked: Sequence[Looked],
    verdicts: list[Verdict] | None,
    settings: DetectSettings,
    past_gone: Sequence[Looked] | None = None,
    alone: Callable[[list[int]], list[list[Alone]]] | None = None,
) -> tuple[Mismatch, ...]:
    """All mismatches of all scans together: removed ones first, the most probable first among each.

    Args:
        prior: the prior.
        looked: each scan.
        verdicts: of all elements of a building; None for a cloud, of which objects are fitted as of the robot's points.
        settings: how.
        past_gone: the same scans compared with what remains of the building, where something is gone. Of what these
            show to be new only that counts which may be what is gone, off its place, and instead of what is seen of it
            without: furniture in the next room would count, too.
        alone: what each scan says of some elements, one by one; None: found here.
    """
    if verdicts is not None and settings.preset != "thesis":
        gone = _gone(
            prior, verdicts, settings, alone or (lambda rows: [alone_of(prior, one.rays, rows) for one in looked])
        )
        is_gone = np.array([one.verdict == REMOVED for one in verdicts], bool)
        prior = prior._replace(known=prior.known._replace(gone=is_gone))
    else:
        gone = _all_fitted(prior, looked, "removed", settings)
    found = sorted(gone, key=lambda one: -one.probability)
    new = _all_fitted(prior, looked, "added", settings)
    if past_gone and gone:
        past = _all_fitted(prior, past_gone, "added", settings)
        new = with_more(new, [one for one in past if any(is_off_its_place(one, other) for other in gone)])
    found += sorted(new, key=lambda one: -one.probability)
    return tuple(linked([one for one in found if one.probability >= settings.least_probability]))


def shown_by_each(found: tuple[Mismatch, ...], scans: int) -> tuple[np.ndarray, np.ndarray]:
    """Of each scan (S,) how many mismatches it shows, and how many of those all others together show too little of."""
    rays = np.array([one.told_by for one in found], int).reshape(-1, scans)
    others = rays.sum(axis=1, keepdims=True) - rays
    return (rays > 0).sum(axis=0), ((rays > 0) & (others < LEAST_MET)).sum(axis=0)


def alone_of(prior: Prior, rays: ScanRays, rows: list[int]) -> list[Alone]:
    """What a scan says of each of some elements that are held for removed, if nothing else stood there."""
    return [standing_alone.of_element(prior.scene, row, rays) for row in rows]


def _gone(
    prior: Prior,
    verdicts: list[Verdict],
    settings: DetectSettings,
    alone_of_rows: Callable[[list[int]], list[list[Alone]]],
) -> list[Mismatch]:
    """The walls and columns whose verdict is removed, with their own boxes; what is gone in all its pieces, as one."""
    table, semantic, things = prior.building.elements, prior.building.elements.semantic, []
    in_whole: set[int] = set()
    for whole, pieces, verdict in of_pieced(prior.building, verdicts, settings.verdicts.change_prior):
        one = whole.element
        if verdict.verdict == REMOVED and one.semantic in KINDS and settings.asks_for(one.ifc_class, one.semantic):
            gone = [row for row in pieces if verdicts[row].verdict == REMOVED]
            things.append(((one.file, one.guid), gone, verdict, joint_change(prior.building, whole, pieces)))
            in_whole.update(gone)
    for row, verdict in enumerate(verdicts):
        if verdict.verdict == REMOVED and int(semantic[row]) in KINDS and row not in in_whole:
            things.append(((table.file[row], table.guid[row]), [row], verdict, of_element(prior.building, row)))
    rows = [row for _, own, _, _ in things for row in own]
    if not rows:
        return []
    scans, found = alone_of_rows(rows), []
    alone = {row: [of_scan[number] for of_scan in scans] for number, row in enumerate(rows)}
    for (file, guid), own, verdict, change in things:
        kind = KINDS[change.semantic]
        box = Box(kind, change.center.astype(np.float64), change.size.astype(np.float64), float(change.yaw))
        box = box._replace(probability=verdict.probability)
        if kind == "pillar" and is_round(change.triangles.vertices):
            box = box._replace(shape="round", rotation=0.0)
        told = verdict.rays[THROUGH] + verdict.rays[SUPPORT]
        each = [all_of(parts) for parts in zip(*(alone[row] for row in own), strict=True)]
        standing = max(verdict.rays[SUPPORT] / max(told, 1), *(one.standing for one in each))
        found.append(
            _mismatch(prior, box, "removed", each)._replace(
                element=guid,
                file=file,
                type_probability=1.0,
                standing=standing,
                shaft=shaft_size(change) if kind == "pillar" else None,
                pieces=() if own[0] not in in_whole else tuple((table.file[row], table.guid[row]) for row in own),
            )
        )
    return found


def _all_fitted(prior: Prior, looked: Sequence[Looked], change: str, settings: DetectSettings) -> list[Mismatch]:
    """Objects of one side, storey by storey: each has a floor and a ceiling of its own."""
    floor, storeys = [one.levels[0] for one in looked], []
    for number in sorted(range(len(looked)), key=floor.__getitem__):
        if storeys and floor[number] - floor[storeys[-1][-1]] < STOREY:
            storeys[-1].append(number)
        else:
            storeys.append([number])
    return [
        found._replace(told_by=_of_all(found.told_by, storey, len(looked)))
        for storey in storeys
        for found in _fitted(prior, _Some(looked, storey), change, settings)
    ]


class _Some(Sequence[Looked]):
    """Some scans of a sequence that may load each when it is asked for."""

    def __init__(self, every: Sequence[Looked], chosen: list[int]):
        self._every, self._chosen = every, chosen

    def __getitem__(self, number: int) -> Looked:
        return self._every[self._chosen[number]]

    def __len__(self) -> int:
        return len(self._chosen)


def _of_all(rays: tuple[int, ...], storey: list[int], scans: int) -> tuple[int, ...]:
    """Rays of the scans of one storey, as of all scans: those of other storeys were not asked."""
    told = dict(zip(storey, rays, strict=True))
    return tuple(told.get(number, 0) for number in range(scans))


def _fitted(prior: Prior, looked: Sequence[Looked], change: str, settings: DetectSettings) -> list[Mismatch]:
    """Objects fitted to the points of one side that the models hold for changed."""
    judged = judged_side(looked, change)
    if not len(judged.points):
        return []
    if settings.preset == "thesis":
        extent = (judged.floor, judged.ceiling)
        boxes = [
            box
            for kind in ("pillar", "wall")
            for box in fit_boxes(judged.points, getattr(judged, kind), kind, settings.boxes, extent)
        ]
        return [
            _mismatch(prior, box, change, _alone(box, change, looked), _measured_by_thesis(box, settings))
            for box in boxes
        ]

    def box_of(one: Found) -> Box:
        return _below_roof(prior, one.box, float(judged.points[one.members, 2].max())) if change == "added" else one.box

    def allows(one: Found) -> bool:
        """Whether it is likely, new, and the rays meet it and hardly pass through it but for a wall's openings."""
        if one.box.probability < settings.least_probability:
            return False
        box = box_of(one)
        alone = _alone(box, change, looked, _face(box, judged.points[one.members]))
        new = np.mean(judged.apart[one.members] > ONTO) if change == "added" else 1.0
        tell, through = sum(part.tell for part in alone), sum(part.through for part in alone)
        deny = sum(part.deny for part in alone) - through
        solid = deny <= MOST_DENIED * (tell + deny) and through <= MOST_OPEN * (tell + through)
        return bool(new >= LEAST_NEW and tell >= LEAST_MET and solid)

    found = [(box_of(one), one) for one in find_objects(judged, settings.objects, prior.known, allows=allows)]
    return [
        _mismatch(prior, box, change, _alone(box, change, looked), one.measured)._replace(
            type_probability=one.type_probability
        )
        for box, one in found
    ]


def _measured_by_thesis(one: Box, settings: DetectSettings) -> tuple[bool, bool, bool]:
    """Walls get a thickness, and everything the height of its room."""
    thick = int(np.argmin(one.dimensions[:2])) if one.object_type == "wall" else -1
    return (thick != 0, thick != 1, not settings.boxes.stretch)


def _below_roof(prior: Prior, box: Box, seen: float) -> Box:
    """A new box, no higher than what the building has above its footprint, and no lower than it was seen [m].

    The ceiling that things are made up to is the one above their highest points; a roof slopes.
    """
    if prior.scene is None:
        return box
    level = np.isin(prior.scene.triangles.semantic, (FLOOR, CEILING))
    places = np.column_stack([footprint(box, np.zeros(2)), np.full(4, seen)])
    free = cast_triangles(prior.scene, Casts(places, np.array([[0.0, 0.0, 1.0]], np.float32)), level).distance
    bottom, top = (box.center[2] + way * box.dimensions[2] / 2 for way in (-1.0, 1.0))
    roof = seen + float(free.min())
    if roof > top - LEAST_LOWER:
        return box
    center, dimensions = np.array(box.center, np.float64), np.array(box.dimensions, np.float64)
    center[2], dimensions[2] = (bottom + roof) / 2, roof - bottom
    return box._replace(center=center, dimensions=dimensions)


def judged_side(looked: Sequence[Looked], change: str) -> Judged:
    """One side of all scans together: of a place that several saw, one point has what all say."""
    sides = [getattr(one, change) for one in looked]
    points = np.concatenate([side.view.points for side in sides])
    scan = np.repeat(np.arange(len(sides)), [len(side.view.points) for side in sides])
    sensors = np.array([one.rays.position for one in looked])
    visits = Visits(points, scan, np.linalg.norm(points - sensors[scan], axis=1))
    pillar, wall = fused(visits, np.concatenate([np.column_stack([side.pillar, side.wall]) for side in sides])).T
    apart = np.concatenate([side.view.apart for side in sides])
    floor, ceiling = min(one.levels[0] for one in looked), max(one.levels[1] for one in looked)
    rays = tuple(Rays(one.rays.position, one.rays.direction, one.rays.distance) for one in looked)
    own = [side.view.levels for side in sides]
    judged = Judged(
        points, pillar, wall, apart, sensors, floor, ceiling, scan,
        rays if change == "added" else None,  # what the robot's rays met says nothing of the faces of what is gone
        None if any(one is None for one in own) else np.concatenate(own),
    )  # fmt: skip
    return _with_sky(judged, looked) if change == "added" else judged


def _with_sky(judged: Judged, looked: Sequence[Looked]) -> Judged:
    """The same with points beyond all others, where nothing came back and nothing should: there one looks through."""
    skies = [_sky(one).astype(judged.points.dtype) for one in looked]
    scan = np.repeat(np.arange(len(skies)), [len(sky) for sky in skies])
    if not len(scan):
        return judged
    old = np.zeros(len(scan), judged.wall.dtype)
    levels = np.full((len(scan), 2), (judged.floor, judged.ceiling))
    return judged._replace(
        points=np.concatenate([judged.points, *skies]),
        pillar=np.concatenate([judged.pillar, old]),
        wall=np.concatenate([judged.wall, old]),
        apart=np.concatenate([judged.apart, old.astype(judged.apart.dtype)]),
        scan=np.concatenate([judged.scan, scan]),
        levels=None if judged.levels is None else np.concatenate([judged.levels, levels]),
    )


def _sky(one: Looked) -> np.ndarray:
    """(n, 3) [m] a place for each cell of directions, in one of which a scan brings nothing back, and should not.

    A cloud, of which no ray is expected to meet anything, does not tell where nothing should come back. What looks down
    has some ground before it, in the model or not: where nothing comes back from there, it was lost.
    """
    rays = one.rays
    if np.isinf(one.expected).all():
        return np.zeros((0, 3))
    nothing = np.isinf(rays.distance) & (np.isinf(one.expected) | (one.expected > rays.limit))
    none = np.flatnonzero(nothing & (rays.direction[:, 2] > 0.0))
    if not len(none):
        return np.zeros((0, 3))
    chosen = none[np.unique(cells_of(rays.direction[none], SKY)[0], return_index=True)[1]]
    farthest = float(rays.distance[: rays.measured].max()) + 1.0
    return rays.position + rays.direction[chosen].astype(np.float64) * farthest


def _face(box: Box, points: np.ndarray) -> np.ndarray | None:
    """Where along a wall its points (n, 3) are, as `of_box` wants it; None of a pillar, which has no openings."""
    if box.object_type != "wall":
        return None
    return np.sort((points - box.center)[:, :2] @ long_axis(box.dimensions, box.rotation))


def _alone(box: Box, change: str, looked: Sequence[Looked], face: np.ndarray | None = None) -> list[Alone]:
    if change == "removed":
        return [standing_alone.of_gone_box(box, one.rays) for one in looked]
    return [standing_alone.of_box(box, one.expected, one.rays, face) for one in looked]


def _mismatch(
    prior: Prior, box: Box, change: str, alone: list[Alone], measured: tuple[bool, bool, bool] = (True, True, True)
) -> Mismatch:
    """The mismatch in the world; what is observable is what the best of the scans shows."""
    shares = [part.tell / part.would_meet for part in alone if part.would_meet]
    return Mismatch(
        box.object_type, change, np.asarray(box.center, np.float64) + prior.origin,
        np.asarray(box.dimensions, np.float64), float(box.rotation), float(box.probability),
        observable_fraction=max(shares, default=0.0), shape=box.shape, measured=measured,
        told_by=tuple(part.tell for part in alone),
    )  # fmt: skip
