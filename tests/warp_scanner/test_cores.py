"""Workers that keep to one core each."""

import os

import pytest

from warp_scanner.cores import core_count, worker_pool
from warp_scanner.launches import thread_count


def cores_of(_):
    return os.getpid(), tuple(sorted(os.sched_getaffinity(0))), thread_count(None)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system binds no process to a core")
def test_each_worker_has_a_core_of_its_own_and_one_thread():
    mine = os.sched_getaffinity(0)
    with worker_pool() as pool:
        told = set(pool.map(cores_of, range(40 * core_count())))
    assert 1 <= len(told) <= core_count() == len(mine)
    cores = [core for _, kept, _ in told for core in kept]
    assert len(cores) == len(set(cores)) == len(told) and set(cores) <= mine
    assert all(threads == 1 for *_, threads in told)
    assert os.sched_getaffinity(0) == mine  # whoever asks keeps its own
