"""Work is shared out whole, to threads that stay, and not to those of a process that this one is a copy of."""

import os
import signal
import sys
import threading

import numpy as np
import pytest

from warp_scanner.launches import load_all, share_out


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
    number = os.fork()
    if not number:
        signal.alarm(20)  # it would wait for threads that it does not have
        done = []
        share_out(lambda *_: done.append(1), 10, 2, at_once=1)
        os._exit(0 if len(done) == 10 else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(number, 0)[1]) == 0


def test_a_kernel_that_is_not_there_is_named():
    with pytest.raises(ModuleNotFoundError, match="no_such"):
        load_all(("voxels", "no_such"))
