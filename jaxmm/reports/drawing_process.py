"""What is drawn of a detection, by a process beside the one that detects and writes all else.

It loads Matplotlib while scans are read and compared, and draws while tables and models are written: the plan and the
pictures of topics itself, and what every direction said by one more process, its copy. Where a process cannot be split
(no fork; JAX, or threads, are there already), everything is drawn in its place, to the same bytes.
"""

import contextlib
import functools
import multiprocessing
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from jaxmm.verdicts.results import Detection

ENDED = "the process that draws was ended"
_waiting: list[Connection] = []  # to the process that waits for something to draw


@contextlib.contextmanager
def drawing_beside() -> Iterator[None]:
    """Within, `drawing` finds a process that is ready."""
    process = None
    if _can_split():
        near, far = multiprocessing.Pipe()
        process = multiprocessing.get_context("fork").Process(target=_wait, args=(far, near))
        process.start()
        far.close()
        _waiting.append(near)
    try:
        yield
    finally:
        if process is not None:
            if near in _waiting:
                _waiting.remove(near)
            near.close()  # which ends the process, too
            process.join()


@contextlib.contextmanager
def drawing(folder: Path, detection: Detection) -> Iterator[Callable[..., None]]:
    """Draw the figures into an existing folder while what is within goes on; done, or told to have failed, at its end.

    Gives what writes mismatches.bcf, whose topics have pictures, there, too; its arguments are those of `write_bcf`
    from the project on.

    Raises:
        OSError: a file cannot be written.
    """
    if not _waiting:
        _plan(folder, detection)
        _panoramas(folder, detection)
        yield functools.partial(_topics, folder, detection)
        return
    near = _waiting.pop()

    def send(what: Any) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # why it ended is asked below
            near.send(what)

    send((folder, detection))
    try:
        yield lambda *words, **named: send((words, named))
    finally:  # whatever went wrong within: nobody may still write into the folder afterwards
        send(None)
        try:
            error = near.recv()
        except (EOFError, ConnectionResetError):
            error = OSError(None, ENDED, str(folder))
    if error is not None:
        raise error


def _plan(folder: Path, detection: Detection) -> None:
    from jaxmm.reports.detection_figures import FIGURES, write_figures  # Matplotlib takes half a second to load

    write_figures(folder, detection, FIGURES[:1])


def _panoramas(folder: Path, detection: Detection) -> None:
    from jaxmm.reports.detection_figures import FIGURES, write_figures

    write_figures(folder, detection, FIGURES[1:])


def _topics(folder: Path, detection: Detection, *words: Any, **named: Any) -> None:
    from jaxmm.reports.bcf import write_bcf

    write_bcf(folder / "mismatches.bcf", detection, *words, **named)


def _can_split() -> bool:
    return sys.platform == "linux" and "jax" not in sys.modules and threading.active_count() == 1


def _wait(far: Connection, near: Connection) -> None:
    """The other side: loads what it takes to draw, and draws once."""
    near.close()  # with its last holder gone, waiting ends
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal; the process that detects ends this one
    import jaxmm.reports.bcf
    import jaxmm.reports.detection_figures  # noqa: F401

    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        folder, detection = far.recv()
        error = None
        with _panoramas_beside(folder, detection) as failed:
            try:
                _plan(folder, detection)
                while (asked := far.recv()) is not None:
                    words, named = asked
                    _topics(folder, detection, *words, **named)
            except EOFError:
                raise
            except Exception as own:  # told on the other side, whatever it is
                error = own
        far.send(error or failed())


@contextlib.contextmanager
def _panoramas_beside(folder: Path, detection: Detection) -> Iterator[Callable[[], Exception | None]]:
    """Within, one more process draws; afterwards, what is given tells how it failed, or None."""
    near, end = multiprocessing.Pipe(duplex=False)

    def draw() -> None:
        near.close()  # `far` stays open: whoever waits there for its last holder waits for this process, too
        try:
            _panoramas(folder, detection)
        except Exception as error:
            end.send(error)
        else:
            end.send(None)

    process = multiprocessing.get_context("fork").Process(target=draw)
    process.start()
    end.close()
    said: list[Exception | None] = []
    try:
        yield lambda: said[0]
    finally:
        try:
            said.append(near.recv())
        except EOFError:
            said.append(OSError(None, ENDED, str(folder)))
        process.join()
