"""The files that other programs are asked about, and what is true of them. World frame: metres, z up."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmm.commands.detect_files import detect, write_all
from jaxmm.commands.scanning import scan
from jaxmm.formats.cloud_files import moved_name, offset_of, write_ply
from jaxmm.formats.poses import GivenPose
from jaxmm.formats.writers import WRITERS, SensorScan, world_points, write_scan
from jaxmm.ifc.colours import ADDED, COLOURS, REMOVED
from jaxmm.reports.plain_files import write_mismatch_points, write_points
from jaxmm.runs.room_scans import room_cases
from jaxmm.verdicts.results import Detection
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

GRID = np.array([155_000.25, 463_000.5, 12.0])  # [m] a place on a national grid
SEED = 41  # of no training, validation or test
PLACES = {"near": np.zeros(3), "grid": GRID}


class Cloud(NamedTuple):
    """A point cloud, and where its points are."""

    path: Path
    points: np.ndarray  # (N, 3) float64 [m]; in the file's own frame where it is a moved one


class Outputs(NamedTuple):
    """All files."""

    clouds: list[Cloud]
    bcf: dict[str, Path]  # by version
    ifc: Path
    selected: list[str]  # GlobalIds that topics select, one each
    camera: list[float]  # (3,) [m] of the topics of mismatches
    painted: dict[str, tuple[int, int, int]]  # by GlobalId


def make(folder: Path) -> Outputs:
    """Scan a changed room, compare it with the model of what it was, and write all there is."""
    (case,) = room_cases("all_four", "occluded", SEED, range(1), sensor=OAK_D_PRO_SMALL)
    model, pairs = folder / "room.ifc", case.pairs
    write_room(model, pairs.prior, case.row)
    yaw, pitch = float(pairs.pose.yaw[case.row]), float(pairs.pose.pitch[case.row])
    pose = GivenPose(np.asarray(case.scan.position, np.float64), yaw, pitch)
    seen = scan(model, pose, OAK_D_PRO_SMALL)
    clouds = [one for name, shift in PLACES.items() for one in _scans(folder, name, seen, shift)]
    write_ply(folder / "robot.ply", np.asarray(case.scan.points, np.float64), {})
    detection = detect(model, folder / "robot.ply", pose)
    for version in ("3.0", "2.1"):
        write_all(detection, model, folder / version, bcf=version)
    clouds += [one for name, shift in PLACES.items() for one in _reports(folder, name, detection, shift)]
    painted = _painted(folder / "3.0" / "updated.ifc")
    selected = sorted(painted)
    bcf = {version: folder / version / "mismatches.bcf" for version in ("3.0", "2.1")}
    return Outputs(
        clouds, bcf, folder / "3.0" / "updated.ifc", selected, list(map(float, detection.scans[0].pose[:3])), painted
    )


def _scans(folder: Path, name: str, seen: SensorScan, shift: np.ndarray) -> list[Cloud]:
    placed = seen._replace(position=seen.position + shift)
    points = world_points(placed)
    return [
        one for suffix in WRITERS if suffix != ".npz"
        for one in _with_moved(write_scan(folder / f"{name}{suffix}", placed), points)
    ]  # fmt: skip


def _reports(folder: Path, name: str, detection: Detection, shift: np.ndarray) -> list[Cloud]:
    drawing = detection.drawing._replace(origin=detection.drawing.origin + shift)
    scans = tuple(
        one._replace(pose=(*(np.array(one.pose[:3]) + shift).tolist(), *one.pose[3:])) for one in detection.scans
    )
    mismatches = tuple(one._replace(center=one.center + shift) for one in detection.mismatches)
    moved = detection._replace(drawing=drawing, scans=scans, mismatches=mismatches)
    robot, prior = (points.astype(np.float64) + drawing.origin for points in (drawing.robot, drawing.prior))
    return [
        *_with_moved(write_mismatch_points(folder / f"mismatches_{name}.ply", moved), np.concatenate([robot, prior])),
        *_with_moved(write_points(folder / f"points_{name}.ply", moved), robot),
    ]


def _with_moved(paths: tuple[Path, ...], points: np.ndarray) -> list[Cloud]:
    offset = offset_of(points)
    return [Cloud(path, points - offset if path == moved_name(paths[0], offset) else points) for path in paths]


def _painted(ifc: Path) -> dict[str, Any]:
    """What the update says that it did: new elements, and those to be removed, by their marks."""
    import ifcopenshell
    from ifcopenshell.util.element import get_pset

    colours = {"added": COLOURS[ADDED], "removed": COLOURS[REMOVED]}
    model = ifcopenshell.open(str(ifc))  # held, for elements of a model that is let go are lost
    verdicts = {one.GlobalId: get_pset(one, "jaxmm_Verdict", "Verdict") for one in model.by_type("IfcBuildingElement")}
    return {guid: colours[verdict] for guid, verdict in verdicts.items() if verdict in colours}
