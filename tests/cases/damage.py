"""Damages to the bytes of a file, from a flipped bit to brackets without end; a reader and a number give the same."""

import re
import struct

import numpy as np

from tests.cases.valid_files import ValidFile

NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
ODD_NUMBERS = (
    *(b"-1", b"0", b"1", b"65536", b"1000000000", b"2147483648", b"4294967295", b"18446744073709551616", b"9" * 400),
    *(b"1e9", b"1e400", b"1e-320", b"-0.0", b"nan", b"-inf", b"0x10", b"1,5", b"1_0", b"*", b""),
)
ODD_WORDS = (
    *(b"\xff\xfe\xfd", b"\0", b"\r", b"\n\n", b"'", b'"', b";", b"$", b"<!--", b"&a;", b"\xe2\x80\xae", b"%s%n"),
    *(b"((((" * 2000, b"[[[[" * 2000, b'{"a":' * 5000, b" " * 70_000, b"../../x", b"#1", b"#29"),
)


def mutate(data: bytes, rng: np.random.Generator) -> bytes:
    """One to four damages, one after the other."""
    for _ in range(rng.choice([1, 1, 1, 2, 3, 4])):
        data = DAMAGES[rng.integers(len(DAMAGES))](data, rng)
    return data


def _place(data: bytes, rng: np.random.Generator) -> int:
    """Somewhere, half of the time near the beginning, where headers are."""
    reach = min(len(data), 600) if rng.random() < 0.5 else len(data)
    return int(rng.integers(reach + 1))


def _flip(data: bytes, rng: np.random.Generator) -> bytes:
    made = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if made:
            made[min(_place(data, rng), len(made) - 1)] ^= 1 << int(rng.integers(8))
    return bytes(made)


def _replace(data: bytes, rng: np.random.Generator) -> bytes:
    place, length = _place(data, rng), int(rng.integers(1, 9))
    fill = bytes([rng.choice([0, 255, 127, 128])]) * length if rng.random() < 0.5 else rng.bytes(length)
    return data[:place] + fill + data[place + length :]


def _insert(data: bytes, rng: np.random.Generator) -> bytes:
    place = _place(data, rng)
    word = ODD_WORDS[rng.integers(len(ODD_WORDS))] if rng.random() < 0.5 else rng.bytes(int(rng.integers(1, 65)))
    return data[:place] + word + data[place:]


def _delete(data: bytes, rng: np.random.Generator) -> bytes:
    place = _place(data, rng)
    return data[:place] + data[place + int(2 ** rng.uniform(0, 10)) :]


def _truncate(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: _place(data, rng)]


def _swap(data: bytes, rng: np.random.Generator) -> bytes:
    a, b, c = sorted(int(place) for place in rng.integers(len(data) + 1, size=3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def _repeat(data: bytes, rng: np.random.Generator) -> bytes:
    place = _place(data, rng)
    block = data[place : place + int(2 ** rng.uniform(0, 10))]
    return data[:place] + block * int(rng.integers(1, 20)) + data[place:]


def _edit_number(data: bytes, rng: np.random.Generator) -> bytes:
    """A number that is written out, most of the time one of the header."""
    found = list(NUMBER.finditer(data[:8192]))
    if not found:
        return _edit_field(data, rng)
    pick = found[int(len(found) * rng.random() ** 2)]
    return data[: pick.start()] + ODD_NUMBERS[rng.integers(len(ODD_NUMBERS))] + data[pick.end() :]


def _edit_field(data: bytes, rng: np.random.Generator) -> bytes:
    """A number in binary: a count of 10^9, one below zero, the largest, NaN."""
    if rng.random() < 0.5:
        odd = np.array(rng.choice([0, 1, -1, 2**31 - 1, 10**9, 65_535, 255]), "<i8").tobytes()
        odd = odd[: rng.choice([1, 2, 4, 8])]
    else:
        odd = struct.pack(rng.choice(["<f", "<d"]), rng.choice([np.nan, np.inf, -3e38, 1e-30, 1e20]))
    place = _place(data, rng)
    return data[:place] + odd + data[place + len(odd) :]


def _edit_length(data: bytes, rng: np.random.Generator) -> bytes:
    """A number in binary that may be a length, a count or a place in the file: a little off, or far beyond."""
    code = str(rng.choice(["<H", "<I", "<Q", ">H", ">I"]))
    size, start = struct.calcsize(code), _place(data, rng)
    for place in range(start, min(start + 200, len(data) - size)):
        (told,) = struct.unpack_from(code, data, place)
        if 0 < told <= 2 * len(data):
            beyond = told + int(rng.choice([-1, 1, 8, -told, told, len(data), 2 ** (8 * size - 2)]))
            return data[:place] + struct.pack(code, beyond % 2 ** (8 * size)) + data[place + size :]
    return _edit_field(data, rng)


def _swap_lines(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    a, b = rng.integers(min(len(lines), 100), size=2)
    lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


DAMAGES = (
    _flip,
    _replace,
    _insert,
    _delete,
    _truncate,
    _swap,
    _repeat,
    _edit_number,
    _edit_number,
    _edit_field,
    _edit_length,
    _edit_length,
    _swap_lines,
)


def damaged(name: str, valid: ValidFile, number: int) -> bytes:
    """The bytes of a case; every second one of a guarded format has its guards put right behind the damage."""
    rng = np.random.default_rng([number, *name.encode()])
    if valid.unwrap and valid.wrap and number % 4:
        return valid.wrap(valid.data, mutate(valid.unwrap(valid.data), rng))
    return mutate(valid.data, rng)
