"""`jaxmm detect`: files in, a folder of reports out, whole or not at all."""

import contextlib
import os
import time
from collections.abc import Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

import jaxmm.reports.notebook  # noqa: F401 - with it, notebooks show a detection
from jaxmm.devices import single_precision
from jaxmm.files import check_empty, write_folder
from jaxmm.formats.bags import is_bag
from jaxmm.formats.dates import latest, parse_date
from jaxmm.formats.poses import SEARCH, AskedPose, GivenPose
from jaxmm.ifc.projects import write_models_as_built, write_updates
from jaxmm.inputs import InputError, Misfit, clipped
from jaxmm.learning.prediction import read_judges
from jaxmm.reports.bcf_request import VERSIONS, NewElement
from jaxmm.reports.drawing_process import drawing
from jaxmm.reports.page import write_page
from jaxmm.reports.plain_files import write_plain
from jaxmm.reports.workbook import MISSING, WORKBOOK, write_workbook
from jaxmm.stations.named_files import Reading, frames_that_fit, read_station, told_of
from jaxmm.stations.sources import Found, ScanSource, names_of, scan_of, sources_of
from jaxmm.stations.work_folder import Shared, Work, engine_of, kept_stations
from jaxmm.verdicts.alignment import fitting_prior, prior_frame_that_fits
from jaxmm.verdicts.detection import detect_stations
from jaxmm.verdicts.panoramas import LEAST_SPAN
from jaxmm.verdicts.priors import Prior, kind_of
from jaxmm.verdicts.results import Detection
from jaxmm.verdicts.scan_frames import own_scan
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.station_steps import HeldStations
from jaxmm.weights import DEFAULT
from warp_scanner.buildings.model_files import Model, model_of
from warp_scanner.sensors.sensors import Pinhole


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
    work: Work | None = None,
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
        work: how to go about several stations; None: one after another, in this process. Other processes import the
            script that calls this, which must then do so below `if __name__ == "__main__"`.

    Raises:
        InputError: a file cannot be used, or does not fit the others; one line.
    """
    start = time.perf_counter()
    files = [Path(one) for one in ([scans] if isinstance(scans, str | os.PathLike) else scans)]
    given: list[AskedPose] = [poses] if isinstance(poses, GivenPose | str) else list(poses or ())
    reading, settings, work = reading or Reading(), settings or DetectSettings(), (work or Work(workers=1)).check()
    stated = None if date is None else parse_date(date)
    files_of_prior = prior_files(prior, also)
    judges = read_judges(Path(model))
    if reading.topic is not None and not any(map(is_bag, files)):
        raise InputError("--topic: expected a bag among the scans, got none")
    found = _posed(list(sources_of(files, reading.topic)), given)
    if SEARCH in given:
        _check_search(files_of_prior.files[0].path, reading)
    if not work.keep_going and (errors := [one.error for one, _ in found if one.error]):
        raise InputError(errors[0])
    sources, alone = [one for one, _ in found], len(found) == 1 and work.engine == "local"
    with contextlib.nullcontext() if alone else engine_of(work, len(found)) as results:
        read = _prior_for(files_of_prior, found, reading)
        if read.building is not None:
            settings.check_asked(read.building)
        loaded = time.perf_counter() - start
        try:
            if alone:
                shelves = [{"source": one} | ({} if scan is None else {"read": scan}) for one, scan in found]
                del found  # else scans that are read already would be held until the end
                stations = HeldStations(shelves, judges, settings)
                stations.each(read_station, read, reading)
                detection = detect_stations(read, stations, settings)
            else:
                with kept_stations(found, Shared(Path(model), settings), work, reading, results) as stations:
                    del found
                    stations.each(read_station, read, reading, may_leave_out=True)
                    detection = detect_stations(read, stations, settings)
        except Misfit as error:
            others = frames_that_fit(read, sources, reading) - {""} or _prior_frames(files_of_prior, sources, reading)
            if len(others) != 1:
                raise
            raise Misfit(f"{error}; its points do lie on the prior {others.pop()}") from error
    timing, when = detection.timing | {"loading": loaded}, stated or latest([one.taken for one in detection.scans])
    return detection._replace(timing=timing, prior=read.file, date=when)


def _posed(found: list[Found], given: list[AskedPose]) -> list[Found]:
    """The sources with their poses and names."""
    if not found:
        raise InputError("scans: expected at least one, got none")
    given = given * len(found) if given == [SEARCH] else given or [None] * len(found)
    if len(given) != len(found):
        remarks = (
            (one.file, (*((one.remark,) if one.remark else ()), *(scan.remarks if scan else ()))) for one, scan in found
        )
        told = "".join(f"; {Path(file).name}: {remark}" for file, some in remarks for remark in some)
        told = clipped(told)  # a file may hold fewer scans than it seems
        if errors := [one.error for one, _ in found if one.error]:
            raise InputError(errors[0])
        raise InputError(f"--pose: expected one for each of {len(found)} scans (or own), got {len(given)}{told}")
    names = names_of([Path(one.file) for one, _ in found])
    return [
        (one._replace(pose=pose, name=name), scan) for (one, scan), pose, name in zip(found, given, names, strict=True)
    ]


def _prior_for(model: Model, found: list[Found], reading: Reading) -> Prior:
    """The prior; of a mesh or cloud as all scans whose pose is known lie on it, which are read for that."""
    posed = []
    for number, (one, scan) in enumerate(found):
        if one.pose == SEARCH or one.error or model.has_ifc:
            continue
        with told_of(Path(one.file)):
            scan = scan_of(one) if scan is None else scan
            found[number] = one, scan
            posed.append(own_scan(scan, one.pose, reading.frame))
    return fitting_prior(model, reading.prior, posed, reading.unit)


def _prior_frames(model: Model, sources: list[ScanSource], reading: Reading) -> set[str]:
    """In which other frames than stated a cloud that is the prior would be fitted by the scans."""
    posed = []
    for one in sources if reading.prior.frame else ():
        with contextlib.suppress(InputError):  # of one that cannot be read, and was to be left out
            if one.pose != SEARCH:
                posed.append(own_scan(scan_of(one), one.pose, reading.frame))
    return {prior_frame_that_fits(model, reading.prior, posed, reading.unit)} - {""} if posed else set()


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
