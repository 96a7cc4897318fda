"""Users' files: what is sound comes back exactly, everything else ends in one line that names the file."""

import numpy as np
import pytest

from jaxmm.inputs import InputError
from jaxmm.thesis.inputs import read_csv, read_labels, read_points


def saved(path, array, **options):
    np.save(path, array, **options)
    return path


def refusal(read, path) -> str:
    """The one line in which `read(path)` ends; it names the file."""
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 600 and str(path) in message
    return message


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.float16, np.int16, ">f4"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_points_come_back_as_written(tmp_path, dtype, order):
    points = np.asarray(np.random.default_rng(0).uniform(-50, 50, (100, 3)).astype(dtype), order=order)
    read = read_points(saved(tmp_path / "a.npy", points))
    assert read.dtype == np.float32 and read.flags.c_contiguous and read.flags.writeable
    np.testing.assert_array_equal(read, points.astype(np.float32))


@pytest.mark.parametrize(
    "array, word",
    [
        pytest.param(np.zeros((0, 3)), "at least one point", id="empty"),
        pytest.param(np.zeros((5, 2)), "(5, 2)", id="two columns"),
        pytest.param(np.zeros(5), "(5,)", id="flat"),
        pytest.param(np.zeros((2, 5, 3)), "(2, 5, 3)", id="three axes"),
        pytest.param(np.float64(3), "()", id="scalar"),
        pytest.param([[0, 0, 0], [0, np.nan, 0]], "the first 1", id="NaN"),
        pytest.param([[0, 0, -np.inf]], "infinity", id="infinity"),
        pytest.param([[1e300, 0, 0]], "float32", id="overflows float32"),
        pytest.param([[5e6 + 0.17, 0, 0]], "move the origin", id="national grid"),
        pytest.param(np.full((4, 3), "a"), "dtype", id="text"),
        pytest.param(np.zeros((4, 3), complex), "dtype", id="complex"),
        pytest.param(np.zeros(4, [("x", "f4"), ("y", "f4"), ("z", "f4")]), "dtype", id="records"),
    ],
)
def test_points_that_are_none_are_refused(tmp_path, array, word):
    assert word in refusal(read_points, saved(tmp_path / "a.npy", array))


def test_objects_are_never_unpickled(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "exploded"), "w"))

    array = np.array([[Bomb(), 0, 0]], object)
    assert "numbers" in refusal(read_points, saved(tmp_path / "a.npy", array))
    assert not (tmp_path / "exploded").exists()


def test_what_is_no_npy_file_is_refused(tmp_path):
    assert "nothing there" in refusal(read_points, tmp_path / "none.npy")
    assert "a folder" in refusal(read_points, tmp_path)
    np.savez(tmp_path / "a.npz", np.zeros((3, 3)))
    assert refusal(read_points, tmp_path / "a.npz")
    (tmp_path / "b.npy").write_bytes(b"")
    assert refusal(read_points, tmp_path / "b.npy")


def test_every_truncation_is_refused(tmp_path):
    whole = saved(tmp_path / "a.npy", np.ones((10, 3), np.float32)).read_bytes()
    cut = tmp_path / "cut.npy"
    for length in range(len(whole)):
        cut.write_bytes(whole[:length])
        assert refusal(read_points, cut)


@pytest.mark.parametrize(
    "shape", ["(10000000000000, 3)", "(-1, 3)", "(4611686018427387905, 3)", "(99999999999999999999, 3)"]
)
def test_a_header_that_promises_too_much_takes_no_memory(tmp_path, shape):
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    path = tmp_path / "a.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(120))
    assert refusal(read_points, path)


@pytest.mark.filterwarnings("ignore")  # a damaged header is Python text that may warn when parsed
def test_damaged_bytes_give_points_or_a_refusal(tmp_path):
    whole = saved(tmp_path / "a.npy", np.ones((10, 3), np.float32)).read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(1500):
        damaged = bytearray(whole)
        for place in rng.integers(0, 140, rng.integers(1, 4)):
            damaged[place] = rng.integers(256)
        (tmp_path / "b.npy").write_bytes(damaged)
        try:
            points = read_points(tmp_path / "b.npy")
        except InputError:
            continue
        assert points.shape[1:] == (3,) and np.isfinite(points).all()


@pytest.mark.parametrize("dtype", [np.float32, np.int64, bool, np.uint8])
def test_labels_come_back_as_written(tmp_path, dtype):
    label = np.arange(20) % 3 == 0
    read = read_labels(saved(tmp_path / "a.npy", label.astype(dtype)), 20)
    assert read.dtype == bool
    np.testing.assert_array_equal(read, label)


@pytest.mark.parametrize(
    "array, word",
    [
        pytest.param(np.zeros(19), "(19,)", id="one short"),
        pytest.param(np.zeros((20, 1)), "(20, 1)", id="two axes"),
        pytest.param(np.full(20, 2), "the first 2", id="other class"),
        pytest.param(np.full(20, 0.5), "0.5", id="probabilities"),
        pytest.param(np.full(20, np.nan), "nan", id="NaN"),
    ],
)
def test_labels_that_are_none_are_refused(tmp_path, array, word):
    assert word in refusal(lambda path: read_labels(path, 20), saved(tmp_path / "a.npy", array))


def test_csv_finds_its_columns_by_name(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes("\ufeffcategoryID; Z ;name;X;Y\r\n3.0;1.5;wall;0.1;-2\r\n-7;2;chair;1e1;4\r\n".encode())
    points, element = read_csv(path)
    np.testing.assert_array_equal(points, np.array([[0.1, -2, 1.5], [10, 4, 2]], np.float32))
    np.testing.assert_array_equal(element, [3, -7])
    assert points.dtype == np.float32 and element.dtype == np.int32


@pytest.mark.parametrize(
    "text, word",
    [
        pytest.param("", "columns", id="empty file"),
        pytest.param("X;Y;Z\n1;2;3\n", "categoryID", id="column missing"),
        pytest.param("X;X;Y;Z;categoryID\n1;1;2;3;4\n", "once", id="column twice"),
        pytest.param("X,Y,Z,categoryID\n1,2,3,4\n", "X,Y,Z", id="commas"),
        pytest.param("X;Y;Z;categoryID\n", "none", id="no rows"),
        pytest.param("X;Y;Z;categoryID\n\n\n", "none", id="blank rows"),
        pytest.param("X;Y;Z;categoryID\n1;2;3;4\n1;2\n", "numbers", id="short row"),
        pytest.param("X;Y;Z;categoryID\n1;2;three;4\n", "three", id="words"),
        pytest.param("X;Y;Z;categoryID\n1,5;2;3;4\n", "1,5", id="decimal comma"),
        pytest.param("X;Y;Z;categoryID\n1;2;nan;4\n", "NaN", id="NaN"),
        pytest.param("X;Y;Z;categoryID\n1;2;3;4.5\n", "whole", id="broken id"),
        pytest.param("X;Y;Z;categoryID\n1;2;3;inf\n", "whole", id="infinite id"),
        pytest.param("X;Y;Z;categoryID\n1;2;3;4e9\n", "32 bits", id="id too large"),
    ],
)
def test_csv_that_is_none_is_refused(tmp_path, text, word):
    (tmp_path / "a.csv").write_text(text)
    assert word in refusal(read_csv, tmp_path / "a.csv")


def test_bytes_that_are_no_text_are_refused(tmp_path):
    (tmp_path / "a").write_bytes(b"X;Y;Z;categoryID\n\xff\xfe")
    assert "UTF-8" in refusal(read_csv, tmp_path / "a")
    assert "nothing there" in refusal(read_csv, tmp_path / "none")
