"""The whole paper at its smallest: every stage and table, nothing made twice, and a stop anywhere changes no bit."""

import dataclasses
import json
import shutil

import pytest

from jaxmm import run_folder
from jaxmm.config import SCENARIOS
from jaxmm.data.simulator_settings import load_config
from jaxmm.inputs import InputError
from jaxmm.learning import fit
from jaxmm.runs.paper import models as paper_models
from jaxmm.runs.paper import rows as paper_rows
from jaxmm.runs.paper import scores, tables
from jaxmm.runs.paper.models import clouds_stage, load_networks, models_stage
from jaxmm.runs.paper.rows import needed_models, sets_of
from jaxmm.runs.paper.scores import default_judges, set_stage
from jaxmm.runs.paper.whole_run import reproduce_paper
from jaxmm.runs.stages import key_of
from jaxmm.versions import versions

pytestmark = pytest.mark.long

TABLES = ("table_1", "label_noise", "studies")
FEW = ("Wall Added", "Removed NN-Distance", "Objects Added")  # a row of each section


@pytest.fixture(scope="module")
def few_rows():
    """Some rows of every section, for each further set costs a second."""
    rows = tuple(
        row for row in paper_rows.TABLE_1 if row.scenes.condition == "occluded" and row.test_case in FEW
    )  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        for module in (paper_rows, tables):
            patch.setattr(module, "TABLE_1", rows)
        patch.delenv("JAXMM_DATA", raising=False)
        told = versions()  # as of now, whoever edits a source while this runs
        patch.setattr("jaxmm.runs.stages.versions", lambda: told)
        yield rows


@pytest.fixture(scope="module")
def config(few_rows, request):
    smoke = load_config(request.config.rootpath / "configs" / "paper_smoke.toml")
    paper = dataclasses.replace(smoke.paper, range_noise=(), misalignment=())
    return dataclasses.replace(smoke, data=dataclasses.replace(smoke.data, test_rooms=1), paper=paper)


@pytest.fixture(scope="module")
def finished(config, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "paper"
    reproduce_paper(config, folder)
    return folder


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and "checkpoints" not in path.parts and path.name not in (".lock", "versions.json")
    }


def test_the_run_folder_holds_what_is_documented(finished, few_rows):
    names = {path.name for path in finished.iterdir()}
    assert names == {".lock", "config.toml", "versions.json", "stages"} | {
        f"{name}.{kind}" for name in TABLES for kind in ("json", "csv", "md")
    }
    rows = json.loads((finished / "table_1.json").read_text())["rows"]
    assert len(rows) == len(few_rows) * 4 * 2
    assert {path.name for path in (finished / "stages" / "rooms").iterdir()} == {scenes.name for scenes in sets_of()}
    for path in finished.rglob("stage.json"):
        assert {"settings", "key", "code", "versions"} <= set(json.loads(path.read_text())), path
    networks = load_networks(finished)
    assert set(networks) == {f"{training}/{scenario}" for training, scenario in needed_models()}
    entries = json.loads((finished / "stages" / "models" / "entries.json").read_text())
    assert set(entries) == set(networks) and len(entries) == len(networks)
    widths = {name: model.params["conv1"]["kernel"].shape[0] for name, model in networks.items()}
    again = load_networks(finished, "models_1")  # the second seed
    assert set(again) == set(networks)
    kernels = [found["nn/pillar_removed"].params["conv1"]["kernel"] for found in (networks, again)]
    assert (kernels[0] != kernels[1]).any()
    told = {row["method"]: row["trainings"] for row in rows if row["test_case"] == "Wall Added"}
    assert told["xyz_nn"]["count"] == 2 and told["rule"] is None and told["evidence"]["count"] == 2
    assert widths["nn/pillar_removed"] == 1 and widths["xyz/pillar_removed"] == 3
    studies = json.loads((finished / "studies.json").read_text())["rows"]
    assert {row["study"] for row in studies} == {"furniture", "training rooms"}
    assert {row["level"] for row in studies if row["method"] == "evidence"} == {8, 1, 2}


def test_several_changes_are_asked_of_all_four_models_and_one_of_its_own(finished):
    def sides(name):
        rooms = json.loads((finished / "stages" / "rooms" / name / "rooms.json").read_text())
        return [set(room["sides"]) for room in rooms]

    assert sides("pillar_and_wall_added_occluded") == [set(SCENARIOS)]
    assert sides("wall_added_occluded") == [{"wall_added"}]


def test_the_same_command_again_makes_nothing_anew(finished, config, monkeypatch):
    def refuse(*_):
        raise AssertionError("made again")

    before, times = contents(finished), {path: path.stat().st_mtime_ns for path in finished.rglob("stages/**/*")}
    for module, name in ((fit, "train_step_all"), (scores, "score_room"), (paper_models, "training_clouds")):
        monkeypatch.setattr(module, name, refuse)
    reproduce_paper(config, finished)
    assert contents(finished) == before
    assert {path: path.stat().st_mtime_ns for path in finished.rglob("stages/**/*")} == times
    # What only the tables use makes only the tables anew.
    other = dataclasses.replace(config, evaluate=dataclasses.replace(config.evaluate, resamples=150))
    reproduce_paper(other, finished)
    after = contents(finished)
    assert {name for name in after if after[name] != before[name]} <= {"config.toml"} | {
        f"{name}.{kind}" for name in TABLES for kind in ("json", "csv", "md")
    }
    reproduce_paper(config, finished)
    assert contents(finished) == before


def test_each_setting_makes_anew_what_depends_on_it_and_nothing_else(config):
    scenes, rows = next(iter(sets_of().items()))

    def keys(config):
        models = key_of(models_stage(config))
        return key_of(clouds_stage(config)), models, key_of(set_stage(config, scenes, rows, models))

    def changed(**sections):
        other = {name: dataclasses.replace(getattr(config, name), **values) for name, values in sections.items()}
        both = zip(keys(config), keys(dataclasses.replace(config, **other)), strict=True)
        return [before != after for before, after in both]

    assert changed(train={"step_count": 5}) == [False, True, True]
    assert changed(data={"train_rooms": 3}) == [True, True, True]
    assert changed(data={"test_rooms": 3}) == [False, False, True]
    assert changed(evaluate={"threshold": 0.7}) == [False, False, True]
    assert changed(evaluate={"resamples": 999}) == [False, False, False]
    assert changed(paper={"multi_rooms": 9}) == [False, False, False]  # this set has one change a room
    assert changed(preprocess={"voxel_size": 0.2}) == [True, True, True]


def test_a_stop_in_the_middle_changes_no_bit(finished, config, tmp_path, monkeypatch):
    """Of training, between two checkpoints, and of scoring, between two rooms and within a file that is written."""
    folder = tmp_path / "paper"
    shutil.copytree(finished, folder)
    for name in (
        "rooms/wall_added_occluded/rooms.json",
        "sweeps/furniture_8/wall_added.json",
        "models/models.safetensors",
    ):
        (folder / "stages" / name).unlink()
    shutil.rmtree(folder / "stages" / "models" / "checkpoints")
    (folder / "table_1.json").unlink()
    for module, name, after in (
        (fit, "train_step_all", 3),
        (scores, "score_room", 1),
        (scores, "score_room", 2),
    ):
        with monkeypatch.context() as patch:
            _stop_after(patch, module, name, after)
            with pytest.raises(KeyboardInterrupt):
                reproduce_paper(config, folder)
    reproduce_paper(config, folder)
    expected, found = contents(finished), contents(folder)
    assert found.keys() == expected.keys()
    assert [name for name in expected if found[name] != expected[name]] == []


def _stop_after(patch, module, name, count):
    calls, original = [], getattr(module, name)

    def stopping(*arguments, **more):
        calls.append(name)
        if len(calls) >= count:
            raise KeyboardInterrupt
        return original(*arguments, **more)

    patch.setattr(module, name, stopping)


def test_seeds_of_the_shipped_models_are_kept_off_the_test_rooms(config):
    with pytest.raises(InputError, match="test_seed: 1 is the training seed"):
        seeds = {"train_seed": 5, "validation_seed": 6, "test_seed": 1}
        default_judges(dataclasses.replace(config, data=dataclasses.replace(config.data, **seeds)), {})


def test_overlapping_seeds_are_one_line(tmp_path, refused):
    path = tmp_path / "paper.toml"
    path.write_text('[data]\ntest_seed = 2\n[preprocess]\nevidence = "exact"\n[paper]\nrows = "all"\n')
    refused(["reproduce", path, "--out", tmp_path / "run"], "seeds must differ", "(1, 2, 2)")
    assert not (tmp_path / "run").exists()


def test_damaged_models_are_told_in_one_line(finished, config, tmp_path):
    folder = tmp_path / "paper"
    shutil.copytree(finished, folder)
    path = folder / "stages" / "models" / run_folder.MODELS
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match=r"models\.safetensors: expected whole models"):
        reproduce_paper(config, folder)


def test_a_run_of_another_kind_is_refused(finished, request, refused):
    config = request.config.rootpath / "configs" / "smoke.toml"
    before = {path: path.stat().st_mtime_ns for path in finished.rglob("*") if path.name != ".lock"}
    refused(["reproduce", config, "--out", finished], "other settings")
    assert before == {path: path.stat().st_mtime_ns for path in finished.rglob("*") if path.name != ".lock"}
