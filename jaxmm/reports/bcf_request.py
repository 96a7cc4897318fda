"""What is asked of mismatches.bcf: its version, and which elements an updated model has; loads nothing that draws."""

from typing import NamedTuple

VERSIONS = ("3.0", "2.1")  # the default first


class NewElement(NamedTuple):
    """What an updated model has for an added object."""

    guid: str  # GlobalId
    file: str  # that holds it, below the folder of the outputs
