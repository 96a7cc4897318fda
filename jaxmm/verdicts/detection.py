"""Detection: robot scans against a prior, from arrays to mismatches and verdicts.

S scans, E elements. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

import time
from collections.abc import Sequence
from functools import partial

import numpy as np

from jaxmm.classes.telling_rays import Telling
from jaxmm.inputs import InputError
from jaxmm.learning.boxes import MISMATCH_TYPES
from jaxmm.learning.element_boxes import boxes_of
from jaxmm.learning.prediction import Judges, Side, judge, unjudged
from jaxmm.rays.scan_rays import PosedScan, ScanRays, rays_of_scan
from jaxmm.verdicts.as_built import AsBuilt, as_built, with_displaced
from jaxmm.verdicts.behind_removed import filling, gone_of, holders, look_past_what_is_gone, remains_of
from jaxmm.verdicts.building_evidence import sight
from jaxmm.verdicts.cloud_comparison import compare
from jaxmm.verdicts.far_elements import toward_far_elements
from jaxmm.verdicts.hanging_openings import without_hanging
from jaxmm.verdicts.mirrors import without_mirror_images
from jaxmm.verdicts.mismatches import Looked, mismatches_of, shown_by_each
from jaxmm.verdicts.named_scans import NamedScan, placed_scan, settled_scan
from jaxmm.verdicts.next_view import Stage, next_views, stand_of
from jaxmm.verdicts.outdoors import OUTDOORS, is_outdoors, of_building_only, things_not_in_model
from jaxmm.verdicts.placement import Placed
from jaxmm.verdicts.priors import Prior, unasked, without_stray
from jaxmm.verdicts.results import (
    Detection,
    Drawing,
    ElementVerdict,
    Mismatch,
    Pose,
    ScanRecord,
    notes_on,
    open_doors,
    with_twins,
)
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.standing_alone import for_sure
from jaxmm.verdicts.verdicts import (
    OCCLUDED,
    REMOVED,
    UNSCANNED,
    VERDICTS,
    Told,
    Verdict,
    retold,
    told_of,
    verdicts_of,
)
from jaxmm.verdicts.wholes import telling_of, wholes_of
from warp_scanner.scenes.scenes import DOOR
from warp_scanner.sensors.sensors import Pinhole
from warp_scanner.sensors.triangles import clearance

UNKNOWN = 0.15  # [m] from what remains of the model, from which on something else stands there


def detect_scans(prior: Prior, scans: list[NamedScan], judges: Judges, settings: DetectSettings) -> Detection:
    """Compare scans with a prior.

    Args:
        prior: from priors.read_prior.
        scans: at least one.
        judges: the four models.
        settings: how.

    Raises:
        InputError: a scan does not fit; the line names its file.
    """
    beyond_thesis, watch = settings.preset != "thesis", _Watch()
    asked = settings.asked(prior.building.elements) if prior.has_elements else np.zeros(0, bool)
    if prior.has_elements:
        prior = prior._replace(notes=(*prior.notes, *unasked(prior.building, asked)))
    if settings.settle and beyond_thesis:
        prior, scans = without_stray(prior), [settled_scan(one) for one in scans]
    watch.lap("settling")
    placed = [placed_scan(prior, one, settings) for one in scans]
    outdoors = [is_outdoors(prior, one.scan.position) for one in placed]
    scans = [
        one._replace(notes=(*one.notes, OUTDOORS)) if is_out else one
        for one, is_out in zip(scans, outdoors, strict=True)
    ]
    watch.lap("registration")
    if beyond_thesis:
        prior = without_hanging(prior, asked)
    if settings.mirrors and beyond_thesis:
        placed, scans = without_mirror_images(prior, placed, scans)
    rays = _rays(prior, placed, scans)
    drawn_prior, stands = prior, as_built(prior, rays, placed, settings)
    prior = stands.prior
    watch.lap("deviations")
    looked, told = _looked_at(prior, rays, scans, outdoors, judges)
    scans = [one._replace(notes=(*one.notes, *found.notes)) for one, found in zip(scans, looked, strict=True)]
    sure, past_gone = partial(_for_sure, prior, looked, scans, settings), None
    if prior.has_elements and beyond_thesis:
        past_gone, told = look_past_what_is_gone(prior, looked, told, judges, settings.verdicts, sure=sure)
    told = sure(told)
    watch.lap("evidence")
    found = _verdicts(told, stands, settings, []) if prior.has_elements else None
    telling = telling_of(prior, looked, found, settings)
    verdicts = None if found is None else retold(found, telling, settings.verdicts)
    wanted = _of_classes(prior, verdicts, settings)
    mismatches = mismatches_of(prior, looked, wanted, settings, past_gone)
    watch.lap("objects")
    elements = _elements(prior, verdicts, placed, looked, stands, settings) if verdicts is not None else ()
    elements = _with_boxes(drawn_prior, elements)  # where the model has them, not where they stand
    if verdicts is not None:
        elements = wholes_of(prior, verdicts, elements, settings)
    watch.lap("next views")
    records = _records(prior, scans, placed, (told, stands, settings, mismatches), telling)
    # Drawn are the rays as the whole model has them, and what the points are held for in the end.
    pairs = zip(looked, past_gone or looked, strict=True)
    drawn = [new._replace(added=new.added._replace(view=one.added.view)) for one, new in pairs]
    drawing = _drawing(drawn_prior, drawn, placed)
    unknown = things_not_in_model(prior, looked, mismatches, settings.unexplained) if beyond_thesis else ()
    registration = {
        "refined": settings.refine,
        "residual": float(np.max([one.residual for one in placed])),
        "scans": [one.registration for one in records],
    }
    notes = (*prior.notes, *notes_on(mismatches, elements), *open_doors(_doors_passed(prior, verdicts, settings)))
    return Detection(
        mismatches, elements, records, registration, settings.as_json(), watch.laps(), notes, drawing,
        unexplained=unknown,
    )  # fmt: skip


class _Watch:
    """Seconds of the steps of a detection, and of all."""

    def __init__(self):
        self._start = self._last = time.perf_counter()
        self._laps: dict[str, float] = {}

    def lap(self, step: str) -> None:
        """The time since the step before."""
        now = time.perf_counter()
        self._laps[step], self._last = now - self._last, now

    def laps(self) -> dict[str, float]:
        return self._laps | {"total": time.perf_counter() - self._start}


def _rays(prior: Prior, placed: list[Placed], scans: list[NamedScan]) -> list[ScanRays]:
    """The rays of each scan, where it was placed."""
    found = []
    for one, scan in zip(placed, scans, strict=True):
        try:
            found.append(toward_far_elements(prior, one.scan, rays_of_scan(one.scan), scan.whole))
        except (InputError, ValueError) as error:
            raise InputError(f"{scan.file}: {error}") from error
    return found


def _looked_at(
    prior: Prior, rays: list[ScanRays], scans: list[NamedScan], outdoors: list[bool], judges: Judges
) -> tuple[list[Looked], list[Told | None]]:
    """Each scan as `look_at` has it, of those from outdoors only what is of the building."""
    looked, told = [], []
    for one, scan, is_out in zip(rays, scans, outdoors, strict=True):
        try:
            found, says = look_at(prior, one, judges)
        except (InputError, ValueError) as error:
            raise InputError(f"{scan.file}: {error}") from error
        looked.append(of_building_only(prior, found) if is_out else found)
        told.append(says)
    return looked, told


def look_at(
    prior: Prior, rays: ScanRays, judges: Judges, changes: Sequence[str] = MISMATCH_TYPES
) -> tuple[Looked, Told | None]:
    """Both sides of one scan, judged; and what it tells of each element of a building.

    Args:
        prior: what should be there.
        rays: of the scan.
        judges: the models.
        changes: which of MISMATCH_TYPES is judged; where "removed" is left out, nothing is told of elements.
    """
    notes = ()
    if prior.has_elements:
        seen = sight(prior, rays)
        expected = seen.expected.distance
    else:
        seen, expected = compare(prior.cloud, rays), np.full(len(rays.distance), np.inf, np.float32)
        notes = seen.notes
    frame = seen.frame
    added, removed = (
        judge(judges, view, frame, change) if change in changes else unjudged(view)
        for change, view in (("added", seen.robot), ("removed", seen.prior))
    )
    looked = Looked(rays, expected, added, removed, (frame.floor, frame.ceiling), notes)
    if not prior.has_elements or "removed" not in changes:
        return looked, None
    return looked, told_of(seen.reached, removed.view.element, removed.view.count, removed.probability)


def _for_sure(
    prior: Prior, looked: list[Looked], scans: list[NamedScan], settings: DetectSettings, told: list[Told | None]
) -> list[Told | None]:
    """What scans tell; those whose pose is estimated, of what is gone only what they would tell from beside, too."""
    return [
        says if says is None or scan.deviation is None else for_sure(prior.scene, one.rays, says, settings.verdicts)
        for one, scan, says in zip(looked, scans, told, strict=True)
    ]


def _verdicts(told: list[Told], stands: AsBuilt, settings: DetectSettings, telling: list[Telling]) -> list[Verdict]:
    """Of each element, by all that scans tell."""
    found = with_displaced(verdicts_of(told, settings.verdicts), stands, settings.verdicts.least_rays)
    return retold(found, telling, settings.verdicts)


def _of_classes(prior: Prior, verdicts: list[Verdict] | None, settings: DetectSettings) -> list[Verdict] | None:
    """The verdicts, with those of all other classes left open."""
    if verdicts is None:
        return None
    wanted = settings.asked(prior.building.elements)
    return [one if mine else one._replace(verdict=OCCLUDED) for one, mine in zip(verdicts, wanted, strict=True)]


def _doors_passed(prior: Prior, verdicts: list[Verdict] | None, settings: DetectSettings) -> list[str]:
    """Names of the doors that rays pass, in walls that stand; of none that gets a verdict."""
    if verdicts is None:
        return []
    table = prior.building.elements
    passed = np.array([one.verdict == REMOVED for one in verdicts]) & (table.semantic == DOOR) & ~settings.asked(table)
    if passed.any():
        passed &= ~filling(prior.building, holders(prior.building, gone_of(prior.building, verdicts)))
    return [repr(table.name[row] or table.guid[row]) for row in np.flatnonzero(passed)]


def _elements(
    prior: Prior,
    verdicts: list[Verdict],
    placed: list[Placed],
    looked: list[Looked],
    stands: AsBuilt,
    settings: DetectSettings,
) -> tuple[ElementVerdict, ...]:
    """The verdicts of the wanted classes, with a view to take next where one was hidden."""
    table, storeys = prior.building.elements, prior.building.storeys
    rows = np.flatnonzero(settings.asked(table))
    hidden, views = np.array([row for row in rows if verdicts[row].verdict == OCCLUDED], int), {}
    if len(hidden) and settings.propose_views:
        gone = gone_of(prior.building, verdicts)
        gone |= filling(prior.building, holders(prior.building, gone))
        gone[hidden] = False
        remains = remains_of(prior, gone) if gone.any() else prior
        views = dict(zip(hidden.tolist(), _views(remains, placed, looked, hidden), strict=True))
    found = {
        row: ElementVerdict(
            table.guid[row], table.ifc_class[row], table.name[row],
            storeys.name[table.storey[row]] if table.storey[row] >= 0 else "",
            *verdicts[row], views.get(row), stands.deviations.get(row), table.file[row],
        )
        for row in rows.tolist()
    }  # fmt: skip
    return tuple(one for row in found for one in with_twins(found[row], prior.building, row, settings.semantics))


def _with_boxes(prior: Prior, elements: tuple[ElementVerdict, ...]) -> tuple[ElementVerdict, ...]:
    """The same, each with the box around it."""
    if not elements:
        return ()
    row = {guid: number for number, guid in enumerate(prior.building.elements.guid)}
    triangles, wanted = prior.building.triangles, np.array([row[one.guid] for one in elements])
    boxes = boxes_of(triangles.vertices, triangles.faces, triangles.element, wanted)
    return tuple(
        one._replace(box=None if box is None else box.shifted(prior.origin))
        for one, box in zip(elements, boxes, strict=True)
    )


def _views(prior: Prior, placed: list[Placed], looked: list[Looked], hidden: np.ndarray) -> list[Pose | None]:
    """For the sensor of the scan that is nearest, in what remains, with all else that any robot saw standing there."""
    seen = np.concatenate([one.added.view.points for one in looked])
    unknown = seen[clearance(prior.scene, seen, UNKNOWN) >= UNKNOWN]
    stands = tuple(stand_of(fit.scan, one.rays, one.levels[0]) for fit, one in zip(placed, looked, strict=True))
    stage = Stage(prior.building, prior.scene, unknown, stands)
    found = []
    for view in next_views(stage, hidden):
        if view is None:
            found.append(None)
            continue
        position, yaw, pitch = view
        found.append((*(float(value) for value in position + prior.origin), yaw, pitch))
    return found


def _records(
    prior: Prior,
    scans: list[NamedScan],
    placed: list[Placed],
    told: tuple[list[Told | None], AsBuilt, DetectSettings, tuple[Mismatch, ...]],
    telling: list[Telling],
) -> tuple[ScanRecord, ...]:
    """What is known of every scan: which verdicts it changed beyond those before it, which mismatches it shows."""
    (says, stands, settings, mismatches), records = told, []
    shows, alone = shown_by_each(mismatches, len(scans))
    if prior.has_elements:
        wanted = settings.asked(prior.building.elements)
        before = np.full(int(wanted.sum()), UNSCANNED)
    for number, (one, fit) in enumerate(zip(scans, placed, strict=True)):
        changed = dict.fromkeys(VERDICTS, 0)
        if prior.has_elements:
            count = number + 1
            by_these = _verdicts(says[:count], stands.by(count), settings, telling[:count])
            now = np.array([found.verdict for found in by_these])[wanted]
            new = now[now != before]
            changed |= {name: int(np.sum(new == name)) for name in VERDICTS}
            before = now
        registration = {
            "shift": fit.shift, "turn": fit.turn, "residual": fit.residual, "overlap": fit.overlap,
            "overlap_before": fit.overlap_before,
        }  # fmt: skip
        pose = _pose_of(fit.scan, prior.origin)
        records.append(ScanRecord(
            one.file, one.points, pose, one.pose_source, one.deviation, registration, changed,
            (*one.notes, *fit.notes, *fit.open),
            int(shows[number]), int(alone[number]), (*one.doubts, *fit.notes),
        ))  # fmt: skip
    return tuple(records)


def _pose_of(scan: PosedScan, origin: np.ndarray) -> Pose:
    forward = scan.rotation[:, 0]
    yaw, pitch = np.arctan2(forward[1], forward[0]), np.arcsin(np.clip(forward[2], -1.0, 1.0))
    return (*(float(value) for value in scan.position + origin), float(np.degrees(yaw)), float(np.degrees(pitch)))


def _drawing(prior: Prior, looked: list[Looked], placed: list[Placed]) -> Drawing:
    """The points and surfaces behind it all."""

    def joined(change: str, field: str) -> np.ndarray:
        sides: list[Side] = [getattr(one, change) for one in looked]
        return np.concatenate([
            getattr(side, field) if hasattr(side, field) else getattr(side.view, field) for side in sides
        ])  # fmt: skip

    triangles, table = (prior.building.triangles, prior.building.elements) if prior.has_elements else (None, None)
    count = [len(one.added.view.points) for one in looked]
    return Drawing(
        prior.origin,
        joined("added", "points"), joined("added", "probability"), joined("added", "evidence"),
        np.repeat(np.arange(len(looked), dtype=np.int32), count),
        joined("removed", "points"), joined("removed", "probability"), joined("removed", "evidence"),
        joined("removed", "element").astype(np.int32),
        table.guid if table else (),
        *((triangles.vertices, triangles.faces, triangles.element) if triangles is not None else (None, None, None)),
        tuple(_corners(one.scan) for one in placed),
        *((table.file, tuple(tuple((one.file, one.guid) for one in own) for own in table.twins)) if table else ()),
    )  # fmt: skip


def _corners(scan: PosedScan) -> np.ndarray:
    """Unit vectors (4, 3) to the corners of a camera's picture, in order around it; (0, 3) of any other sensor."""
    if not isinstance(scan.sensor, Pinhole):
        return np.zeros((0, 3), np.float32)
    wide, high = (np.tan(np.radians(fov) / 2) for fov in (scan.sensor.horizontal_fov, scan.sensor.vertical_fov))
    corners = np.array([[1.0, y, z] for y, z in ((wide, high), (-wide, high), (-wide, -high), (wide, -high))])
    return (corners / np.linalg.norm(corners, axis=1, keepdims=True) @ scan.rotation.T).astype(np.float32)
