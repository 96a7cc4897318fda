"""Starts Warp without its warning that there is no GPU: none is needed here."""

import functools
import os
import sys
import tempfile

import warp as wp

NO_GPU = b"Could not find or load the NVIDIA CUDA driver"


@functools.cache
def start_quietly() -> None:
    """Initialise Warp once; whatever else it has to say on standard error is passed on.

    The warning comes from Warp's native library, which no log level reaches, so the file descriptor is borrowed for the
    moment of initialisation.
    """
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
