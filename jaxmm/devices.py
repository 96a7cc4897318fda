"""What JAX is told by the environment: which devices to use, and how precise to be."""

import contextlib
import importlib.util
import os
from collections.abc import Iterator
from importlib.metadata import entry_points

from jaxmm.inputs import InputError

ASKED = "JAX_PLATFORMS"
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
    """JAX computes in single precision inside, as our models were trained, whatever JAX_ENABLE_X64 says."""
    import jax

    with jax.enable_x64(False):
        yield
