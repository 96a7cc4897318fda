"""A Ctrl-C ends a command though what it finds forgets it, or makes another error of it."""

import argparse
import subprocess
import sys
import threading

import pytest

from jaxmm.commands import cli
from jaxmm.commands.interruptions import interruption
from jaxmm.inputs import InputError

FORGOTTEN = """
import gc, os, signal, sys, time
from jaxmm.commands.interruptions import heed

class Last:
    def __del__(self):
        raise error

def collected(*_):
    gc.callbacks.remove(collected)
    raise error

error = {error}
heed({shown})
try:
    {lost}
    time.sleep({wait})
except KeyboardInterrupt:
    print("interrupted")
"""


def after(error: str, lost: str, wait: float, shown: bool = False) -> tuple[str, str]:
    code = FORGOTTEN.format(error=error, lost=lost, wait=wait, shown=shown)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    return done.stdout.strip(), done.stderr


@pytest.mark.parametrize("lost", ["Last()", "gc.callbacks.append(collected); gc.collect()"])
def test_one_that_is_forgotten_comes_again(lost):
    assert after("KeyboardInterrupt()", lost, 50.0) == ("interrupted", "")
    assert after("KeyboardInterrupt()", lost, 50.0, shown=True) == ("interrupted", "")
    assert after("RuntimeError()", lost, 0.5) == ("", "")  # of other errors nobody hears
    assert "RuntimeError" in after("RuntimeError()", lost, 0.5, shown=True)[1]


def test_one_that_ends_as_the_error_of_a_lock_is_told_as_one(capsys):
    def run(*_):
        try:
            try:
                raise KeyboardInterrupt
            finally:
                threading.Lock().release()  # of none: what a thread pool's lock does that Ctrl-C took away
        except RuntimeError as error:
            raise InputError(f"settings: {error}") from error

    assert cli._run(argparse.Namespace(command="train", run=run, debug=False)) == 1
    assert capsys.readouterr().err == "jaxmm train: interrupted; the same command with --resume goes on\n"


def test_other_errors_come_of_none():
    try:
        try:
            raise OSError
        finally:
            raise ValueError
    except ValueError as error:
        assert interruption(error) is None
    assert interruption(None) is None
