"""One real point per 0.1 m voxel, beside Open3D's voxel_down_sample, which answers with means, on the same clouds.

    python -m benchmarks.voxels [--json FILE]        half a minute; needs the `peers` extra

The clouds are raw scans of generated rooms. One at a time, ours runs on one thread as Open3D does; as a batch it shares
the clouds out over 2 threads, and so does a thread pool for Open3D. Open3D gets its point clouds made before the clock
starts; ours takes the float32 arrays as they are. Exactness: how many choices are those of the reference in NumPy.
"""

import itertools
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice

import numpy as np

from benchmarks import peers
from benchmarks.command_line import CommandLine
from benchmarks.timing import measure_in_turns, write_report
from jaxmm.learning.preprocess import voxel_downsample
from warp_scanner.clouds.points import points_of
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.rooms.pairs import PairConfig, make_pairs

THREADS = 2
PEER = "Open3D voxel_down_sample (means)"
NOISE = 0.005  # [m] of the robot's ranges
VOXEL = 0.1  # [m]
FULL, SMOKE = {"pairs": 16, "repeat": 15}, {"pairs": 1, "repeat": 1}
ROOMS_AT_ONCE = 32


def scanned_pairs(first: int, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Returns of a DT scan and a robot scan of rooms, (N, 3) float32 [m] each, of a 320 x 200 camera: up to 64,000."""
    pairs = make_pairs(
        PairConfig(scenario="pillar_removed", condition="occluded", range_noise=NOISE), np.arange(first, first + count)
    )
    sides = [points_of(pairs.pose, pairs.directions, scan.distance) for scan in (pairs.dt, pairs.robot)]
    dt, robot = ([points[np.isfinite(points[:, 0])] for points in side] for side in sides)
    return list(zip(dt, robot, strict=True))


def thinned_pairs(count: int, sizes: tuple[int, int]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The first `count` pairs that keep between sizes[0] and sizes[1] points a side at one per 0.1 m voxel."""
    return list(islice((pair for pair in _all_thinned() if all(sizes[0] <= len(c) <= sizes[1] for c in pair)), count))


def _all_thinned() -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for first in itertools.count(0, ROOMS_AT_ONCE):
        clouds = [cloud for pair in scanned_pairs(first, ROOMS_AT_ONCE) for cloud in pair]
        thinned = [cloud[kept] for cloud, kept in zip(clouds, thin_clouds(clouds, VOXEL), strict=True)]
        yield from zip(thinned[::2], thinned[1::2], strict=True)


def rows_of(clouds: list[np.ndarray], repeat: int) -> list[dict]:
    """One row for clouds one at a time on one thread, one for all of them as a batch on two."""
    import open3d

    theirs = [open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.astype(np.float64))) for cloud in clouds]

    def singly():
        return [thin_clouds([cloud], VOXEL, threads=1)[0] for cloud in clouds]

    def together():
        return thin_clouds(clouds, VOXEL, THREADS)

    def peer_singly():
        return [cloud.voxel_down_sample(VOXEL) for cloud in theirs]

    def peer_together():
        with ThreadPoolExecutor(THREADS) as pool:
            return list(pool.map(lambda cloud: cloud.voxel_down_sample(VOXEL), theirs))

    same = [
        np.array_equal(kept, voxel_downsample(cloud, VOXEL)) for kept, cloud in zip(together(), clouds, strict=True)
    ]
    contestants = {"one at a time, 1 thread": (singly, peer_singly), "a batch, 2 threads": (together, peer_together)}
    timings = measure_in_turns([function for both in contestants.values() for function in both], repeat)
    rows = []
    for number, case in enumerate(contestants):
        ours, peer = timings[2 * number : 2 * number + 2]
        rows.append(
            {
                "case": f"{len(clouds)} clouds, {case}",
                "ours": round(ours.median / len(clouds) * 1e3, 3),
                "peer": round(peer.median / len(clouds) * 1e3, 3),
                "peer_name": PEER,
                "unit": "ms/cloud",
                "ratio": round(peer.median / ours.median, 2),
                "ours_first_call_s": round(ours.first, 3),
                "peer_first_call_s": round(peer.first, 3),
                "points_mean": round(float(np.mean([len(cloud) for cloud in clouds]))),
                "voxels_mean": round(float(np.mean([len(kept) for kept in together()]))),
                "same_as_reference_share": float(np.mean(same)),
            }
        )
    return rows


def first_call() -> float:
    """Seconds of the first call of this process: fetching the kernels, or compiling them when the cache is empty."""
    return measure_in_turns([lambda: thin_clouds([np.zeros((1, 3))])], repeat=1)[0].first


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    options = parser.parse_args()
    start = first_call()
    print(f"first thinning of this process, kernels fetched or compiled: {start:.2f} s")
    clouds = [cloud for pair in scanned_pairs(0, options.pairs) for cloud in pair]
    rows = rows_of(clouds, options.repeat) if peers.has("open3d") else []
    for row in rows:
        print(
            f"{row['case']:38} ours {row['ours']:6.3f}  Open3D {row['peer']:6.3f} {row['unit']}"
            f"  ratio {row['ratio']:5.2f}  {row['points_mean']} points to {row['voxels_mean']}"
        )
    for row in rows[:1]:
        print(f"    the same points as the reference in {row['same_as_reference_share']:.2%} of the clouds")
    if options.json:
        write_report(options.json, rows, "open3d", "warp-lang", "numpy", kernel_first_call_s=start)
    return 0


if __name__ == "__main__":
    sys.exit(main())
