"""Stages are made anew when what matters to them is another, and only then."""

import datetime
import json
import shutil

import pytest

from jaxmm.inputs import InputError
from jaxmm.runs import stages
from jaxmm.runs.stages import Stage, code_of, key_of, open_stage, stage_folder

STAGE = Stage("models", {"steps": 3}, ("jaxmm.learning.train_step",))


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A copy of the sources that a test may change."""
    for package in stages.PACKAGES:
        target = tmp_path / "tree" / package
        shutil.copytree(stages.TREE / package, target, ignore=shutil.ignore_patterns("__pycache__", "weights"))
    monkeypatch.setattr(stages, "TREE", tmp_path / "tree")
    code_of.cache_clear()
    yield tmp_path / "tree"
    code_of.cache_clear()


def changed(path, text, stage=STAGE):
    before = key_of(stage)
    path.write_text(path.read_text() + text)
    code_of.cache_clear()
    return key_of(stage) != before


@pytest.mark.parametrize("name", ["train_step", "network", "fused_layers", "losses"])
def test_code_that_a_stage_runs_matters(tree, name):
    assert changed(tree / "jaxmm" / "learning" / f"{name}.py", "\nANOTHER = 1\n")


@pytest.mark.parametrize(
    "name",
    [
        "reports/figures", "reports/room_figures", "learning/result_tables", "learning/room_scores", "learning/boxes",
        "learning/__init__", "commands/cli", "runs/main_job", "run_folder", "versions",
    ],
)  # fmt: skip
def test_code_that_it_does_not_run_does_not(tree, name):
    assert not changed(tree / "jaxmm" / f"{name}.py", "\nANOTHER = 1\n")


def test_prose_does_not_matter(tree):
    path = tree / "jaxmm" / "learning" / "network.py"
    text = path.read_text()
    before = key_of(STAGE)
    assert '"""' in text
    first = text.index('"""') + 3
    path.write_text(text[:first] + "Other words. " + text[first:] + "\n# A remark.\n")
    code_of.cache_clear()
    assert key_of(STAGE) == before
    path.write_text(path.read_text().replace("1 / math.sqrt(fan_in)", "2 / math.sqrt(fan_in)"))
    code_of.cache_clear()
    assert key_of(STAGE) != before


def test_modules_apart_do_not_matter_nor_does_what_only_they_import(tree):
    stage = STAGE._replace(modules=("jaxmm.learning.room_scores",), apart=("jaxmm.learning.result_tables",))
    assert not changed(tree / "jaxmm" / "learning" / "result_tables.py", "\nANOTHER = 1\n", stage)
    assert changed(
        tree / "jaxmm" / "learning" / "metrics.py", "\nANOTHER = 1\n", stage
    )  # room_scores imports it itself


@pytest.mark.parametrize(
    "other", [{"settings": {"steps": 4}}, {"inputs": ("x",)}, {"modules": ("jaxmm.learning.metrics",)}]
)
def test_settings_inputs_and_modules_make_the_key(other):
    assert key_of(STAGE._replace(**other)) != key_of(STAGE)
    assert key_of(STAGE._replace(name="elsewhere")) == key_of(STAGE)


def test_an_unknown_module_is_refused():
    with pytest.raises(ValueError, match=r"jaxmm\.nothing"):
        code_of(("jaxmm.nothing",))


def test_a_folder_stays_with_its_key_and_is_emptied_with_another(tmp_path):
    folder = open_stage(tmp_path, STAGE)
    (folder / "result").write_text("kept")
    assert open_stage(tmp_path, STAGE) == folder == stage_folder(tmp_path, "models")
    assert (folder / "result").read_text() == "kept"
    told = json.loads((folder / "stage.json").read_text())
    assert told["settings"] == {"steps": 3} and told["key"] == key_of(STAGE) and "git_commit" in told["versions"]
    assert abs(datetime.date.fromisoformat(told["date"]) - datetime.datetime.now(datetime.UTC).date()).days <= 1
    assert open_stage(tmp_path, STAGE._replace(settings={"steps": 4})) == folder
    assert [path.name for path in folder.iterdir()] == ["stage.json"]


@pytest.mark.parametrize("damage", [lambda path: path.unlink(), lambda path: path.write_text("{"[:1])])
def test_a_folder_without_its_key_is_begun_anew(tmp_path, damage):
    folder = open_stage(tmp_path, STAGE)
    (folder / "result").write_text("whose?")
    damage(folder / "stage.json")
    open_stage(tmp_path, STAGE)
    assert not (folder / "result").exists()


def test_a_stage_that_is_not_there_is_told_in_one_line(tmp_path):
    with pytest.raises(InputError, match="the stage models"):
        stage_folder(tmp_path, "models")
