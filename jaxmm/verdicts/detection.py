"""Detection: robot scans against a prior, from arrays to mismatches and verdicts.

S scans, E elements. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

import time

import numpy as np

from jaxmm.classes.lacking import lacking_notes
from jaxmm.classes.telling_rays import Telling
from jaxmm.deviations.seen_surfaces import Faces
from jaxmm.learning.element_boxes import boxes_of
from jaxmm.learning.prediction import Judges
from jaxmm.rays.joint_poses import REACHES, held_together
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.as_built import AsBuilt, as_built, knows_deviations, with_displaced
from jaxmm.verdicts.behind_removed import filling, gone_of, holders, look_past_what_is_gone, remains_of
from jaxmm.verdicts.hanging_openings import without_hanging
from jaxmm.verdicts.mismatch_points import drawing_of
from jaxmm.verdicts.mismatches import Asks, mismatches_of, shown_by_each
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.next_view import Stage, next_views, stand_of
from jaxmm.verdicts.outdoors import things_not_in_model
from jaxmm.verdicts.placement import correction_of
from jaxmm.verdicts.priors import Prior, unasked, without_stray
from jaxmm.verdicts.results import (
    Detection,
    ElementVerdict,
    Mismatch,
    Pose,
    ScanRecord,
    notes_on,
    open_doors,
    with_twins,
)
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.station_steps import (
    HeldStations,
    Stations,
    Stood,
    alone_station,
    anew_station,
    ask_station,
    boxes_station,
    drawn_of,
    face_station,
    lay_station,
    look_station,
    looked_of,
    moved_station,
    past_of,
    rays_of,
    telling_station,
)  # fmt: skip
from jaxmm.verdicts.verdicts import (
    OCCLUDED,
    REMOVED,
    UNSCANNED,
    VERDICTS,
    Told,
    Verdict,
    of_pieced,
    pieces_together,
    retold,
    verdicts_of,
)
from jaxmm.verdicts.wholes import telling_of, wholes_of
from warp_scanner.scenes.scenes import DOOR
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
    return detect_stations(prior, HeldStations([{"scan": one} for one in scans], judges, settings), settings)


def detect_stations(prior: Prior, stations: Stations, settings: DetectSettings) -> Detection:
    """Compare what was scanned from some stations with a prior.

    Every step is done station by station, and gives sums: per element, per face, per place. These are fused here.

    Raises:
        InputError: a scan does not fit; the line names its file.
    """
    beyond_thesis, watch = settings.preset != "thesis", _Watch()
    asked = settings.asked(prior.building.elements) if prior.has_elements else np.zeros(0, bool)
    if prior.has_elements:
        said = lacking_notes(settings.classes, prior.building) + unasked(prior.building, asked)
        prior = prior._replace(notes=(*prior.notes, *said))
    if settings.settle and beyond_thesis:
        prior = without_stray(prior)
    together = prior.has_elements and beyond_thesis and settings.refine and len(stations.kept(len)) > 1
    laid = stations.each(lay_station, prior, together, may_leave_out=True)
    held = held_together(laid, lambda points: distance_to(prior, points)) if together else [None] * len(laid)
    watch.lap("registration")
    if beyond_thesis:
        prior = without_hanging(prior, asked)
    shown = stations.each(face_station, prior, own=held, may_leave_out=True)
    stood = [one.stood for one in shown]
    drawn_prior, stands = prior, _as_built(prior, stations, [one.faces for one in shown], settings)
    prior = stands.prior
    watch.lap("deviations")
    looked = stations.each(look_station, prior)
    stood = [
        one._replace(scan=one.scan._replace(notes=(*one.scan.notes, *found.notes)))
        for one, found in zip(stood, looked, strict=True)
    ]
    says, is_past = [one.says for one in looked], False
    if prior.has_elements and beyond_thesis:
        new = look_past_what_is_gone(
            prior.building, says, settings.verdicts, lambda gone: stations.each(ask_station, prior, gone)
        )
        is_past, says = any(one is not old for one, old in zip(new, says, strict=True)), new
    if is_past:
        stations.each(anew_station, prior)
    told = [None if one is None else one.sure for one in says]
    watch.lap("evidence")
    found = _by_networks(told, stands, settings) if prior.has_elements else None
    telling = telling_of(
        prior, found, settings, lambda others, gone: stations.each(telling_station, prior, others, gone)
    )
    verdicts = None if found is None else retold(found, telling, settings.verdicts)
    wanted = _of_classes(prior, verdicts, settings)
    seen = stations.kept(looked_of)
    past_gone = stations.kept(past_of) if is_past else None
    asks = Asks(
        lambda rows: stations.each(alone_station, prior, rows),
        lambda boxes, chosen: stations.each(boxes_station, prior, boxes, own=chosen),
        stations.kept(rays_of),
    )
    mismatches = mismatches_of(prior, seen, wanted, settings, past_gone, asks)
    watch.lap("objects")
    elements = _elements(prior, verdicts, (stations, stood), stands, settings) if verdicts is not None else ()
    elements = _with_boxes(drawn_prior, elements)  # where the model has them, not where they stand
    if verdicts is not None:
        elements = wholes_of(prior, verdicts, elements, settings, stands)
    watch.lap("next views")
    records = _records(prior, stood, (told, stands, settings, mismatches), telling)
    drawing = drawing_of(drawn_prior, stations.kept(drawn_of), [one.placed.scan for one in stood])
    unknown = things_not_in_model(prior, seen, mismatches, settings.unexplained) if beyond_thesis else ()
    registration = {
        "refined": settings.refine,
        "residual": float(np.max([one.placed.residual for one in stood])),
        "scans": [one.registration for one in records],
    }
    doors = open_doors(_doors_passed(prior, verdicts, settings))
    notes = (*prior.notes, *stations.left_out, *notes_on(mismatches, elements), *doors)
    return Detection(
        mismatches, elements, records, registration, settings.as_json(), watch.laps(), notes, drawing,
        unexplained=unknown,
    )  # fmt: skip


def distance_to(prior: Prior, points: np.ndarray) -> np.ndarray:
    """(n,) [m] from points (n, 3) [m] to the surface of a building, as far as scans are matched."""
    return clearance(prior.scene, points.astype(np.float32), 2.0 * REACHES[0]).astype(np.float64)


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


def _as_built(prior: Prior, stations: Stations, faces: list[Faces], settings: DetectSettings) -> AsBuilt:
    if not knows_deviations(prior, settings):
        return AsBuilt(prior, {}, np.zeros(0), {})
    beside = stations.kept(lambda shelf: shelf["beside"])
    return as_built(prior, faces, beside, lambda there, rows: stations.each(moved_station, there, rows), settings)


def _by_networks(told: list[Told], stands: AsBuilt, settings: DetectSettings) -> list[Verdict]:
    """Of each element, by all that scans tell but what nothing else explains."""
    found = pieces_together(stands.prior.building, verdicts_of(told, settings.verdicts), settings.verdicts)
    return with_displaced(found, stands, settings.verdicts.least_rays)


def _of_classes(prior: Prior, verdicts: list[Verdict] | None, settings: DetectSettings) -> list[Verdict] | None:
    """The verdicts, with those of all other classes left open, but for pieces of what is asked for."""
    if verdicts is None:
        return None
    wanted = settings.asked(prior.building.elements)
    for whole, rows, _ in of_pieced(prior.building, verdicts, settings.verdicts.change_prior):
        wanted[rows] |= settings.asks_for(whole.element.ifc_class, whole.element.semantic)
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
    seen_from: tuple[Stations, list[Stood]],
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
        views = dict(zip(hidden.tolist(), _views(remains, *seen_from, hidden), strict=True))
    found = {
        row: ElementVerdict(
            table.guid[row], table.ifc_class[row], table.name[row],
            storeys.name[table.storey[row]] if table.storey[row] >= 0 else "",
            *verdicts[row], views.get(row), stands.deviation(row), file=table.file[row],
        )
        for row in rows.tolist()
    }  # fmt: skip
    return tuple(one for row in found for one in with_twins(found[row], prior.building, row, settings.asks_for))


def _with_boxes(prior: Prior, elements: tuple[ElementVerdict, ...]) -> tuple[ElementVerdict, ...]:
    """The same, each with the box around it."""
    if not elements:
        return ()
    table, triangles = prior.building.elements, prior.building.triangles
    row = {key: number for number, key in enumerate(zip(table.file, table.guid, strict=True))}
    # A twin has no triangles of its own: it is where the one is that keeps them.
    rows = [next(row[key] for key in (one.key, *one.same_as) if key in row) for one in elements]
    boxes = boxes_of(triangles.vertices, triangles.faces, triangles.element, np.array(rows))
    return tuple(
        one._replace(box=None if box is None else box.shifted(prior.origin))
        for one, box in zip(elements, boxes, strict=True)
    )


def _views(prior: Prior, stations: Stations, stood: list[Stood], hidden: np.ndarray) -> list[Pose | None]:
    """For the sensor of the scan that is nearest, in what remains, with all else that any robot saw standing there."""
    unknown, stands = [], []
    for one, looked in zip(stood, stations.kept(looked_of), strict=True):
        seen = looked.added.view.points
        unknown.append(seen[clearance(prior.scene, seen, UNKNOWN) >= UNKNOWN])
        stands.append(stand_of(one.placed.scan, looked.rays, looked.levels[0]))
    unknown, stands = np.concatenate(unknown), tuple(stands)
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
    stood: list[Stood],
    told: tuple[list[Told | None], AsBuilt, DetectSettings, tuple[Mismatch, ...]],
    telling: list[Telling],
) -> tuple[ScanRecord, ...]:
    """What is known of every scan: which verdicts it changed beyond those before it, which mismatches it shows."""
    (says, stands, settings, mismatches), records = told, []
    shows, alone = shown_by_each(mismatches, len(stood))
    if prior.has_elements:
        wanted = settings.asked(prior.building.elements)
        before = np.full(int(wanted.sum()), UNSCANNED)
    for number, (one, fit, _) in enumerate(stood):
        changed = dict.fromkeys(VERDICTS, 0)
        if prior.has_elements:
            count = number + 1
            by_these = _by_networks(says[:count], stands.by(count), settings)
            by_these = retold(by_these, telling[:count], settings.verdicts)
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
            (*one.notes, *correction_of(fit, one.pose_source), *fit.notes, *fit.open),
            int(shows[number]), int(alone[number]), (*one.doubts, *fit.notes), one.taken,
        ))  # fmt: skip
    return tuple(records)


def _pose_of(scan: PosedScan, origin: np.ndarray) -> Pose:
    forward = scan.rotation[:, 0]
    yaw, pitch = np.arctan2(forward[1], forward[0]), np.arcsin(np.clip(forward[2], -1.0, 1.0))
    return (*(float(value) for value in scan.position + origin), float(np.degrees(yaw)), float(np.degrees(pitch)))
