"""What JAX is told by the environment: which devices to use, and how precise to be."""

import contextlib
import importlib.util
import os
import sys
from collections.abc import Iterator
from importlib.metadata import entry_points

from jaxmm.inputs import InputError

ASKED = "JAX_PLATFORMS"
PRECISION = "JAX_ENABLE_X64"
_YES = ("y", "yes", "t", "true", "on", "1")  # as JAX reads it
BUILT_IN = ("cpu", "tpu")  # platforms that JAX knows without a plugin


def check_devices() -> None:
    """Refuse a platform without a device here at once, before anything is read.

    Raises:
        InputError: JAX_PLATFORMS names no platform that can be used.
    """
    asked = os.environ.get(ASKED, "")
    names = [name.strip() for name in asked.split(",") if name.strip()]
    if not names or "cpu" in names:
        return
    can = not {*names}.isdisjoint(BUILT_IN) or has_plugin()
    if can:
        import jax

        try:
            can = bool(jax.devices())
        except Exception:  # a backend that cannot start raises almost anything
            can = False
    if not can:
        raise InputError(f"{ASKED}: expected a platform that has a device here, such as cpu, got {asked!r}")


def has_plugin() -> bool:
    """Whether anything is installed that gives JAX a platform; JAX looks for it in the same two places."""
    return importlib.util.find_spec("jax_plugins") is not None or bool(entry_points(group="jax_plugins"))


@contextlib.contextmanager
def single_precision() -> Iterator[None]:
    """JAX computes in single precision inside, as our models were trained, whatever JAX_ENABLE_X64 says.

    Where JAX is not loaded yet, it is not loaded for that: it takes over a second, and most detections need none of it.
    """
    if "jax" in sys.modules:
        import jax

        with jax.enable_x64(False):
            yield
        return
    said = os.environ.get(PRECISION)
    os.environ[PRECISION] = "0"  # which JAX reads when it is first imported
    try:
        yield
    finally:
        if said is None:
            del os.environ[PRECISION]
        else:
            os.environ[PRECISION] = said
        if said is not None and "jax" in sys.modules:  # by now: whoever calls next finds it as the environment says
            import jax

            jax.config.update("jax_enable_x64", said.strip().lower() in _YES)
