"""Table I out of scores: means over the models that are present, and over those that the thesis's rule selects."""

import csv
import io

import pytest

from jaxmm.config import SCENARIOS, EvaluateConfig
from jaxmm.learning.metrics import METRICS
from jaxmm.learning.result_tables import LABEL_KINDS
from jaxmm.runs.paper import tables
from jaxmm.runs.paper.rows import TABLE_1
from jaxmm.runs.paper.tables import as_csv, as_markdown, as_summary, file_rows, label_noise, not_best, rows_of, table_1

CONFIG = EvaluateConfig(least_positives=20, resamples=100)
METHODS = (
    "nn-raw",
    "rule",
    "nn",
    "xyz_nn",
    "xyz",
    "nn_augmented",
    "clean_only",
    "not_augmented",
    "nn_heuristic",
    "evidence",
)
ALL_FOUR = next(row for row in TABLE_1 if row.test_case == "Objects Added & Removed")
PILLARS = next(row for row in TABLE_1 if row.test_case == "Pillars Added")


def side(auc, positives=50, boxes=1, fraction=0.5):
    metrics = dict.fromkeys(METRICS, auc)
    scored = {
        "boxes": [], "boxes_matched": min(boxes, 1), "boxes_found": boxes, "boxes_true": 1,
        "metrics": dict.fromkeys(LABEL_KINDS, metrics),
    }  # fmt: skip
    counts = dict.fromkeys(LABEL_KINDS, positives)
    return {"positives": counts, "observable_fraction": fraction, "methods": dict.fromkeys(METHODS, scored)}


def scene(**sides):
    return {"room": 0, "place": "", "sides": sides}


def row_of(row, scenes, method="nn", kind="true"):
    found = rows_of(row, scenes, CONFIG, ("generated rooms", {"roc_auc": 0.5}))
    (one,) = [one for one in found if (one["method"], one["label_kind"]) == (method, kind)]
    return one


def test_a_room_is_the_mean_of_the_models_whose_change_is_there():
    sides = {name: side(auc) for name, auc in zip(SCENARIOS, (1.0, 0.8, 0.6, 0.4), strict=True)}
    assert row_of(ALL_FOUR, [scene(**sides)])["roc_auc"] == pytest.approx(0.7)
    assert row_of(PILLARS, [scene(**sides)])["roc_auc"] == 1.0  # whatever the three others say


def test_models_that_see_too_little_are_left_out_and_rooms_where_all_do():
    first = scene(**{name: side(0.5, positives=19 if name == "pillar_added" else 20) for name in SCENARIOS})
    first["sides"]["pillar_added"] = side(0.0, positives=19)
    second = scene(**{name: side(0.1, positives=3) for name in SCENARIOS})
    row = row_of(ALL_FOUR, [first, second])
    assert row["roc_auc"] == 0.5 and row["scene_count"] == 1 and row["room_count"] == 2


def test_boxes_of_all_present_models_are_counted():
    sides = {name: side(1.0, boxes=count) for name, count in zip(SCENARIOS, (1, 3, 0, 0), strict=True)}
    row = row_of(ALL_FOUR, [scene(**sides)])
    assert row["box_precision"] == 2 / 4 and row["box_recall"] == 2 / 4


def test_the_rule_of_the_thesis_averages_over_models_that_found_a_box():
    sides = {name: side(auc) for name, auc in zip(SCENARIOS, (1.0, 0.8, 0.6, 0.4), strict=True)}
    sides["pillar_added"] = side(1.0, boxes=0)
    sides["wall_removed"] = side(0.4, boxes=0)
    selected = row_of(PILLARS, [scene(**sides)])["selected"]
    assert selected["roc_auc"] == pytest.approx(0.7)  # wall added and pillar removed, both wrongly
    assert selected["right_share"] == 0.0 and selected["room_share"] == 1.0
    nothing = scene(**{name: side(1.0, boxes=0) for name in SCENARIOS})
    selected = row_of(PILLARS, [nothing])["selected"]
    assert selected["roc_auc"] is None and selected["right_share"] is None and selected["room_share"] == 0.0
    both = row_of(PILLARS, [scene(**sides), nothing])["selected"]
    assert both["room_share"] == 0.5 and both["roc_auc"] == pytest.approx(0.7)


def test_a_selected_model_without_its_change_has_no_score_but_counts_as_wrong():
    sides = {name: side(1.0) for name in SCENARIOS}
    unseen = side(None, positives=0, fraction=None)
    sides |= {"pillar_removed": unseen, "wall_removed": unseen, "wall_added": side(1.0, boxes=0)}
    selected = row_of(PILLARS, [scene(**sides)])["selected"]
    assert selected["roc_auc"] == 1.0 and selected["right_share"] == pytest.approx(1 / 3)


def whole():
    scores = {}
    for number, row in enumerate(TABLE_1):
        names = SCENARIOS if len(row.models) > 1 or row.section == "Multi-Mismatch Testing" else row.models
        scores[row.scenes.name] = [scene(**{name: side(0.9 + number / 1000) for name in names}) for _ in range(3)]
    return scores


def test_the_table_has_every_row_with_four_methods_and_both_labels():
    rows = table_1(whole(), CONFIG)
    assert len(rows) == (54 + 8) * 4 * 2
    for row, start in zip(TABLE_1, range(0, len(rows), 8), strict=True):
        own = rows[start : start + 8]
        assert {one["method"] for one in own} == {"nn-raw", "rule", row.method, "evidence"}
        told = [one for one in own if one["reported"] is not None]
        if row.section == "Sensor Noise":
            assert not told
        else:
            (one,) = told
            assert (one["method"], one["label_kind"]) == (row.method, "heuristic") and len(one["reported"]) == 4
        assert all((one["selected"] is not None) == (row.section == "Multi-Mismatch Testing") for one in own)
        assert {one["training"] for one in own} == {None, row.training}


def test_files_and_labels_have_rows_of_their_own():
    scores = whole()
    files = {name: scenes for name, scenes in scores.items() if name.startswith("building_pillar")}
    rows = file_rows(files, CONFIG)
    assert len(rows) == 4 * 4 * 2 and {row["source"] for row in rows} == {"IFC files"}
    noise = label_noise(scores, CONFIG)
    assert len(noise) == 8 * 3 * 2 and {row["method"] for row in noise} == {"nn-raw", "nn", "nn_heuristic"}


def test_the_csv_says_what_the_rows_say():
    rows = table_1(whole(), CONFIG)
    table = list(csv.DictReader(io.StringIO(as_csv(rows))))
    assert len(table) == len(rows)
    for flat, row in zip(table, rows, strict=True):
        assert flat["test_case"] == row["test_case"] and float(flat["roc_auc"]) == row["roc_auc"]
        assert float(flat["ci95_roc_auc_low"]) == row["ci95"]["roc_auc"][0]
        assert flat["reported_roc_auc"] == ("" if row["reported"] is None else str(row["reported"]["roc_auc"]))
        assert (flat["selected_right_share"] == "") == (row["selected"] is None)


def test_the_text_has_a_line_for_every_row():
    rows = table_1(whole(), CONFIG)
    text = as_markdown(rows)
    for row in TABLE_1:
        line = f"| {row.test_case.lower()} {row.scenes.condition} | 3/3 |"
        assert text.count(line) >= 4, line
    summary = as_summary(rows)
    assert all(summary.count(f"| {row.test_case.lower()} {row.scenes.condition} |") >= 1 for row in TABLE_1)
    assert "Heuristic" not in summary
    assert text.count("## ") == 5 and "Means over the models that found a box" in text


def test_rows_that_are_not_won_are_told():
    rows = table_1(whole(), CONFIG)
    assert not_best(rows) == []
    lost = next(row for row in rows if row["method"] == "evidence")
    lost["roc_auc"] -= 2 * tables.BEHIND
    (told,) = not_best(rows)
    assert told["test_case"] == lost["test_case"] and told["roc_auc"] - told["evidence"] > tables.BEHIND


def test_a_row_of_several_trainings_tells_how_far_they_are_apart():
    """The mean over trainings in each room; its interval is over rooms, that of trainings stands beside it."""
    nn = {"nn": (0.9, 0.7), "nn@1": (0.8, 0.6), "nn@2": (1.0, 0.5)}  # by room
    scenes = []
    for room in range(2):
        sides = {"pillar_added": side(0.5)}
        own = {name: sides["pillar_added"]["methods"]["nn"] | {"metrics": side(aucs[room])["methods"]["nn"]["metrics"]}
               for name, aucs in nn.items()}  # fmt: skip
        sides["pillar_added"]["methods"] = sides["pillar_added"]["methods"] | own
        scenes.append(scene(**sides))
    row = row_of(PILLARS, scenes)
    assert row["roc_auc"] == pytest.approx(0.75) and row["scene_count"] == 2
    assert row["trainings"]["count"] == 3 and row["trainings"]["roc_auc"] == pytest.approx([0.7, 0.8])
    assert row["ci95"]["roc_auc"] == pytest.approx([0.6, 0.9])  # of means 0.9 and 0.6, by room
    assert row["box_precision"] == 1.0
    assert row_of(PILLARS, scenes, method="rule")["trainings"] is None
    assert "0.7500 0.600-0.900 [0.7000-0.8000]" in as_markdown(
        rows_of(PILLARS, scenes, CONFIG, ("generated rooms", None))
    )


def test_views_of_one_building_are_drawn_together():
    row = next(row for row in TABLE_1 if row.scenes.kind == "buildings" and row.models == ("wall_added",))
    places = {"a": 0.5, "b": 1.0}
    scenes = [scene(wall_added=side(auc)) | {"place": place} for place, auc in places.items() for _ in range(50)]
    assert row_of(row, scenes)["ci95"]["roc_auc"] == [0.5, 1.0]  # two buildings, whatever the views
    apart = row_of(row, [one | {"place": ""} for one in scenes])
    assert apart["roc_auc"] == 0.75 and apart["ci95"]["roc_auc"][0] > 0.6
    assert row_of(row, [one | {"place": "a"} for one in scenes])["ci95"]["roc_auc"] is None


def test_what_ships_is_a_row_by_itself_and_its_further_trainings_stand_beside_it():
    scenes = []
    for _ in range(2):
        one = side(0.5)
        auc = {"evidence": 1.0, "evidence@1": 0.9, "evidence@2": 0.98}
        one["methods"] = one["methods"] | {name: side(value)["methods"]["nn"] for name, value in auc.items()}
        scenes.append(scene(pillar_added=one))
    row = row_of(PILLARS, scenes, method="evidence")
    assert row["roc_auc"] == 1.0 and row["trainings"]["count"] == 2
    assert row["trainings"]["roc_auc"] == pytest.approx([0.9, 0.98])
    text = as_markdown(rows_of(PILLARS, scenes, CONFIG, ("generated rooms", None)))
    one = as_markdown(rows_of(PILLARS, scenes[:1], CONFIG, ("generated rooms", None)))
    assert "1.0000 [0.9000-0.9800]" in one  # of one room there is no interval
    assert "the worst and the best of 2 trainings, of evidence of others than the one that is shown" in text
