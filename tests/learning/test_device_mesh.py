"""The joint step on several devices that a CPU pretends to have, in a process of its own: JAX counts them once."""

import json
import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

from jaxmm.learning.device_mesh import mesh_of

DEVICES = 4
MESHES = ((2, 2), (4, 1), (1, 4))  # devices for scenarios, and for clouds
STEPS = """
import json, sys
import jax, numpy as np
from jaxmm.config import Config, NetworkConfig, TrainConfig
from jaxmm.learning import train_step
from jaxmm.learning.batches import Batch
from jaxmm.learning.device_mesh import mesh_of, place

rng = np.random.default_rng(0)
mask = np.arange(50) < rng.integers(20, 51, (4, 4, 1))
features = rng.normal(size=(*mask.shape, 4)).astype(np.float32)
batch = Batch(features, rng.random(mask.shape) < 0.3, mask, mask, rng.integers(0, 2**32, (4, 4), np.uint32))


def steps(config, place_all):
    states = train_step.init_all(jax.random.key(0), 4, config)
    states, placed = place_all(states, batch)
    for _ in range(3):
        states, losses = train_step.train_step_all(states, placed, config)
    return states, losses  # Adam's means of the gradients among them: its steps alone would hide a factor


def check(config, one, scenarios, clouds):
    mesh = mesh_of(scenarios, clouds)
    many = steps(config, lambda states, batch: place(states, batch, mesh))
    kernel = many[0].model.params["conv2"]["kernel"]
    assert len(kernel.sharding.device_set) == scenarios * clouds, kernel.sharding
    if config.train.map_models == "vmap":
        assert kernel.addressable_shards[0].data.shape[0] == 4 // scenarios, "the new states were gathered"
    for found, expected in zip(jax.tree.leaves(many), jax.tree.leaves(one), strict=True):
        found, expected = np.asarray(found), np.asarray(expected)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * max(1e-3, np.abs(expected).max()))


for mode in ("vmap", "map"):
    train_config = TrainConfig(learning_rate=1e-3, map_models=mode)
    config = Config(network=NetworkConfig((8, 16), (12,), 0.3), train=train_config)
    one = steps(config, lambda states, batch: (states, batch))
    for mesh in json.loads(sys.argv[1]):
        try:
            check(config, one, *mesh)
            said = "the same"
        except Exception as error:
            said = f"{type(error).__name__}: {error}"
        print(json.dumps([mode, mesh, said]), flush=True)
"""


@pytest.fixture(scope="module")
def found():
    """What a process with four devices says of each mode and mesh; the step on one device is made once for all."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={DEVICES}"
    done = subprocess.run(
        [sys.executable, "-c", STEPS, json.dumps(MESHES)],
        env={**os.environ, "XLA_FLAGS": flags.strip(), "JAX_PLATFORMS": "cpu"},
        cwd=Path(__file__).resolve().parents[2],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return {(mode, tuple(mesh)): said for mode, mesh, said in map(json.loads, done.stdout.splitlines())}


@pytest.mark.long
@pytest.mark.parametrize("mode", ["vmap", "map"])
@pytest.mark.parametrize("mesh", MESHES)
def test_step_on_four_devices_is_the_step_on_one(mode, mesh, found):
    assert found[mode, mesh] == "the same"


def test_too_few_devices_are_refused():
    count = len(jax.devices())
    with pytest.raises(ValueError, match=f"needs {2 * count} devices, got {count}"):
        mesh_of(2, count)
