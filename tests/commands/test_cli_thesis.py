"""`jaxmm thesis` on a whole, a damaged and a hostile repository."""

import json
import os
import pickle
import zipfile

import numpy as np
import pytest

from jaxmm.commands import cli


@pytest.fixture
def repository(tmp_path):
    """The thesis's layout with one pair: 40 points, of which the last 10 are gone from the robot scan."""
    points = np.random.default_rng(0).uniform(-1, 1, (40, 3)).astype(np.float32)
    points[30:] += 3
    folder = tmp_path / "thesis" / "datasets" / "dataset_pillar_removed"
    scans, labels = (folder / "clean_and_occluded" / name for name in ("npy_files_x", "labels_x"))
    tables = folder / "clean" / "preprocessed_csv_files"
    for place in (scans, labels, tables):
        place.mkdir(parents=True)
    name = "room_test_1_clean_dt_scan_x"
    np.save(scans / f"{name}.npy", points)
    np.save(scans / "room_test_1_clean_robot_scan_x.npy", points[:30])
    np.save(labels / f"{name}_labels.npy", (np.arange(40) >= 30).astype(np.float32))
    rows = [f"{x};{y};{z};{int(i >= 30)}" for i, (x, y, z) in enumerate(points)]
    (tables / f"{name}.csv").write_text("\n".join(["X;Y;Z;categoryID", *rows]))
    return tmp_path / "thesis"


def scan_file(repository, pattern="*dt_scan_x.npy"):
    (path,) = repository.rglob(pattern)
    return path


def thesis(repository, method="nn-raw", *more):
    return ["thesis", repository, "--method", method, "--out", repository.parent / "out.json", *more]


def test_thesis_scores_a_whole_repository(repository, capsys):
    assert cli.main(list(map(str, thesis(repository)))) == 0
    out, err = capsys.readouterr()
    (row,) = json.loads((repository.parent / "out.json").read_text())["rows"]
    assert row["roc_auc"] == 1 and row["positives"] == 10 and row["by_element"]["roc_auc"] == 1
    assert err == "" and "pillar_removed room_test_1 clean: AUC 1.0000" in out
    assert "; labels by element: AUC 1.0000, FPR@95 0.0000" in out


def truncated(path):
    path.write_bytes(path.read_bytes()[:-5])


def with_array(array):
    return lambda path: np.save(path, array)


POINTS = np.ones((40, 3), np.float32)


@pytest.mark.parametrize(
    "pattern, damage, words",
    [
        pytest.param("*dt_scan_x.npy", truncated, [".npy"], id="truncated scan"),
        pytest.param("*dt_scan_x.npy", lambda path: path.write_bytes(b""), [".npy"], id="scan of no bytes"),
        pytest.param("*dt_scan_x.npy", with_array(POINTS.astype(object)), ["bject"], id="scan of objects"),
        pytest.param("*dt_scan_x.npy", with_array(POINTS[:, :2]), ["(N, 3)", "(40, 2)"], id="flat scan"),
        pytest.param("*dt_scan_x.npy", with_array(POINTS[:0]), ["at least one point"], id="empty scan"),
        pytest.param("*dt_scan_x.npy", with_array(POINTS * np.nan), ["finite", "NaN"], id="scan of NaN"),
        pytest.param("*robot_scan_x.npy", with_array(POINTS * np.inf), ["finite"], id="partner of infinities"),
        pytest.param("*robot_scan_x.npy", os.unlink, ["expected its partner"], id="no partner"),
        pytest.param("*_labels.npy", os.unlink, ["labels"], id="no labels"),
        pytest.param("*_labels.npy", truncated, [".npy"], id="truncated labels"),
        pytest.param("*_labels.npy", with_array(np.ones(39)), ["40 labels", "(39,)"], id="too few labels"),
        pytest.param("*_labels.npy", with_array(np.full(40, 2)), ["0 and 1"], id="labels of 2"),
        pytest.param("*_labels.npy", with_array(np.full(40, np.nan)), ["0 and 1"], id="labels of NaN"),
        pytest.param("*.csv", lambda path: path.write_text("X;Y;Z\n1;2;3"), ["categoryID"], id="csv without ids"),
        pytest.param("*.csv", truncated, [], id="truncated csv"),
        pytest.param("*.csv", lambda path: path.write_text(""), ["columns"], id="empty csv"),
        pytest.param("*.csv", lambda path: path.write_text("X;Y;Z;categoryID\n0;nan;0;1"), ["finite"], id="csv of NaN"),
    ],
)
def test_damaged_scans_are_refused_and_nothing_is_written(repository, pattern, damage, words, refused):
    path = scan_file(repository, pattern)
    damage(path)
    refused(thesis(repository), path.stem.split("_scan_")[0], *words)
    assert not (repository.parent / "out.json").exists()


def released(repository, content):
    """Write a .pth of our own making: torch's archive around any pickle."""
    path = repository / "trained_models" / "pillar_removed" / "net.pth"
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, bytes):
        path.write_bytes(content)
        return path
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("net/data.pkl", pickle.dumps(content, protocol=2))
        archive.writestr("net/byteorder", "little")
    return path


class Command:
    def __reduce__(self):
        return os.mkdir, ("tricked",)


@pytest.mark.parametrize(
    "content, word",
    [
        pytest.param({"conv1.weight": Command()}, "mkdir", id="a command to run"),
        pytest.param({"conv1.weight": [1, 2]}, "tensors", id="a list"),
        pytest.param(Command(), "mkdir", id="no dict"),
        pytest.param({"epoch": 3}, "tensors", id="a number"),
        pytest.param(b"not a zip at all", "torch.save", id="no archive"),
        pytest.param(b"", "torch.save", id="no bytes"),
    ],
)
def test_weights_that_hold_anything_but_tensors_are_refused(repository, content, word, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = released(repository, content)
    refused(thesis(repository, "released"), path, word)
    assert not (repository.parent / "out.json").exists() and not os.path.exists("tricked")


def test_truncated_released_weights_are_refused(repository, data_root, refused):
    (original,) = (data_root / "thesis" / "trained_models" / "pillar_removed").glob("*.pth")
    whole = original.read_bytes()
    for length in (len(whole) // 2, len(whole) - 1):
        path = released(repository, whole[:length])
        refused(thesis(repository, "released"), path, "torch.save")
        assert not (repository.parent / "out.json").exists()


def test_options_of_thesis_that_do_not_fit_are_refused(repository, finished_run, tmp_path, refused):
    refused(thesis(repository, "nn"), "--model", "expected a run folder")
    assert not (repository.parent / "out.json").exists()
    refused(thesis(repository, "nn-raw", "--model", finished_run), "--model", "nn-raw")
    refused(thesis(repository, "nn", "--weights", tmp_path), "--weights", "released")
    refused(thesis(repository, "released", "--model", finished_run), "--model")
    refused(thesis(repository, "nn", "--model", tmp_path), tmp_path, "run folder")
    refused(thesis(repository, "nn", "--model", tmp_path / "x.safetensors"), "x.safetensors", "no file")
    refused(thesis(repository, "released"), "trained_models", "found none")
    refused(thesis(tmp_path / "none"), "datasets", "found none")
    missing = ["thesis", repository, "--method", "nn-raw", "--out"]
    refused([*missing, tmp_path / "none" / "out.json"], "--out", tmp_path / "none" / "out.json")
    refused([*missing, tmp_path], "--out", tmp_path)
    assert not (tmp_path / "none").exists()
