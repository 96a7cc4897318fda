"""Work is shared out whole, to threads that stay, and not to those of a process that this one is a copy of."""

import os
import signal
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType

import numpy as np
import pytest

from warp_scanner import launches
from warp_scanner.launches import load, load_all, share_out


@pytest.mark.parametrize("count", [0, 1, 7, 1000])
@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("at_once", [None, 1, 6])
def test_every_item_is_worked_on_once(count, threads, at_once):
    times = np.zeros(count, int)

    def work(first, size):
        times[first : first + size] += 1

    share_out(work, count, threads, at_once)
    assert (times == 1).all()


def test_threads_stay_from_call_to_call_and_errors_come_through():
    seen = set()
    for _ in range(20):
        share_out(lambda *_: seen.add(threading.get_ident()), 100, 2)
    assert threading.get_ident() not in seen and len(seen) <= 2
    with pytest.raises(ZeroDivisionError):
        share_out(lambda first, _: 1 / (first - 50), 100, 2, at_once=1)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no process can be split")
@pytest.mark.skipif("jax" in sys.modules, reason="JAX and fork do not get along")
def test_a_copy_of_the_process_makes_threads_of_its_own():
    share_out(lambda *_: None, 100, 2)
    launches._compiler().submit(int).result()
    number = os.fork()
    if not number:
        signal.alarm(20)  # it would wait for threads that it does not have
        done = []
        share_out(lambda *_: done.append(1), 10, 2, at_once=1)
        launches._compiler().submit(int).result()
        os._exit(0 if len(done) == 10 else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(number, 0)[1]) == 0


def test_one_thread_compiles_each_file_once_whoever_asks(monkeypatch):
    compiled = []
    monkeypatch.setattr(
        launches.wp, "load_module", lambda kernels, device: compiled.append((kernels, threading.get_ident()))
    )
    files = [ModuleType(f"kernels {number}") for number in range(5)]
    with ThreadPoolExecutor(3) as several:
        list(several.map(load, files * 4))
    load(files[0])
    assert [kernels for kernels, _ in compiled] == sorted({*files}, key=[one for one, _ in compiled].index)
    assert len({thread for _, thread in compiled}) == 1 and compiled[0][1] != threading.get_ident()


def test_a_file_that_does_not_compile_is_told_to_each_who_asks(monkeypatch):
    def failing(kernels, device):
        raise RuntimeError("no such function")

    monkeypatch.setattr(launches.wp, "load_module", failing)
    kernels = ModuleType("kernels that fail")
    for _ in range(2):
        with pytest.raises(RuntimeError, match="no such function"):
            load(kernels)


def test_a_kernel_that_is_not_there_is_named():
    with pytest.raises(ModuleNotFoundError, match="no_such"):
        load_all(("voxels", "no_such"))
