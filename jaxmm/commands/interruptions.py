"""Ctrl-C, wherever it finds a command: Python raises it in whatever runs just then, and not all of that passes it on.

In a callback of the garbage collector, or where an object is taken apart, an exception is printed and forgotten; both
JAX and Warp have such. While a thread pool waits for its lock, that lock ends it with an error of its own.
"""

import functools
import signal
import sys

AGAIN = 0.05  # [s] after which one that was forgotten is raised once more


def heed(shown: bool) -> None:
    """From here to the end of this process no Ctrl-C is forgotten; what else was is printed if it is to be shown.

    Threads that write checkpoints go on to complain for themselves about an error that is told, some of them after it
    was, so nothing is put back. Only for the main thread of a process that is this command's alone.
    """
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    sys.unraisablehook = functools.partial(_forgotten, shown)


def _forgotten(shown: bool, what: "sys.UnraisableHookArgs") -> None:
    if interruption(what.exc_value) is not None:
        signal.setitimer(signal.ITIMER_REAL, AGAIN)  # at once it would find the same callback
    elif shown:
        sys.__unraisablehook__(what)


def interruption(error: BaseException | None) -> KeyboardInterrupt | None:
    """The Ctrl-C that an error is, or came of; None where it has nothing to do with one."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error
