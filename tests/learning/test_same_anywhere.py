"""Training and its answers are the same bits on other processors: with AVX2 alone, and on an emulated one.

XLA's own limit reaches what XLA compiles, and not the libraries that it calls; an emulated processor limits both.
"""

import json
import os
import shutil
import subprocess
import sys

import pytest

from jaxmm.caches import TREE as ROOT
from jaxmm.versions import instructions

STEPS = r"""
import hashlib, json, re, sys
import jax, numpy as np
from jaxmm.config import COMPACT, THESIS, Config, NetworkConfig, TrainConfig
from jaxmm.learning import train_step
from jaxmm.learning.batches import Batch

PRODUCT = r"= f32\[(\d+,\d+,\d+)\]\S* dot\("
NETWORKS = {"thesis": THESIS, "compact": COMPACT, "small": NetworkConfig((16, 32), (16,), 0.1)}


def left_to_eigen(compiled):
    # Shapes (clouds, rows, columns) of products that XLA gives to no YNNPACK fusion; those of vectors it makes itself.
    taken = set(re.findall(r"calls=%([^,\s]+),[^\n]*__ynn_fusion", compiled))
    bodies = re.findall(r"^%(\S+) [^\n]*{\n(.*?)^}", compiled, re.M | re.S)
    products = [shape for name, body in bodies if name not in taken for shape in re.findall(PRODUCT, body)]
    return [shape for shape in products if "1" not in shape.split(",")]


def digests(name, clouds, points, features):
    rng = np.random.default_rng(points)
    labels = rng.random((4, clouds, points)) < 0.05
    mask = np.broadcast_to(np.arange(points) < 0.8 * points, labels.shape)
    values = np.where(labels[..., None], 2, 0.1) * rng.normal(size=(*labels.shape, features)).astype(np.float32)
    batch = Batch(values, labels, mask, mask, rng.integers(0, 2**32, (4, clouds), np.uint32))
    train = TrainConfig(learning_rate=1e-3, schedule="cosine", step_count=100)
    config = Config(network=NETWORKS[name], train=train)
    states, losses = train_step.init_all(jax.random.key(0), features, config), []
    eigen = left_to_eigen(train_step.train_step_all.lower(states, batch, config).compile().as_text())
    for step in range(3):
        states, loss = train_step.train_step_all(states, batch._replace(seeds=batch.seeds + np.uint32(step)), config)
        losses.append(loss)
    model = states.model
    one = jax.tree.map(lambda leaf: leaf[0], model)
    found = {
        "states": states,
        "losses": losses,
        "validation": train_step.validate_all(model, batch, config),
        "logits": train_step.all_logits(model, batch, config.network),
        "probabilities": train_step.probabilities(one, values[0, 0], mask[0, 0], config.network),
    }
    told = {part: hashlib.sha256(b"".join(np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(tree))).hexdigest()
            for part, tree in found.items()}
    return {"eigen": eigen} | told


print(json.dumps([digests(*what) for what in json.loads(sys.argv[1])]))
"""
# Network, clouds, points and features: sums of few and of many numbers, of even and of odd counts.
CASES = (("small", 4, 512, 4), ("compact", 3, 333, 29))  # an emulated processor is a hundred times as slow
WHOLE = (*CASES, ("compact", 8, 2048, 29), ("thesis", 8, 512, 4))  # the last is what the demo trains


def bits(cases, flags="", before=()):
    """Digests of what a process of its own computes, for each case."""
    done = subprocess.run(
        [*before, sys.executable, "-c", STEPS, json.dumps(cases)],
        env=os.environ
        | {
            "PYTHONPATH": str(ROOT),
            "XLA_FLAGS": flags,
            "JAX_DISABLE_MOST_OPTIMIZATIONS": "0",  # as users compile
            "JAX_ENABLE_COMPILATION_CACHE": "0",  # or one would run what the other compiled
        },
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.long
@pytest.mark.skipif("X86_V3" not in instructions(), reason="AVX2 is for processors of Intel's and AMD's kind")
def test_steps_are_the_same_bits_with_avx2_alone():
    wide, narrow = bits(CASES[1:]), bits(CASES[1:], "--xla_cpu_max_isa=AVX2")
    assert wide == narrow
    # No limit reaches Eigen, which makes other bits on another processor.
    assert wide[0]["eigen"] == []


@pytest.mark.long
@pytest.mark.skipif("X86_V3" not in instructions(), reason="AVX2 is for processors of Intel's and AMD's kind")
def test_steps_are_the_same_bits_on_an_emulated_haswell():
    emulator = shutil.which("qemu-x86_64") or shutil.which("qemu-x86_64-static")
    if not emulator:
        pytest.skip("needs qemu-user")
    compact = CASES[1:]  # layers of 16 channels, as of the small one, are not the same there
    assert bits(compact) == bits(compact, "", (emulator, "-cpu", "Haswell-noTSX"))  # AVX2 and no more, own caches


@pytest.mark.long
@pytest.mark.skipif("X86_V3" not in instructions(), reason="AVX2 is for processors of Intel's and AMD's kind")
def test_steps_of_whole_trainings_are_the_same_bits_with_avx2_alone():
    assert bits(WHOLE) == bits(WHOLE, "--xla_cpu_max_isa=AVX2")
