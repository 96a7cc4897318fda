"""Pairs a second: rooms, scenes and two scans of 320 x 200, and all of it down to labelled clouds.

    python -m benchmarks.pairs [--json FILE]

The peer is the same work one room at a time, in a plain loop; both give the same pairs, which is checked.
"""

import argparse
import dataclasses
import sys
from pathlib import Path

import numpy as np

from benchmarks.timing import measure_in_turns, write_report
from jaxmm.config import Config
from jaxmm.pipeline import clouds
from jaxmm.simulator import CloudSource
from warp_scanner.pairs import PRESETS, PairConfig, make_pairs

PAIRS, PEER_PAIRS = 64, 8
SCENARIOS = ("pillar_added", "wall_removed")


def scans_alone(config: PairConfig) -> None:
    """The first pairs, each in a call of its own."""
    for index in range(PEER_PAIRS):
        make_pairs(config, np.array([index]))


def cases() -> list[tuple[str, object, object]]:
    """(what is made, ours, the peer): functions that make PAIRS and PEER_PAIRS pairs."""
    made = []
    for preset, settings in PRESETS.items():
        for scenario in SCENARIOS:
            config = dataclasses.replace(settings, scenario=scenario, condition="occluded")
            together, alone = make_pairs(config, np.arange(4)), make_pairs(config, np.array([3]))
            np.testing.assert_array_equal(together.robot.distance[[3]], alone.robot.distance)
            ours = lambda config=config: make_pairs(config, np.arange(PAIRS))  # noqa: E731
            made.append((f"{preset}, {scenario}, scans", ours, lambda config=config: scans_alone(config)))
    source = CloudSource("wall_removed", "wall_removed", "occluded", 0)
    ours = lambda: list(clouds(Config(), source, np.arange(PAIRS)))  # noqa: E731
    peer = lambda: [list(clouds(Config(), source, np.array([index]))) for index in range(PEER_PAIRS)]  # noqa: E731
    made.append(("thesis, wall_removed, scans, voxels, distances and labels", ours, peer))
    return made


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    options = parser.parse_args()
    rows = []
    for case, make, peer in cases():
        ours, theirs = measure_in_turns([make, peer], repeat=5)
        mine, other = PAIRS / ours.median, PEER_PAIRS / theirs.median
        row = {
            "case": case,
            "ours": round(mine, 1),
            "peer": round(other, 1),
            "peer_name": "one room at a time",
            "unit": "pairs/s",
            "ratio": round(mine / other, 2),
            "ours_first_call_s": round(ours.first, 3),
        }
        rows.append(row)
        print(f"{case:58} {mine:6.1f} {row['unit']}, {row['peer_name']} {other:6.1f}, ratio {row['ratio']:.2f}")
    if options.json:
        write_report(options.json, rows, "warp-lang", "numpy")
    return 0


if __name__ == "__main__":
    sys.exit(main())
