"""Scaling, sweeps and the thesis's scans: what they learn from, what a level changes, and how their rows come about."""

import dataclasses

import numpy as np
import pytest

from jaxmm.config import SCENARIOS, Config, Table
from jaxmm.data import labelled_rooms
from jaxmm.data.simulator_settings import CloudSource, pair_config
from jaxmm.learning.metrics import METRICS
from jaxmm.runs.paper import scaling as paper_scaling
from jaxmm.runs.paper import sweeps as paper_sweeps
from jaxmm.runs.paper import thesis_scans
from jaxmm.runs.paper.scaling import ThinClouds, scaling_config
from jaxmm.runs.paper.sweeps import levels, study_rows
from jaxmm.thesis.repository import find_pairs

BASE = Config(scan=Table.of({"sensor_height": 1.5, "width": 96, "height": 60}))
CONFIG = dataclasses.replace(
    BASE,
    data=dataclasses.replace(BASE.data, train_seed=24, validation_seed=25),
    preprocess=dataclasses.replace(BASE.preprocess, evidence="exact"),
    paper=dataclasses.replace(BASE.paper, scaling_rooms=(1, 3), scaling_points=48),
)


@pytest.fixture(scope="module")
def chunk():
    return paper_scaling._chunk(scaling_config(CONFIG), 0, 2, 0, 4)


def test_chunks_do_not_depend_on_where_they_are_cut(chunk):
    config = scaling_config(CONFIG)
    parts = [paper_scaling._chunk(config, 0, 2, first, first + 2) for first in (0, 2)]
    for name, whole in chunk.items():
        np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), whole)


def test_thinned_clouds_are_points_of_the_clouds_themselves(chunk):
    """Even rooms are clean, odd ones occluded; evidence in half precision, distances and labels exact."""
    clouds = ThinClouds(chunk, 4)
    config = scaling_config(CONFIG)
    for room, condition in enumerate(("clean", "occluded", "clean", "occluded")):
        source = CloudSource("pillar_removed", "pillar_removed", condition, 24)
        ((whole, _),) = labelled_rooms.clouds(config, source, np.array([room]))
        thin = clouds[room]
        assert len(thin.distance) == min(48, len(whole.distance))
        known = {
            (d, t, e[0].astype(np.float16)) for d, t, e in zip(whole.distance, whole.true, whole.evidence, strict=True)
        }
        assert {(d, t, e[0]) for d, t, e in zip(thin.distance, thin.true, thin.evidence, strict=True)} <= known


def test_smaller_sets_are_the_first_rooms_of_larger_ones(chunk):
    clouds = ThinClouds(chunk, 4)
    small = clouds.first(2)
    assert len(clouds) == 4 and len(small) == 2
    np.testing.assert_array_equal(small[1].distance, clouds[1].distance)


def test_every_size_gets_the_same_number_of_updates():
    config = scaling_config(CONFIG)
    assert config.train.step_count == CONFIG.paper.scaling_steps and config.train.patience == 0
    assert config.scan.thawed() == {"preset": "varied", "width": 96, "height": 60}
    assert config.preprocess.object_filter == "none" and config.network.encoder == (32, 64, 64, 128)


def test_levels_have_folders_of_their_own_and_change_one_thing():
    found = levels(CONFIG)
    assert len({level.name for level in found}) == len(found) == 4 + 4 + 5 + 5
    source = CloudSource("pillar_added", "pillar_added", "occluded", 3)
    plain = pair_config(CONFIG, source)
    for level in found:
        own = paper_sweeps._config(CONFIG, level)
        own = dataclasses.replace(own, scan=Table.of(own.scan.thawed() | level.scan))
        pair = pair_config(own, source)
        differing = {
            field.name for field in dataclasses.fields(pair) if getattr(pair, field.name) != getattr(plain, field.name)
        }
        if level.study == "furniture":
            assert pair.room.table_limit + pair.room.chair_limit == level.value
            assert differing <= {"room", "furniture_share"}
        elif level.study == "range noise":
            assert pair.range_noise == level.value and differing <= {"range_noise", "testable_margin"}
        else:
            assert differing <= {"position_error", "angle_error"} and bool(differing) == (level.value > 0)
            assert (own.preprocess.registration == "refine") == level.study.endswith("registered")


def side(auc):
    scored = {"boxes_matched": 1, "boxes_found": 1, "boxes_true": 1, "metrics": {"true": dict.fromkeys(METRICS, auc)}}
    methods = ("nn-raw", "rule", "nn", "evidence", "nn_1", "nn_3", "evidence_1", "evidence_3")
    return {"positives": {"true": 50}, "observable_fraction": 0.5, "methods": dict.fromkeys(methods, scored)}


def test_rows_of_studies_are_means_over_rooms_at_their_level():
    rooms = {name: [{"room": i, "sides": {name: side(auc)}} for i, auc in enumerate((0.5, 1.0))] for name in SCENARIOS}
    sweeps = {level.name: rooms for level in levels(CONFIG)}
    rows = study_rows(CONFIG, sweeps, rooms)
    assert len(rows) == 18 * 4 * 4 + 4 * (2 + 2 * 2)
    assert {row["roc_auc"] for row in rows} == {0.75}
    scaling = [row for row in rows if row["study"] == "training rooms"]
    assert {(row["level"], row["method"]) for row in scaling} == {
        (None, "nn-raw"), (None, "rule"), (1, "nn"), (3, "nn"), (1, "evidence"), (3, "evidence"),
    }  # fmt: skip
    text = paper_sweeps.as_markdown(rows)
    assert text.count("\n## ") + text.startswith("## ") == 5 and "| 0.02 | 2/2 | 0.7500 / 0.750 |" in text


def test_points_whose_released_label_is_wrong_are_counted(tmp_path):
    """Ten points of element 7 changed, of which three are not labelled; two of another element are, wrongly."""
    folder = tmp_path / "datasets" / "dataset_pillar_removed"
    scans, labels = (folder / "clean_and_occluded" / name for name in ("npy_files_x", "labels_x"))
    tables = folder / "clean" / "preprocessed_csv_files"
    for place in (scans, labels, tables):
        place.mkdir(parents=True)
    points = np.random.default_rng(0).uniform(-1, 1, (40, 3)).astype(np.float32)
    points[28:] += 5
    element = np.where(np.arange(40) >= 30, 7, 1)
    released = np.zeros(40, np.float32)
    released[33:] = released[28:30] = 1
    name = "room_test_1_clean_dt_scan_x"
    np.save(scans / f"{name}.npy", points)
    np.save(scans / "room_test_1_clean_robot_scan_x.npy", points[:28])
    np.save(labels / f"{name}_labels.npy", released)
    lines = [f"{x};{y};{z};{e}" for (x, y, z), e in zip(points, element, strict=True)]
    (tables / f"{name}.csv").write_text("\n".join(["X;Y;Z;categoryID", *lines]))
    (pair,) = find_pairs(tmp_path)
    assert thesis_scans._wrong(pair) == 3 + 2


def test_a_scored_pair_becomes_a_row_for_each_kind_of_labels():
    scored = {
        "source": "synthetic", "scenario": "pillar_removed", "condition": "occluded", "room": "room_test_1",
        "points": 9, "positives": 2, "wrong_labels": 5, "by_element": dict.fromkeys(METRICS[:4], 0.9),
        **dict.fromkeys(METRICS, 0.8),
    }  # fmt: skip
    rows = [row for name in thesis_scans.METHODS for row in thesis_scans._rows(scored, name)]
    assert [row["label_kind"] for row in rows] == ["released", "by element"] * 5
    assert {(row["label_kind"], row["roc_auc"]) for row in rows} == {("released", 0.8), ("by element", 0.9)}
    text = thesis_scans.as_markdown(rows)
    assert text.count("synthetic pillar removed, occluded") == 2 and "| 9 | 2 | 5 | 0.8000 / 0.800 |" in text
