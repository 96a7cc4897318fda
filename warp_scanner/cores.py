"""How many cores there are for this process, and workers that keep to one each.

Imports no Warp: processes that only share work out ask, too.
"""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.queues import SimpleQueue


def core_count() -> int:
    """Cores that this process may run on, at least 1: on a cluster's machine a job has but a part of them.

    As `os.process_cpu_count` of Python 3.13. Where a system does not tell, as macOS, all cores of the machine.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def worker_pool() -> ProcessPoolExecutor:
    """A new process for each core, which keeps to it: threads of workers that share cores wait for each other.

    What a script runs in it takes single rooms, whose work is short: two workers of two threads each took 1.6 times as
    long over the same rooms as two of one. On macOS, which binds no process, they share all cores.
    """
    context = multiprocessing.get_context("spawn")
    if not hasattr(os, "sched_setaffinity"):
        return ProcessPoolExecutor(core_count(), mp_context=context)
    cores = context.SimpleQueue()
    for core in sorted(os.sched_getaffinity(0)):
        cores.put(core)
    return ProcessPoolExecutor(core_count(), mp_context=context, initializer=_keep_to_one, initargs=(cores,))


def _keep_to_one(cores: SimpleQueue[int]) -> None:
    os.sched_setaffinity(0, {cores.get()})
