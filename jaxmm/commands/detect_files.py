"""`jaxmm detect`: files in, a folder of reports out, whole or not at all."""

import contextlib
import dataclasses
import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

import jaxmm.reports.notebook  # noqa: F401 - with it, notebooks show a detection
from jaxmm.devices import single_precision
from jaxmm.files import check_empty, write_folder
from jaxmm.formats.bags import is_bag
from jaxmm.formats.dates import latest, parse_date, taken_of
from jaxmm.formats.poses import SEARCH, AskedPose, GivenPose
from jaxmm.formats.readers import PointScan, read_scans
from jaxmm.formats.units import FITS
from jaxmm.ifc.projects import write_models_as_built, write_updates
from jaxmm.inputs import InputError, Misfit, clipped
from jaxmm.learning.prediction import read_judges
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.rays.viewpoint import Viewpoint, doubts_about, estimate, estimate_by_other, is_turned_away
from jaxmm.reports.bcf_request import VERSIONS, NewElement
from jaxmm.reports.drawing_process import drawing
from jaxmm.reports.page import write_page
from jaxmm.reports.plain_files import write_plain
from jaxmm.reports.workbook import MISSING, WORKBOOK, write_workbook
from jaxmm.verdicts.alignment import fitting_prior, lay
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.panoramas import LEAST_SPAN
from jaxmm.verdicts.priors import Prior, kind_of
from jaxmm.verdicts.results import Detection
from jaxmm.verdicts.scan_frames import FRAMES, OwnScan, frame_that_fits, own_scan
from jaxmm.verdicts.searched_scans import searched_scan
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from warp_scanner.buildings.model_files import Model, model_of
from warp_scanner.buildings.positions import away_from, span_of
from warp_scanner.clouds.voxels import thin_clouds
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


@single_precision()
@threadpool_limits.wrap(limits=1, user_api="blas")  # products are small: threads would wait more than they compute
def detect(
    prior: Path | str,
    scans: Sequence[Path | str] | Path | str,
    poses: Sequence[AskedPose] | AskedPose = None,
    *,
    also: Sequence[Path | str] = (),
    reading: Reading | None = None,
    settings: DetectSettings | None = None,
    model: Path | str = DEFAULT,
    date: str | None = None,
) -> Detection:
    """Compare robot scans with a building model, as `jaxmm detect` does, without writing anything.

    Args:
        prior: IFC or mesh file, a folder of such, or a point cloud.
        scans: point clouds, bags or folders of depth images, see `formats.readers`; each may hold several.
        poses: one for each scan; None takes the one of its file, or estimates it, "search" looks for the only place in
            the building that the scan fits. None or "search" alone does so for all.
        also: IFC and mesh files that describe the same building as well.
        reading: units, frame and sensor.
        settings: how to detect.
        model: run folder or .safetensors file of models of the method "evidence".
        date: when the scans were taken, as 2026-03-02 or 2026-03-02T14:30; None: what their files say.

    Raises:
        InputError: a file cannot be used, or does not fit the others; one line.
    """
    start = time.perf_counter()
    files = [Path(one) for one in ([scans] if isinstance(scans, str | os.PathLike) else scans)]
    given: list[AskedPose] = [poses] if isinstance(poses, GivenPose | str) else list(poses or ())
    reading, settings = reading or Reading(), settings or DetectSettings()
    stated = None if date is None else parse_date(date)
    files_of_prior = prior_files(prior, also)
    judges = read_judges(Path(model))
    if reading.topic is not None and not any(map(is_bag, files)):
        raise InputError("--topic: expected a bag among the scans, got none")
    found = [(file, scan) for file in files for scan in read_scans(file, reading.topic if is_bag(file) else None)]
    if not found:
        raise InputError("scans: expected at least one, got none")
    given = given * len(found) if given == [SEARCH] else given or [None] * len(found)
    if len(given) != len(found):
        told = "".join(f"; {file.name}: {remark}" for file, scan in found for remark in scan.remarks)
        told = clipped(told)  # a file may hold fewer scans than it seems
        raise InputError(f"--pose: expected one for each of {len(found)} scans (or own), got {len(given)}{told}")
    if SEARCH in given:
        _check_search(files_of_prior.files[0].path, reading)
    posed: list[OwnScan | None] = []  # None: to be searched, once the prior is read
    for (file, scan), pose in zip(found, given, strict=True):
        with _told_of(file):
            posed.append(None if pose == SEARCH else own_scan(scan, pose, reading.frame))
    read = fitting_prior(files_of_prior, reading.prior, [one for one in posed if one is not None], reading.unit)
    own = []
    for (file, scan), one in zip(found, posed, strict=True):
        with _told_of(file):
            own.append(one or searched_scan(read, scan, reading.frame, reading.unit))
    named = []
    try:
        names = _names([file for file, _ in found])
        for (file, scan), pose, mine, name in zip(found, given, own, names, strict=True):
            with _told_of(file):
                one = _named(read, name, scan, mine, reading)
                doubts = () if pose == SEARCH else _doubts_about_frame(read, scan, pose, reading)
                named.append(one._replace(notes=(*one.notes, *doubts), doubts=(*one.doubts, *doubts)))
        loaded = time.perf_counter() - start
        detection = detect_scans(read, named, judges, settings)
    except Misfit as error:
        pairs = [(scan, pose) for (_, scan), pose in zip(found, given, strict=True) if pose != SEARCH]
        others = {frame_that_fits(read, scan, pose, reading.frame, reading.unit) for scan, pose in pairs} - {""}
        if len(others) != 1:
            raise
        raise Misfit(f"{error}; its points do lie on the prior {others.pop()}") from error
    taken = [taken_of(file, scan.taken) for file, scan in found]
    records = tuple(one._replace(taken=when) for one, when in zip(detection.scans, taken, strict=True))
    timing = detection.timing | {"loading": loaded}
    return detection._replace(timing=timing, prior=read.file, scans=records, date=stated or latest(taken))


def write_all(
    detection: Detection,
    prior: Path | str,
    out: Path | str,
    *,
    also: Sequence[Path | str] = (),
    apply: bool = False,
    as_built: bool = False,
    bcf: str = VERSIONS[0],
) -> list[str]:
    """Write every output into a new folder, whole or not at all; returns what is to be said about it, a line each.

    Args:
        detection: what was found.
        prior: its file, or folder; IFC files are also written anew with the changes marked, or made.
        out: folder that does not exist yet, or is empty.
        also: as `detect` was given it.
        apply: delete removed elements instead of marking them; not while a scan may be of another place or pose.
        bcf: version of mismatches.bcf, "3.0" or "2.1".
        as_built: of an IFC file, also write the model with displaced elements where they were measured; likewise.

    Raises:
        InputError: the folder holds something, or cannot be written.
    """
    model, out = prior_files(prior, also), Path(out)
    check_empty(out, "--out")
    start, said = time.perf_counter(), []

    def write(work: Path) -> None:
        with drawing(work, detection) as write_topics:
            write_page(work / "report.html", detection)
            new = {}
            if model.has_ifc:
                updates = write_updates(model, detection, work, apply=apply)
                new = {number: NewElement(*where) for number, where in updates.new.items()}
                said.extend(updates.notes)
            write_topics(Path(model.name).stem, version=bcf, new=new)
            if model.has_ifc and as_built:
                said.extend(write_models_as_built(model, detection, work))
            if not write_workbook(work / WORKBOOK, detection):
                said.append(MISSING)
        timing = detection.timing | {"writing": time.perf_counter() - start}
        write_plain(work, detection._replace(timing=timing))

    try:
        write_folder(out, write)
    except OSError as error:
        raise InputError(f"--out: cannot write {out}: {error.strerror}") from error
    return said


def prior_files(prior: Path | str, also: Sequence[Path | str] = ()) -> Model:
    """The files of a prior.

    Raises:
        InputError: a folder without models, or what cannot be put together with others; one line.
    """
    try:
        return model_of(prior, also)
    except ValueError as error:
        raise InputError(str(error)) from error
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}") from error


def _check_search(prior: Path, reading: Reading) -> None:
    """Refuse to search in what is no building, and for what does not look around."""
    if kind_of(prior) == "cloud":
        raise InputError(f"--pose search: expected an IFC or mesh file to search in, got the point cloud {prior}")
    if isinstance(reading.sensor, Pinhole):
        raise InputError(
            f"--pose search: too narrow: the sensor spans {reading.sensor.horizontal_fov:g} degrees of azimuth; "
            f"expected at least {LEAST_SPAN:g}, as of a scanner that looks around"
        )


@contextlib.contextmanager
def _told_of(file: Path) -> Iterator[None]:
    """Errors that come up name the file."""
    try:
        yield
    except InputError as error:
        text, kind = str(error), Misfit if isinstance(error, Misfit) else InputError
        raise kind(text if text.startswith(str(file)) else f"{file}: {text}") from error


def _names(files: list[Path]) -> list[str]:
    """What to call the scans of these files, one of each: by name, with as many folders as tell them apart.

    Several of one file are numbered as they stand there.
    """
    parts = {file: file.absolute().parts for file in files}

    def name(file: Path) -> str:
        depth = next(
            depth
            for depth in range(1, len(parts[file]) + 1)
            if sum(other[-depth:] == parts[file][-depth:] for other in set(parts.values())) == 1
        )
        return Path(*parts[file][-depth:]).as_posix()

    return [
        name(file) if files.count(file) == 1 else f"{name(file)}#{files[:number].count(file)}"
        for number, file in enumerate(files)
    ]


def _named(prior: Prior, name: str, scan: PointScan, own: OwnScan, reading: Reading) -> NamedScan:
    """One scan in its place, with all that was assumed about it."""
    points, pose, source, told, contradictions = lay(prior, own, 1.0 if own.source == "searched" else reading.unit)
    notes, sensor, deviation, doubts = [*scan.remarks, *own.notes, *told], reading.sensor, None, list(contradictions)
    thin = points[thin_clouds([(points - prior.origin).astype(np.float32)], ESTIMATED_FROM)[0]]
    if pose is not None:
        view = (sensor.horizontal_fov, sensor.vertical_fov) if isinstance(sensor, Pinhole) else None
        doubts += doubts_about(points, thin, *pose, view)
        # It changes nothing but what is drawn, and files of scanners that look around say nothing by it.
        if sensor is None and source == "given" and is_turned_away(thin, *pose):
            notes.append("hardly any of its points lies before the sensor, as it is turned: is its yaw right?")
    else:
        camera = sensor or OAK_D_PRO
        if not isinstance(camera, Pinhole):
            raise InputError("only the viewpoint of a camera can be estimated from its points; give it with --pose")
        viewpoint, by = _viewpoint(prior, thin, camera)
        view = f"{camera.horizontal_fov:g} x {camera.vertical_fov:g} degrees"
        notes.append(f"its pose is estimated{by}, for a camera that sees {view}")
        pose = viewpoint.position, GivenPose(viewpoint.position, viewpoint.yaw, viewpoint.pitch).rotation
        deviation = tuple(float(value) for value in viewpoint.deviation)
    placed = PosedScan((points - prior.origin).astype(np.float32), pose[0] - prior.origin, pose[1], sensor)
    _check_place(prior, placed, thin - prior.origin, source)
    return NamedScan(placed, name, len(scan.points), source, deviation, (*notes, *doubts), tuple(doubts))


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
    reach = min(most, float(np.linalg.norm(thin - scan.position, axis=1).max(initial=0.0)))
    if away <= reach:
        return
    where = ", ".join(f"{value:.10g}" for value in scan.position + prior.origin)
    raise Misfit(
        f"the pose {where}, {source}, is {away:.4g} m outside the building, which spans {span_of(prior.building)} m, "
        f"and the scan reaches {reach:.4g} m: it cannot show any of it"
    )
