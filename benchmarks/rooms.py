"""Room generation: many rooms at once against the same rooms one at a time.   python -m benchmarks.rooms [--json FILE]

Both make the same rooms to the bit, which is checked. The peer is a plain loop over room numbers; it makes fewer rooms,
so that a round takes seconds.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from benchmarks.timing import measure_in_turns, write_report
from warp_scanner.rooms.rooms import PRESETS, RoomConfig, make_rooms
from warp_scanner.scenes.scenes import GAP, Primitives, take

ROOMS, PEER_ROOMS = 4096, 128


def one_at_a_time(config: RoomConfig, count: int) -> list[Primitives]:
    """The first rooms of seed 0, each in a call of its own."""
    return [make_rooms(config, 0, np.array([index]), threads=1) for index in range(count)]


def rows_of(name: str, repeat: int) -> list[dict]:
    """One row per thread count."""
    config = PRESETS[name]
    rooms = make_rooms(config, 0, np.arange(ROOMS))
    for index, room in enumerate(one_at_a_time(config, 16)):
        for ours, theirs in zip(take(rooms, [index]), room, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    rows = []
    for threads in (1, 2):
        ours, theirs = measure_in_turns(
            [
                lambda n=threads: make_rooms(config, 0, np.arange(ROOMS), threads=n),
                lambda: one_at_a_time(config, PEER_ROOMS),
            ],
            repeat,
        )
        mine, peer = 1e3 * ours.median / ROOMS, 1e3 * theirs.median / PEER_ROOMS
        rows.append(
            {
                "case": f"{name}, {threads} thread{'s' * (threads > 1)}",
                "ours": round(mine, 4),
                "peer": round(peer, 4),
                "peer_name": "the same rooms one at a time",
                "unit": "ms a room",
                "ratio": round(peer / mine, 2),
                "ours_first_call_s": round(ours.first, 3),
                "rooms": ROOMS,
                "primitives": float(np.mean(np.sum(rooms.kind != GAP, axis=1))),
            }
        )
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    options = parser.parse_args()
    rows = []
    for name in PRESETS:
        for row in rows_of(name, repeat=7):
            rows.append(row)
            print(
                f"{row['case']:20} {row['ours']:.3f} {row['unit']} of {row['primitives']:.0f} primitives,"
                f" {row['peer_name']} {row['peer']:.3f}, ratio {row['ratio']:.1f}"
            )
    if options.json:
        write_report(options.json, rows, "warp-lang", "numpy")
    return 0


if __name__ == "__main__":
    sys.exit(main())
