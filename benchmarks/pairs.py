"""Pairs a second: rooms, scenes and two scans of 320 x 200, and whole data sets down to labelled clouds.

    python -m benchmarks.pairs [--json FILE]        about three minutes

The peer of the scans is the same work one room at a time, in a plain loop; both give the same pairs, which is checked.
Data sets are what `jaxmm generate` writes, all scenarios, clean and occluded, preprocessed, with distances, both kinds
of labels and, where said, evidence; once, start of the processes included. Their peer is one process.
"""

import argparse
import dataclasses
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.timing import measure_in_turns, write_report
from jaxmm.config import Config, DataConfig, Table
from jaxmm.data.generation import Request, generate
from warp_scanner.rooms.pairs import PRESETS, PairConfig, make_pairs

PAIRS, PEER_PAIRS = 64, 8
PAIRS_IN_ALL = 2048  # of a data set
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


def generate_all(config: Config, workers: int) -> float:
    """Pairs a second of a data set of PAIRS_IN_ALL, from nothing to its manifest."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        generate(config, Path(folder) / "shards", Request(PAIRS_IN_ALL, workers=workers))
        return PAIRS_IN_ALL / (time.perf_counter() - begin)


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
    for case, config in data_sets():
        mine, other = generate_all(config, 2), generate_all(config, 1)
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
