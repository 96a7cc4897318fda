"""One station of a detection, step by step: what a scan says, and what of it is kept.

Each step is a pure function of what all stations share and of one station's shelf, and gives little: sums per element
and per face, which `jaxmm.verdicts.detection` fuses. So steps of many stations may be done one after another or side by
side, in this process or elsewhere, and nobody holds more than one station's rays.

E elements, P rays. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

from collections.abc import Callable, MutableMapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from jaxmm.classes.telling_rays import Telling, telling_rays
from jaxmm.deviations.deviation import faces_of
from jaxmm.deviations.moved_faces import faces_of_moved
from jaxmm.deviations.seen_surfaces import Faces
from jaxmm.deviations.shifted_columns import beside_columns
from jaxmm.inputs import InputError
from jaxmm.learning.boxes import MISMATCH_TYPES
from jaxmm.learning.prediction import Judges, Side, judge, unjudged
from jaxmm.objects.face_finish import Rays
from jaxmm.rays.joint_poses import Held, Station
from jaxmm.rays.own_ranges import own_ranges
from jaxmm.rays.patches import patches_of
from jaxmm.rays.scan_rays import PosedScan, ScanRays, rays_of_scan
from jaxmm.verdicts.as_built import knows_deviations, panes_of, trust_in
from jaxmm.verdicts.behind_removed import Says, ask_again, judged_anew, past_nothing
from jaxmm.verdicts.building_evidence import sight
from jaxmm.verdicts.cloud_comparison import compare
from jaxmm.verdicts.far_elements import toward_far_elements
from jaxmm.verdicts.mirrors import unmirrored
from jaxmm.verdicts.mismatches import alone_of
from jaxmm.verdicts.named_scans import NamedScan, held_scan, laid_scan, placed_scan, settled_scan
from jaxmm.verdicts.outdoors import OUTDOORS, is_outdoors, of_building_only
from jaxmm.verdicts.placement import Placed
from jaxmm.verdicts.priors import Prior, known_of
from jaxmm.verdicts.scan_fusion import Looked, rays_to_faces
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.standing_alone import Alone, Boxes, for_sure, of_boxes
from jaxmm.verdicts.verdicts import Told, told_of


class Context(NamedTuple):
    """What all stations share."""

    prior: Prior
    judges: Judges
    settings: DetectSettings

    @property
    def beyond_thesis(self) -> bool:
        """Whether all is done that the thesis's preset leaves out."""
        return self.settings.preset != "thesis"


Shelf = MutableMapping[str, Any]  # what is kept of one station from step to step


class Stations(Protocol):
    """Places that scans were taken from, each with a shelf: first of all its NamedScan stands there as "scan"."""

    left_out: Sequence[str]  # why some do not count any more, a line each

    def each(
        self,
        step: Callable[..., Any],
        prior: Prior,
        *arguments: Any,
        own: Sequence[Any] | None = None,
        may_leave_out: bool = False,
    ) -> list[Any]:
        """What step(context, shelf, *arguments) gives of each station, in their order, wherever it is done.

        Where each has an argument of its `own`, that comes last.
        Only where it says so may one that cannot be used be left out: later, what it showed counts already.
        """

    def kept(self, load: Callable[[Shelf], Any]) -> Sequence[Any]:
        """Of each station something from its shelf, which is loaded when it is asked for."""


class HeldStations:
    """Stations whose shelves this process holds."""

    left_out: Sequence[str] = ()

    def __init__(self, shelves: list[Shelf], judges: Judges, settings: DetectSettings):
        self._shelves = shelves
        self._judges, self._settings = judges, settings

    def each(
        self,
        step: Callable[..., Any],
        prior: Prior,
        *arguments: Any,
        own: Sequence[Any] | None = None,
        may_leave_out: bool = False,
    ) -> list[Any]:
        """One after another; none is left out."""
        context = Context(prior, self._judges, self._settings)
        each = [()] * len(self._shelves) if own is None else [(one,) for one in own]
        return [step(context, shelf, *arguments, *last) for shelf, last in zip(self._shelves, each, strict=True)]

    def kept(self, load: Callable[[Shelf], Any]) -> list[Any]:
        """All at once."""
        return [load(shelf) for shelf in self._shelves]


class Stood(NamedTuple):
    """One station with what is known of it; without its points."""

    scan: NamedScan
    placed: Placed
    is_out: bool  # of the building


class Shown(NamedTuple):
    """What one station shows of faces."""

    stood: Stood
    faces: Faces | None  # None where nothing is measured


class Judged(NamedTuple):
    """What one station tells of elements."""

    notes: tuple[str, ...]
    says: Says | None  # None of a cloud


def lay_station(context: Context, shelf: Shelf, together: bool) -> Station | None:
    """First step: the ranges of a scan settle, and it is laid upon the prior; its surfaces, if others may hold it."""
    one, (prior, _, settings) = shelf.pop("scan"), context
    if settings.settle and context.beyond_thesis:
        one = settled_scan(one)
    placed, misfit = laid_scan(prior, one, settings) if together else (placed_scan(prior, one, settings), "")
    shelf["laid"] = one._replace(scan=_bare(one.scan)), placed, misfit
    if not together:
        return None
    return Station(patches_of(placed.scan.points, placed.scan.position), placed.scan.position, not misfit)


def face_station(context: Context, shelf: Shelf, held: Held | None) -> Shown:
    """Second step: where others hold it, its rays, and what they show of faces."""
    (one, *laid), (prior, _, settings) = shelf.pop("laid"), context
    placed = held_scan(prior, one, laid, held)
    is_out = is_outdoors(prior, placed.scan.position)
    if is_out:
        one = one._replace(notes=(*one.notes, OUTDOORS))
    try:
        rays = rays_of_scan(placed.scan)
        if settings.mirrors and context.beyond_thesis:
            scan, notes = unmirrored(prior, placed.scan, rays)
            if notes:
                # Images would come back with all points as they were measured.
                one, placed = one._replace(notes=(*one.notes, *notes), whole=None), placed._replace(scan=scan)
                rays = rays_of_scan(scan)
        rays = toward_far_elements(prior, placed.scan, rays, one.whole)
    except (InputError, ValueError) as error:
        raise InputError(f"{one.file}: {error}") from error
    stood = Stood(one._replace(whole=None), placed._replace(scan=_bare(placed.scan)), is_out)
    shelf["rays"], shelf["stood"] = rays, stood
    if not knows_deviations(prior, settings):
        return Shown(stood, None)
    shelf["own"] = own_ranges(rays, placed.scan.rotation, one.whole if one.is_settled else None)
    trust = trust_in(placed, settings.refine)
    faces = faces_of(prior.scene, rays, trust, shelf["own"], panes_of(prior))
    shelf["beside"] = beside_columns(prior.scene, rays, settings.deviations.most, faces.ends)
    shelf["poses"] = faces.poses
    return Shown(stood, faces)


def moved_station(context: Context, shelf: Shelf, rows: np.ndarray) -> Faces:
    """Where columns were found beside their places: what its rays show of them (n,) there."""
    prior = context.prior
    return faces_of_moved(prior.scene, shelf["rays"], rows, shelf["poses"], shelf["own"], panes_of(prior))


def look_station(context: Context, shelf: Shelf) -> Judged:
    """Third step: both sides, judged; of a scan from outdoors only what is of the building."""
    stood = shelf["stood"]
    try:
        found, told = look_at(context.prior, shelf["rays"], context.judges)
    except (InputError, ValueError) as error:
        raise InputError(f"{stood.scan.file}: {error}") from error
    if stood.is_out:
        found = of_building_only(context.prior, found)
    shelf["looked"], shelf["told"] = found._replace(rays=None), told
    return Judged(found.notes, None if told is None else _says(context, shelf, told))


def ask_station(context: Context, shelf: Shelf, gone: np.ndarray) -> Says | None:
    """What it tells without what is gone (E,); None where it shows nothing more to be gone."""
    (prior, judges, settings), one = context, looked_of(shelf)
    view = shelf["past"] if "past" in shelf else past_nothing(one, shelf["told"])
    new = ask_again(prior, one, view, gone, judges, settings.verdicts)
    if new is view:
        return None
    shelf["past"] = new
    return _says(context, shelf, new.told)


def anew_station(context: Context, shelf: Shelf) -> None:
    """What is new past what is gone."""
    if "past" in shelf:
        found = judged_anew(context.prior, looked_of(shelf), shelf["past"], context.judges)
        shelf["anew"] = found._replace(rays=None)


def alone_station(context: Context, shelf: Shelf, rows: list[int]) -> list[Alone]:
    """What its rays say of elements that are gone, one by one."""
    return alone_of(context.prior, shelf["rays"], rows)


def boxes_station(context: Context, shelf: Shelf, asked: Boxes, is_asked: bool) -> list[Alone]:
    """What its rays say of objects that may stand there, one by one; nothing where it is not asked."""
    if not is_asked:
        return []
    one = past_of(shelf) if asked.is_past else looked_of(shelf)
    return of_boxes(asked, one.expected, one.rays)


def telling_station(context: Context, shelf: Shelf, others: np.ndarray, gone: np.ndarray) -> Telling:
    """What its rays tell of some elements (E,) bool that nothing else explains, without what is gone (E,) bool."""
    found, vacant = telling_rays(known_of(context.prior), shelf["rays"], others, gone), context.prior.vacant
    return found if vacant is None else found._replace(support=np.where(vacant, 0, found.support))


def _bare(scan: PosedScan) -> PosedScan:
    return scan._replace(points=np.zeros((0, 3), np.float32), unseen=None)


def looked_of(shelf: Shelf) -> Looked:
    """The scan after all was asked of it, with its rays."""
    return shelf["looked"]._replace(rays=shelf["rays"])


def rays_of(shelf: Shelf) -> Rays:
    """All its rays, as faces are asked about."""
    return rays_to_faces(shelf["rays"])


def past_of(shelf: Shelf) -> Looked:
    """The same compared with what remains, where it shows something to be gone."""
    return shelf["anew"]._replace(rays=shelf["rays"]) if "anew" in shelf else looked_of(shelf)


def drawn_of(shelf: Shelf) -> tuple[Side, Side]:
    """Its rays as the whole model has them, and what the points are held for in the end."""
    old = shelf["looked"]
    new = shelf["anew"] if "anew" in shelf else old
    return new.added._replace(view=old.added.view), new.removed


def _says(context: Context, shelf: Shelf, told: Told) -> Says:
    """What a scan tells; one whose pose is estimated, of what is gone only what it would tell from beside, too."""
    if shelf["stood"].scan.deviation is None:
        return Says(told, told)
    return Says(told, for_sure(context.prior.scene, shelf["rays"], told, context.settings.verdicts))


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
