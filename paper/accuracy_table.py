"""Markdown tables of what `python -m benchmarks.accuracy` measured.

    python paper/accuracy_table.py runs/accuracy [--figure accuracy_reliability.png]

Reads the run folders and prints; rooms are scored by benchmarks.accuracy alone. First a line a row of the two main
conditions, then a line a condition: of each method the worst of the eight rows.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from jaxmm.learning.calibration import Reliability
from jaxmm.reports.figures import reliability_curves

DRAWN, KINDS = ("unfiltered", "real_sensor"), ("clean", "occluded")
METHODS = ("nn-raw", "rule", "evidence")
MAIN = ("thesis", "varied")


def main(folder: Path, figure: Path | None) -> None:
    for name in MAIN:
        print(f"{name}:\n")
        _print_lines(["row", "rooms", "observable", *METHODS, "lower ends"], _rows_of(folder / name))
    names = [path.parent.name for path in sorted(folder.glob("*/table_1.json"))]
    print("the worst row of each condition:\n")
    told = ["condition", "rooms a row", *METHODS, "ECE clean", "ECE occluded", "Brier clean", "Brier occluded"]
    _print_lines(told, [_worst(folder, name) for name in sorted(names, key=_order)])
    if figure:
        drawn = [name for name in DRAWN if name in names]
        sums = {f"{name.replace('_', ' ')}, {kind}": _sums(folder / name, kind) for name in drawn for kind in KINDS}
        reliability_curves(sums, figure, "Probabilities on test rooms, true labels")


def _sums(folder: Path, kind: str) -> Reliability:
    told = json.loads((folder / "reliability.json").read_text())["evidence"][f"all {kind}"]
    return Reliability(*(np.array(told[name]) for name in Reliability._fields))


def _order(name: str) -> tuple[bool, str]:
    return name.startswith("sweep"), name if name not in MAIN else f" {MAIN.index(name)}"


def _table(folder: Path) -> dict[tuple[str, str], dict[str, dict]]:
    """Row -> method -> what table_1.json says of it, true labels."""
    found: dict[tuple[str, str], dict[str, dict]] = {}
    for row in json.loads((folder / "table_1.json").read_text())["rows"]:
        if row["label_kind"] == "true":
            found.setdefault((row["test_case"].lower(), row["condition"]), {})[row["method"]] = row
    return found


def _rows_of(folder: Path) -> list[list[str]]:
    lines = []
    for (case, condition), methods in _table(folder).items():
        last = methods["evidence"]
        ends = [last["ci95"][name] for name in ("roc_auc", "precision_at_95")]
        low = f"{ends[0][0]:.4f} / {ends[1][0]:.3f}" if all(ends) else "-"
        rooms = f"{last['scene_count']}/{last['room_count']}"
        scores = [_scores(methods[name]) for name in METHODS]
        lines.append([f"{case} {condition}", rooms, f"{last['observable_share']:.2f}", *scores, low])
    return lines


def _worst(folder: Path, name: str) -> list[str]:
    table = _table(folder / name)
    told = json.loads((folder / name / "reliability.json").read_text())["evidence"]
    errors = [f"{told[f'all {kind}'][key]:.4f}" for key in ("ece", "brier") for kind in ("clean", "occluded")]
    scores = []
    for method in METHODS:
        rows = [methods[method] for methods in table.values() if methods[method]["roc_auc"] is not None]
        keys = ("roc_auc", "precision_at_95")
        scores.append(_scores({key: min((row[key] for row in rows), default=None) for key in keys}))
    rooms = str(next(iter(table.values()))["evidence"]["room_count"])
    return [name.replace("_", " "), rooms, *scores, *errors]


def _scores(row: dict) -> str:
    return "-" if row["roc_auc"] is None else f"{row['roc_auc']:.4f} / {row['precision_at_95']:.3f}"


def _print_lines(header: list[str], lines: list[list[str]]) -> None:
    for line in (header, ["---"] * len(header), *lines):
        print(f"| {' | '.join(line)} |")
    print()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="what benchmarks.accuracy wrote with --out")
    parser.add_argument("--figure", type=Path, help="also draw how reliable probabilities are")
    options = parser.parse_args()
    main(options.folder, options.figure)
