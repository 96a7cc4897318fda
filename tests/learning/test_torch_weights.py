"""The reader of PyTorch state dicts: torch as witness, and files that try to be something else."""

import os
import pickle
import pickletools
import zipfile
from collections import OrderedDict
from typing import ClassVar

import numpy as np
import pytest

from jaxmm.inputs import InputError
from jaxmm.learning.torch_weights import read_state_dict, run_pickle
from jaxmm.thesis import repository

TORCH_MISSING = "the witness, torch, is not installed"
NUMBERS = np.arange(6, dtype="<f4").tobytes()


class Reference:
    """Becomes a persistent id when pickled, as torch does with storages."""

    def __init__(self, *identity):
        self.identity = identity


class Global:
    """Becomes a name to import."""

    def __init__(self, module, name):
        self.module, self.name = module, name

    def __call__(self):
        raise AssertionError("only there because a pickler asks for something that can be called")


class Call:
    """Becomes a call of `function` when the pickle is loaded."""

    def __init__(self, function, *arguments):
        self.call = (function, arguments)

    def __reduce__(self):
        return self.call


class Rebuild(Call):
    """A tensor as torch stores it."""

    def __init__(self, offset=0, shape=(2, 3), stride=(3, 1), count=6, kind="FloatStorage", key="0"):
        storage = Reference("storage", Global("torch", kind), key, "cpu", count)
        function = Global("torch._utils", "_rebuild_tensor_v2")
        super().__init__(function, storage, offset, shape, stride, False, OrderedDict())


class Pickler(pickle._Pickler):
    """Writes what torch's own pickler writes, without torch."""

    dispatch: ClassVar = dict(pickle._Pickler.dispatch)

    def persistent_id(self, item):
        return item.identity if isinstance(item, Reference) else None

    def save_name(self, item):
        self.write(pickle.GLOBAL + f"{item.module}\n{item.name}\n".encode())

    dispatch[Global] = save_name


def write_archive(path, content, storages, protocol=2, **options):
    """A .pth file: `content` pickled, and the raw bytes of each storage."""
    with zipfile.ZipFile(path, "w", **options) as archive:
        with archive.open("weights/data.pkl", "w") as file:
            Pickler(file, protocol).dump(content)
        for key, data in storages.items():
            archive.writestr(f"weights/data/{key}", data)
    return path


def refuses(path, *words):
    with pytest.raises(InputError) as caught:
        read_state_dict(path)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 600
    for word in (str(path), *words):
        assert word in message


@pytest.mark.parametrize("protocol", [2, 4])
@pytest.mark.parametrize("kind", [dict, OrderedDict])
def test_reads_a_sound_file(tmp_path, protocol, kind):
    content = kind({"layer.weight": Rebuild(), "turned": Rebuild(1, (2, 2), (1, 3)), "scalar": Rebuild(5, (), ())})
    result = read_state_dict(write_archive(tmp_path / "a.pth", content, {"0": NUMBERS}, protocol))
    assert list(result) == ["layer.weight", "turned", "scalar"]
    np.testing.assert_array_equal(result["layer.weight"], [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(result["turned"], [[1, 4], [2, 5]])
    assert result["scalar"] == 5 and result["scalar"].shape == ()


@pytest.mark.parametrize(
    "tensor, word",
    [
        pytest.param(Rebuild(shape=(2, 4)), "more elements", id="more than stored"),
        pytest.param(Rebuild(offset=1), "reaches", id="offset too far"),
        pytest.param(Rebuild(shape=(2, 2), stride=(5, 1)), "reaches", id="stride too far"),
        pytest.param(Rebuild(offset=-1), ">= 0", id="negative offset"),
        pytest.param(Rebuild(stride=(-3, 1)), ">= 0", id="negative stride"),
        pytest.param(Rebuild(shape=(-2, -3)), ">= 0", id="negative shape"),
        pytest.param(Rebuild(shape=(6,)), ">= 0", id="ranks differ"),
        pytest.param(Rebuild(shape=(10**12,), stride=(0,)), "more elements", id="one number, endlessly"),
        pytest.param(Rebuild(shape=((2,), 3)), ">= 0", id="nested shape"),
        pytest.param(Rebuild(count=7), "bytes", id="count differs from the data"),
        pytest.param(Rebuild(count=10**15), "bytes", id="huge count"),
        pytest.param(Rebuild(kind="DoubleStorage"), "48 bytes", id="type differs from the data"),
        pytest.param(Rebuild(kind="QInt8Storage"), "QInt8Storage", id="unknown type"),
        pytest.param(Rebuild(key="7"), "data/7", id="no data"),
        pytest.param(Rebuild(key="../data.pkl"), "no entry", id="another entry"),
        pytest.param(3.5, "BINFLOAT", id="a number"),
        pytest.param("text", "str", id="text"),
        pytest.param({"inner": Rebuild()}, "dict", id="nested dict"),
        pytest.param([Rebuild()], "EMPTY_LIST", id="list"),
        pytest.param(
            Reference("storage", Global("torch", "FloatStorage"), "0", "cpu", 6), "Storage", id="bare storage"
        ),
        pytest.param(Reference("other", 3), "storage", id="other reference"),
        pytest.param(np.float32(3), "expected tensors only", id="NumPy scalar"),
        pytest.param(Global("os", "system"), "os.system", id="bare name"),
        pytest.param(Global("torch", "load"), "torch.load", id="torch's own functions"),
    ],
)
def test_anything_but_tensors_within_their_storage_is_refused(tmp_path, tensor, word):
    refuses(write_archive(tmp_path / "a.pth", {"x": tensor}, {"0": NUMBERS}), word)


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4, 5])
@pytest.mark.parametrize("function", [os.system, eval, exec, os.remove])
def test_no_code_of_a_file_runs(tmp_path, protocol, function):
    victim = tmp_path / "victim"
    victim.write_text("here")
    argument = {
        os.system: f"rm {victim}",
        os.remove: str(victim),
        eval: f"__import__('os').remove({str(victim)!r})",
        exec: f"import os; os.remove({str(victim)!r})",
    }[function]
    malicious = Call(function, argument)
    path = write_archive(tmp_path / "a.pth", {"x": malicious, "y": Rebuild()}, {"0": NUMBERS}, protocol)
    refuses(path)
    assert victim.exists()
    with zipfile.ZipFile(path) as archive:
        pickled = archive.read("weights/data.pkl")
    # The bomb is live: the program names the function and calls it.
    steps = [(step.name, str(argument)) for step, argument, _ in pickletools.genops(pickled)]
    assert "REDUCE" in dict(steps) and any(function.__name__ in argument for _, argument in steps)


def test_attributes_reach_no_function():
    """BUILD could set attributes of what it finds; only a dict is admitted, and there they are dropped."""
    program = b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n}X\x08\x00\x00\x00__code__K\x01sb."
    with pytest.raises(ValueError, match="attributes"):
        run_pickle(program)


def test_files_that_are_no_archive_are_refused(tmp_path):
    refuses(tmp_path / "none.pth", "nothing there")
    refuses(tmp_path, "a folder")
    for name, data in {"empty": b"", "text": b"hello", "old": pickle.dumps({"x": 1})}.items():
        (tmp_path / name).write_bytes(data)
        refuses(tmp_path / name, "zip")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("weights/other", "x")
    refuses(tmp_path / "a.zip", "data.pkl")
    refuses(write_archive(tmp_path / "b.pth", {}, {}), "dict of tensors")
    refuses(write_archive(tmp_path / "c.pth", {"x": Rebuild()}, {"0": np.full(6, np.nan, "<f4").tobytes()}), "NaN")
    assert list(read_state_dict(write_archive(tmp_path / "d.pth", {"x": Rebuild()}, {"0": NUMBERS}))) == ["x"]


def test_compressed_bombs_are_refused_before_they_unfold(tmp_path):
    content = {"x": Rebuild(shape=(10**7,), stride=(1,), count=10**7)}
    path = write_archive(tmp_path / "a.pth", content, {"0": bytes(4 * 10**7)}, compression=zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 10**5
    refuses(path, "uncompressed")


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    path = write_archive(tmp_path_factory.mktemp("sound") / "a.pth", {"x": Rebuild()}, {"0": NUMBERS})
    return path.read_bytes()


def test_every_truncation_is_refused(tmp_path, sound):
    for length in range(len(sound)):
        (tmp_path / "a.pth").write_bytes(sound[:length])
        refuses(tmp_path / "a.pth")
    (tmp_path / "a.pth").write_bytes(sound)
    assert list(read_state_dict(tmp_path / "a.pth")) == ["x"]


def test_damaged_bytes_give_the_tensor_or_a_refusal(tmp_path, sound):
    rng = np.random.default_rng(0)
    for _ in range(1000):
        damaged = bytearray(sound)
        for place in rng.integers(0, len(sound), rng.integers(1, 4)):
            damaged[place] = rng.integers(256)
        (tmp_path / "a.pth").write_bytes(damaged)
        try:
            result = read_state_dict(tmp_path / "a.pth")
        except InputError:
            continue
        assert all(isinstance(value, np.ndarray) for value in result.values())


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # from pickletools, on damaged text
def test_damaged_programs_give_a_value_or_a_plain_error(sound, tmp_path):
    """Checksums guard the archive; here the interpreter faces random programs alone."""
    (tmp_path / "a.pth").write_bytes(sound)
    with zipfile.ZipFile(tmp_path / "a.pth") as archive:
        program = archive.read("weights/data.pkl")
    rng, values, errors = np.random.default_rng(1), 0, 0
    for _ in range(1500):
        damaged = bytearray(program)
        for place in rng.integers(0, len(program), rng.integers(1, 6)):
            damaged[place] = rng.integers(256)
        path = tmp_path / "b.pth"
        try:
            run_pickle(bytes(damaged))
            values += 1
        except (ValueError, IndexError, KeyError, TypeError):
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr("weights/data.pkl", bytes(damaged))
            refuses(path)
            errors += 1
    assert values + errors == 1500 and min(values, errors) > 10


def test_agrees_with_torch(tmp_path):
    torch = pytest.importorskip("torch", reason=TORCH_MISSING)
    base = torch.randn(4, 6, 5)
    state = OrderedDict(
        plain=base,
        turned=base.permute(2, 0, 1),
        part=base[1:3, ::2, 4],
        scalar=torch.tensor(7),
        empty=torch.zeros(0, 3),
        truth=torch.tensor([True, False]),
        **{
            str(kind): torch.arange(5).to(kind)
            for kind in (torch.float64, torch.float16, torch.int16, torch.uint8, torch.int8)
        },
    )
    torch.save(state, tmp_path / "a.pth")
    ours = read_state_dict(tmp_path / "a.pth")
    assert list(ours) == list(state)
    for name, tensor in state.items():
        assert ours[name].dtype == tensor.numpy().dtype and ours[name].shape == tuple(tensor.shape)
        np.testing.assert_array_equal(ours[name], tensor.numpy())
    assert np.shares_memory(ours["plain"], ours["turned"])  # a view stays one
    assert not ours["plain"].flags.writeable


def test_a_whole_module_of_torch_is_refused(tmp_path):
    torch = pytest.importorskip("torch", reason=TORCH_MISSING)
    torch.save(torch.nn.Linear(3, 2), tmp_path / "a.pth")
    refuses(tmp_path / "a.pth", "expected tensors only")
    torch.save({"model": torch.nn.Linear(3, 2).state_dict(), "epoch": 3}, tmp_path / "b.pth")
    refuses(tmp_path / "b.pth", "expected tensors only")


def test_released_weights_agree_with_torch(data_root):
    torch = pytest.importorskip("torch", reason=TORCH_MISSING)
    weights = repository.find_weights(data_root / "thesis")
    assert len(weights) == 4
    for path in weights.values():
        ours, theirs = read_state_dict(path), torch.load(path, map_location="cpu", weights_only=True)
        assert list(ours) == list(theirs) and len(ours) == 44
        for name, tensor in theirs.items():
            np.testing.assert_array_equal(ours[name], tensor.numpy(), strict=True)
