"""Keeps libraries from saying on standard error what a user of ours need not read."""

import contextlib
import functools
import logging
import os
import sys
import tempfile
import warnings
from collections.abc import Iterator

import numpy as np

NO_GPU = b"Could not find or load the NVIDIA CUDA driver"


@functools.cache
def start_quietly() -> None:
    """Initialise Warp once, without its warning that there is no GPU: none is needed here.

    Whatever else Warp has to say on standard error is passed on. The warning comes from its native library, which no
    log level reaches, so the file descriptor is borrowed for the moment of initialisation.
    """
    import warp as wp  # slow to import, and readers of files that want `silent` do without

    with tempfile.TemporaryFile() as caught:
        kept = os.dup(2)
        os.dup2(caught.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        caught.seek(0)
        for line in caught:
            if NO_GPU not in line:
                sys.stderr.write(line.decode(errors="replace"))


@contextlib.contextmanager
def silent(library: str) -> Iterator[None]:
    """Without what a library, and NumPy under it, say of a failure beside the exception.

    Args:
        library: the name of its logger.
    """
    logger = logging.getLogger(library)
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
