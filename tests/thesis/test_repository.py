"""The thesis's public repository: its layout in every variant, and the figures that its own scans and weights give."""

import numpy as np
import pytest

from jaxmm.inputs import InputError
from jaxmm.learning.metrics import METRICS
from jaxmm.learning.torch_weights import read_state_dict
from jaxmm.thesis import repository as thesis

CLEAN, OCCLUDED = "clean", "occluded"
PERFECT = (1.0, 0.0, 1.0)
# (AUC, FPR at 95 % recall, precision there) of the raw distance and of the released network, measured independently.
REMOVED = {
    ("synthetic", "pillar_removed", CLEAN): (PERFECT, (0.9325, 0.9785, 0.0304)),
    ("synthetic", "pillar_removed", OCCLUDED): ((0.9164, 0.3613, 0.0847), (0.8923, 0.8365, 0.0384)),
    ("synthetic", "wall_removed", CLEAN): (PERFECT, PERFECT),
    ("synthetic", "wall_removed", OCCLUDED): ((0.9859, 0.1434, 0.8581), (0.9859, 0.1434, 0.8581)),
    ("atlas", "pillar_removed", CLEAN): (PERFECT, (0.9847, 0.0, 1.0)),
}
ADDED = {
    ("synthetic", scenario, condition): (PERFECT, PERFECT)
    for scenario in ("pillar_added", "wall_added")
    for condition in (CLEAN, OCCLUDED)
}


def write_scan(folder, name, points, labels=None, suffix="_no_augmented"):
    """One scan in the layout of the repository, with its labels."""
    for place, array, ending in (("npy_files", points, ""), ("labels", labels, "_labels")):
        if array is not None:
            (folder / f"{place}{suffix}").mkdir(parents=True, exist_ok=True)
            np.save(folder / f"{place}{suffix}" / f"{name}{ending}.npy", array)


def write_csv(path, points, element):
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [f"{x};{y};{z};{number}" for (x, y, z), number in zip(points, element, strict=True)]
    path.write_text("\n".join(["X;Y;Z;categoryID", *rows]) + "\n")


@pytest.fixture
def repository(tmp_path):
    """pillar_removed, room_test_1 and room_3, clean: 40 points, the last 10 changed and of element 2."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (40, 3)).astype(np.float32)
    other = points[:30]
    points[30:] += 10
    folder = tmp_path / "datasets" / "dataset_pillar_removed" / "clean_and_occluded"
    for room in ("room_test_1", "room_3"):
        write_scan(folder, f"{room}_clean_dt_scan_x", points, (np.arange(40) >= 30).astype(np.float32))
        write_scan(folder, f"{room}_clean_robot_scan_x", other, np.zeros(30))
    csv = folder.parent / "clean" / "preprocessed_csv_files" / "room_test_1_clean_dt_scan_x.csv"
    write_csv(csv, points, np.where(np.arange(40) >= 29, 2, 1))
    return tmp_path


def test_a_pair_is_found_and_read(repository):
    (pair,) = thesis.find_pairs(repository)
    assert (pair.scenario, pair.source, pair.room, pair.condition) == (
        "pillar_removed",
        "synthetic",
        "room_test_1",
        CLEAN,
    )
    assert "dt_scan" in pair.scored.name and "robot_scan" in pair.other.name
    scan = thesis.read_pair(pair)
    assert scan.points.shape == (40, 3) and scan.other.shape == (30, 3) and scan.label.sum() == 10
    np.testing.assert_array_equal(scan.distance > 0, scan.label)
    assert [pair.room for pair in thesis.find_pairs(repository, "train")] == ["room_3"]


def test_a_row_holds_what_the_design_promises(repository):
    (pair,) = thesis.find_pairs(repository)
    box = {"object_type": "pillar"}
    row = thesis.score_pair(pair, thesis.nn_raw, lambda points, score: [box | {"points": len(points) + len(score)}])
    assert list(row) == [
        "scenario",
        "source",
        "room",
        "condition",
        "points",
        "positives",
        *METRICS,
        "by_element",
        "boxes",
    ]
    assert row["points"] == 40 and row["positives"] == 10 and row["roc_auc"] == 1 and row["fpr_at_95"] == 0
    assert list(row["by_element"]) == ["roc_auc", "fpr_at_95", "precision_at_95", "iou_at_95"]
    assert row["boxes"] == [box | {"points": 80}]
    upside_down = thesis.score_pair(pair, lambda scan: -scan.distance)
    assert upside_down["roc_auc"] == 0 and upside_down["boxes"] == []


def test_points_of_the_changed_element_that_did_not_move_are_void(repository):
    (pair,) = thesis.find_pairs(repository)
    score = np.arange(40.0)
    score[29] = 99  # of element 2, but where it was: counts against the released labels, not by element
    row = thesis.score_pair(pair, lambda scan: score)
    assert row["roc_auc"] < 1 and row["by_element"]["roc_auc"] == 1


def test_a_pair_without_positives_says_how_high_it_scored(repository):
    (pair,) = thesis.find_pairs(repository)
    np.save(pair.labels, np.zeros(40))
    row = thesis.score_pair(pair, lambda scan: np.linspace(0, 0.75, 40))
    assert row["max_probability"] == 0.75 and row["by_element"] is None and row["positives"] == 0
    assert all(row[name] is None for name in METRICS)


def test_without_a_csv_there_are_no_labels_by_element(repository):
    (pair,) = thesis.find_pairs(repository)
    pair.elements.unlink()
    (pair,) = thesis.find_pairs(repository)
    assert pair.elements is None and thesis.score_pair(pair, thesis.nn_raw)["by_element"] is None


def test_originals_are_preferred_to_moved_copies_and_to_single_conditions(repository):
    points, labels = np.ones((3, 3)), np.zeros(3)
    base = repository / "datasets" / "dataset_pillar_removed"
    for folder, suffix in ((base / "clean_and_occluded", ""), (base / CLEAN, ""), (base / CLEAN, "_no_augmented")):
        for side in ("dt", "robot"):
            for ending in ("", "_rotated", "_rotated_and_translated", "_translated"):
                write_scan(folder, f"room_test_1_clean_{side}_scan_x{ending}", points, labels, suffix)
    write_scan(base / CLEAN, "room_test_2_clean_dt_scan_x", points, labels, "")
    write_scan(base / CLEAN, "room_test_2_clean_robot_scan_x", points, labels, "")
    pairs = thesis.find_pairs(repository)
    assert [pair.room for pair in pairs] == ["room_test_1", "room_test_2"]
    assert pairs[0].scored.parent.name == "npy_files_no_augmented" and "clean_and" in str(pairs[0].scored)
    assert pairs[0].labels.parent.name == "labels_no_augmented" and pairs[1].labels.parent.name == "labels"


def test_labels_come_from_the_folder_of_the_same_name(tmp_path):
    folder = tmp_path / "datasets" / "dataset_real_world" / "wall_added" / OCCLUDED
    for side in ("dt", "robot"):
        write_scan(folder, f"room_test_1_occluded_{side}_scan_wall_added_x", np.ones((3, 3)), np.zeros(3), "_filtered")
    (folder / "labels_filtered").rename(folder / "labels_npy_filtered")
    write_scan(folder, "room_test_1_occluded_robot_scan_wall_added_x", None, np.ones(3), "_no_augmented")
    write_csv(folder / "preprocessed_csv_files" / "room_test_1_occluded_robot_scan_x.csv", np.ones((3, 3)), [1, 1, 1])
    (pair,) = thesis.find_pairs(tmp_path)
    assert (pair.source, pair.scenario, pair.condition) == ("atlas", "wall_added", OCCLUDED)
    assert "robot_scan" in pair.scored.name and pair.labels.parent.name == "labels_npy_filtered"
    assert pair.elements.name == "room_test_1_occluded_robot_scan_x.csv"


def refused(call, *words):
    with pytest.raises(InputError) as caught:
        call()
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_what_is_no_repository_is_refused(tmp_path, repository):
    refused(lambda: thesis.find_pairs(tmp_path / "none"), "none", "folder datasets")
    (tmp_path / "empty" / "datasets").mkdir(parents=True)
    refused(lambda: thesis.find_pairs(tmp_path / "empty"), "room_test_*", "npy_files*")
    refused(lambda: thesis.find_pairs(tmp_path / "empty", "train"), "training room")
    refused(lambda: thesis.find_weights(tmp_path / "empty"), "trained_models/<scenario>")
    with pytest.raises(ValueError, match="test or train"):
        thesis.find_pairs(repository, "all")


def test_incomplete_pairs_are_refused(repository):
    (pair,) = thesis.find_pairs(repository)
    assert len(thesis.read_pair(pair).points) == 40
    np.save(pair.labels, np.zeros(39))
    refused(lambda: thesis.read_pair(pair), str(pair.labels), "40 labels", "(39,)")
    pair.labels.unlink()
    refused(lambda: thesis.find_pairs(repository), str(pair.scored), "labels")
    pair.other.unlink()
    refused(lambda: thesis.find_pairs(repository), "partner", pair.other.name)


def test_a_csv_of_other_points_is_refused(repository):
    (pair,) = thesis.find_pairs(repository)
    points = thesis.read_pair(pair).points
    write_csv(pair.elements, points[:-1], np.ones(39, int))
    refused(lambda: thesis.read_pair(pair), str(pair.elements), "40 points", "got 39")
    write_csv(pair.elements, points[::-1], np.ones(40, int))
    refused(lambda: thesis.read_pair(pair), str(pair.elements), "point 0 lies")
    write_csv(pair.elements, points, np.ones(40, int))
    np.testing.assert_array_equal(thesis.read_pair(pair).points, points)


def test_weights_are_found_wherever_they_lie(tmp_path):
    def touch(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
        return path

    flat = touch(tmp_path / "trained_models" / "net_wall_added_1.pth")
    touch(tmp_path / "trained_models" / "pillar_added" / "net_pillar_added_clean_and_occluded.pth")
    best = touch(
        tmp_path / "trained_models" / "pillar_added" / "net_pillar_added_clean_and_occluded_no_augmented_no_xyz.pth"
    )
    assert thesis.find_weights(tmp_path) == {"pillar_added": best, "wall_added": flat}
    assert thesis.find_weights(tmp_path / "trained_models") == {"pillar_added": best, "wall_added": flat}
    touch(tmp_path / "trained_models" / "net_wall_added_2.pth")
    refused(
        lambda: thesis.find_weights(tmp_path),
        "one network for wall_added",
        "net_wall_added_1.pth, net_wall_added_2.pth",
    )


@pytest.fixture(scope="module")
def pairs(data_root):
    return thesis.find_pairs(data_root / "thesis")


def test_every_released_test_pair_is_found(data_root, pairs):
    found = {(pair.source, pair.scenario, pair.condition) for pair in pairs}
    synthetic = {("synthetic", scenario, condition) for scenario in thesis.SCENARIOS for condition in (CLEAN, OCCLUDED)}
    atlas = {("atlas", scenario, CLEAN) for scenario in thesis.SCENARIOS}
    assert found >= synthetic | atlas
    here = [pair for pair in pairs if (pair.source, pair.scenario, pair.condition) in synthetic | atlas]
    assert all(pair.elements is not None for pair in here)
    for pair in thesis.find_pairs(data_root / "thesis", "train"):
        assert not pair.room.startswith("room_test")
        thesis.read_pair(pair)


def rounded(row):
    return tuple(round(row[name], 4) for name in ("roc_auc", "fpr_at_95", "precision_at_95"))


def test_raw_distance_gives_the_known_figures(pairs):
    rows = {}
    for pair in pairs:
        if pair.room == "room_test_1":
            rows[pair.source, pair.scenario, pair.condition] = thesis.score_pair(pair, thesis.nn_raw)
    for key, (expected, _) in REMOVED.items():
        assert rounded(rows[key]) == expected, key
    for key, row in rows.items():
        if key[1].endswith("added"):
            assert rounded(row) == PERFECT, key
    pillar = rows["synthetic", "pillar_added", CLEAN]
    assert pillar["positives"] == 435 and round(pillar["iou_at_95"], 4) == 0.9517
    assert pillar["thesis_iou_at_95"] == 413 / 435
    wall = rows["synthetic", "wall_removed", OCCLUDED]
    assert round(wall["thesis_fpr_at_95"], 4) == 0.1254


def forward(weights, distance):
    """The released network in plain float64 arrays, as the weights themselves define it."""
    state = {name: value.astype(np.float64) for name, value in weights.items()}

    def layer(x, conv, norm):
        x = x @ state[f"{conv}.weight"][:, :, 0].T + state[f"{conv}.bias"]
        x = (x - state[f"{norm}.running_mean"]) / np.sqrt(state[f"{norm}.running_var"] + 1e-5)
        return np.maximum(x * state[f"{norm}.weight"] + state[f"{norm}.bias"], 0)

    x = distance[:, None].astype(np.float64)
    for index in range(1, 5):
        x = layer(x, f"conv{index}", f"bn{index}")
    x = np.concatenate([x, np.broadcast_to(x.max(axis=0), x.shape)], axis=1)
    for index in range(1, 3):
        x = layer(x, f"seg_conv{index}", f"seg_bn{index}")
    return (x @ state["seg_conv3.weight"][:, :, 0].T + state["seg_conv3.bias"])[:, 0]


@pytest.mark.parametrize("key", [*REMOVED, *ADDED])
def test_released_networks_give_the_known_figures(data_root, pairs, key):
    pair = next(
        pair for pair in pairs if (pair.source, pair.scenario, pair.condition) == key and pair.room == "room_test_1"
    )
    weights = read_state_dict(thesis.find_weights(data_root / "thesis")[pair.scenario])
    row = thesis.score_pair(pair, lambda scan: forward(weights, scan.distance))
    assert rounded(row) == (REMOVED | ADDED)[key][1]
