"""`jaxmm benchmark`: the method on the page runs from what the page says, and is scored; mistakes are one line."""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from jaxmm.commands import cli
from tests.test_docs import ROOT, blocks

PAGE = ROOT / "docs" / "benchmark-data.md"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Where the page's commands and its method were run."""
    pytest.importorskip("ifcopenshell")
    place = tmp_path_factory.mktemp("benchmark")
    (place / "settings.toml").write_text('sensors = ["velodyne-16"]')
    words = ["--count", "10", "--workers", "1", "--settings", place / "settings.toml"]
    assert cli.main(["benchmark", "export", str(place / "scenes"), *map(str, words)]) == 0
    (code,) = blocks(PAGE, "python")
    assert "jaxmm" not in code
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run([sys.executable, "-c", code], cwd=place, env=env, check=True)
    return place


def test_the_method_of_the_page_is_scored_by_the_command_of_the_page(place, monkeypatch, capsys):
    (command,) = [line for text in blocks(PAGE, "") for line in text.splitlines() if " score " in line]
    monkeypatch.chdir(place)
    assert cli.main([*command.split()[1:], "--out", "scores.json"]) == 0
    out = capsys.readouterr().out
    told = json.loads((place / "scores.json").read_text())
    assert "| points added |" in out and "| elements |" in out and "| objects |" not in out
    values = {(row["part"], row["metric"]): row["value"] for row in told["rows"] if row["difficulty"] == "all"}
    assert values["points added", "roc_auc"] > 0.9 and told["scenes"] == 2


def test_scores_of_the_test_split_need_its_truth(place, said, monkeypatch, tmp_path):
    monkeypatch.chdir(place)
    shutil.copytree(place / "predictions", tmp_path / "predictions")
    for name in ("000004", "000009"):
        counts = json.loads((place / "scenes" / "test" / name / "scene.json").read_text())["points"]
        np.savez(tmp_path / "predictions" / name, scan=np.zeros(counts["scan"]))
    assert said("benchmark", "score", "scenes", tmp_path / "predictions") == (0, [])
    shutil.move(place / "scenes-test-truth.npz", tmp_path / "kept.npz")
    code, lines = said("benchmark", "score", "scenes", tmp_path / "predictions")
    assert code == 2 and len(lines) == 1 and "--truth" in lines[0]
    assert said("benchmark", "score", "scenes", tmp_path / "predictions", "--truth", tmp_path / "kept.npz") == (0, [])


def test_missing_and_ill_formed_predictions_name_scene_and_column(place, refused, tmp_path):
    shutil.copytree(place / "predictions", tmp_path / "predictions")
    words = ["benchmark", "score", place / "scenes", tmp_path / "predictions", "--split", "validation"]
    with np.load(tmp_path / "predictions" / "000003.npz") as whole:
        arrays = dict(whole)
    np.savez(tmp_path / "predictions" / "000003", **(arrays | {"reference": arrays["reference"][:-1]}))
    refused(words, "scene 000003", "column reference")
    (tmp_path / "predictions" / "000003.npz").unlink()
    refused(words, "scene 000003", "found neither")
    refused(["benchmark", "score", tmp_path, tmp_path / "predictions"], "expected a folder of jaxmm benchmark export")
    refused(["benchmark", "score", place / "scenes", tmp_path / "none"], "expected a folder of predictions")
    refused(["benchmark", "export", tmp_path / "new", "--count", "0"], "--count")
    refused(["benchmark", "export", tmp_path / "new", "--settings", tmp_path / "none.toml"], "none.toml")
    assert not (tmp_path / "new").exists()


def test_a_split_that_is_not_there_or_not_meant_names_the_one_that_is(place, refused, tmp_path):
    refused(
        ["benchmark", "score", place / "scenes", place / "predictions"],
        "found those for validation: say --split validation",
    )
    shutil.copytree(place / "scenes", tmp_path / "scenes")
    shutil.rmtree(tmp_path / "scenes" / "test")
    before = sorted(path for folder in (tmp_path, place) for path in folder.rglob("*"))
    refused(
        ["benchmark", "score", tmp_path / "scenes", place / "predictions"],
        "scenes of the split test, found none; --split train has 6, --split validation has 2",
    )
    assert sorted(path for folder in (tmp_path, place) for path in folder.rglob("*")) == before


def test_both_steps_have_help_with_an_example_that_parses(capsys):
    for step in ("export", "score"):
        with pytest.raises(SystemExit) as end:
            cli.main(["benchmark", step, "--help"])
        example = " ".join(capsys.readouterr().out.split()).partition("example: jaxmm ")[2]
        assert end.value.code == 0 and cli._parser().parse_args(example.split()).step == step
