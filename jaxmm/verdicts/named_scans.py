"""Robot scans with what is known of their files: their ranges settle, and they are laid upon the prior.

Positions are offsets from the prior's origin, world axes: metres, z up.
"""

import dataclasses
from functools import partial
from typing import NamedTuple

from jaxmm.formats.dates import Taken
from jaxmm.inputs import InputError, Misfit
from jaxmm.rays.joint_poses import Held
from jaxmm.rays.range_noise import settled
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.verdicts.building_evidence import passed_by, surfaces_along, surfaces_for
from jaxmm.verdicts.cloud_comparison import visible
from jaxmm.verdicts.contradictions import doubts_by_rays
from jaxmm.verdicts.placement import InFile, Placed, hold, place
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.results import Pose
from jaxmm.verdicts.settings import DetectSettings
from warp_scanner.buildings.positions import away_from
from warp_scanner.lengths import length_in_words

LEAST_TOLD = 0.0005  # share of the points left out of a scan that is worth a word


class NamedScan(NamedTuple):
    """A robot scan with what is known of its file."""

    scan: PosedScan
    file: str
    points: int  # in the file
    pose_source: str  # "given", "file", "estimated" or "searched"
    deviation: Pose | None = None  # standard deviations of an estimated pose
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()  # those of its notes that say that its points contradict its pose
    whole: PosedScan | None = None  # with all its points as they were measured, where some were drawn from it to settle
    is_settled: bool = False  # whether ranges are others than those of `whole`
    taken: Taken | None = None  # when; None where nobody knows
    unit: float = 1.0  # [m] in which its file was read


def settled_scan(one: NamedScan) -> NamedScan:
    """A scan whose ranges have settled, with what is to be said of that."""
    found = settled(one.scan)
    if found.scan is one.scan and not found.stray:
        return one
    if found.scan is one.scan:
        note = f"{found.stray:.0%} of its points are on no plane with others: its ranges are taken as they are"
        return one._replace(notes=(*one.notes, note))
    note = f"its ranges err by {found.sigma * 1000:.{1 if found.sigma < 0.01 else 0}f} mm"
    if found.moved:
        note += ": settled on the planes around them"
    if found.stray >= LEAST_TOLD:
        note += f"; {found.stray:.1%} of the points, between surfaces or behind edges, were left out"
    return one._replace(scan=found.scan, notes=(*one.notes, note), whole=one.scan, is_settled=found.moved)


def placed_scan(prior: Prior, one: NamedScan, settings: DetectSettings) -> Placed:
    """A scan where it fits the prior best, with its doubts.

    Raises:
        InputError: it does not fit; the line names its file.
    """
    try:
        rays = rays_of_scan(one.scan, holes=not prior.has_elements)
        if prior.has_elements:
            found = place(
                one.scan, surfaces_along(prior.scene, rays), refine=settings.refine, limits=settings.limits,
                passed=lambda: passed_by(prior.scene, rays),
                shown=partial(surfaces_for, prior.scene), in_file=InFile(-prior.origin, one.unit),
            )  # fmt: skip
            doubts = doubts_by_rays(prior.scene, found.scan) if settings.preset != "thesis" else ()
            return found._replace(notes=(*found.notes, *doubts))
        return place(
            one.scan, visible(prior.cloud, rays), refine=settings.refine, limits=settings.cloud_limits,
            in_sight_only=True, shown=lambda there: visible(prior.cloud, rays_of_scan(there)),
            in_file=InFile(-prior.origin, one.unit),
        )  # fmt: skip
    except (InputError, ValueError) as error:
        away = away_from(prior.building, one.scan.position) if prior.has_elements else 0.0
        where = f"; it would be {length_in_words(away)} outside the building" if away > 0.0 else ""
        kind = Misfit if isinstance(error, Misfit) else InputError
        raise kind(f"{one.file}: {error}{where}") from error


def laid_scan(prior: Prior, one: NamedScan, settings: DetectSettings) -> tuple[Placed, str]:
    """The same of one scan of several, which others may hold: as it is believed, and why, where it does not fit alone.

    Raises:
        InputError: nothing can be said of how it lies; the line names its file.
    """
    try:
        return placed_scan(prior, one, settings), ""
    except Misfit as error:
        try:
            return placed_scan(prior, one, dataclasses.replace(settings, refine=False)), str(error)
        except InputError:
            raise error from None


def held_scan(prior: Prior, one: NamedScan, laid: tuple[Placed, str], held: Held | None) -> Placed:
    """A scan that was laid by `laid_scan`, where others hold it if they do, with its doubts.

    Raises:
        Misfit: it fits neither the prior nor the others; the line names its file.
    """
    placed, misfit = laid
    if held is None:
        if misfit:
            raise Misfit(misfit)
        return placed
    try:
        shown = partial(surfaces_for, prior.scene)
        found = hold(placed, held, one.scan, shown, bool(misfit), InFile(-prior.origin, one.unit))
        return found._replace(notes=(*found.notes, *doubts_by_rays(prior.scene, found.scan)))
    except Misfit as error:
        raise Misfit(f"{one.file}: {error}") from error
