"""`jaxmm scan`: what a sensor at one place in a building sees."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmm.formats.poses import GivenPose
from jaxmm.formats.writers import SensorScan
from jaxmm.inputs import InputError
from warp_scanner.buildings.model_files import model_of
from warp_scanner.buildings.positions import check_position
from warp_scanner.buildings.projects import read_model
from warp_scanner.scenes.building import Building, ReadOptions
from warp_scanner.sensors.imperfections import imperfect
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO, Sensor
from warp_scanner.sensors.surface import incidence_of, intensity_of
from warp_scanner.sensors.triangles import cast_faces, face_normals, prepare


def scan(
    scene: Path | str,
    pose: GivenPose,
    sensor: Sensor = OAK_D_PRO,
    *,
    also: Sequence[Path | str] = (),
    reading: ReadOptions | None = None,
    seed: int = 0,
) -> SensorScan:
    """Scan a building from one place, as `jaxmm scan` does, without writing anything.

    Args:
        scene: IFC or mesh file, or a folder of such that describe one building.
        pose: where the sensor stands and looks, in the frame of the building.
        sensor: which directions it looks in, how far it reaches, and how it errs.
        also: IFC and mesh files that describe the same building as well.
        reading: how the files are to be read.
        seed: of the errors of a sensor that errs, from 0 and below 2^63.

    Returns:
        Every ray of the sensor, returned or not, with the element that it met.

    Raises:
        InputError: the file cannot be read, no sensor can stand there, nothing comes back, or a seed out of range.
    """
    found = scan_of(opened(Path(scene), reading or ReadOptions(), also), pose, sensor, seed)
    check_returns(found, f"{tuple(pose.position.tolist())}", scene)
    return found


def opened(scene: Path, reading: ReadOptions, also: Sequence[Path | str] = ()) -> Building:
    """The building of a file, or of several.

    Raises:
        InputError: it cannot be read so.
    """
    try:
        model = model_of(scene, also)
        if model.has_ifc and (reading.unit != 1.0 or reading.y_up is not None):
            raise InputError(f"--unit, --up: only for mesh files; {scene} says its unit and axes itself")
        return read_model(model, reading)
    except (ValueError, ImportError) as error:
        raise InputError(str(error)) from error


def scan_of(building: Building, pose: GivenPose, sensor: Sensor, seed: int) -> SensorScan:
    """What a sensor sees of a building.

    Raises:
        InputError: no sensor can stand there, or a seed out of range.
    """
    if not 0 <= seed < 2**63:
        raise InputError(f"--seed: expected at least 0 and below 2^63, got {seed}")
    scene = prepare(building.triangles)
    try:
        check_position(building, scene, pose.position, sensor.range_limits[1])
    except ValueError as error:
        raise InputError(str(error)) from error
    rolled = Rotation.from_euler("X", pose.roll, degrees=True).as_matrix().astype(np.float32)
    rotation, directions = rotation_of([pose.yaw], [pose.pitch]) @ rolled, sensor.directions()
    rays = Rays(np.array([pose.position - building.origin]), directions, rotation)
    found, face = cast_faces(scene, rays)
    incidence = incidence_of(face_normals(building.triangles, face), rays)
    found = imperfect(found, incidence, sensor, seed, np.zeros(1, int))
    incidence = np.where(np.isfinite(found.distance), incidence, np.nan).astype(np.float32)
    light = intensity_of(found.distance, found.semantic, incidence)
    arrays = (field[0] for field in (*found, incidence, light))
    return SensorScan(np.asarray(pose.position), rotation[0], directions, *arrays, building.elements)


def check_returns(scan: SensorScan, pose: str, scene: Path | str) -> None:
    """Refuse a scan of which no ray comes back.

    Raises:
        InputError: that.
    """
    if not np.isfinite(scan.distance).any():
        raise InputError(f"--pose {pose}: no ray of the sensor comes back from {scene} there")
