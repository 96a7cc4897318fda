"""Predictions as NPZ and as CSV: the same either way, and one line for whatever is wrong."""

import csv

import numpy as np
import pytest

from jaxmm.exchange.predictions import COLUMNS, read_prediction
from jaxmm.inputs import InputError

COUNTS = {"scan": 4, "reference": 3, "elements": 2}
GOOD = {
    "scan": np.array([0.1, 0.2, 0.3, 7.0]), "reference": np.array([1.0, 0.0, -5.0]),
    "elements": np.array([0.5, np.nan]),
    "objects": np.array([[2, 1.0, 2.0, 3.0, 4.0, 0.2, 3.0, 30.0, 0.75]]),
}  # fmt: skip


def write_csv(path, arrays):
    with open(path, "w", newline="") as file:
        rows = csv.DictWriter(file, COLUMNS)
        rows.writeheader()
        for kind, column in (("scan", "scan"), ("reference", "reference"), ("element", "elements")):
            for index, value in enumerate(arrays[column]):
                rows.writerow({"kind": kind, "index": index, "score": "" if np.isnan(value) else value})
        for row in arrays["objects"]:
            rows.writerow({"kind": "object", **dict(zip((*COLUMNS[3:], "score"), row, strict=True))})


@pytest.mark.parametrize("ending", ["npz", "csv"])
def test_both_kinds_of_files_say_the_same(tmp_path, ending):
    if ending == "npz":
        np.savez(tmp_path / "000004.npz", **GOOD)
    else:
        write_csv(tmp_path / "000004.csv", GOOD)
    said = read_prediction(tmp_path, "000004", COUNTS)
    for column in ("scan", "reference", "elements"):
        np.testing.assert_array_equal(getattr(said, column), GOOD[column])
    ((change, box),) = said.objects
    assert (change, box.object_type, box.rotation, box.probability) == ("added", "wall", 30.0, 0.75)
    np.testing.assert_array_equal([*box.center, *box.dimensions], GOOD["objects"][0, 1:7])


@pytest.mark.parametrize(
    "column, values, word",
    [
        ("scan", np.zeros(5), "expected 4 numbers, got 5"), ("scan", np.array([0, 1, np.nan, 0]), "finite"),
        ("scan", np.array(["a"] * 4), "real numbers"), ("reference", np.zeros((3, 1)), "expected 3 numbers"),
        ("reference", np.full(3, np.inf), "finite"), ("elements", np.array([0.5, 1.5]), "0 to 1"),
        ("elements", np.zeros(9), "expected 2 numbers, got 9"), ("objects", np.zeros((2, 8)), r"\(K, 9\)"),
        ("objects", np.zeros((1, 9)), "labels 1 to 4, got 0"), ("objects", np.ones((1, 9)) * 5, "labels 1 to 4"),
        ("objects", np.ones((1, 9)) * -1, "labels"), ("scan", np.zeros(4000), "column scan: expected 4"),
        ("elements", np.array([None, None]), "plain numbers"), ("objects", np.ones((1, 9)) * np.nan, "labels"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_line_with_scene_and_column(tmp_path, column, values, word):
    np.savez(tmp_path / "000004.npz", **(GOOD | {column: values}))
    with pytest.raises(InputError, match=word) as error:
        read_prediction(tmp_path, "000004", COUNTS)
    assert "\n" not in str(error.value) and "scene 000004" in str(error.value)
    assert f"column {column}" in str(error.value) or "plain numbers" in str(error.value)


@pytest.mark.parametrize(
    "text, word",
    [
        ("", "column kind"), ("kind,index\nscan,0\n", "column score"), ("kind,index,score\nscan,4,1\n", "column index"),
        ("kind,index,score\nscan,0,1\nscan,0,1\n", "column index"), ("kind,index,score\nscan,0,much\n", "column score"),
        ("kind,index,score\nscan,0,\n", "column score"), ("kind,index,score\nscan,0,nan\n", "column score"),
        ("kind,index,score\nscan,0.5,1\n", "column index"), ("kind,index,score\npoint,0,1\n", "column kind"),
        ("kind,index,score\nscan,0,1\n", "column scan: expected 4 rows, 3"),
        ("kind,index,score\nscan,0\n", "column score"),
        ("kind,index,score\nelement,1,2\nelement,0,1", "column elements"),
        ("kind,index,score,label,x\nobject,,0.5,1,2\n", "column y"), ("kind,index,score,score\n", "column score"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_csv_is_one_line_with_scene_and_column(tmp_path, text, word):
    (tmp_path / "000004.csv").write_text(text)
    with pytest.raises(InputError, match=word) as error:
        read_prediction(tmp_path, "000004", COUNTS)
    assert "\n" not in str(error.value) and "scene 000004" in str(error.value)


def test_damaged_files_and_files_of_code_are_refused(tmp_path):
    np.savez(tmp_path / "000004.npz", **GOOD)
    whole = (tmp_path / "000004.npz").read_bytes()
    for cut in range(0, len(whole), 97):
        (tmp_path / "000004.npz").write_bytes(whole[:cut])
        with pytest.raises(InputError, match="scene 000004"):
            read_prediction(tmp_path, "000004", COUNTS)
    with pytest.raises(InputError, match=r"scene 000005: expected 000005\.npz or 000005\.csv"):
        read_prediction(tmp_path, "000005", COUNTS)
    (tmp_path / "000004.npz").unlink()
    (tmp_path / "000004.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="CSV"):
        read_prediction(tmp_path, "000004", COUNTS)
