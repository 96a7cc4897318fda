"""How long one detection takes, stage by stage: four sensors, ideal and as built, beside the thesis's preset.

    python -m benchmarks.latency [--json FILE] [--repeat 5]        four minutes

From loaded arrays to the text of report.json, in a furnished room of a validation seed in which a wall and a pillar are
new, and in one in which they are gone, so that it is looked at twice. Each has a process of its own, whose first call
loads, or compiles, kernels and networks; of later calls, in turns with the thesis's preset on the same scan, the median
is taken. Prints Markdown.
"""

import json
import statistics
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.command_line import CommandLine
from benchmarks.timing import measure_in_turns, write_report
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.reports.report_json import to_json
from jaxmm.runs.room_scans import RoomCase, room_cases
from jaxmm.verdicts.detection import Detection, detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT

SEED = 27  # of validation
CHANGES = {"new": ("pillar_and_wall_added", 2), "gone": ("pillar_and_wall_removed", 2)}  # scene and room
SENSORS = tuple(
    f"{name}{built}" for name in ("oak-d-pro", "ouster-64", "velodyne-16", "tls") for built in ("", "-real")
)
FULL = {"sensors": SENSORS, "changes": tuple(CHANGES), "repeat": 5}
SMOKE = {"sensors": ("velodyne-16-real",), "changes": ("new",), "repeat": 1}
STAGES = ("registration", "evidence", "objects", "next views")


def row_of(sensor: str, change: str, model: Path, repeat: int) -> dict[str, Any]:
    """Seconds of one sensor's scan of a room with a change."""
    scene, room = CHANGES[change]
    case = next(room_cases(scene, "occluded", SEED, range(room, room + 1), sensor=sensor))
    judges, kept = read_judges(model), []

    def ours() -> None:
        kept.append(_detected(case, judges, "default"))

    mine, thesis = measure_in_turns([ours, lambda: _detected(case, judges, "thesis")], repeat)
    return {
        "case": sensor.replace("-real", ", as built"), "change": change, "points": len(case.scan.points),
        **{name: statistics.median(one.timing[name] for one in kept[1:]) for name in STAGES},
        "ours": mine.median, "peer": thesis.median, "peer_name": "thesis's preset", "unit": "s",
        "ratio": thesis.median / mine.median, "ours_first_call_s": mine.first,
    }  # fmt: skip


def _detected(case: RoomCase, judges: Judges, preset: str) -> Detection:
    scan = NamedScan(case.scan, "scan", len(case.scan.points), "given")
    found = detect_scans(case.prior, [scan], judges, DetectSettings(preset=preset))
    json.dumps(to_json(found))
    return found


def table(rows: list[dict[str, Any]]) -> str:
    """All sensors, as Markdown."""
    names = [f"{name} [s]" for name in (*STAGES, "all", "thesis's preset")]
    lines = [
        f"| sensor | wall and pillar | points | {' | '.join(names)} | ratio | first call [s] |",
        "| --- |" + " --- |" * (len(names) + 4),
    ]
    for row in rows:
        seconds = [f"{row[name]:.2f}" for name in (*STAGES, "ours", "peer", "ratio")]
        case = f"{row['case']} | {row['change']} | {row['points']:,}"
        lines.append(f"| {case} | {' | '.join(seconds)} | {row['ours_first_call_s']:.1f} |")
    return "\n".join(lines)


def main() -> None:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    parser.add_argument("--repeat", type=int, metavar="N", help="calls after the first, at least 1")
    parser.add_argument("--model", type=Path, default=DEFAULT, metavar="RUN|FILE")
    asked = parser.parse_args()
    if asked.repeat < 1:
        parser.error(f"--repeat: expected at least 1, got {asked.repeat}")
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        rows = [
            pool.submit(row_of, sensor, change, asked.model, asked.repeat).result()
            for change in asked.changes
            for sensor in asked.sensors
        ]
    print(table(rows))
    if asked.json:
        write_report(asked.json, rows, "jax", "numpy", "scipy", "small-gicp", "warp-lang")


if __name__ == "__main__":
    main()
