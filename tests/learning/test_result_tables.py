"""Table I: what enters a mean, what stands beside it, and that its three files say the same."""

import csv
import itertools
import json

import numpy as np
import pytest

from jaxmm.config import CONDITIONS, SCENARIOS, EvaluateConfig
from jaxmm.learning import result_tables
from jaxmm.learning.metrics import METRICS

CONFIG = EvaluateConfig(least_positives=20, resamples=400)
# The columns that users rely on; see README.
CONTRACT = [
    "section", "test_case", "condition", "method", "label_kind", "roc_auc", "fpr_at_95", "precision_at_95",
    "iou_at_95", "thesis_fpr_at_95", "thesis_iou_at_95", "observable_share", "box_precision", "box_recall",
    "scene_count", "room_count", "left_out_share", "ci95", "reported",
]  # fmt: skip
METHODS = ("nn-raw", "nn", "xyz_nn")


def room(scenario="pillar_added", condition="clean", label_kind="true", method="nn", **changes):
    scores = {
        "positives": 50, "observable_fraction": 0.5, "boxes_matched": 1, "boxes_found": 1, "boxes_true": 1,
        **dict.fromkeys(METRICS, 0.5),
    }  # fmt: skip
    names = {"scenario": scenario, "condition": condition, "label_kind": label_kind, "method": method}
    return names | scores | changes


def only_row(rooms, config=CONFIG):
    (row,) = result_tables.table_rows(rooms, config, result_tables.reported_values())
    return row


def whole_table(rooms_per_row=6):
    rng = np.random.default_rng(0)
    rooms = [
        room(*names, **dict(zip(METRICS, rng.random(6), strict=True)), observable_fraction=float(rng.random()))
        for names in itertools.product(SCENARIOS, CONDITIONS, result_tables.LABEL_KINDS, METHODS)
        for _ in range(rooms_per_row)
    ]
    return result_tables.table_rows(rooms, CONFIG, result_tables.reported_values())


def test_a_table_has_a_row_for_every_case_method_and_label_kind_with_the_promised_keys():
    rows = whole_table()
    assert len(rows) == 8 * 3 * 2
    keys = [(row["test_case"], row["condition"], row["method"], row["label_kind"]) for row in rows]
    assert len(set(keys)) == len(rows)
    for row in rows:
        assert list(row) == CONTRACT and row["section"] == "Individual Models"
        assert set(row["ci95"]) == set(METRICS) | {"observable_share", "box_precision", "box_recall"}
        for name, interval in row["ci95"].items():
            assert interval[0] <= row[name] <= interval[1], name


def test_means_are_over_rooms_with_enough_positives():
    rooms = [room(roc_auc=0.5), room(roc_auc=1.0, positives=20), room(roc_auc=0.0, positives=19)]
    rooms.append(room(roc_auc=None, positives=100))  # everything in it is positive: there is nothing to rank
    row = only_row(rooms)
    assert row["roc_auc"] == 0.75 and row["scene_count"] == 2 and row["left_out_share"] == 0.5


def test_a_row_without_a_scored_room_has_gaps_but_still_counts_boxes():
    row = only_row([room(positives=0, roc_auc=None, observable_fraction=0.0, boxes_matched=0, boxes_found=2)] * 3)
    assert row["roc_auc"] is None and row["ci95"]["roc_auc"] is None
    assert row["scene_count"] == 0 and row["left_out_share"] == 1
    assert row["box_precision"] == 0 and row["box_recall"] == 0 and row["observable_share"] == 0


def test_boxes_are_counted_over_all_rooms():
    counts = [(1, 1, 1), (0, 3, 1), (1, 2, 1), (0, 0, 1)]
    rooms = [room(boxes_matched=m, boxes_found=f, boxes_true=t, positives=0) for m, f, t in counts]
    row = only_row(rooms)
    assert row["box_precision"] == pytest.approx(2 / 6) and row["box_recall"] == 2 / 4
    none_found = only_row([room(boxes_matched=0, boxes_found=0)] * 2)
    assert none_found["box_precision"] is None and none_found["box_recall"] == 0


def test_the_observable_share_is_over_all_rooms_too():
    row = only_row([room(observable_fraction=1.0), room(observable_fraction=0.0, positives=0)])
    assert row["observable_share"] == 0.5 and row["ci95"]["observable_share"] == [0.0, 1.0]


def test_intervals_cover_the_mean_as_often_as_they_promise():
    """Of 200 rows of 40 rooms each, drawn around 0.7, about 95 % of the intervals hold 0.7."""
    rng = np.random.default_rng(1)
    covered = 0
    for values in np.clip(rng.normal(0.7, 0.1, (200, 40)), 0, 1):
        low, high = only_row([room(roc_auc=float(value)) for value in values])["ci95"]["roc_auc"]
        covered += low <= 0.7 <= high
    assert 0.90 < covered / 200 < 0.98


def test_reported_stands_only_beside_the_method_and_labels_that_the_thesis_reported():
    for row in whole_table(2):
        told = row["method"] == "xyz_nn" and row["label_kind"] == "heuristic"
        assert (row["reported"] is not None) == told
    row = only_row([room("pillar_removed", "occluded", "heuristic", "xyz_nn")])
    assert row["reported"] == {
        "roc_auc": 0.9923, "thesis_fpr_at_95": 0.0605, "precision_at_95": 0.5484, "thesis_iou_at_95": 0.5326,
    }  # fmt: skip


def test_the_reported_values_are_those_of_the_eight_printed_rows():
    reported = result_tables.reported_values()
    assert len(reported) == 8
    printed = {key: tuple(value.values()) for key, value in reported.items()}
    assert printed == {  # ROC AUC, FPR, precision, IoU, as the thesis prints them
        ("Pillar Added", "clean"): (1.0000, 0.0000, 1.0000, 0.9494),
        ("Pillar Added", "occluded"): (1.0000, 0.0000, 1.0000, 0.9480),
        ("Wall Added", "clean"): (0.9995, 0.0000, 1.0000, 0.9495),
        ("Wall Added", "occluded"): (0.9998, 0.0005, 0.9981, 0.9479),
        ("Pillar Removed", "clean"): (0.9999, 0.0000, 1.0000, 0.9493),
        ("Pillar Removed", "occluded"): (0.9923, 0.0605, 0.5484, 0.5326),
        ("Wall Removed", "clean"): (1.0000, 0.0000, 1.0000, 0.9495),
        ("Wall Removed", "occluded"): (0.8464, 0.2119, 0.7238, 0.6972),
    }


def test_csv_and_markdown_say_what_the_json_says(tmp_path):
    rooms = [room("wall_added", positives=0, roc_auc=None), room("wall_removed", "occluded", "heuristic", "xyz_nn")]
    rows = whole_table() + result_tables.table_rows(rooms, CONFIG, result_tables.reported_values())
    result_tables.write_table(tmp_path, rows, {"seed": 0})
    assert json.loads((tmp_path / "table_1.json").read_text()) == {"rows": rows, "meta": {"seed": 0}}
    assert result_tables.read_rows(tmp_path) == rows
    with open(tmp_path / "table_1.csv", newline="") as file:
        flat = list(csv.DictReader(file))
    assert len(flat) == len(rows)
    for row, cells in zip(rows, flat, strict=True):
        for name in CONTRACT[:-2]:
            assert cells[name] == ("" if row[name] is None else str(row[name]))
        for name, interval in row["ci95"].items():
            ends = [cells[f"{name}_low"], cells[f"{name}_high"]]
            assert ends == (["", ""] if interval is None else list(map(str, interval)))
        for name in METRICS:
            if name not in result_tables.REPORTED_METRICS:
                continue
            told = (row["reported"] or {}).get(name)
            assert cells[f"reported_{name}"] == ("" if told is None else str(told))
    result_tables.write_table(tmp_path, whole_table(), {})
    assert_markdown_agrees((tmp_path / "table_1.md").read_text(), whole_table())


def cells_of(line):
    return line.strip("| ").split(" | ")


def assert_markdown_agrees(text, rows):
    """The short tables come first, one per kind of label and metric; the long one has every row."""
    long = text.split("Every column:")[1]
    short = dict(
        zip(
            itertools.product(result_tables.LABEL_KINDS, result_tables.SHOWN),
            text.split(", with its 95 %")[1:],
            strict=True,
        )
    )
    for row in rows:
        case = f"{row['test_case'].lower()} {row['condition']}"
        for metric in result_tables.SHOWN:
            lines = short[row["label_kind"], metric].split("Every column:")[0].splitlines()
            (line,) = [line for line in lines if line.startswith(f"| {case} |")]
            low, high = row["ci95"][metric]
            value, ends = cells_of(line)[3 + METHODS.index(row["method"])].split(" ")
            shown_low, shown_high = map(float, ends.split("-"))
            assert value == f"{row[metric]:.4f}"
            assert low - 0.001 < shown_low <= low + 1e-8 and high - 1e-8 <= shown_high < high + 0.001
            assert cells_of(line)[1] == "6/6"
            if row["reported"]:
                assert cells_of(line)[2] == f"{row['reported'][metric]:.4f}"
        start = f"| {row['test_case']}, {row['condition']} | {row['label_kind']} | {row['method']} | 6/6 |"
        (line,) = [line for line in long.splitlines() if line.startswith(start)]
        values = [cell.split(" ")[0] for cell in cells_of(line)[4:]]
        measured = [row[name] for name in (*METRICS, "observable_share", *result_tables.BOX_METRICS)]
        reported = [(row["reported"] or {}).get(name) for name in result_tables.REPORTED_METRICS]
        assert values == ["-" if value is None else f"{value:.4f}" for value in measured + reported]


def test_the_terminal_shows_the_short_tables_within_a_hundred_columns():
    rows = whole_table()
    terminal = result_tables.as_terminal(rows)
    assert max(map(len, terminal.splitlines())) <= 100
    short = result_tables.as_markdown(rows).split("Every column:")[0]
    lines = [line for line in short.splitlines() if line.startswith("|") and "---" not in line]
    assert len(lines) == 4 * 9
    for line in lines:
        assert all(cell in terminal for cell in cells_of(line))


def test_one_room_has_no_interval():
    row = only_row([room(roc_auc=0.7)])
    assert row["roc_auc"] == 0.7 and row["ci95"]["roc_auc"] is None
