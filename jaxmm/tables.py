"""Table I from the scores of single rooms: means with intervals, reported values beside them; JSON, CSV, Markdown."""

import csv
import io
import itertools
import json
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.config import EvaluateConfig
from jaxmm.metrics import METRICS, bootstrap_interval
from jaxmm.runs import write_json, write_text

SECTION = "Individual Models"
LABEL_KINDS = ("heuristic", "true")
BOX_METRICS = ("box_precision", "box_recall")
REPORTED_METHOD = "xyz_nn"  # the thesis's individual models saw coordinates, and augmented copies
COLUMNS = ("section", "test_case", "condition", "method", "label_kind", *METRICS, "observable_share", *BOX_METRICS)

Room = dict[str, Any]  # scores of one room: see evaluate.score_room
Row = dict[str, Any]  # one row of the table: the columns, scene_count, left_out_share, ci95, reported


def table_rows(rooms: Iterable[Room], config: EvaluateConfig, reported: dict[tuple[str, str], dict]) -> list[Row]:
    """One row for each (scenario, condition, label kind, method) among `rooms`, in their order.

    A metric is taken per room and averaged over the rooms that have at least `least_positives` testable positives;
    `left_out_share` says how many have not. Boxes are counted over all rooms.
    """

    def key(room: Room) -> tuple[str, ...]:
        return room["scenario"], room["condition"], room["label_kind"], room["method"]

    groups: dict[tuple[str, ...], list[Room]] = {}
    for room in rooms:
        groups.setdefault(key(room), []).append(room)
    return [_row(*group_key, members, config, reported) for group_key, members in groups.items()]


def _row(scenario, condition, label_kind, method, rooms: list[Room], config: EvaluateConfig, reported: dict) -> Row:
    scored = [room for room in rooms if room["positives"] >= config.least_positives and room["roc_auc"] is not None]
    test_case = scenario.replace("_", " ").title()
    row = {
        "section": SECTION,
        "test_case": test_case,
        "condition": condition,
        "method": method,
        "label_kind": label_kind,
    }
    interval: dict[str, list[float] | None] = {}
    for metric in METRICS:
        values = np.array([[room[metric], 1.0] for room in scored])
        row[metric], interval[metric] = _ratio(values, config.resamples)
    shares = np.array([[room["observable_fraction"], 1.0] for room in rooms])
    row["observable_share"], interval["observable_share"] = _ratio(shares, config.resamples)
    for metric, total in zip(BOX_METRICS, ("boxes_found", "boxes_true"), strict=True):
        counts = np.array([[room["boxes_matched"], room[total]] for room in rooms], float)
        row[metric], interval[metric] = _ratio(counts, config.resamples)
    row["scene_count"] = len(scored)
    row["left_out_share"] = 1 - len(scored) / len(rooms)
    row["ci95"] = interval
    told = method == REPORTED_METHOD and label_kind == "heuristic"
    row["reported"] = reported.get((test_case, condition)) if told else None
    return row


def _ratio(counts: np.ndarray, resamples: int) -> tuple[float | None, list[float] | None]:
    """Sum of column 0 over sum of column 1, and its interval over rooms; None where there is nothing to count."""
    if not len(counts) or counts[:, 1].sum() == 0:
        return None, None
    low, high = bootstrap_interval(counts, resamples)
    return float(counts[:, 0].sum() / counts[:, 1].sum()), [low, high]


def reported_values() -> dict[tuple[str, str], dict[str, float]]:
    """The thesis's Table I by (test case, condition), from paper/reported.toml of the source tree; empty elsewhere."""
    path = Path(__file__).resolve().parents[1] / "paper" / "reported.toml"
    if not path.is_file():
        return {}
    rows = [row for row in tomllib.loads(path.read_text())["rows"] if row["section"] == SECTION]
    return {(row["test_case"], row["condition"]): {name: row[name] for name in row if name in METRICS} for row in rows}


def write_table(folder: Path, rows: list[Row], meta: dict[str, Any]) -> None:
    """Write table_1.json, table_1.csv and table_1.md."""
    write_json(folder / "table_1.json", {"rows": rows, "meta": meta})
    write_text(folder / "table_1.csv", _as_csv(rows))
    write_text(folder / "table_1.md", as_markdown(rows))


def read_rows(folder: Path) -> list[Row]:
    """The rows of a table_1.json that `write_table` wrote."""
    return json.loads((folder / "table_1.json").read_text())["rows"]


def _as_csv(rows: list[Row]) -> str:
    measured = [*METRICS, "observable_share", *BOX_METRICS]
    names = [*COLUMNS, "scene_count", "left_out_share"]
    names += [f"{metric}_{end}" for metric in measured for end in ("low", "high")]
    names += [f"reported_{metric}" for metric in METRICS]
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        flat = {name: row[name] for name in (*COLUMNS, "scene_count", "left_out_share")}
        for metric in measured:
            flat[f"{metric}_low"], flat[f"{metric}_high"] = row["ci95"][metric] or (None, None)
        flat |= {f"reported_{metric}": value for metric, value in (row["reported"] or {}).items()}
        writer.writerow(flat)
    return text.getvalue()


def as_markdown(rows: list[Row]) -> str:
    """The table for people: one block per label kind, one line per test case, one group of columns per method."""
    return "\n".join(_block(rows, label_kind, _markdown_line, rule=True) for label_kind in LABEL_KINDS)


def as_terminal(rows: list[Row]) -> str:
    """The same table in fixed columns."""
    return "\n".join(_block(rows, label_kind, _terminal_line, rule=False) for label_kind in LABEL_KINDS)


def _block(rows: list[Row], label_kind: str, line: Callable[[list[str]], str], *, rule: bool) -> str:
    rows = [row for row in rows if row["label_kind"] == label_kind]
    if not rows:
        return ""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    titles = {"heuristic": "Heuristic labels (the thesis's)", "true": "True labels (the simulator's)"}
    title = f"{titles[label_kind]}: ROC AUC ± half its 95 % interval, precision at 95 % recall"
    header = ["test case", "condition", "rooms", "reported", *methods]
    lines = [title, "", line(header)] + ([line(["---"] * len(header))] if rule else [])
    for (test_case, condition), group in itertools.groupby(rows, lambda row: (row["test_case"], row["condition"])):
        by_method = {row["method"]: row for row in group}
        counts = "/".join(dict.fromkeys(str(row["scene_count"]) for row in by_method.values()))
        reported = next((row["reported"] for row in by_method.values() if row["reported"]), None)
        told = f"{reported['roc_auc']:.4f}, {reported['precision_at_95']:.4f}" if reported else "-"
        lines.append(line([test_case, condition, counts, told, *(_measured(by_method.get(name)) for name in methods)]))
    return "\n".join(lines) + "\n"


def _measured(row: Row | None) -> str:
    if row is None or row["roc_auc"] is None:
        return "-"
    low, high = row["ci95"]["roc_auc"]
    return f"{row['roc_auc']:.4f} ± {(high - low) / 2:.4f}, {row['precision_at_95']:.4f}"


def _markdown_line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _terminal_line(cells: list[str]) -> str:
    widths = (14, 9, 5, 14, *[23] * (len(cells) - 4))
    return "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()
