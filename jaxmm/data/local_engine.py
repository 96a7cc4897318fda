"""Runs a pure function over many tasks on the cores of this machine: one process a core, one task each at a time.

Processes, because preprocessing is NumPy and holds the interpreter lock; spawned, because threads of JAX do not survive
a fork. A process that loses its parent ends with its task; the parent ends its processes with itself. Between tasks a
process keeps nothing of those before, so that however many it does, its peak is that of the largest.
"""

import contextlib
import importlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any

from jaxmm import heap
from warp_scanner.cores import core_count

Task = tuple[int, ...]


def results(function: Callable[..., Any], tasks: Iterable[Task], workers: int | None = None) -> Iterator[tuple]:
    """Yield (task, function(*task)) for all tasks, in whatever order they finish; never more than one a worker at once.

    Args:
        function: picklable, and found by its import path.
        tasks: taken one by one as workers become free, so there may be any number of them.
        workers: processes, by default one a core this process may use; with one, the work is done in this process,
            whose threads share one heap from then on.

    Raises:
        RuntimeError: a process was killed, for want of memory perhaps.
        Exception: whatever the function raised.
    """
    with Pool(workers) as pool:
        yield from pool.results(function, tasks)


class Pool:
    """Processes that stay from one function to the next; each is started when there is a first task for it.

    Used in a `with` block, at whose end they are ended.
    """

    def __init__(self, workers: int | None = None, *, keep_to_cores: bool = False, module: str | None = None):
        """More of how.

        Args:
            workers: as of `results`.
            keep_to_cores: keeps each process to one core, where the system can: for functions whose threads share.
            module: import path of what processes load before their first task; then they are started with the block,
                and load it while this one still finds out what there is to do.
        """
        self._workers = workers or core_count()
        self._keep_to_cores = keep_to_cores and hasattr(os, "sched_setaffinity")
        self._module = module
        self._processes: dict[Connection, multiprocessing.Process] = {}

    def __enter__(self) -> "Pool":
        if self._module is not None and self._workers > 1:
            for place in range(self._workers):
                self._at(place)
        return self

    def __exit__(self, *_: object) -> None:
        for connection, process in self._processes.items():
            process.kill()
            process.join()
            connection.close()
        self._processes = {}

    def results(self, function: Callable[..., Any], tasks: Iterable[Task]) -> Iterator[tuple]:
        """As `results` of this module. Afterwards, or after an error, no task is under way."""
        if self._workers == 1:
            heap.share()
            yield from ((task, function(*task)) for task in tasks)
            return
        waiting, busy = iter(tasks), set()
        try:
            for place, task in zip(range(self._workers), waiting, strict=False):
                connection = self._at(place)
                connection.send((function, task))
                busy.add(connection)
            while busy:
                for connection in wait(list(busy)):
                    task, result = _received(connection, self._processes[connection])
                    # The next task goes out before this result is dealt with, so that no core waits for a disk.
                    following = next(waiting, None)
                    if following is None:
                        busy.remove(connection)
                    else:
                        connection.send((None, following))
                    yield task, result
        except BaseException:
            self.__exit__()
            raise

    def _at(self, place: int) -> Connection:
        """To the process of that number, which may have to be started."""
        if place == len(self._processes):
            cores = sorted(os.sched_getaffinity(0)) if self._keep_to_cores else []
            connection, process = _start(cores[place % len(cores)] if cores else None, self._module)
            self._processes[connection] = process
        return list(self._processes)[place]


def _start(core: int | None, module: str | None) -> tuple[Connection, multiprocessing.Process]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, core, module), daemon=True)
    # The tracker that multiprocessing starts beside the first child unblocks signals when it is up.
    resource_tracker.ensure_running()
    with _undisturbed():
        process.start()
    theirs.close()  # the child's alone from here, so that either end sees the other one die
    return ours, process


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Ctrl-C, which reaches every process of the terminal, waits until this is over.

    A child that is started inherits the mask, and leaves Ctrl-C to the parent. To the parent other threads, as of JAX,
    still hand it: a child that it then leaves half started would tell of that at length.
    """
    came: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()  # which alone may set a handler, and gets Ctrl-C
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number)) if is_main else None
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if handler is not None:
            signal.signal(signal.SIGINT, handler)
    if came:
        raise KeyboardInterrupt


def _serve(connection: Connection, core: int | None, module: str | None) -> None:
    if core is not None:
        os.sched_setaffinity(0, {core})
    heap.share()
    if module is not None:
        importlib.import_module(module)
    function = None
    while True:
        try:
            new, task = connection.recv()
        except EOFError:
            return
        function = new or function
        try:
            connection.send(_reply(function, task))  # and no name for it, which would keep it during the next task
        except BrokenPipeError:  # the parent was killed
            return


def _reply(function: Callable[..., Any], task: Task) -> tuple[Task, Any, Exception | None]:
    try:
        return task, function(*task), None
    except Exception as error:
        return task, None, error


def _received(connection: Connection, process: multiprocessing.Process) -> tuple[Task, Any]:
    try:
        task, result, error = connection.recv()
    except (EOFError, ConnectionResetError) as lost:
        process.join()
        raise RuntimeError(f"a worker process ended early (exit code {process.exitcode})") from lost
    if error is not None:
        raise error
    return task, result
