"""Tasks for the engines' tests, in a module that loads little: every worker process imports it anew."""

import os
import signal
import threading
import time
from pathlib import Path

from jaxmm import heap
from jaxmm.inputs import InputError


def square(number):
    return number * number


def die(number):
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def fail(number):
    raise InputError(f"room {number} is on fire")


def whoami(number):
    time.sleep(0.2)
    return os.getpid()


def memory(name):
    """A number of /proc/self/status [MB]."""
    return int(Path("/proc/self/status").read_text().partition(f"{name}:")[2].split()[0]) / 1024


kept = []


def crowd(threads):
    """How much the address space [MB] grows by threads that allocate side by side."""
    before, together = memory("VmSize"), threading.Barrier(threads)

    def allocate():
        pieces = [bytes(4000) for _ in range(100)]
        together.wait()
        return pieces

    started = [threading.Thread(target=allocate) for _ in range(threads)]
    for step in ("start", "join"):
        for thread in started:
            getattr(thread, step)()
    return memory("VmSize") - before


def burden(megabytes):
    """Memory [MB] at the start of a task that leaves a hole in the heap, growth by its threads, and a large result."""
    heap.give_back()
    before = memory("VmRSS")
    pieces = [bytes(4000) for _ in range(megabytes * 250)]
    kept.append(pieces[-1])  # at the heap's end, so that what is free lies below
    return before, crowd(8), b"1" * (megabytes << 20)
