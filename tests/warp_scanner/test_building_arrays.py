"""A building comes out of its arrays as it went in, to the last bit, with nothing in it that could run."""

import json

import numpy as np
import pytest

from tests.cases.valid_ifc import ifc_text
from warp_scanner.buildings.arrays import packed, unpacked
from warp_scanner.guarded import Plain
from warp_scanner.scenes.building import NO_STOREYS, Failure, Found, Part, ReadOptions, Storeys, assemble
from warp_scanner.scenes.scenes import PILLAR, WALL


def random_building(seed):
    """Tetrahedra with odd names; with and without storeys, a place on the map, failures and flaws."""
    rng = np.random.default_rng(seed)
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
    names = ["", "é", '"quoted"\n', "\ud800", "\0", "[1, 2]"]
    parts = [
        Part(f"guid {row}", names[row % 3], names[rng.integers(6)], int(rng.integers(-1, 2)) if seed % 2 else -1,
             (WALL, PILLAR)[row % 2], rng.normal(size=(4, 3)) + 1e6 * (seed % 3), faces)
        for row in range(rng.integers(1, 9))
    ]  # fmt: skip
    storeys = Storeys(("s0", "s1"), ("low", "\ud800"), np.array([-0.1, 3.0])) if seed % 2 else NO_STOREYS
    lost = tuple(Failure(*names[k : k + 4]) for k in range(seed % 3))
    to_map = rng.normal(size=(4, 4)) if seed % 4 else None
    project = "0 project" if seed % 3 else None
    return assemble("a.ifc", parts, Found(storeys, lost, ("a note",), to_map, lost[:1], 0.1 + 0.2, project))


def sent(plain):
    """As it comes out of a pipe."""
    return Plain(json.loads(json.dumps(plain.words)), plain.arrays)


def assert_same(found, expected):
    assert type(found) is type(expected)
    if isinstance(expected, np.ndarray):
        assert found.dtype == expected.dtype and found.tobytes() == expected.tobytes()
        assert found.shape == expected.shape
    elif isinstance(expected, tuple):
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            assert_same(one, other)
    else:
        assert found == expected


@pytest.mark.parametrize("seed", range(12))
def test_what_is_packed_comes_out_equal(seed):
    building = random_building(seed)
    plain = packed(building)
    assert not any(array.dtype.hasobject for array in plain.arrays.values())
    assert_same(unpacked(sent(plain)), building)


@pytest.mark.parametrize("options", [ReadOptions(), ReadOptions(glass="transparent", doors="open")])
def test_a_process_of_its_own_reads_the_same(tmp_path, options):
    pytest.importorskip("ifcopenshell")
    from warp_scanner.buildings.ifc_files import parse_ifc, read_ifc

    path = tmp_path / "a.ifc"
    path.write_bytes(ifc_text("IFC4"))
    assert_same(read_ifc(path, options), parse_ifc(path, options))
