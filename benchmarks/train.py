"""One training step of all four thesis networks, beside PyTorch, and beside the same step one model at a time.

    python -m benchmarks.train [--json FILE] [--points N]        five minutes; needs the `peers` extra

A step is forward, focal loss, backward and Adam for 4 models x 8 clouds x N points with one feature. Every point is
real, so that ours gains nothing from padding. PyTorch runs on as many threads, in its own layout for convolutions, one
model after the other, eager and through torch.compile. Memory is the most that a fresh process of each held at once,
less what it held before its models and batch were made (on Linux only).
"""

import dataclasses
import multiprocessing
import re
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np

from benchmarks import peers
from benchmarks.command_line import CommandLine
from benchmarks.timing import measure_in_turns, write_report
from jaxmm.config import THESIS, Config, NetworkConfig
from jaxmm.learning.batches import Batch
from jaxmm.learning.train_step import COMPILER_OPTIONS, init_all, train_step, train_step_all

MODELS = 4
OURS = "jaxmm"
PEERS = {"PyTorch eager": False, "torch.compile": True}  # whether it is compiled


def random_batch(clouds: int, points: int) -> Batch:
    """Distances like those of a scan pair: most nearly zero, a few large and changed."""
    rng = np.random.default_rng(0)
    labels = rng.random((MODELS, clouds, points)) < 0.05
    distance = np.where(labels, rng.uniform(0.09, 2.0, labels.shape), rng.exponential(0.01, labels.shape))
    mask = np.ones(labels.shape, bool)
    seeds = rng.integers(0, 2**32, (MODELS, clouds), np.uint32)
    return Batch(distance[..., None].astype(np.float32), labels, mask, mask, seeds)


def joint_step(batch: Batch, config: Config, mode: str):
    """A function that takes one joint step, models mapped by `mode`, and returns the losses."""
    config = dataclasses.replace(config, train=dataclasses.replace(config.train, map_models=mode))
    states = init_all(jax.random.key(0), 1, config)

    def step():
        nonlocal states
        states, losses = train_step_all(states, batch, config)
        return losses

    return step


def separate_steps(batch: Batch, config: Config):
    """The same four updates as four calls of a step compiled for one model."""
    stacked = init_all(jax.random.key(0), 1, config)
    states = [jax.tree.map(lambda leaf, i=i: leaf[i], stacked) for i in range(MODELS)]
    batches = [jax.tree.map(lambda leaf, i=i: leaf[i], batch) for i in range(MODELS)]
    one = jax.jit(train_step, static_argnames="config", donate_argnames="state", compiler_options=COMPILER_OPTIONS)

    def step():
        losses = []
        for index in range(MODELS):
            states[index], loss = one(states[index], batches[index], config)
            losses.append(loss)
        return losses

    return step


def peer_step(batch: Batch, config: Config, compiled: bool):
    """The same four updates in PyTorch."""
    from benchmarks.peers.torch_networks import torch_step

    return torch_step(batch, config, compiled)


CONTESTANTS: dict[str, Callable[[Batch, Config], Callable]] = {
    OURS: lambda batch, config: joint_step(batch, config, "map"),
    "jaxmm, models side by side": lambda batch, config: joint_step(batch, config, "vmap"),
    "jaxmm, one model at a time": separate_steps,
} | {name: lambda batch, config, how=compiled: peer_step(batch, config, how) for name, compiled in PEERS.items()}
FULL = {"contestants": tuple(CONTESTANTS), "network": THESIS, "clouds": 8, "points": 4096, "repeat": 5}
# What is compiled takes as long at any size, but for the number of layers.
SMALL = NetworkConfig(encoder=(4, 8), head=(4,))
SMOKE = {"contestants": (OURS, "PyTorch eager"), "network": SMALL, "clouds": 1, "points": 64, "repeat": 1}


def contestants(names: list[str], batch: Batch, config: Config) -> dict[str, Callable]:
    """Steps of those named, without those that this machine cannot run; says why not."""
    steps = {name: CONTESTANTS[name](batch, config) for name in names}
    if "torch.compile" not in steps:
        return steps
    try:
        steps["torch.compile"]()
    except Exception as error:  # whatever a missing or unfit C++ compiler raises, wrapped in torch's own errors
        print(f"torch.compile left out: {str(error).strip().splitlines()[0]}", file=sys.stderr)
        del steps["torch.compile"]
    return steps


def peak_memory(name: str, size: tuple[int, int], config: Config) -> float:
    """Most memory [GB] that two steps with so many clouds and points added to a fresh process."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_added_memory, (name, size, config))


def _added_memory(name: str, size: tuple[int, int], config: Config) -> float:
    peers.why_missing("torch")  # loads it where it can be, for its libraries should count for nobody
    jax.block_until_ready(jax.numpy.zeros(1))
    before = _most_held()
    step = CONTESTANTS[name](random_batch(*size), config)
    for _ in range(2):
        jax.block_until_ready(step())
    return (_most_held() - before) / 2**20


def _most_held() -> int:
    """The most memory [kB] this process ever held, from Linux; getrusage would begin with what its parent held."""
    status = Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\s*(\d+) kB", status)[1])


def rows_of(ours: float, peers: dict[str, float], case: str, unit: str) -> list[dict]:
    """Rows of the report, each also printed; a ratio above 1 means that ours needs less."""
    rows = []
    for name, peer in peers.items():
        rows.append(
            {
                "case": case,
                "ours": round(ours, 3),
                "peer": round(peer, 3),
                "peer_name": name,
                "unit": unit,
                "ratio": round(peer / ours, 2),
            }
        )
        print(f"{case}: ours {ours:.2f} {unit}, {name} {peer:.2f} {unit}, ratio {peer / ours:.2f}")
    return rows


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    parser.add_argument("--points", type=int, help="points per cloud")
    parser.add_argument("--repeat", type=int, help="steps after the first, of which the median is taken")
    options = parser.parse_args()
    with_torch = peers.has("torch")
    names = [name for name in options.contestants if with_torch or name not in PEERS]
    size, config = (options.clouds, options.points), Config(network=options.network)
    steps = contestants(names, random_batch(*size), config)
    timings = dict(zip(steps, measure_in_turns(list(steps.values()), options.repeat), strict=True))
    ours, case = timings.pop(OURS), f"step of {MODELS} models x {options.clouds} clouds x {options.points} points"
    print("first call:", ", ".join(f"{n} {t.first:.1f} s" for n, t in {"ours": ours, **timings}.items()))
    rows = rows_of(ours.median, {name: timing.median for name, timing in timings.items()}, case, "s")
    for row, timing in zip(rows, timings.values(), strict=True):
        row |= {"ours_first_call_s": round(ours.first, 2), "peer_first_call_s": round(timing.first, 2)}
    if sys.platform == "linux":
        memory = {name: peak_memory(name, size, config) for name in steps if name != "torch.compile"}
        rows += rows_of(memory.pop(OURS), memory, f"memory of a {case}", "GB")
    if options.json:
        write_report(options.json, rows, "jax", "flax", "optax", "torch", "numpy")
    return 0


if __name__ == "__main__":
    sys.exit(main())
