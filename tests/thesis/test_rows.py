"""`jaxmm thesis` on the thesis's own scans: the file it writes holds the known figures."""

import dataclasses
import json

import numpy as np
import pytest

from jaxmm import run_folder
from jaxmm.commands import cli
from jaxmm.config import CONDITIONS, SCENARIOS
from jaxmm.learning import model_files
from jaxmm.learning.metrics import METRICS

PERFECT = (1.0, 0.0, 1.0)
# (AUC, FPR at 95 % recall, precision there) of the raw distance and of the released network, measured independently.
KNOWN = {
    ("synthetic", "pillar_removed", "clean"): (PERFECT, (0.9325, 0.9785, 0.0304)),
    ("synthetic", "pillar_removed", "occluded"): ((0.9164, 0.3613, 0.0847), (0.8923, 0.8365, 0.0384)),
    ("synthetic", "wall_removed", "clean"): (PERFECT, PERFECT),
    ("synthetic", "wall_removed", "occluded"): ((0.9859, 0.1434, 0.8581), (0.9859, 0.1434, 0.8581)),
    ("atlas", "pillar_removed", "clean"): (PERFECT, (0.9847, 0.0, 1.0)),
} | {
    ("synthetic", f"{kind}_added", condition): (PERFECT, PERFECT)
    for kind in ("pillar", "wall")
    for condition in CONDITIONS
}


def score(root, method, out, *more):
    assert cli.main(["thesis", str(root), "--method", method, "--out", str(out), *map(str, more)]) == 0
    return json.loads(out.read_text())["rows"]


def figures(row):
    return tuple(round(row[name], 4) for name in ("roc_auc", "fpr_at_95", "precision_at_95"))


@pytest.mark.long
@pytest.mark.parametrize("column, method", [(0, "nn-raw"), (1, "released")])
def test_the_file_holds_the_known_figures(data_root, tmp_path, column, method):
    rows = score(data_root / "thesis", method, tmp_path / "out.json")
    found = {(row["source"], row["scenario"], row["condition"]): row for row in rows if row["room"] == "room_test_1"}
    for key, expected in KNOWN.items():
        assert figures(found[key]) == expected[column], key
    for row in rows:
        names = ["scenario", "source", "room", "condition", "points", "positives", *METRICS, "by_element", "boxes"]
        assert list(row)[: len(names)] == names
        assert set(row) - set(names) == ({"max_probability"} if row["positives"] == 0 else set())
        assert row["by_element"] is None or list(row["by_element"]) == list(METRICS[:4])
        for box in row["boxes"]:
            assert set(box) == {
                "object_type",
                "shape",
                "mismatch_type",
                "center",
                "dimensions",
                "rotation",
                "probability",
            }
            assert f"{box['object_type']}_{box['mismatch_type']}" == row["scenario"]
    # In units of the thesis: its FPR and IoU of the rows it printed.
    wall = found["synthetic", "wall_removed", "occluded"]
    assert round(wall["thesis_fpr_at_95"], 4) == 0.1254
    assert round(found["synthetic", "pillar_added", "clean"]["thesis_iou_at_95"], 4) == 0.9494


def test_added_objects_are_found_as_boxes(data_root, tmp_path):
    rows = score(data_root / "thesis", "nn-raw", tmp_path / "out.json")
    for row in rows:
        if row["source"] == "synthetic" and row["scenario"].endswith("added") and row["condition"] == "clean":
            assert len(row["boxes"]) == 1, row["scenario"]


@pytest.mark.long
def test_a_model_of_ours_scores_the_scans_too(data_root, finished_run, tmp_path):
    for method in ("nn", "xyz_nn"):
        rows = score(data_root / "thesis", method, tmp_path / f"{method}.json", "--model", finished_run)
        assert {row["scenario"] for row in rows} == set(SCENARIOS)
        assert all(0 <= row["roc_auc"] <= 1 for row in rows if row["positives"])
    # A file says what a folder says.
    by_file = score(data_root / "thesis", "nn", tmp_path / "file.json", "--model", finished_run / run_folder.MODELS)
    assert by_file == json.loads((tmp_path / "nn.json").read_text())["rows"]


def test_a_method_that_was_not_trained_is_refused(data_root, finished_run, tmp_path, capsys):
    models, config = model_files.load_models(finished_run)
    alone = dataclasses.replace(config, train=dataclasses.replace(config.train, methods=("nn",)))
    path = tmp_path / "nn.safetensors"
    model_files.save_models(path, {"nn": models["nn"]}, alone)
    arguments = ["thesis", data_root / "thesis", "--method", "xyz_nn", "--model", path, "--out", tmp_path / "x.json"]
    assert cli.main(list(map(str, arguments))) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(path) in line and "method xyz_nn" in line and "found nn" in line
    assert not (tmp_path / "x.json").exists() and np.isfinite(models["nn"].params["conv1"]["kernel"]).all()
