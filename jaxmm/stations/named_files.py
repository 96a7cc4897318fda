"""A scan of a file in its place: with the pose that was given, that its file says, or that is searched or estimated.

Positions are offsets from the prior's origin, world axes: metres, z up.
"""

import contextlib
import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from jaxmm.formats.cloud_frames import FRAMES
from jaxmm.formats.dates import taken_of
from jaxmm.formats.poses import SEARCH, GivenPose
from jaxmm.formats.readers import PointScan
from jaxmm.formats.units import FITS
from jaxmm.inputs import InputError, Misfit
from jaxmm.rays.scan_rays import PosedScan, even_draw
from jaxmm.rays.viewpoint import Viewpoint, doubts_about, estimate, estimate_by_other, is_turned_away
from jaxmm.stations.sources import ScanSource, scan_of
from jaxmm.vectors import lengths
from jaxmm.verdicts.alignment import lay
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.scan_frames import OwnScan, frame_that_fits, own_scan
from jaxmm.verdicts.searched_scans import searched_scan
from jaxmm.verdicts.station_steps import Context, Shelf
from warp_scanner.buildings.positions import away_from, span_of
from warp_scanner.clouds.voxels import thinned_cloud
from warp_scanner.lengths import length_in_words
from warp_scanner.scenes.building import ReadOptions
from warp_scanner.sensors.sensors import OAK_D_PRO, Pinhole, Sensor

ESTIMATED_FROM = 0.1  # [m] voxels of the cloud that a viewpoint is estimated from
ESTIMABLE = (
    "only a camera's can be, here of one that sees {:g} x {:g} degrees (--sensor); no scanner's that looks around"
)


@dataclasses.dataclass(frozen=True)
class Reading:
    """How files are to be read."""

    prior: ReadOptions = ReadOptions()
    unit: float | None = None  # [m] of the scans; None: told by how they lie on the prior
    # Of the scans' points: "world"; "sensor", "optical": the pose takes them to the world. None: the world's, or where
    # a file says a pose and not what it is of, the sensor's if that fits; see `own_scan`.
    frame: str | None = None
    sensor: Sensor | None = None  # None: any; its view is then what its points span
    topic: str | None = None  # of the clouds in bags; None: the only one

    def __post_init__(self):
        if self.frame not in (None, *FRAMES):
            raise InputError(f"--frame: expected {', '.join(FRAMES[:-1])} or {FRAMES[-1]}, got {self.frame!r}")
        if self.unit is not None and not 0.0 < self.unit < 1e6:
            raise InputError(f"--unit: expected a length in metres above 0, got {self.unit:g}")


def read_station(context: Context, shelf: Shelf, reading: Reading) -> None:
    """The step before all others: the scan of a source, unless it stands on the shelf as "read", in its place."""
    source: ScanSource = shelf["source"]
    file = Path(source.file)
    scan = shelf.pop("read") if "read" in shelf else scan_of(source)
    with told_of(file):
        if source.pose == SEARCH:
            own = searched_scan(context.prior, scan, reading.frame, reading.unit)
        else:
            own = own_scan(scan, source.pose, reading.frame)
        one = _named(context.prior, source.name, scan, own, reading)
        doubts = () if source.pose == SEARCH else _doubts_about_frame(context.prior, scan, source.pose, reading)
    one = one._replace(taken=taken_of(file, scan.taken))
    shelf["scan"] = one._replace(notes=(*one.notes, *doubts), doubts=(*one.doubts, *doubts))


def frames_that_fit(prior: Prior, sources: list[ScanSource], reading: Reading) -> set[str]:
    """In which other frames some scans would lie on the prior; "" for those that do as they are."""
    found = set()
    for one in sources:
        if one.pose != SEARCH:
            with contextlib.suppress(InputError):  # of one that cannot be read, and was to be left out
                found.add(frame_that_fits(prior, scan_of(one), one.pose, reading.frame, reading.unit))
    return found


@contextlib.contextmanager
def told_of(file: Path) -> Iterator[None]:
    """Errors that come up name the file."""
    try:
        yield
    except InputError as error:
        text, kind = str(error), Misfit if isinstance(error, Misfit) else InputError
        raise kind(text if text.startswith(str(file)) else f"{file}: {text}") from error


def _named(prior: Prior, name: str, scan: PointScan, own: OwnScan, reading: Reading) -> NamedScan:
    """One scan in its place, with all that was assumed about it."""
    laid = lay(prior, own, 1.0 if own.source == "searched" else reading.unit)
    pose, source, sensor, deviation = laid.pose, laid.source, reading.sensor, None
    notes, doubts = [*scan.remarks, *own.notes, *laid.notes], list(laid.doubts)
    if sensor is not None and laid.unseen is not None:
        notes.append("its file tells which rays brought nothing back: with --sensor the view is that sensor's instead")
    offsets = laid.offsets(prior.origin)
    thin = laid.way(laid.own[thinned_cloud(offsets, ESTIMATED_FROM)])
    if pose is not None:
        view = (sensor.horizontal_fov, sensor.vertical_fov) if isinstance(sensor, Pinhole) else None
        doubts += doubts_about(laid.way(even_draw(laid.own)), thin, *pose, view)
        # It changes nothing but what is drawn, and files of scanners that look around say nothing by it.
        if sensor is None and source == "given" and is_turned_away(thin, *pose):
            notes.append("hardly any of its points lies before the sensor, as it is turned: is its yaw right?")
    else:
        camera = sensor or OAK_D_PRO
        if not isinstance(camera, Pinhole):
            raise InputError(
                "only the viewpoint of a camera can be estimated from its points; give it with --pose, or have the "
                "place searched that the scan fits (--pose search)"
            )
        viewpoint, by = _viewpoint(prior, thin, camera)
        view = f"{camera.horizontal_fov:g} x {camera.vertical_fov:g} degrees"
        notes.append(f"its pose is estimated{by}, for a camera that sees {view}")
        pose = viewpoint.position, GivenPose(viewpoint.position, viewpoint.yaw, viewpoint.pitch).rotation
        deviation = tuple(float(value) for value in viewpoint.deviation)
    placed = PosedScan(offsets, pose[0] - prior.origin, pose[1], sensor, laid.unseen)
    _check_place(prior, placed, thin - prior.origin, source)
    return NamedScan(
        placed, name, len(scan.points), source, deviation, (*notes, *doubts), tuple(doubts), unit=laid.unit
    )  # fmt: skip


def _doubts_about_frame(prior: Prior, scan: PointScan, pose: GivenPose | None, reading: Reading) -> tuple[str, ...]:
    """That most of a scan would lie on the prior in another frame, and far less does as it is stated."""
    other = frame_that_fits(prior, scan, pose, reading.frame, reading.unit, FITS)
    return (f"far more of its points would lie on the prior {other}",) if other else ()


def _viewpoint(prior: Prior, thin: np.ndarray, camera: Pinhole) -> tuple[Viewpoint, str]:
    """Where a camera stood, by its own points or else by the prior's, of which a phrase for the note tells."""
    view = camera.horizontal_fov, camera.vertical_fov
    try:
        return estimate(thin, *view, pitch=None), ""
    except InputError as error:
        alone = InputError(f"{error}; {ESTIMABLE.format(*view)}")
    if prior.cloud is not None:
        with contextlib.suppress(InputError):
            found = estimate_by_other(thin, prior.cloud.astype(np.float64) + prior.origin, *view)
            return found, " from the points of the prior, as of a scan from the same place"
    raise alone


def _check_place(prior: Prior, scan: PosedScan, thin: np.ndarray, source: str) -> None:
    """Refuse a sensor so far outside of the prior that none of its points (N, 3) [m] can be on it.

    `source` says where its pose is from.
    """
    if prior.building is None:
        return
    away = away_from(prior.building, scan.position)
    most = scan.sensor.range_limits[1] if scan.sensor else np.inf
    reach = min(most, float(lengths(thin - scan.position).max(initial=0.0)))
    if away <= reach:
        return
    where = ", ".join(f"{value:.10g}" for value in scan.position + prior.origin)
    raise Misfit(
        f"the pose {where}, {source}, is {length_in_words(away)} outside the building, which spans "
        f"{span_of(prior.building)} m, and the scan reaches {reach:.4g} m: it cannot show any of it"
    )
