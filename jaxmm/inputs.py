"""What cannot be used of what a user gives: one line that names it, what was expected and what came.

Imports nothing slow: every command does so before it knows what it is to do.
"""

import re

CSV_COLUMNS = ("X", "Y", "Z", "categoryID")
BREAKS = re.compile("[\r\n\v\f\x1c-\x1e\x85\u2028\u2029]+")  # between lines
MOST_SHOWN = 200  # characters of a file that an error quotes


class InputError(ValueError):
    """A file of the user's that cannot be used; the message is one line, and the command line exits with code 2."""

    def __init__(self, told: str):
        super().__init__(BREAKS.sub(" ", told))  # names that a file gives its parts may hold any character


class Misfit(InputError):
    """A scan that is not of the prior's place, as it is said to lie."""


def clipped(text: str) -> str:
    """What a user's file says, no longer than a line of an error bears."""
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}…"


def one_line(error: Exception) -> str:
    """What an error of a library says, as a part of ours."""
    return clipped(" ".join(str(error).split())) or type(error).__name__
