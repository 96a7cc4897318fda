"""What the environment tells JAX: a platform without a device is refused at once, and precision changes no verdict."""

import os
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import pytest

from jaxmm import devices
from jaxmm.inputs import InputError

COMMAND = (sys.executable, "-m", "jaxmm")


@pytest.mark.parametrize("asked", [None, "", "cpu", "cuda,cpu", " cpu "])
def test_where_there_is_a_device_nothing_is_said(monkeypatch, asked):
    monkeypatch.delenv(devices.ASKED, raising=False)
    if asked is not None:
        monkeypatch.setenv(devices.ASKED, asked)
    devices.check_devices()


@pytest.mark.skipif(devices.has_plugin(), reason="a plugin of JAX is installed: there may be such a device")
def test_a_platform_without_a_device_is_refused_before_anything_is_read(tmp_path):
    house = tmp_path / "house.ifc"
    house.write_text("x")
    asked = [*COMMAND, "detect", house, house, "--out", tmp_path / "found"]
    start = time.perf_counter()
    done = subprocess.run(asked, env={**os.environ, "JAX_PLATFORMS": "cuda"}, capture_output=True, text=True)
    took = time.perf_counter() - start
    wanted = "JAX_PLATFORMS: expected a platform that has a device here, such as cpu, got 'cuda'"
    assert (done.returncode, done.stderr) == (2, f"jaxmm detect: {wanted}\n")
    start = time.perf_counter()
    subprocess.run([*COMMAND, "--version"], check=True, capture_output=True)
    assert took < time.perf_counter() - start + 1.0  # the machine may be busy with other things
    # What computes without JAX does not ask.
    done = subprocess.run([*COMMAND, "revert", house, "--out", tmp_path / "a.ifc"], capture_output=True, text=True,
                          env={**os.environ, "JAX_PLATFORMS": "cuda"})  # fmt: skip
    assert "JAX_PLATFORMS" not in done.stderr


def test_a_platform_whose_backend_does_not_start_is_refused(monkeypatch):
    def broken():
        raise AssertionError

    monkeypatch.setattr(devices, "has_plugin", lambda: True)
    monkeypatch.setattr(jax, "devices", broken)
    monkeypatch.setenv(devices.ASKED, "cuda")
    with pytest.raises(InputError, match="got 'cuda'"):
        devices.check_devices()


def test_inside_arrays_are_of_single_precision_and_outside_as_before():
    with jax.enable_x64(True):
        with devices.single_precision():
            assert jnp.zeros(3).dtype == jnp.float32
        assert jnp.zeros(3).dtype == jnp.float64


INSIDE = """
import os, sys
from jaxmm.devices import single_precision
with single_precision():
    assert "jax" not in sys.modules, "loaded for nothing"
    import jax.numpy
    assert jax.numpy.zeros(3).dtype == jax.numpy.float32
assert jax.numpy.zeros(3).dtype == jax.numpy.{outside}
assert os.environ.get("JAX_ENABLE_X64") == {said!r}
"""


OUTSIDE = [("1", "float64"), ("True", "float64"), ("0", "float32"), (None, "float32")]


@pytest.mark.parametrize(("said", "outside"), OUTSIDE)
def test_jax_is_not_loaded_to_be_told_so_and_then_does_as_the_environment_says(said, outside):
    environment = {name: value for name, value in os.environ.items() if name != devices.PRECISION}
    environment |= {} if said is None else {devices.PRECISION: said}
    asked = [sys.executable, "-c", INSIDE.format(outside=outside, said=said)]
    done = subprocess.run(asked, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
