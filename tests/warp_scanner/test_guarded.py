"""A reader that crashes, stalls, swallows memory or talks does so in a process of its own, and costs one line."""

import io
import os
import pickle
import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from warp_scanner import guarded
from warp_scanner.guarded import Limits, Plain, limits_for, read_guarded

LIMITS = Limits(60, 4 << 30)
PATH = Path("a.ifc")


def well(path, options):
    print("what a library says")
    os.write(1, b"and what it says below Python")
    return Plain({"path": str(path), "options": options}, {"array": np.arange(5), "words": np.array(["ä", "\ud800"])})


def refuse(path, _):
    raise ValueError(f"{path}: expected more")


def crash(_, number):
    os.kill(os.getpid(), number)


def stall(*_):
    while True:
        pass


def sleep(*_):
    time.sleep(600.0)


def doze(*_):
    """Looks now and then whether something has come."""
    while True:
        time.sleep(0.05)


def work(path, seconds):
    begun = time.process_time()
    while time.process_time() - begun < seconds:
        pass
    return Plain(str(path), {})


def swallow(path, count):
    try:
        return Plain(len(np.ones(count)), {})
    except MemoryError as error:
        raise ValueError(f"{path}: too much") from error


def fail(*_):
    raise KeyError("a bug")


def sneak(*_):
    return Plain(None, {"objects": np.array([Marker("unused")], object)})


def forge(_, how):
    """What a reader that a file has taken over could do: answer in place of the code around it, and end well."""
    folder, kind = how
    forged = {
        "pickle": pickle.dumps(Marker(folder)),
        "npy": _saved(np.save, np.array([Marker(folder)], object)),
        "npz": _saved(np.savez, words=np.array([Marker(folder)], object)),
        "nothing": b"",
        "no words": _saved(np.savez, words=np.zeros(3)),
        "no zip": _saved(np.savez, words=np.zeros(3))[:-9],
    }[kind]
    for number in range(3, 32):
        try:
            os.write(number, forged)
        except OSError:
            continue
    os._exit(0)


class Marker:
    """Leaves a file behind where it is unpickled."""

    def __init__(self, folder):
        self.folder = folder

    def __reduce__(self):
        return os.mkdir, (os.path.join(self.folder, "unpickled"),)


def _saved(save, *arrays, **named):
    with io.BytesIO() as file:
        save(file, *arrays, **named)
        return file.getvalue()


def test_what_is_read_comes_back_whole():
    words, arrays = read_guarded(well, PATH, ["solid", 2.0], LIMITS)
    assert words == {"path": str(PATH), "options": ["solid", 2.0]}
    assert arrays.keys() == {"array", "words"}
    np.testing.assert_array_equal(arrays["array"], np.arange(5))
    np.testing.assert_array_equal(arrays["words"], ["ä", "\ud800"])


@pytest.mark.parametrize("kind", ["pickle", "npy", "npz", "nothing", "no words", "no zip"])
def test_no_answer_carries_code(tmp_path, kind):
    with pytest.raises(ValueError, match=r"^a.ifc: .* answer cannot be read$"):
        read_guarded(forge, PATH, [str(tmp_path), kind], LIMITS)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    "read, options, limits, words",
    [
        (refuse, None, LIMITS, "a.ifc: expected more"),
        (crash, signal.SIGSEGV, LIMITS, "a.ifc: .* killed by SIGSEGV"),
        (crash, signal.SIGABRT, LIMITS, "a.ifc: .* killed by SIGABRT"),
        (stall, None, Limits(1, 4 << 30), "a.ifc: .* 1 s of computing, .* not done"),
        (swallow, 10**9, LIMITS, "a.ifc: too much"),
        (fail, None, LIMITS, "a.ifc: .* the reader ended"),
        (sneak, None, LIMITS, "a.ifc: .* the reader ended"),
    ],
)
def test_what_goes_wrong_is_one_line(read, options, limits, words, capfd):
    with pytest.raises(ValueError, match=words) as caught:
        read_guarded(read, PATH, options, limits)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.long
@pytest.mark.parametrize("read", [sleep, doze])
def test_what_waits_for_ever_is_ended(monkeypatch, read):
    monkeypatch.setattr(guarded, "_IDLE", 3.0)
    monkeypatch.setattr(guarded, "_LOOK", 0.5)
    with pytest.raises(ValueError, match=r"a.ifc: .* computed nothing for 3 s and was not done"):
        read_guarded(read, PATH, None, LIMITS)


def test_what_computes_is_waited_for(monkeypatch):
    monkeypatch.setattr(guarded, "_IDLE", 0.5)
    monkeypatch.setattr(guarded, "_LOOK", 0.1)
    monkeypatch.setattr(guarded, "_LEAST", 0.05)
    assert read_guarded(work, PATH, 2.0, LIMITS).words == str(PATH)


def test_limits_grow_with_the_file(tmp_path):
    (tmp_path / "a.ifc").write_bytes(bytes(1_000_000))
    assert limits_for(tmp_path / "a.ifc") == Limits(120, (4 << 30) + 200_000_000)


def test_brackets_without_end_are_one_line(tmp_path):
    pytest.importorskip("ifcopenshell")
    from tests.cases.valid_ifc import ifc_text
    from warp_scanner.buildings.ifc_files import read_ifc

    path = tmp_path / "a.ifc"
    path.write_bytes(ifc_text("IFC4").replace(b"'IFC4'", b"'IFC4'" + b"[" * 100_000))  # crashes ifcopenshell 0.9
    with pytest.raises(ValueError, match=re.escape(str(path))) as caught:
        read_ifc(path)
    assert "\n" not in str(caught.value)
