"""Records of stations: what comes back is what was written, to the bit, and a file makes no more than our own kinds."""

import numpy as np
import pytest

from jaxmm.inputs import InputError
from jaxmm.rays.scan_rays import PosedScan, ScanRays
from jaxmm.stations.records import KINDS, digest_of, read_record, write_record
from jaxmm.verdicts.verdicts import VerdictSettings
from warp_scanner.sensors.sensors import PRESETS


def plain(value):
    """Nested tuples in which arrays are their bytes, so that == compares bits, NaN included."""
    if isinstance(value, np.ndarray | np.generic):
        return type(value).__name__, value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    return (type(value).__name__, *map(plain, value)) if isinstance(value, tuple | list) else value


def test_what_is_read_is_what_was_written(tmp_path):
    rng = np.random.default_rng(0)
    for sensor in PRESETS.values():
        scan = PosedScan(rng.normal(size=(5, 3)).astype(np.float32), rng.normal(size=3), np.eye(3), sensor)
        rays = ScanRays(scan.position, scan.points, np.array([np.inf, np.nan, 1.0]), 3, scan.points[:0], 0.1, np.inf)
        value = {"a": (scan, None, [rays, True, "ü"]), 3: np.float64(0.1), "b": (1, 2.5, -0.0, np.int64(7))}
        write_record(tmp_path / "one.record", value)
        assert plain(read_record(tmp_path / "one.record")) == plain(value)


def test_arrays_keep_the_order_of_their_numbers_in_memory(tmp_path):
    """Products of the same numbers in another order come out otherwise."""
    rows = np.arange(12.0).reshape(3, 4)
    for array in (rows, rows.T, rows[:, ::2], np.array(3.0), rows[:1].T):
        write_record(tmp_path / "one.record", array)
        found = read_record(tmp_path / "one.record")
        np.save(tmp_path / "one.npy", array)
        assert found.strides == np.load(tmp_path / "one.npy").strides and plain(found) == plain(array)
        assert found.flags.writeable


def test_other_kinds_are_neither_written_nor_made(tmp_path, monkeypatch):
    path = tmp_path / "one.record"
    for strange in (VerdictSettings(), {1: [VerdictSettings()]}, {1, 2}):
        with pytest.raises(TypeError, match="expected a record"):
            write_record(path, strange)
        assert not path.exists()
    for array in (np.array([None]), np.zeros(2, [("a", int)])):
        with pytest.raises(TypeError, match="expected a record of plain arrays"):
            write_record(path, array)
    with monkeypatch.context() as patched:
        patched.setitem(KINDS, "VerdictSettings", VerdictSettings)
        write_record(path, VerdictSettings())
    with pytest.raises(InputError, match="expected a record of a station"):
        read_record(path)
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(InputError, match=r"other\.npz: [^\n]*damaged"):
        read_record(tmp_path / "other.npz")


def test_damaged_files_are_refused(tmp_path):
    path = tmp_path / "one.record"
    write_record(path, (np.arange(100),))
    whole = path.read_bytes()
    for length in range(0, len(whole), 37):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"one\.record"):
            read_record(path)
    for place in range(0, len(whole), 37):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        with pytest.raises(InputError, match=r"one\.record"):
            read_record(path)


def test_digests_tell_apart_what_differs():
    values = [
        (), (1,), (1.0,), ("1",), (None,), (np.zeros(3),), (np.zeros(3, np.float32),), (np.zeros((3, 1)),),
        (np.array([0.0, 0.0, -0.0]),), ([np.zeros(3)],), (np.zeros(1), np.zeros(2)), (np.zeros(2), np.zeros(1)),
    ]  # fmt: skip
    assert len({digest_of(*one) for one in values}) == len(values)
    assert digest_of(np.zeros(3), "a") == digest_of(np.zeros(3), "a")
