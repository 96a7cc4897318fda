"""What is drawn of a detection, by a process beside the one that detects and writes all else.

It loads Matplotlib while scans are read and compared, and draws while tables and models are written. Where a process
cannot be split (no fork; JAX, or threads, are there already), everything is drawn in its place, to the same bytes.
"""

import contextlib
import multiprocessing
import signal
import sys
import threading
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path

from jaxmm.verdicts.results import Detection

_waiting: list[Connection] = []  # to the process that waits for something to draw


def draw(folder: Path, detection: Detection, project: str) -> None:
    """Write the figures and mismatches.bcf, whose topics have pictures, into an existing folder.

    Raises:
        OSError: a file cannot be written.
    """
    from jaxmm.reports.bcf import write_bcf  # Matplotlib takes half a second to load
    from jaxmm.reports.detection_figures import write_figures

    write_figures(folder, detection)
    write_bcf(folder / "mismatches.bcf", detection, project=project)


@contextlib.contextmanager
def drawing_beside() -> Iterator[None]:
    """Within, `drawing` finds a process that is ready."""
    process = None
    if _can_split():
        near, far = multiprocessing.Pipe()
        process = multiprocessing.get_context("fork").Process(target=_wait, args=(far, near), daemon=True)
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
def drawing(folder: Path, detection: Detection, project: str) -> Iterator[None]:
    """`draw` while what is within goes on; all is drawn, or told to have failed, when it ends.

    Raises:
        OSError: as `draw` does.
    """
    if not _waiting:
        draw(folder, detection, project)
        yield
        return
    near = _waiting.pop()
    near.send((folder, detection, project))
    try:
        yield
    finally:  # whatever went wrong within: nobody may still write into the folder afterwards
        try:
            error = near.recv()
        except EOFError:
            error = OSError(None, "the process that draws was ended", str(folder))
    if error is not None:
        raise error


def _can_split() -> bool:
    return sys.platform == "linux" and "jax" not in sys.modules and threading.active_count() == 1


def _wait(far: Connection, near: Connection) -> None:
    """The other side: loads what it takes to draw, and draws once."""
    near.close()  # with its last holder gone, waiting ends
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal; the process that detects ends this one
    import jaxmm.reports.bcf
    import jaxmm.reports.detection_figures  # noqa: F401

    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        asked = far.recv()
        try:
            draw(*asked)
        except Exception as error:  # told on the other side, whatever it is
            far.send(error)
        else:
            far.send(None)
