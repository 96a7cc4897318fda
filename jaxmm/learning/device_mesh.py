"""Several devices: the scenarios of a step and its clouds as the two axes of a mesh.

Nothing in train.py knows of devices. XLA splits the step by where its arrays live, and adds up over the clouds' axis
what a batch normalisation, a loss and a gradient sum over. Several hosts need `jax.distributed.initialize()` before.
"""

from collections.abc import Sequence

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxmm.learning.batches import Batch
from jaxmm.learning.train_step import TrainState

SCENARIO, CLOUD = "scenario", "cloud"


def mesh_of(scenarios: int, clouds: int, devices: Sequence[jax.Device] | None = None) -> Mesh:
    """A mesh of scenarios x clouds devices, the first of all there are if none are named.

    Raises:
        ValueError: there are fewer devices.
    """
    devices = jax.devices() if devices is None else devices
    if len(devices) < scenarios * clouds:
        raise ValueError(f"a mesh of {scenarios} x {clouds} needs {scenarios * clouds} devices, got {len(devices)}")
    return Mesh(np.array(devices[: scenarios * clouds]).reshape(scenarios, clouds), (SCENARIO, CLOUD))


def place(states: TrainState, batch: Batch, mesh: Mesh) -> tuple[TrainState, Batch]:
    """Split states (S, ...) over the mesh's scenarios, and a batch (S, B, ...) over its scenarios and clouds.

    Where scenarios are split, train with `map_models = "vmap"`: "map" visits one model after the other, and every
    device has to wait for each.

    Raises:
        ValueError: S or B is no multiple of the mesh's size along that axis.
    """
    models = NamedSharding(mesh, PartitionSpec(SCENARIO))
    clouds = NamedSharding(mesh, PartitionSpec(SCENARIO, CLOUD))
    return jax.device_put(states, models), jax.device_put(batch, clouds)
