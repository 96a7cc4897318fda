"""From probabilities to mismatches: objects that were added, elements that are gone, and what moved.

S scans, N points of one side of all scans, E elements. Positions are offsets from the prior's origin, world axes:
metres, z up; mismatches come back in the world.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxmm.learning.box_match import footprint
from jaxmm.learning.boxes import Box, fit_boxes, long_axis
from jaxmm.learning.upright_shapes import is_round
from jaxmm.objects.clues import ONTO
from jaxmm.objects.face_finish import Rays
from jaxmm.objects.finder import Found, find_objects
from jaxmm.rays.evidence import SUPPORT, THROUGH
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.verdicts import standing_alone
from jaxmm.verdicts.moved import is_off_its_place, linked, with_more
from jaxmm.verdicts.priors import Prior, shaft_size
from jaxmm.verdicts.results import Mismatch
from jaxmm.verdicts.scan_fusion import Looked, judged_side, rays_to_faces
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.standing_alone import Alone, Boxes, all_of
from jaxmm.verdicts.verdicts import REMOVED, Verdict, keys_of, of_pieced, within
from warp_scanner.buildings.changes import joint_change, of_element
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

# Boxes and faces of some objects -> of each, what each scan says of it.
AloneOf = Callable[[Sequence[Box], Sequence[np.ndarray | None]], list[list[Alone]]]


class Asks(NamedTuple):
    """What scans say, each by itself, wherever it is held."""

    elements: Callable[[list[int]], list[list[Alone]]]  # of each scan about elements, by their rows
    boxes: Callable[[Boxes, list[bool]], list[list[Alone]]]  # of each of the chosen scans; of all others nothing
    rays: Sequence[Rays]  # (S,) all of each, which may be loaded when they are asked for


def mismatches_of(
    prior: Prior,
    looked: Sequence[Looked],
    verdicts: list[Verdict] | None,
    settings: DetectSettings,
    past_gone: Sequence[Looked] | None = None,
    asks: Asks | None = None,
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
        asks: what scans say of elements and boxes, one by one; None: found here.
    """
    asks = asks or _asks_of(prior, looked, past_gone)
    if verdicts is not None and settings.preset != "thesis":
        gone = _gone(prior, verdicts, settings, asks.elements)
        is_gone = np.array([one.verdict == REMOVED for one in verdicts], bool)
        prior = prior._replace(known=prior.known._replace(gone=is_gone))
    else:
        gone = _all_fitted(prior, looked, ("removed", False), settings, asks)
    found = sorted(gone, key=lambda one: -one.probability)
    new = _all_fitted(prior, looked, ("added", False), settings, asks)
    if past_gone and gone:
        past = _all_fitted(prior, past_gone, ("added", True), settings, asks)
        new = with_more(new, [one for one in past if any(is_off_its_place(one, other) for other in gone)])
    found += sorted(new, key=lambda one: -one.probability)
    return tuple(linked([one for one in found if one.probability >= settings.least_probability]))


def _asks_of(prior: Prior, looked: Sequence[Looked], past_gone: Sequence[Looked] | None) -> Asks:
    """What scans that are held here say."""

    def of_boxes(asked: Boxes, chosen: list[bool]) -> list[list[Alone]]:
        scans = past_gone if asked.is_past else looked
        return [
            standing_alone.of_boxes(asked, scans[number].expected, scans[number].rays) if mine else []
            for number, mine in enumerate(chosen)
        ]

    rays = [rays_to_faces(one.rays) for one in looked]
    return Asks(lambda rows: [alone_of(prior, one.rays, rows) for one in looked], of_boxes, rays)


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
    """The walls and columns whose verdict is removed, with their own boxes; what is gone in all its pieces, as one.

    So is what a third file has of it, in fewer pieces.
    """
    table, semantic, things = prior.building.elements, prior.building.elements.semantic, []
    in_whole: set[int] = set()
    wholes = [
        (whole, rows, verdict)
        for whole, rows, verdict in of_pieced(prior.building, verdicts, settings.verdicts.change_prior)
        if verdict.verdict == REMOVED
        and whole.element.semantic in KINDS
        and settings.asks_for(whole.element.ifc_class, whole.element.semantic)
    ]
    every = [whole for whole, _, _ in wholes]
    smaller = {keys_of(other) for whole in every for other in within(whole, every)}
    for whole, pieces, verdict in wholes:
        if keys_of(whole) in smaller:
            continue
        gone = [row for row in pieces if verdicts[row].verdict == REMOVED]
        keys = [(table.file[row], table.guid[row]) for row in gone]
        keys += [keys_of(other)[0] for other in within(whole, every)]
        things.append((keys_of(whole)[0], gone, verdict, joint_change(prior.building, whole, pieces), tuple(keys)))
        in_whole.update(gone)
    for row, verdict in enumerate(verdicts):
        if verdict.verdict == REMOVED and int(semantic[row]) in KINDS and row not in in_whole:
            things.append(((table.file[row], table.guid[row]), [row], verdict, of_element(prior.building, row), ()))
    rows = [row for _, own, *_ in things for row in own]
    if not rows:
        return []
    scans, found = alone_of_rows(rows), []
    alone = {row: [of_scan[number] for of_scan in scans] for number, row in enumerate(rows)}
    for (file, guid), own, verdict, change, keys in things:
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
                pieces=keys,
            )
        )
    return found


def _all_fitted(
    prior: Prior, looked: Sequence[Looked], side: tuple[str, bool], settings: DetectSettings, asks: Asks
) -> list[Mismatch]:
    """Objects of one side, storey by storey: each has a floor and a ceiling of its own.

    `side` is the change, and whether scans are compared with what remains without what is gone.
    """
    floor, storeys = [one.levels[0] for one in looked], []
    for number in sorted(range(len(looked)), key=floor.__getitem__):
        if storeys and floor[number] - floor[storeys[-1][-1]] < STOREY:
            storeys[-1].append(number)
        else:
            storeys.append([number])
    found = []
    for storey in storeys:
        alone = functools.partial(_alone, asks, side, storey, len(looked))
        for one in _fitted(prior, (_Some(looked, storey), _Some(asks.rays, storey)), side[0], settings, alone):
            found.append(one._replace(told_by=_of_all(one.told_by, storey, len(looked))))
    return found


def _alone(
    asks: Asks,
    side: tuple[str, bool],
    storey: list[int],
    scans: int,
    boxes: Sequence[Box],
    faces: Sequence[np.ndarray | None],
) -> list[list[Alone]]:
    """Of each box what each scan of a storey says, of so many in all."""
    if not len(boxes):
        return []
    of_scan = asks.boxes(Boxes(tuple(boxes), tuple(faces), *side), [number in storey for number in range(scans)])
    return [[of_scan[number][row] for number in storey] for row in range(len(boxes))]


class _Some(Sequence):
    """Some scans of a sequence that may load each when it is asked for."""

    def __init__(self, every: Sequence, chosen: list[int]):
        self._every, self._chosen = every, chosen

    def __getitem__(self, number: int) -> Any:
        return self._every[self._chosen[number]]

    def __len__(self) -> int:
        return len(self._chosen)


def _of_all(rays: tuple[int, ...], storey: list[int], scans: int) -> tuple[int, ...]:
    """Rays of the scans of one storey, as of all scans: those of other storeys were not asked."""
    told = dict(zip(storey, rays, strict=True))
    return tuple(told.get(number, 0) for number in range(scans))


def _fitted(
    prior: Prior,
    scans: tuple[Sequence[Looked], Sequence[Rays]],
    change: str,
    settings: DetectSettings,
    alone: AloneOf,
) -> list[Mismatch]:
    """Objects fitted to the points of one side that the models hold for changed."""
    judged = judged_side(scans[0], change, scans[1])
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
            _mismatch(prior, box, change, told, _measured_by_thesis(box, settings))
            for box, told in zip(boxes, alone(boxes, [None] * len(boxes)), strict=True)
        ]

    def box_of(one: Found) -> Box:
        return _below_roof(prior, one.box, float(judged.points[one.members, 2].max())) if change == "added" else one.box

    def allows(found: list[Found]) -> list[bool]:
        """Whether each is likely, new, and the rays meet it and hardly pass through it but for a wall's openings."""
        likely = [row for row, one in enumerate(found) if one.box.probability >= settings.least_probability]
        boxes = [box_of(found[row]) for row in likely]
        faces = [_face(box, judged.points[found[row].members]) for box, row in zip(boxes, likely, strict=True)]
        fits = [False] * len(found)
        for row, told in zip(likely, alone(boxes, faces), strict=True):
            new = np.mean(judged.apart[found[row].members] > ONTO) if change == "added" else 1.0
            tell, through = sum(part.tell for part in told), sum(part.through for part in told)
            deny = sum(part.deny for part in told) - through
            solid = deny <= MOST_DENIED * (tell + deny) and through <= MOST_OPEN * (tell + through)
            fits[row] = bool(new >= LEAST_NEW and tell >= LEAST_MET and solid)
        return fits

    found = find_objects(judged, settings.objects, prior.known, allows=allows)
    boxes = [box_of(one) for one in found]
    return [
        _mismatch(prior, box, change, told, one.measured)._replace(type_probability=one.type_probability)
        for one, box, told in zip(found, boxes, alone(boxes, [None] * len(boxes)), strict=True)
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


def _face(box: Box, points: np.ndarray) -> np.ndarray | None:
    """Where along a wall its points (n, 3) are, as `of_box` wants it; None of a pillar, which has no openings."""
    if box.object_type != "wall":
        return None
    return np.sort((points - box.center)[:, :2] @ long_axis(box.dimensions, box.rotation))


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
