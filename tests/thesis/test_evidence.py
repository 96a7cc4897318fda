"""Evidence of scan pairs in the thesis's layout, on rooms of our own whose truth is known."""

import json
import shutil

import numpy as np
import pytest

from jaxmm.commands import cli
from jaxmm.config import Config, Table
from jaxmm.data.labelled_rooms import pairs_of
from jaxmm.data.preprocessed_pairs import sides_of
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.rays.evidence import FEATURES
from jaxmm.rays.rule import rule_scores
from jaxmm.thesis import repository
from jaxmm.thesis.evidence import FIELD_OF_VIEW, evidence_features, viewpoint_of

WIDE, HIGH = FIELD_OF_VIEW
SENSOR = {"kind": "pinhole", "width": 320, "height": 200, "horizontal_fov": WIDE, "vertical_fov": HIGH}
CONFIG = Config(scan=Table.of({"sensor": SENSOR}))
ROOM = 5


@pytest.fixture(scope="module", params=["wall_removed", "pillar_added"])
def written(request, tmp_path_factory):
    """A repository with one test room, and where its scans were taken from."""
    root, scenario = tmp_path_factory.mktemp("repository"), request.param
    source = CloudSource(scenario, scenario, "occluded", 3)
    pairs = pairs_of(CONFIG, source, np.array([ROOM]))
    sides = sides_of(CONFIG, pairs)
    removed = scenario.endswith("removed")
    scored, other = (sides.dt[0], sides.robot[0]) if removed else (sides.robot[0], sides.dt[0])
    scan, changed = (pairs.dt, pairs.changed_dt) if removed else (pairs.robot, pairs.changed_robot)
    place = root / "datasets" / f"dataset_{scenario}" / "clean_and_occluded"
    names = [f"room_test_1_occluded_{side}_scan_x" for side in (("dt", "robot") if removed else ("robot", "dt"))]
    for folder in ("npy_files_no_augmented", "labels_no_augmented"):
        (place / folder).mkdir(parents=True)
    for name, kept in zip(names, (scored, other), strict=True):
        np.save(place / "npy_files_no_augmented" / f"{name}.npy", kept.points)
    label = changed[0, scored.pixel].astype(np.float32)
    np.save(place / "labels_no_augmented" / f"{names[0]}_labels.npy", label)
    csv = place.parent / "occluded" / "preprocessed_csv_files" / f"{names[0]}.csv"
    csv.parent.mkdir(parents=True)
    rows = zip(scored.points.tolist(), scan.element[0, scored.pixel].tolist(), strict=True)
    csv.write_text("X;Y;Z;categoryID\n" + "".join(f"{x};{y};{z};{element - 3}\n" for (x, y, z), element in rows))
    return root, scenario, pairs.pose


def test_the_viewpoint_and_what_it_saw_are_found(written):
    root, scenario, pose = written
    (pair,) = repository.find_pairs(root)
    scan = repository.read_pair(pair)
    viewpoint = viewpoint_of(scan)
    assert np.linalg.norm(viewpoint.position - pose.position[0]) < 0.1
    removed = scenario.endswith("removed")
    for elements in (True, False):
        features = evidence_features(scan, scenario, viewpoint, elements=elements)
        assert features.shape == (len(scan.points), len(FEATURES)) and np.isfinite(features).all()
        score = rule_scores(features, removed=removed)
        assert np.median(score[scan.label]) > np.quantile(score[~scan.label], 0.95)
    # Categories may have any number, below zero too: all of them are elements.
    known = evidence_features(scan, scenario, viewpoint, elements=True)[:, FEATURES.index("pooled")]
    assert known.all() == removed


def test_the_command_tells_what_elements_are_worth(written, tmp_path):
    root, scenario, _ = written
    assert cli.main(["thesis", str(root), "--method", "rule", "--out", str(tmp_path / "rule.json")]) == 0
    (row,) = json.loads((tmp_path / "rule.json").read_text())["rows"]
    assert row["scenario"] == scenario and row["by_element"]["roc_auc"] > 0.97
    assert set(row["without_elements"]) == set(row["by_element"])
    assert cli.main(["thesis", str(root), "--method", "nn-raw", "--out", str(tmp_path / "raw.json")]) == 0
    (raw,) = json.loads((tmp_path / "raw.json").read_text())["rows"]
    assert "without_elements" not in raw


def test_the_default_models_rank_what_changed_first(written, tmp_path):
    root, scenario, _ = written
    out = tmp_path / "evidence.json"
    assert cli.main(["thesis", str(root), "--method", "evidence", "--out", str(out)]) == 0
    (row,) = json.loads(out.read_text())["rows"]
    assert row["scenario"] == scenario and row["by_element"]["roc_auc"] > 0.995
    assert row["without_elements"]["roc_auc"] > 0.98


def test_what_cannot_be_compared_is_one_line(written, tmp_path, refused):
    root, scenario, _ = written
    refused(["thesis", root, "--method", "rule", "--model", "x", "--out", tmp_path / "out.json"], "--model")
    copy = tmp_path / "copy"
    shutil.copytree(root, copy)
    (other,) = (copy / "datasets" / f"dataset_{scenario}").rglob(
        f"npy_files*/*_{'robot' if scenario.endswith('removed') else 'dt'}_scan_x.npy"
    )
    points = np.load(other)
    arguments = ["thesis", copy, "--method", "evidence", "--out", tmp_path / "out.json"]
    np.save(other, points * 1000)
    refused(arguments, other.parents[0], "in millimetres")
    np.save(other, points + 100.0)
    refused(arguments, other.parents[0], "0.0% of its points")
    assert not (tmp_path / "out.json").exists()


def test_the_rule_scores_by_pools_and_columns():
    at = {name: column for column, name in enumerate(FEATURES)}
    gone = np.zeros((3, len(FEATURES)), np.float32)
    gone[:2, at["pooled"]] = 1
    gone[:2, at["pool through"]] = (0.9, 0.1)
    gone[:2, at["pool support"]] = (0.0, 0.8)
    gone[2, at["through"]] = 1.0
    score = rule_scores(gone, removed=True)
    assert score[0] > 0.95 and score[1] < 0.15 and score[2] == 0.5
    new = np.zeros((3, len(FEATURES)), np.float32)
    new[:, at["blocked"]] = (1, 1, 0)
    new[:, at["apart"]] = 0.5
    new[:, at["column high"]] = (1.0, 0.3, 1.0)
    new[:, at["column ceiling gap"]] = (0.0, 0.7, 0.0)
    score = rule_scores(new, removed=False)
    assert score[0] == 1.0 and 0.0 < score[1] < 0.2 and score[2] == 0.0
