"""Legacy VTK files: the same points as text and as big-endian numbers, and what is none."""

import numpy as np
import pytest

from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError

POINTS = np.random.default_rng(5).uniform(-9, 9, (300, 3)).astype(np.float32)
AFTER = b"\nVERTICES 1 2\n1 0\nPOINT_DATA 300\nSCALARS intensity float\nLOOKUP_TABLE default\n" + b"1 " * 300


def header(coding: str, kind="float", count=300, dataset="POLYDATA") -> bytes:
    return f"# vtk DataFile Version 3.0\nmade here\n{coding}\nDATASET {dataset}\nPOINTS {count} {kind}\n".encode()


def as_text(points) -> bytes:
    return "\n".join(" ".join(map(repr, row)) for row in points.astype(float).tolist()).encode()


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(header("ASCII") + as_text(POINTS) + AFTER, id="text"),
        pytest.param(header("ASCII", "double", dataset="UNSTRUCTURED_GRID") + as_text(POINTS) + AFTER, id="doubles"),
        pytest.param(header("BINARY") + POINTS.astype(">f4").tobytes() + AFTER, id="binary"),
        pytest.param(header("BINARY", "double") + POINTS.astype(">f8").tobytes() + AFTER, id="binary doubles"),
    ],
)
def test_points_are_those_that_were_written(tmp_path, content):
    file = tmp_path / "scan.vtk"
    file.write_bytes(content)
    (scan,) = read_scans(file)
    np.testing.assert_allclose(scan.points, POINTS, atol=1e-6)
    assert scan.position is None and not scan.remarks


@pytest.mark.parametrize(
    "content, word",
    [
        (b"<VTKFile type='PolyData'>", "legacy VTK"),
        (header("GZIP"), "ASCII or BINARY"),
        (header("ASCII", count=400) + as_text(POINTS), "expected 400 points"),
        (header("BINARY") + POINTS.tobytes()[:-4], "299"),
        (header("BINARY", count=10**11), "header promises 100000000000"),
        (header("ASCII", kind="colour"), "expected POINTS, their number"),
        (header("ASCII", dataset="STRUCTURED_POINTS"), "STRUCTURED_POINTS"),
        (b"# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\n", "found none"),
        (b"# vtk DataFile Version 3.0\n" + b"x" * 9000, "4096 bytes"),
    ],
)
def test_what_is_none_is_refused_in_one_line(tmp_path, content, word):
    file = tmp_path / "scan.vtk"
    file.write_bytes(content)
    with pytest.raises(InputError) as error:
        read_scans(file)
    assert word in str(error.value) and "\n" not in str(error.value) and str(file) in str(error.value)
