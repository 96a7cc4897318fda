"""Real scans against themselves and each other: where nothing changed, nothing is told, and poses come back."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm import detect
from jaxmm.formats.poses import GivenPose

BASE = np.array([0.0, 0.0, 0.4])  # [m] the laser stands about so high above the frame of the points
SECOND = 0.614, -0.011, 0.006, 6.63  # [m], [deg] the second scan in the first, by ICP


class Flat(NamedTuple):
    """Two scans (N, 3) of a flat by a tilting laser, from two places in it, each in the frame of its own base."""

    first: np.ndarray
    second: np.ndarray


@pytest.fixture(scope="module")
def flat(data_root):
    def read(name):
        lines = (data_root / "real/libpointmatcher" / name).read_text().split("\n")
        count = int(next(line for line in lines if line.startswith("POINTS")).split()[1])
        start = next(row for row, line in enumerate(lines) if line.startswith("POINTS")) + 1
        return np.array([line.split() for line in lines[start : start + count]], float)

    if not (data_root / "real/libpointmatcher").is_dir():
        pytest.skip("needs the scans of a flat: JAXMM_DATA holds no real/libpointmatcher")
    return Flat(read("cloud_0.vtk"), read("cloud_1.vtk"))


def detected(folder, prior, scan, position, yaw=0.0):
    for name, points in (("prior", prior), ("scan", scan)):
        np.save(folder / f"{name}.npy", points.astype(np.float32))
    return detect(folder / "prior.npy", folder / "scan.npy", GivenPose(np.asarray(position), yaw, 0.0))


@pytest.mark.parametrize("which", ["whole", "every other point", "the left half", "0.3 m off"])
def test_a_scan_against_itself_has_no_mismatch(flat, tmp_path, which):
    points, shift = flat.first, np.zeros(3)
    prior, scan = points, points
    if which == "every other point":
        prior, scan = points[::2], points[1::2]
    elif which == "the left half":
        prior = points[points[:, 1] > 0.0]
    elif which == "0.3 m off":
        shift = np.array([0.3, 0.0, 0.0])
    found = detected(tmp_path, prior, scan + shift, BASE + shift)
    assert not found.mismatches
    (record,) = found.scans
    assert np.linalg.norm(np.array(record.pose[:3]) - BASE) < 0.03 and record.registration["turn"] < 0.5


@pytest.mark.parametrize("off", [(0.0, 0.0, 0.0), (0.3, 0.1, 8.0)])
def test_the_same_flat_from_another_place_has_no_mismatch(flat, tmp_path, off):
    """Its pose right, and off by so much [m, deg]."""
    yaw = SECOND[3] + off[2]
    position = np.array([SECOND[0] + off[0], SECOND[1] + off[1], SECOND[2]])
    scan = flat.second @ Rotation.from_euler("z", yaw, degrees=True).as_matrix().T + position
    found = detected(tmp_path, flat.first, scan, position + BASE, yaw)
    assert not found.mismatches
    (record,) = found.scans
    assert np.linalg.norm(np.array(record.pose[:3]) - np.array(SECOND[:3]) - BASE) < 0.05
    assert record.pose[3] == pytest.approx(SECOND[3], abs=0.6)
