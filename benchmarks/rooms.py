"""Room generation: many rooms at once against the same rooms one at a time.   python -m benchmarks.rooms [--json FILE]

Both make the same rooms to the bit, which is checked. The peer is a plain loop over room numbers; it makes fewer rooms,
so that a round takes seconds.
"""

import sys
from argparse import Namespace

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.timing import measure_in_turns, write_report
from warp_scanner.rooms.rooms import PRESETS, RoomConfig, make_rooms
from warp_scanner.scenes.scenes import GAP, Primitives, take

FULL = {"rooms": 4096, "peer_rooms": 128, "checked": 16, "repeat": 7}
SMOKE = {"rooms": 8, "peer_rooms": 2, "checked": 2, "repeat": 1}


def one_at_a_time(config: RoomConfig, count: int) -> list[Primitives]:
    """The first rooms of seed 0, each in a call of its own."""
    return [make_rooms(config, 0, np.array([index]), threads=1) for index in range(count)]


def rows_of(name: str, sizes: Namespace) -> list[dict]:
    """One row per thread count."""
    config = PRESETS[name]
    rooms = make_rooms(config, 0, np.arange(sizes.rooms))
    for index, room in enumerate(one_at_a_time(config, sizes.checked)):
        for ours, theirs in zip(take(rooms, [index]), room, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    rows = []
    for threads in (1, 2):
        ours, theirs = measure_in_turns(
            [
                lambda n=threads: make_rooms(config, 0, np.arange(sizes.rooms), threads=n),
                lambda: one_at_a_time(config, sizes.peer_rooms),
            ],
            sizes.repeat,
        )
        mine, peer = 1e3 * ours.median / sizes.rooms, 1e3 * theirs.median / sizes.peer_rooms
        rows.append(
            {
                "case": f"{name}, {threads} thread{'s' * (threads > 1)}",
                "ours": round(mine, 4),
                "peer": round(peer, 4),
                "peer_name": "the same rooms one at a time",
                "unit": "ms a room",
                "ratio": round(peer / mine, 2),
                "ours_first_call_s": round(ours.first, 3),
                "rooms": sizes.rooms,
                "primitives": float(np.mean(np.sum(rooms.kind != GAP, axis=1))),
            }
        )
    return rows


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    options = parser.parse_args()
    rows = []
    for name in PRESETS:
        for row in rows_of(name, options):
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
