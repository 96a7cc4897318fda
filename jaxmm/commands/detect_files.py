"""`jaxmm detect`: files in, a folder of reports out, whole or not at all."""

import os
import time
from collections.abc import Sequence
from pathlib import Path

import jaxmm.reports.notebook  # noqa: F401 - with it, notebooks show a detection
from jaxmm.files import check_empty, write_folder
from jaxmm.formats.bags import is_bag
from jaxmm.formats.poses import SEARCH, AskedPose, GivenPose
from jaxmm.ifc.as_built import write_as_built
from jaxmm.ifc.update import write_update
from jaxmm.inputs import InputError, Misfit, clipped
from jaxmm.learning.prediction import read_judges
from jaxmm.reports.bcf import write_bcf
from jaxmm.reports.detection_figures import write_figures
from jaxmm.reports.page import write_page
from jaxmm.reports.plain_files import write_plain
from jaxmm.reports.workbook import MISSING, WORKBOOK, write_workbook
from jaxmm.stations.named_files import Reading, frames_that_fit, read_station, told_of
from jaxmm.stations.sources import Found, names_of, scan_of, sources_of
from jaxmm.stations.work_folder import Shared, Work, kept_stations
from jaxmm.verdicts.alignment import fitting_prior
from jaxmm.verdicts.detection import detect_stations
from jaxmm.verdicts.panoramas import LEAST_SPAN
from jaxmm.verdicts.priors import Prior, kind_of
from jaxmm.verdicts.results import Detection
from jaxmm.verdicts.scan_frames import own_scan
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.station_steps import HeldStations
from jaxmm.weights import DEFAULT
from warp_scanner.sensors.sensors import Pinhole


def detect(
    prior: Path | str,
    scans: Sequence[Path | str] | Path | str,
    poses: Sequence[AskedPose] | AskedPose = None,
    *,
    reading: Reading | None = None,
    settings: DetectSettings | None = None,
    model: Path | str = DEFAULT,
    work: Work | None = None,
) -> Detection:
    """Compare robot scans with a building model, as `jaxmm detect` does, without writing anything.

    Args:
        prior: IFC or mesh file, or a point cloud.
        scans: point clouds, bags or folders of depth images, see `formats.readers`; each may hold several.
        poses: one for each scan; None takes the one of its file, or estimates it, "search" looks for the only place in
            the building that the scan fits. None or "search" alone does so for all.
        reading: units, frame and sensor.
        settings: how to detect.
        model: run folder or .safetensors file of models of the method "evidence".
        work: how to go about several stations; None: one after another, in this process. Other processes import the
            script that calls this, which must then do so below `if __name__ == "__main__"`.

    Raises:
        InputError: a file cannot be used, or does not fit the others; one line.
    """
    start = time.perf_counter()
    files = [Path(one) for one in ([scans] if isinstance(scans, str | os.PathLike) else scans)]
    given: list[AskedPose] = [poses] if isinstance(poses, GivenPose | str) else list(poses or ())
    reading, settings, work = reading or Reading(), settings or DetectSettings(), (work or Work(workers=1)).check()
    judges = read_judges(Path(model))
    if reading.topic is not None and not any(map(is_bag, files)):
        raise InputError("--topic: expected a bag among the scans, got none")
    found = _posed(list(sources_of(files, reading.topic)), given)
    if SEARCH in given:
        _check_search(Path(prior), reading)
    if not work.keep_going and (errors := [one.error for one, _ in found if one.error]):
        raise InputError(errors[0])
    read = _prior_for(Path(prior), found, reading)
    loaded = time.perf_counter() - start
    sources = [one for one, _ in found]
    try:
        if len(found) == 1 and work.engine == "local":
            shelves = [{"source": one} | ({} if scan is None else {"read": scan}) for one, scan in found]
            stations = HeldStations(shelves, judges, settings)
            stations.each(read_station, read, reading)
            detection = detect_stations(read, stations, settings)
        else:
            shared = Shared(Path(model), settings)
            with kept_stations(found, shared, work, reading, read) as stations:
                del found
                stations.each(read_station, read, reading)
                detection = detect_stations(read, stations, settings)
    except Misfit as error:
        others = frames_that_fit(read, sources, reading) - {""}
        if len(others) != 1:
            raise
        raise Misfit(f"{error}; its points do lie on the prior {others.pop()}") from error
    return detection._replace(timing=detection.timing | {"loading": loaded}, prior=read.file)


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


def _prior_for(path: Path, found: list[Found], reading: Reading) -> Prior:
    """The prior; of a mesh or cloud as all scans whose pose is known lie on it, which are read for that."""
    posed = []
    for number, (one, scan) in enumerate(found):
        if one.pose == SEARCH or one.error or path.suffix.lower() == ".ifc":
            continue
        with told_of(Path(one.file)):
            scan = scan_of(one) if scan is None else scan
            found[number] = one, scan
            posed.append(own_scan(scan, one.pose, reading.frame))
    return fitting_prior(path, reading.prior, posed, reading.unit)


def write_all(
    detection: Detection, prior: Path | str, out: Path | str, *, apply: bool = False, as_built: bool = False
) -> list[str]:
    """Write every output into a new folder, whole or not at all; returns what is to be said about it, a line each.

    Args:
        detection: what was found.
        prior: its file; an IFC file is also written anew with the changes marked, or made.
        out: folder that does not exist yet, or is empty.
        apply: delete removed elements instead of marking them; not while a scan may be of another place or pose.
        as_built: of an IFC file, also write the model with displaced elements where they were measured; likewise.

    Raises:
        InputError: the folder holds something, or cannot be written.
    """
    prior, out = Path(prior), Path(out)
    check_empty(out, "--out")
    start, said = time.perf_counter(), []

    def write(work: Path) -> None:
        write_figures(work, detection)
        write_page(work / "report.html", detection)
        write_bcf(work / "mismatches.bcf", detection, project=prior.stem)
        if prior.suffix.lower() == ".ifc":
            said.extend(write_update(prior, detection, work, apply=apply).notes)
            if as_built:
                said.extend(write_as_built(prior, detection, work))
        timing = detection.timing | {"writing": time.perf_counter() - start}
        write_plain(work, detection._replace(timing=timing))
        if not write_workbook(work / WORKBOOK, detection):
            said.append(MISSING)

    try:
        write_folder(out, write)
    except OSError as error:
        raise InputError(f"--out: cannot write {out}: {error.strerror}") from error
    return said


def _check_search(prior: Path, reading: Reading) -> None:
    """Refuse to search in what is no building, and for what does not look around."""
    if kind_of(prior) == "cloud":
        raise InputError(f"--pose search: expected an IFC or mesh file to search in, got the point cloud {prior}")
    if isinstance(reading.sensor, Pinhole):
        raise InputError(
            f"--pose search: too narrow: the sensor spans {reading.sensor.horizontal_fov:g} degrees of azimuth; "
            f"expected at least {LEAST_SPAN:g}, as of a scanner that looks around"
        )
