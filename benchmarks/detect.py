"""Probabilities of all four networks on one cloud, beside the same networks in PyTorch.

    python -m benchmarks.detect [--json FILE] [--points N]        a minute; needs the `peers` extra

Four models, one feature, running statistics, no dropout: what one scan against one model costs. PyTorch runs eager, on
as many threads, without gradients, one model after the other. Both answer with probabilities.
"""

import sys

import jax
import numpy as np

from benchmarks import peers
from benchmarks.command_line import CommandLine
from benchmarks.timing import measure_in_turns, write_report
from jaxmm.config import COMPACT, THESIS, NetworkConfig
from jaxmm.learning.train_step import init_model, probabilities
from warp_scanner.cores import core_count

MODELS = 4
FULL, SMOKE = {"points": 8192, "repeat": 20}, {"points": 256, "repeat": 1}


def ours(distance: np.ndarray, network: NetworkConfig):
    """A function that returns the probabilities of four models, one after the other."""
    models = [init_model(jax.random.key(index), 1, network) for index in range(MODELS)]
    mask = np.ones(len(distance), bool)
    return lambda: [probabilities(model, distance, mask, network) for model in models]


def theirs(distance: np.ndarray, network: NetworkConfig):
    """The same in PyTorch."""
    import torch

    from benchmarks.peers.torch_networks import PointNetwork

    torch.set_num_threads(core_count())
    models = [PointNetwork(network).eval() for _ in range(MODELS)]
    x = torch.from_numpy(np.ascontiguousarray(distance.T[None]))

    def detect():
        with torch.no_grad():
            return [torch.sigmoid(model(x)) for model in models]

    return detect


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    parser.add_argument("--points", type=int, help="points of the cloud")
    parser.add_argument("--repeat", type=int, help="calls after the first, of which the median is taken")
    options = parser.parse_args()
    distance = np.random.default_rng(0).exponential(0.05, (options.points, 1)).astype(np.float32)
    rows = []
    for name, network in {"thesis": THESIS, "compact": COMPACT}.items() if peers.has("torch") else ():
        mine, peer = measure_in_turns([ours(distance, network), theirs(distance, network)], options.repeat)
        row = {
            "case": f"{MODELS} {name} networks, {options.points} points",
            "ours": round(1e3 * mine.median, 1),
            "peer": round(1e3 * peer.median, 1),
            "peer_name": "PyTorch eager",
            "unit": "ms",
            "ratio": round(peer.median / mine.median, 2),
            "ours_first_call_s": round(mine.first, 2),
            "peer_first_call_s": round(peer.first, 2),
        }
        rows.append(row)
        print(f"{row['case']}: ours {row['ours']} ms, PyTorch eager {row['peer']} ms, ratio {row['ratio']}")
    if options.json:
        write_report(options.json, rows, "jax", "flax", "torch", "numpy")
    return 0


if __name__ == "__main__":
    sys.exit(main())
