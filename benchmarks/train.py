"""One training step of all four thesis networks, beside PyTorch eager, and beside the same step one model at a time.

    python -m benchmarks.train [--json FILE] [--points N]        two to three minutes; needs the `peers` extra

A step is forward, focal loss, backward and Adam for 4 models x 8 clouds x N points with one feature. Every point is
real, so that ours gains nothing from padding. PyTorch runs on the same two threads, in its own layout for convolutions,
one model after the other.
"""

import argparse
import os
import sys
from itertools import pairwise
from pathlib import Path

import jax
import numpy as np

from benchmarks.timing import measure_in_turns, write_report
from jaxmm.batches import Batch
from jaxmm.config import Config
from jaxmm.train import init_all, train_step, train_step_all

MODELS, CLOUDS = 4, 8
CONFIG = Config()


def random_batch(points: int) -> Batch:
    """Distances like those of a scan pair: most nearly zero, a few large and changed."""
    rng = np.random.default_rng(0)
    labels = rng.random((MODELS, CLOUDS, points)) < 0.05
    distance = np.where(labels, rng.uniform(0.09, 2.0, labels.shape), rng.exponential(0.01, labels.shape))
    mask = np.ones(labels.shape, bool)
    seeds = rng.integers(0, 2**32, (MODELS, CLOUDS), np.uint32)
    return Batch(distance[..., None].astype(np.float32), labels, mask, mask, seeds)


def joint_step(batch: Batch):
    """A function that takes one joint step and returns the losses."""
    states = init_all(jax.random.key(0), 1, CONFIG)

    def step():
        nonlocal states
        states, losses = train_step_all(states, batch, CONFIG)
        return losses

    return step


def separate_steps(batch: Batch):
    """The same four updates as four calls of a step compiled for one model."""
    stacked = init_all(jax.random.key(0), 1, CONFIG)
    states = [jax.tree.map(lambda leaf, i=i: leaf[i], stacked) for i in range(MODELS)]
    batches = [jax.tree.map(lambda leaf, i=i: leaf[i], batch) for i in range(MODELS)]
    one = jax.jit(train_step, static_argnames="config", donate_argnames="state")

    def step():
        losses = []
        for index in range(MODELS):
            states[index], loss = one(states[index], batches[index], CONFIG)
            losses.append(loss)
        return losses

    return step


def torch_step(batch: Batch):
    """The same four updates in PyTorch, eager."""
    import torch

    torch.set_num_threads(os.cpu_count() or 1)
    models = [torch_network(torch) for _ in range(MODELS)]
    settings = CONFIG.train
    adams = [
        torch.optim.Adam(model.parameters(), settings.learning_rate, weight_decay=settings.weight_decay)
        for model in models
    ]
    features = [torch.from_numpy(np.ascontiguousarray(clouds.transpose(0, 2, 1))) for clouds in batch.features]
    labels = [torch.from_numpy(clouds.astype(np.float32)) for clouds in batch.labels]

    def step():
        for model, adam, x, y in zip(models, adams, features, labels, strict=True):
            adam.zero_grad()
            entropy = torch.nn.functional.binary_cross_entropy_with_logits(model(x), y, reduction="none")
            (CONFIG.loss.alpha * (1 - torch.exp(-entropy)) ** CONFIG.loss.gamma * entropy).mean().backward()
            adam.step()

    return step


def torch_network(torch):
    """The thesis network as PyTorch users write it: convolutions of kernel 1, the summary repeated and concatenated."""
    nn, network = torch.nn, CONFIG.network

    def block(inputs: int, outputs: int, drop: bool):
        layers = [nn.Conv1d(inputs, outputs, 1), nn.BatchNorm1d(outputs), nn.ReLU()]
        return layers + [nn.Dropout(network.dropout)] * drop

    widths = [1, *network.encoder]
    last = len(widths) - 2
    pairs = list(pairwise(widths))
    encoder = [layer for i, (a, b) in enumerate(pairs) for layer in block(a, b, i == last)]
    widths = [2 * network.encoder[-1], *network.head]
    head = [layer for a, b in pairwise(widths) for layer in block(a, b, True)]

    class PointNetwork(nn.Module):
        def __init__(self):
            super().__init__()
            self.encoder = nn.Sequential(*encoder)
            self.head = nn.Sequential(*head, nn.Conv1d(network.head[-1], 1, 1))

        def forward(self, x):
            x = self.encoder(x)
            summary = x.max(2, keepdim=True)[0].expand(-1, -1, x.shape[2])
            return self.head(torch.cat([x, summary], 1))[:, 0]

    return PointNetwork()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    parser.add_argument("--points", type=int, default=4096, help="points per cloud")
    parser.add_argument("--repeat", type=int, default=5, help="steps after the first, of which the median is taken")
    options = parser.parse_args()
    try:
        import torch  # noqa: F401
    except ImportError:
        print("benchmarks.train needs torch to compare with: run `make setup-peers`", file=sys.stderr)
        return 2
    batch = random_batch(options.points)
    ours, separate, theirs = measure_in_turns(
        [joint_step(batch), separate_steps(batch), torch_step(batch)], options.repeat
    )
    rows = []
    for name, peer in (("PyTorch eager", theirs), ("jaxmm, one model at a time", separate)):
        row = {
            "case": f"step of {MODELS} models x {CLOUDS} clouds x {options.points} points",
            "ours": round(ours.median, 3),
            "peer": round(peer.median, 3),
            "peer_name": name,
            "unit": "s",
            "ratio": round(peer.median / ours.median, 2),
            "ours_first_call_s": round(ours.first, 2),
            "peer_first_call_s": round(peer.first, 2),
        }
        rows.append(row)
        print(
            f"{row['case']}: ours {row['ours']:.3f} s, {name} {row['peer']:.3f} s, ratio {row['ratio']:.2f};"
            f" first call {row['ours_first_call_s']:.2f} s / {row['peer_first_call_s']:.2f} s"
        )
    if options.json:
        write_report(options.json, rows, "jax", "flax", "optax", "torch", "numpy")
    return 0


if __name__ == "__main__":
    sys.exit(main())
