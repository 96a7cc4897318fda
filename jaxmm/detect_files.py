"""`jaxmm detect`: files in, a folder of reports out, whole or not at all."""

import dataclasses
import shutil
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm import runs
from jaxmm.bcf import write_bcf
from jaxmm.detect_settings import DetectSettings
from jaxmm.detection import NamedScan, detect_scans
from jaxmm.detection_figures import write_figures
from jaxmm.files import check_empty
from jaxmm.ifc_update import write_update
from jaxmm.inputs import InputError
from jaxmm.judging import Judges
from jaxmm.notebook import detection_html
from jaxmm.page import write_page
from jaxmm.priors import Prior, distance_to, read_prior
from jaxmm.report import Detection
from jaxmm.report_files import write_plain
from jaxmm.scan_files import PointScan, read_scans
from jaxmm.scan_poses import GivenPose
from jaxmm.scan_rays import PosedScan
from jaxmm.scan_units import FITS, overlap, unit_of
from jaxmm.viewpoint import doubts_about, estimate
from jaxmm.weights import DEFAULT
from warp_scanner.building_poses import inside
from warp_scanner.buildings import ReadOptions, bounds
from warp_scanner.mesh_files import SUFFIXES
from warp_scanner.sensors import OAK_D_PRO, Pinhole, Sensor
from warp_scanner.voxels import thin_clouds

EVIDENCE = "evidence"
ESTIMATED_FROM = 0.1  # [m] voxels of the cloud that a viewpoint is estimated from
FRAMES = ("world", "sensor")

# Notebooks ask the object itself; the type stays free of what draws.
Detection._repr_html_ = detection_html


class Reading(NamedTuple):
    """How files are to be read."""

    prior: ReadOptions = ReadOptions()
    unit: float | None = None  # [m] of the scans; None: told by how they lie on the prior
    frame: str = "world"  # of the scans' points; "sensor": they are moved to where the pose says
    sensor: Sensor | None = None  # None: any; its view is then what its points span


def detect(
    prior: Path | str,
    scans: list[Path | str] | Path | str,
    poses: list[GivenPose] | None = None,
    *,
    reading: Reading | None = None,
    settings: DetectSettings | None = None,
    model: Path | str = DEFAULT,
) -> Detection:
    """Compare robot scans with a building model, as `jaxmm detect` does, without writing anything.

    Args:
        prior: IFC or mesh file, or a point cloud.
        scans: point clouds, see `scan_files`; a file may hold several.
        poses: one for each scan; None takes those of the files, or estimates them.
        reading: units, frame and sensor.
        settings: how to detect.
        model: run folder or .safetensors file of models of the method "evidence".

    Raises:
        InputError: a file cannot be used, or does not fit the others; one line.
    """
    start = time.perf_counter()
    files = [Path(one) for one in (scans if isinstance(scans, list) else [scans])]
    reading, settings = reading or Reading(), settings or DetectSettings()
    judges = read_judges(Path(model))
    found = [(file, scan) for file in files for scan in read_scans(file)]
    if poses and len(poses) != len(found):
        raise InputError(f"--pose: expected one for each of {len(found)} scans, got {len(poses)}")
    read = _fitting_prior(Path(prior), reading, found[0][1])
    named = []
    for number, (file, scan) in enumerate(found):
        name = file.name if sum(one == file for one, _ in found) == 1 else f"{file.name}#{number}"
        try:
            named.append(_named(read, name, scan, poses[number] if poses else None, reading))
        except InputError as error:
            text = str(error)
            raise InputError(text if text.startswith(str(file)) else f"{file}: {text}") from error
    loaded = time.perf_counter() - start
    detection = detect_scans(read, named, judges, settings)
    return detection._replace(timing=detection.timing | {"loading": loaded}, prior=read.file)


def read_judges(model: Path) -> Judges:
    """The four models of a run folder or .safetensors file.

    Raises:
        InputError: it holds no models that judge evidence.
    """
    models, trained = runs.load_models(model)
    if EVIDENCE not in models:
        raise InputError(f"--model: {model}: expected models of the method {EVIDENCE}, found {', '.join(models)}")
    return Judges(models[EVIDENCE], trained.network)


def write_all(detection: Detection, prior: Path, out: Path, *, apply: bool = False) -> list[str]:
    """Write every output into a new folder, whole or not at all; returns what is to be said about it, a line each.

    Args:
        detection: what was found.
        prior: its file; an IFC file is also written anew with the changes marked, or made.
        out: folder that does not exist yet, or is empty.
        apply: delete removed elements instead of marking them.

    Raises:
        InputError: the folder holds something, or cannot be written.
    """
    check_empty(out, "--out")
    start, said = time.perf_counter(), []
    out.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    try:
        write_figures(work, detection)
        write_page(work / "report.html", detection)
        write_bcf(work / "mismatches.bcf", detection, project=prior.stem)
        if prior.suffix.lower() == ".ifc":
            said += write_update(prior, detection, work, apply=apply).notes
        timing = detection.timing | {"writing": time.perf_counter() - start}
        write_plain(work, detection._replace(timing=timing))
        work.chmod(0o755)
        if out.exists():
            out.rmdir()
        work.rename(out)
    except OSError as error:
        raise InputError(f"--out: cannot write {out}: {error.strerror}") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return said


def _fitting_prior(path: Path, reading: Reading, scan: PointScan) -> Prior:
    """The prior, turned upright where a mesh whose axes nobody told only fits the scan that way."""
    prior = read_prior(path, reading.prior)
    open_axis = path.suffix.lower() in SUFFIXES and reading.prior.y_up is None and prior.has_elements
    if not open_axis or reading.frame != "world":
        return prior
    scale = reading.unit or 1.0
    if overlap(scan.points * scale, _distance(prior)) >= FITS:
        return prior
    turned = read_prior(path, dataclasses.replace(reading.prior, y_up=True))
    if overlap(scan.points * scale, _distance(turned)) < FITS:
        return prior
    note = f"{path.name} fits the scan with y up, and was read that way; --up says which axis it is"
    return turned._replace(notes=(*turned.notes, note))


def _distance(prior: Prior):
    """To the prior's surface, from points of the world."""
    return lambda points, reach: distance_to(prior, (points - prior.origin).astype(np.float32), reach)


def _named(prior: Prior, name: str, scan: PointScan, given: GivenPose | None, reading: Reading) -> NamedScan:
    """One scan in its place, with all that was assumed about it."""
    notes, sensor = list(scan.remarks), reading.sensor
    points, unit = scan.points, reading.unit
    pose, source = _known_pose(scan, given)
    if reading.frame == "sensor":
        if pose is None:
            raise InputError("points in the sensor's frame need a pose; give it with --pose")
        position, rotation = pose
        points = points * (unit or 1.0) @ rotation.T + position
    else:
        if unit is None:
            unit, word = unit_of(points, _distance(prior))
            notes += [f"it fits the prior in {word}, and was read so"] if word else []
        points = points * unit
        if source == "file" and pose is not None:
            pose = pose[0] * unit, pose[1]
    deviation = None
    thin = points[thin_clouds([(points - prior.origin).astype(np.float32)], ESTIMATED_FROM)[0]]
    if pose is not None:
        view = (sensor.horizontal_fov, sensor.vertical_fov) if isinstance(sensor, Pinhole) else None
        notes += doubts_about(thin, *pose, view)
    else:
        camera = sensor or OAK_D_PRO
        if not isinstance(camera, Pinhole):
            raise InputError("only the viewpoint of a camera can be estimated from its points; give it with --pose")
        told = estimate(thin, camera.horizontal_fov, camera.vertical_fov, pitch=None)
        view = f"{camera.horizontal_fov:g} x {camera.vertical_fov:g} degrees"
        notes.append(f"its pose is estimated, for a camera that sees {view}")
        pose = told.position, GivenPose(told.position, told.yaw, told.pitch).rotation
        source, deviation = "estimated", tuple(float(value) for value in told.deviation)
    placed = PosedScan((points - prior.origin).astype(np.float32), pose[0] - prior.origin, pose[1], sensor)
    _check_place(prior, placed, source)
    return NamedScan(placed, name, len(scan.points), source, deviation, tuple(notes))


def _known_pose(scan: PointScan, given: GivenPose | None) -> tuple[tuple[np.ndarray, np.ndarray] | None, str]:
    if given is not None:
        return (given.position, given.rotation), "given"
    if scan.position is not None:
        return (scan.position, np.eye(3) if scan.rotation is None else scan.rotation), "file"
    return None, "estimated"


def _check_place(prior: Prior, scan: PosedScan, source: str) -> None:
    """Refuse a sensor that is nowhere near the prior; `source` says where its pose is from."""
    if prior.scene is None or inside(prior.building, prior.scene, scan.position[None])[0]:
        return
    low, high = (corner + prior.origin for corner in bounds(prior.building.triangles))
    where = ", ".join(f"{value:.10g}" for value in scan.position + prior.origin)
    spans = ", ".join(f"{a:.2f} to {b:.2f}" for a, b in zip(low, high, strict=True))
    raise InputError(f"the pose {where}, {source}, is outside the building, which spans {spans} m")
