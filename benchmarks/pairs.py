"""Pairs a second: rooms, scenes and two scans of 320 x 200, and whole data sets down to labelled clouds.

    python -m benchmarks.pairs [--json FILE]        about three minutes

The peer of the scans is the same work one room at a time, in a plain loop; both give the same pairs, which is checked.
Data sets are what `jaxmm generate` writes, all scenarios, clean and occluded, preprocessed, with distances, both kinds
of labels and, where said, evidence; once, start of the processes included. Their peer is one process.
"""

import dataclasses
import sys
import tempfile
import time
from argparse import Namespace
from pathlib import Path

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.timing import measure_in_turns, write_report
from jaxmm.config import Config, DataConfig, Table
from jaxmm.data.generation import Request, generate
from warp_scanner.rooms.pairs import PRESETS, PairConfig, make_pairs

# Pairs of scans, those of the peer, those of a data set, and which data sets.
FULL = {"pairs": 64, "peer_pairs": 8, "pairs_in_all": 2048, "data_sets": (0, 1, 2), "repeat": 5}
SMOKE = {"pairs": 2, "peer_pairs": 1, "pairs_in_all": 8, "data_sets": (2,), "repeat": 1}
SCENARIOS = ("pillar_added", "wall_removed")


def scans_alone(config: PairConfig, count: int) -> None:
    """The first pairs, each in a call of its own."""
    for index in range(count):
        make_pairs(config, np.array([index]))


def cases(sizes: Namespace) -> list[tuple[str, object, object]]:
    """(what is made, ours, the peer): functions that make as many pairs as is said."""
    made = []
    for preset, settings in PRESETS.items():
        for scenario in SCENARIOS:
            config = dataclasses.replace(settings, scenario=scenario, condition="occluded")
            together, alone = make_pairs(config, np.arange(4)), make_pairs(config, np.array([3]))
            np.testing.assert_array_equal(together.robot.distance[[3]], alone.robot.distance)
            ours = lambda config=config: make_pairs(config, np.arange(sizes.pairs))  # noqa: E731
            peer = lambda config=config: scans_alone(config, sizes.peer_pairs)  # noqa: E731
            made.append((f"{preset}, {scenario}, scans", ours, peer))
    return made


def data_sets() -> list[tuple[str, Config]]:
    """(what it is, its settings)."""
    evidence = dataclasses.replace(Config().preprocess, evidence="exact")
    mixed = DataConfig(train_rooms=3, unchanged_rooms=1, multi_rooms=1)
    varied = Config(data=mixed, scan=Table.of({"preset": "varied"}))
    return [
        ("data set, thesis, single changes", Config(data=DataConfig(unchanged_rooms=0))),
        ("data set, varied, with unchanged and several", varied),
        ("data set, varied, with evidence too", dataclasses.replace(varied, preprocess=evidence)),
    ]


def generate_all(config: Config, workers: int, count: int) -> float:
    """Pairs a second of a data set of so many, from nothing to its manifest."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        generate(config, Path(folder) / "shards", Request(count, workers=workers))
        return count / (time.perf_counter() - begin)


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    options = parser.parse_args()
    rows = []
    for case, make, peer in cases(options):
        ours, theirs = measure_in_turns([make, peer], options.repeat)
        mine, other = options.pairs / ours.median, options.peer_pairs / theirs.median
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
    for case, config in (data_sets()[number] for number in options.data_sets):
        mine, other = (generate_all(config, workers, options.pairs_in_all) for workers in (2, 1))
        rows.append(
            {
                "case": case,
                "ours": round(mine, 1),
                "peer": round(other, 1),
                "peer_name": "one process",
                "unit": "pairs/s",
                "ratio": round(mine / other, 2),
            }
        )
        print(f"{case:58} {mine:6.1f} pairs/s, one process {other:12.1f}, ratio {mine / other:.2f}")
    if options.json:
        write_report(options.json, rows, "warp-lang", "numpy")
    return 0


if __name__ == "__main__":
    sys.exit(main())
