"""Boxes on the thesis's released scans, by its distances and its settings."""

import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

from jaxmm.learning.box_match import box_overlap, match_boxes
from jaxmm.learning.boxes import Box, fit_boxes


def changed_cloud(folder, side):
    """One released clean pair: the scored scan and which of its points are over 0.09 m from the other scan."""
    other = {"robot": "dt", "dt": "robot"}[side]
    (path,) = sorted(folder.glob(f"room_test_1_clean_{side}_scan*.npy"))
    points, reference = np.load(path), np.load(path.with_name(path.name.replace(f"{side}_scan", f"{other}_scan")))
    return points, (cKDTree(reference).query(points)[0] > 0.09).astype(float)


SIDE = {"pillar_added": "robot", "wall_added": "robot", "pillar_removed": "dt", "wall_removed": "dt"}


@pytest.mark.parametrize("scenario", SIDE)
def test_released_test_room_gives_one_box_around_the_labelled_points(data_root, scenario):
    (folder,) = (data_root / "thesis" / "datasets" / f"dataset_{scenario}" / "clean_and_occluded").glob("npy_files*")
    points, changed = changed_cloud(folder, SIDE[scenario])
    object_type = scenario.split("_")[0]
    (box,) = fit_boxes(points, changed, object_type)
    (labels,) = folder.parent.glob(f"labels*/room_test_1_clean_{SIDE[scenario]}_scan*.npy")
    labelled = points[np.load(labels).astype(bool).ravel()]
    inside = np.all(np.abs(labelled - box.center) <= box.dimensions / 2 + 0.02, axis=1)
    assert np.mean(inside) > 0.99
    assert box.dimensions[2] == pytest.approx(3.0, abs=1e-3)
    assert box.shape == ("round" if scenario == "pillar_added" else "rectangular")


@pytest.mark.parametrize("scenario", SIDE)
def test_atlas_boxes_against_the_true_ones(data_root, scenario):
    clean = data_root / "thesis" / "datasets" / "dataset_real_world" / scenario / "clean"
    (folder,) = clean.glob("npy_files*")
    object_type = scenario.split("_")[0]
    (box,) = fit_boxes(*changed_cloud(folder, SIDE[scenario]), object_type)
    (file,) = (clean / "bounding_boxes").glob("*.json")
    (record,) = json.loads(file.read_text())["objects"]
    truth = Box(object_type, np.array(record["center"]), np.array(record["dimensions"]), record["rotation"])
    if object_type == "pillar":
        assert len(match_boxes([box], [truth])) == 1
        assert box_overlap(box, truth) > 0.75
    else:
        # The added wall is seen 6 m high of 8 m, the removed one 2 m long of 3.5 m and not to its full height; with a
        # thickness of 0.15 m neither box reaches the true one by the match rule, though both stand at its place.
        assert match_boxes([box], [truth]) == []
        assert 0.1 < box_overlap(box, truth) < 0.25
        assert np.linalg.norm(box.center[:2] - truth.center[:2]) < 0.65
