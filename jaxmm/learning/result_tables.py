"""Table I from the scores of single rooms: means with intervals, reported values beside them; JSON, CSV, Markdown."""

import csv
import io
import itertools
import math
import tomllib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.caches import TREE
from jaxmm.config import EvaluateConfig
from jaxmm.files import load_json, write_json, write_text
from jaxmm.learning.metrics import METRICS, bootstrap_interval

SECTION = "Individual Models"
LABEL_KINDS = ("heuristic", "true")
BOX_METRICS = ("box_precision", "box_recall")
REPORTED_METRICS = ("roc_auc", "precision_at_95", "thesis_fpr_at_95", "thesis_iou_at_95")
LABEL_TITLES = {"heuristic": "Heuristic labels (the thesis's)", "true": "True labels (the simulator's)"}
SHOWN = {"roc_auc": "ROC AUC", "precision_at_95": "precision at 95 % recall"}  # in the short tables
REPORTED_METHOD = "xyz_nn"  # the thesis's individual models saw coordinates, and augmented copies
NAMES = ("section", "test_case", "condition", "method", "label_kind")
COLUMNS = (*NAMES, *METRICS, "observable_share", *BOX_METRICS)

COUNTS = ("scene_count", "room_count", "left_out_share")

Room = dict[str, Any]  # scores of one room: see room_scores.score_room
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
    test_case = scenario.replace("_", " ").title()
    told = method == REPORTED_METHOD and label_kind == "heuristic"
    names = dict(zip(NAMES, (SECTION, test_case, condition, method, label_kind), strict=True))
    return row_of(names, rooms, config, reported.get((test_case, condition)) if told else None)


def row_of(names: dict[str, str], rooms: list[Room], config: EvaluateConfig, reported: dict | None) -> Row:
    """One row out of the scores of its rooms; `names` are its NAMES.

    Rooms that are views of one `place` are drawn together for intervals: they say less than as many places.
    """
    scored = [room for room in rooms if room["positives"] >= config.least_positives and room["roc_auc"] is not None]
    row = dict(names)
    interval: dict[str, list[float] | None] = {}
    for metric in METRICS:
        values = np.array([[room[metric], 1.0] for room in scored])
        row[metric], interval[metric] = _ratio(_by_place(values, scored), config.resamples)
    told = [room for room in rooms if room["observable_fraction"] is not None]
    shares = np.array([[room["observable_fraction"], 1.0] for room in told])
    row["observable_share"], interval["observable_share"] = _ratio(_by_place(shares, told), config.resamples)
    for metric, total in zip(BOX_METRICS, ("boxes_found", "boxes_true"), strict=True):
        counts = np.array([[room["boxes_matched"], room[total]] for room in rooms], float)
        row[metric], interval[metric] = _ratio(_by_place(counts, rooms), config.resamples)
    row["scene_count"] = len(scored)
    row["room_count"] = len(rooms)
    row["left_out_share"] = 1 - len(scored) / max(len(rooms), 1)
    row["ci95"] = interval
    row["reported"] = reported
    return row


def _by_place(counts: np.ndarray, rooms: list[Room]) -> np.ndarray:
    """Counts (R, 2) added up over the rooms of each place, where rooms tell one."""
    places = [room.get("place") or number for number, room in enumerate(rooms)]
    if len(set(places)) == len(places):
        return counts
    number = np.unique(list(map(str, places)), return_inverse=True)[1]
    return np.column_stack([np.bincount(number, column) for column in counts.T])


def _ratio(counts: np.ndarray, resamples: int) -> tuple[float | None, list[float] | None]:
    """Sum of column 0 over sum of column 1, and its interval over rooms; None where there is nothing to count.

    One room says nothing of how rooms differ, so it has no interval.
    """
    if not len(counts) or counts[:, 1].sum() == 0:
        return None, None
    ratio = float(counts[:, 0].sum() / counts[:, 1].sum())
    return ratio, list(bootstrap_interval(counts, resamples)) if len(counts) > 1 else None


def reported_values() -> dict[tuple[str, str], dict[str, float]]:
    """The thesis's Table I by (test case, condition), from paper/reported.toml of the source tree; empty elsewhere."""
    return {
        (case, condition): told for (section, case, condition), told in all_reported().items() if section == SECTION
    }


def all_reported() -> dict[tuple[str, str, str], dict[str, float]]:
    """The same of every section, by (section, test case, condition)."""
    path = TREE / "paper" / "reported.toml"
    if not path.is_file():
        return {}
    rows = tomllib.loads(path.read_text())["rows"]
    return {
        (row["section"], row["test_case"], row["condition"]): {name: row[name] for name in row if name in METRICS}
        for row in rows
    }


def write_table(folder: Path, rows: list[Row], meta: dict[str, Any]) -> None:
    """Write table_1.json, table_1.csv and table_1.md."""
    write_json(folder / "table_1.json", {"rows": rows, "meta": meta})
    write_text(folder / "table_1.csv", _as_csv(rows))
    write_text(folder / "table_1.md", as_markdown(rows))


def read_rows(folder: Path) -> list[Row]:
    """The rows of a table_1.json that `write_table` wrote."""
    return load_json(folder / "table_1.json")["rows"]


def _as_csv(rows: list[Row]) -> str:
    measured = [*METRICS, "observable_share", *BOX_METRICS]
    names = [*COLUMNS, *COUNTS]
    names += [f"{metric}_{end}" for metric in measured for end in ("low", "high")]
    names += [f"reported_{metric}" for metric in REPORTED_METRICS]
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        flat = {name: row[name] for name in (*COLUMNS, *COUNTS)}
        for metric in measured:
            flat[f"{metric}_low"], flat[f"{metric}_high"] = row["ci95"][metric] or (None, None)
        flat |= {f"reported_{metric}": value for metric, value in (row["reported"] or {}).items()}
        writer.writerow(flat)
    return text.getvalue()


def as_markdown(rows: list[Row]) -> str:
    """The table for people: short ones as in the terminal, then every column of every row."""
    blocks = [_block(rows, kind, metric, _markdown_line) for kind in LABEL_KINDS for metric in SHOWN]
    return "\n".join([*filter(None, blocks), "Every column:\n", *_full_table(rows)]) + "\n"


def as_terminal(rows: list[Row]) -> str:
    """Two short tables per kind of label, in fixed columns."""
    blocks = [_block(rows, kind, metric, _terminal_line) for kind in LABEL_KINDS for metric in SHOWN]
    return "\n".join(filter(None, blocks))


def short_table(rows: list[Row], label_kind: str, metric: str) -> str:
    """One metric on one kind of labels, for people: Markdown; empty where no row has them."""
    return _block(rows, label_kind, metric, _markdown_line)


def _block(rows: list[Row], label_kind: str, metric: str, line: Callable[[list[str]], str]) -> str:
    """One line per test case, one column per method."""
    rows = [row for row in rows if row["label_kind"] == label_kind]
    if not rows:
        return ""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    header = ["test case", "rooms", "reported", *methods]
    title = f"{LABEL_TITLES[label_kind]}: {SHOWN[metric]}, with its 95 % interval over rooms"
    if counts := {row["method"]: row["trainings"]["count"] for row in rows if row.get("trainings")}:
        title += f"; in brackets the worst and the best of {max(counts.values())} trainings"
        # Rows of evidence are of the models that ship, which need not lie between these.
        title += ", of evidence of others than the one that is shown" if "evidence" in counts else ""
    lines = [title, "", line(header)]
    lines += [line(["---"] * len(header))] if line is _markdown_line else []
    for (test_case, condition), group in itertools.groupby(rows, lambda row: (row["test_case"], row["condition"])):
        by_method = {row["method"]: row for row in group}
        any_row = next(iter(by_method.values()))
        reported = next((row["reported"] for row in by_method.values() if row["reported"]), None)
        cells = [f"{test_case.lower()} {condition}", f"{any_row['scene_count']}/{any_row['room_count']}"]
        cells.append(_number(reported and reported[metric]))
        lines.append(line(cells + [_measured(by_method.get(name), metric) for name in methods]))
    return "\n".join(lines) + "\n"


def _full_table(rows: list[Row]) -> Iterator[str]:
    told = [f"reported {metric}" for metric in REPORTED_METRICS]
    measured = [*METRICS, "observable_share", *BOX_METRICS]
    names = ["test case", "labels", "method", "rooms", *(name.replace("_", " ") for name in measured + told)]
    yield _markdown_line(names)
    yield _markdown_line(["---"] * len(names))
    for row in rows:
        cells = [f"{row['test_case']}, {row['condition']}", row["label_kind"], row["method"]]
        cells.append(f"{row['scene_count']}/{row['room_count']}")
        cells += [_measured(row, metric) for metric in measured]
        reported = row["reported"] or {}
        yield _markdown_line(cells + [_number(reported.get(metric)) for metric in REPORTED_METRICS])


def _measured(row: Row | None, metric: str) -> str:
    if row is None or row[metric] is None:
        return "-"
    seeds = (row.get("trainings") or {}).get(metric)
    of_seeds = f" [{_number(seeds[0])}-{_number(seeds[1])}]" if seeds else ""
    if row["ci95"][metric] is None:
        return f"{_number(row[metric])}{of_seeds}"
    # Rounded outwards, so that what is printed of an interval holds the value printed beside it.
    low, high = row["ci95"][metric]
    low, high = math.floor(low * 1000 + 1e-6) / 1000, math.ceil(high * 1000 - 1e-6) / 1000
    return f"{_number(row[metric])} {low + 0.0:.3f}-{high + 0.0:.3f}{of_seeds}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _markdown_line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _terminal_line(cells: list[str]) -> str:
    widths = (23, 5, 8, *[18] * (len(cells) - 3))
    return "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()
