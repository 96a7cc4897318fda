"""Nearest neighbours both ways between pairs of clouds, beside pykdtree and scipy on the same clouds.

    python -m benchmarks.neighbours [--json FILE]        about a minute; needs the `peers` extra

The clouds are scans of generated rooms, prior and reality, thinned to one point per 0.1 m. Ours answers all pairs in
one call, sharing them out over 2 threads; pykdtree takes float32 and uses as many through OpenMP; scipy's trees are
searched by pairs on 2 threads. All sort their clouds while the clock runs. Exactness is measured against scipy in
float64. On a busy machine OpenMP's waiting threads cost pykdtree dearly: measure on a quiet one.
"""

import os
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.spatial import cKDTree

from benchmarks import peers
from benchmarks.command_line import CommandLine
from benchmarks.timing import measure_in_turns, write_report
from benchmarks.voxels import thinned_pairs
from warp_scanner.clouds.neighbours import nearest_both_ways

THREADS = 2
PEERS = {"pykdtree": "pykdtree, float32, OpenMP", "scipy": "scipy cKDTree, float64"}
FULL = {"cases": ((256, (3_000, 15_000), 9), (256, (300, 3_000), 9))}  # pairs, points of a cloud, repeats
SMOKE = {"cases": ((2, (3_000, 15_000), 1),)}


def both_ways(tree, cloud: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances of one pair by trees of a library."""
    return tree(other).query(cloud)[0], tree(cloud).query(other)[0]


def difference(found: list, expected: list) -> float:
    """The largest difference of two answers [m]."""
    return float(
        max(np.abs(a - b).max() for f, e in zip(found, expected, strict=True) for a, b in zip(f, e, strict=True))
    )


def rows_of(pair_count: int, sizes: tuple[int, int], repeat: int, names: list[str]) -> list[dict]:
    """One row per peer, of those named, for a batch of pairs whose clouds have sizes[0] to sizes[1] points."""
    pairs = thinned_pairs(pair_count, sizes)
    clouds, others = ([pair[side] for pair in pairs] for side in (0, 1))

    def ours():
        return [(there.distance, back.distance) for there, back in nearest_both_ways(clouds, others, THREADS)]

    def pykdtree():
        from pykdtree.kdtree import KDTree

        return [both_ways(KDTree, cloud, other) for cloud, other in pairs]

    def scipy():
        with ThreadPoolExecutor(THREADS) as pool:
            return list(pool.map(lambda pair: both_ways(cKDTree, *pair), pairs))

    exact = [both_ways(cKDTree, cloud.astype(np.float64), other.astype(np.float64)) for cloud, other in pairs]
    contestants = [ours, *({"pykdtree": pykdtree, "scipy": scipy}[name] for name in names)]
    differences = [difference(answer(), exact) for answer in contestants]
    timings = measure_in_turns(contestants, repeat)
    each = [round(timing.median / len(pairs) * 1e3, 3) for timing in timings]
    size = [len(cloud) for pair in pairs for cloud in pair]
    return [
        {
            "case": f"{len(pairs)} pairs of {sizes[0]} to {sizes[1]} points",
            "ours": each[0],
            "peer": each[place],
            "peer_name": PEERS[name],
            "unit": "ms/pair",
            "ratio": round(timings[place].median / timings[0].median, 2),
            "ours_first_call_s": round(timings[0].first, 3),
            "peer_first_call_s": round(timings[place].first, 3),
            "points_mean": round(float(np.mean(size))),
            "ours_difference_max_m": differences[0],
            "peer_difference_max_m": differences[place],
        }
        for place, name in enumerate(names, start=1)
    ]


def first_call() -> float:
    """Seconds of the first search of this process: fetching the kernels, or compiling them when the cache is empty."""
    cloud = np.zeros((1, 3))
    return measure_in_turns([lambda: nearest_both_ways([cloud], [cloud])], repeat=1)[0].first


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", str(THREADS))  # pykdtree's; read when it is first imported
    names = [name for name in PEERS if name == "scipy" or peers.has("pykdtree.kdtree")]
    start = first_call()
    print(f"first search of this process, kernels fetched or compiled: {start:.2f} s")
    rows = []
    for pair_count, sizes, repeat in options.cases:
        for row in rows_of(pair_count, sizes, repeat, names):
            rows.append(row)
            print(
                f"{row['case']:34} ours {row['ours']:6.3f}  {row['peer_name']:26} {row['peer']:6.3f} {row['unit']}"
                f"  ratio {row['ratio']:5.2f}"
            )
        theirs = [f"{one['peer_name']} by {one['peer_difference_max_m']:.1e} m" for one in rows[-len(names) : -1]]
        print(
            f"    {row['points_mean']} points a cloud; ours differs from scipy in float64 by at most"
            f" {row['ours_difference_max_m']:.1e} m",
            *theirs,
            sep=", ",
        )
    if options.json:
        write_report(options.json, rows, "pykdtree", "scipy", "warp-lang", "numpy", kernel_first_call_s=start)
    return 0


if __name__ == "__main__":
    sys.exit(main())
