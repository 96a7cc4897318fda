"""Reads PyTorch state dicts without PyTorch, and nothing else: no code that a file names is ever called.

A `.pth` file is a zip archive: `<name>/data.pkl`, a pickle that lists tensors, and `<name>/data/<key>`, their raw
numbers. A pickle is a program for a small stack machine. The one below knows the few instructions that a state dict
needs; `pickletools` splits the bytes into instructions and runs none of them.
"""

import math
import pickletools
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmm.inputs import InputError, one_line

MAX_PICKLE = 16 * 2**20  # [bytes]; a state dict's list of tensors takes some kilobytes
STORAGES = {
    "DoubleStorage": "f8",
    "FloatStorage": "f4",
    "HalfStorage": "f2",
    "LongStorage": "i8",
    "IntStorage": "i4",
    "ShortStorage": "i2",
    "CharStorage": "i1",
    "ByteStorage": "u1",
    "BoolStorage": "?",
}
ORDERED_DICT = ("collections", "OrderedDict")
REBUILD_TENSOR = ("torch._utils", "_rebuild_tensor_v2")
PLAIN = {"BINUNICODE", "SHORT_BINUNICODE", "BININT", "BININT1", "BININT2", "LONG1"}
CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False, "EMPTY_TUPLE": ()}
TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}


class Name(NamedTuple):
    """A name that the pickle would import; here it only stands for itself."""

    module: str
    name: str


class Storage(NamedTuple):
    """A flat run of numbers in the archive."""

    code: str  # NumPy type without byte order
    key: str  # of its entry under data/
    count: int


class Tensor(NamedTuple):
    """A view of a storage; offset and stride in elements, checked to stay within it."""

    storage: Storage
    offset: int
    shape: tuple[int, ...]
    stride: tuple[int, ...]


MARK = object()


def read_state_dict(path: Path | str) -> dict[str, np.ndarray]:
    """The tensors of a PyTorch state dict by name.

    Returns:
        Read-only arrays with the saved shapes, types and strides; tensors that shared memory still do.

    Raises:
        InputError: missing or damaged file, no PyTorch archive, anything but a flat dict of tensors, a tensor that
            reaches beyond its storage, or NaN or infinity.
    """
    if not Path(path).is_file():
        raise InputError(
            f"{path}: expected a .pth file, found {'a folder' if Path(path).is_dir() else 'nothing there'}"
        )
    try:
        with zipfile.ZipFile(path) as archive:
            return _read_archive(archive, path)
    except InputError:
        raise
    except (OSError, EOFError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"{path}: expected a whole zip archive as torch.save writes it: {one_line(error)}") from error
    except Exception as error:  # zipfile leaks struct.error and others on damaged headers
        raise InputError(f"{path}: damaged .pth file: {type(error).__name__}: {one_line(error)}") from error


def _read_archive(archive: zipfile.ZipFile, path: Path | str) -> dict[str, np.ndarray]:
    entries = archive.infolist()
    names = [entry.filename for entry in entries]
    size = Path(path).stat().st_size
    # torch stores without compression, so no entry can be larger than the file, nor all of them together: no zip bombs.
    if any(entry.compress_type != zipfile.ZIP_STORED or entry.file_size != entry.compress_size for entry in entries):
        raise InputError(f"{path}: expected uncompressed entries, as torch.save writes them")
    if sum(entry.file_size for entry in entries) > size or len(set(names)) < len(names):
        raise InputError(f"{path}: expected entries that do not overlap, each with its own name")
    pickles = [name for name in names if name.count("/") == 1 and name.endswith("/data.pkl")]
    if len(pickles) != 1:
        raise InputError(f"{path}: expected one <name>/data.pkl in the archive, found {len(pickles)}")
    folder = pickles[0].removesuffix("data.pkl")
    if archive.getinfo(pickles[0]).file_size > MAX_PICKLE:
        raise InputError(f"{path}: data.pkl is larger than {MAX_PICKLE} bytes, too large for a state dict")
    try:
        content = run_pickle(archive.read(pickles[0]))
    except (
        IndexError,
        KeyError,
        TypeError,
    ) as error:  # an instruction that finds the stack or memo without its operand
        raise InputError(f"{path}: data.pkl is damaged: {type(error).__name__}") from error
    except ValueError as error:
        raise InputError(f"{path}: {one_line(error)}") from error
    order = archive.read(folder + "byteorder") if folder + "byteorder" in names else b"little"
    if order not in (b"little", b"big"):
        raise InputError(f"{path}: expected byteorder little or big, got {order[:20]!r}")
    loaded: dict[str, bytes] = {}
    return {
        name: _as_array(name, tensor, order.decode(), lambda key: archive.read(f"{folder}data/{key}"), loaded, path)
        for name, tensor in _check_content(content, path).items()
    }


def run_pickle(program: bytes) -> Any:
    """Interpret the instructions of a state dict; what it names is compared with a short list, never imported.

    Raises:
        ValueError: an instruction or a name that no state dict of tensors needs, or a truncated program.
    """
    stack: list[Any] = []
    memo: dict[int, Any] = {}
    for opcode, argument, _ in pickletools.genops(program):
        name = opcode.name
        if name == "STOP":
            return stack.pop()
        elif name in ("PROTO", "FRAME"):
            pass
        elif name in PLAIN:
            stack.append(argument)
        elif name in CONSTANTS:
            stack.append(CONSTANTS[name])
        elif name == "EMPTY_DICT":
            stack.append({})
        elif name == "MARK":
            stack.append(MARK)
        elif name in ("BINPUT", "LONG_BINPUT"):
            memo[argument] = stack[-1]
        elif name == "MEMOIZE":
            memo[len(memo)] = stack[-1]
        elif name in ("BINGET", "LONG_BINGET"):
            stack.append(memo[argument])
        elif name in TUPLES:
            stack[-TUPLES[name] :] = [tuple(_top(stack, TUPLES[name]))]
        elif name == "TUPLE":
            stack.append(tuple(_pop_to_mark(stack)))
        elif name == "SETITEM":
            value, key = stack.pop(), stack.pop()
            _set_items(stack[-1], [key, value])
        elif name == "SETITEMS":
            items = _pop_to_mark(stack)
            _set_items(stack[-1], items)
        elif name == "GLOBAL":
            stack.append(_admitted(*argument.split(" ", 1)))
        elif name == "STACK_GLOBAL":
            word, module = stack.pop(), stack.pop()
            stack.append(_admitted(module, word))
        elif name == "BINPERSID":
            stack.append(_storage(stack.pop()))
        elif name == "REDUCE":
            arguments, function = stack.pop(), stack.pop()
            stack.append(_call(function, arguments))
        elif name == "BUILD":
            # torch hangs format versions on the dict as an attribute; tensors do not need them.
            if not isinstance(stack.pop(), dict) or not isinstance(stack[-1], dict):
                raise ValueError("expected attributes on the dict of tensors only")
        else:
            raise ValueError(f"expected tensors only, got the pickle instruction {name}")
    raise ValueError("data.pkl ends too early")


def _top(stack: list[Any], count: int) -> list[Any]:
    if len(stack) < count:
        raise ValueError("data.pkl is damaged: stack underflow")
    return stack[-count:]


def _pop_to_mark(stack: list[Any]) -> list[Any]:
    items = []
    while (item := stack.pop()) is not MARK:
        items.append(item)
    return items[::-1]


def _set_items(target: Any, items: list[Any]) -> None:
    if not isinstance(target, dict) or len(items) % 2 or not all(isinstance(key, str) for key in items[::2]):
        raise ValueError("expected a dict with text as keys")
    target.update(zip(items[::2], items[1::2], strict=True))


def _admitted(module: Any, name: Any) -> Name:
    # Values of the file are printed only when they are known to be short: nested tuples can print without end.
    if not (isinstance(module, str) and isinstance(name, str)):
        raise ValueError("expected tensors only, the file names something that is no text")
    storage = module == "torch" and name in STORAGES
    if not (storage or (module, name) in (ORDERED_DICT, REBUILD_TENSOR)):
        raise ValueError(f"expected tensors only, the file names {module[:60]}.{name[:60]}")
    return Name(module, name)


def _storage(identity: Any) -> Storage:
    match identity:
        case ("storage", Name("torch", kind), str(key), str(), int(count)) if kind in STORAGES and count >= 0:
            return Storage(STORAGES[kind], key, count)
    raise ValueError("expected a reference to a storage of numbers, got something else")


def _call(function: Any, arguments: Any) -> Any:
    if function == ORDERED_DICT and arguments == ():
        return {}
    if function == REBUILD_TENSOR:
        match arguments:
            case (Storage() as storage, int(offset), tuple(shape), tuple(stride), bool(), dict()):
                return _tensor(storage, offset, shape, stride)
    raise ValueError("expected a call that makes a tensor, got another")


def _tensor(storage: Storage, offset: int, shape: tuple, stride: tuple) -> Tensor:
    numbers = (offset, *shape, *stride)
    if len(shape) != len(stride) or len(shape) > 16 or any(type(n) is not int or n < 0 for n in numbers):
        raise ValueError("expected whole numbers >= 0 as a tensor's offset, shape and stride, got others")
    if math.prod(shape) > storage.count:  # also ends shapes of huge size that repeat one number with stride 0
        raise ValueError(f"a tensor of shape {shape} has more elements than its storage of {storage.count}"[:200])
    last = offset + sum((size - 1) * step for size, step in zip(shape, stride, strict=True))
    if math.prod(shape) and last >= storage.count:
        raise ValueError(f"a tensor reaches element {last} of a storage of {storage.count}"[:200])
    return Tensor(storage, offset, shape, stride)


def _check_content(content: Any, path: Path | str) -> dict[str, Tensor]:
    if not isinstance(content, dict) or not content:
        raise InputError(f"{path}: expected a dict of tensors, got {type(content).__name__}")
    for name, value in content.items():
        if not isinstance(value, Tensor):
            raise InputError(f"{path}: expected tensors only, got {type(value).__name__} under {name[:60]!r}")
    return content


def _as_array(
    name: str, tensor: Tensor, order: str, read: Callable[[str], bytes], loaded: dict[str, bytes], path: Path | str
) -> np.ndarray:
    storage = tensor.storage
    dtype = np.dtype(storage.code).newbyteorder(order)
    if storage.key not in loaded:
        try:
            loaded[storage.key] = read(storage.key)
        except KeyError as error:
            raise InputError(f"{path}: no numbers for {name[:60]!r}: no entry data/{storage.key[:60]}") from error
    data = loaded[storage.key]
    if len(data) != storage.count * dtype.itemsize:
        expected = storage.count * dtype.itemsize
        raise InputError(f"{path}: expected {expected} bytes for {name[:60]!r}, got {len(data)}")
    if not math.prod(tensor.shape):
        return np.zeros(tensor.shape, dtype)
    strides = tuple(step * dtype.itemsize for step in tensor.stride)
    array = np.ndarray(tensor.shape, dtype, data, tensor.offset * dtype.itemsize, strides)
    if not np.isfinite(array).all():
        raise InputError(f"{path}: expected finite numbers, got NaN or infinity in {name[:60]!r}")
    return array
