"""Exported scenes: plain, whole, true, and the same however they came about."""

import json
import shutil

import numpy as np
import pytest

from jaxmm.exchange.export import Request, export, truth_path
from jaxmm.exchange.scene_files import read_scene, read_truth, scene_names
from jaxmm.exchange.scenes import LABELS, SAME, UNOBSERVABLE
from jaxmm.exchange.tasks import SPLITS, TEST, ExportSettings, task_of
from jaxmm.inputs import InputError
from jaxmm.learning.boxes import Box
from jaxmm.verdicts.mismatch_points import inside
from jaxmm.verdicts.priors import read_prior
from tests.exchange.conftest import SETTINGS
from warp_scanner.sensors.triangles import clearance


def files_of(folder):
    """Content by path, but for the lock."""
    paths = [path for path in folder.rglob("*") if path.is_file() and path.name != ".lock"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def scenes_of(folder, truth=None):
    for split in SPLITS:
        names = scene_names(folder, split)
        known = read_truth(folder, split, names, truth or truth_path(folder))
        for name in names:
            yield task_of(SETTINGS, int(name)), read_scene(folder, split, name), known[name]


def test_the_test_split_comes_without_its_truth(exported):
    assert not list((exported / TEST).rglob("truth*")) and truth_path(exported).parent == exported.parent
    assert all((path / "truth.npz").is_file() for path in (exported / "train").iterdir())
    assert all("pillar_" not in path.read_text() for path in (exported / TEST).rglob("scene.json"))


def test_what_is_told_of_a_scene_is_as_the_schema_has_it(exported):
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((exported / "schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    for path in exported.rglob("scene.json"):
        about = json.loads(path.read_text(), parse_constant=pytest.fail)
        jsonschema.validate(about, schema)
        assert path.parts[-2] == about["name"] and path.parts[-3] == about["split"]


def test_the_model_that_is_given_is_what_its_scan_shows(exported):
    for _, scene, _ in list(scenes_of(exported))[::4]:
        prior = read_prior(scene.model)
        apart = clearance(prior.scene, (scene.reference - prior.origin).astype(np.float32), 1.0)
        assert apart.max() < 2e-3  # cylinders are of flat faces there
        guids = [one["guid"] for one in scene.about["elements"]]
        assert set(guids) <= set(prior.building.elements.guid) and len(set(guids)) == len(guids)
        rotation = np.array(scene.about["pose"]["rotation"])
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(scene.misses, axis=1), 1.0, atol=1e-5)


@pytest.mark.long
def test_labels_are_of_what_really_changed(exported):
    seen = set()
    for task, scene, truth in scenes_of(exported):
        prior = read_prior(scene.model)
        changed = truth.reference[(truth.reference != SAME)]
        for row, label in enumerate(truth.elements):
            own = truth.reference[scene.element == row]
            assert set(own) <= {SAME} or label in (*set(own), UNOBSERVABLE)
        assert not len(changed) or np.all(scene.element[truth.reference != SAME] >= 0)
        for label, *box, shown in truth.objects:
            assert 0.0 <= shown <= 1.0
            kind, change = LABELS[int(label)].split("_")
            whole = Box(kind, np.array(box[:3]), np.array(box[3:6]) + 0.01, box[6])
            side, labels = (scene.scan, truth.scan) if change == "added" else (scene.reference, truth.reference)
            if change == "removed" or not (task.lost or task.sensor.endswith("-real")):
                own = side[labels == label]
                others = [Box(kind, row[1:4], row[4:7] + 0.01, row[7]) for row in truth.objects if row[0] == label]
                assert all(
                    any(inside(one, point[None], np.zeros(3))[0] for one in (whole, *others)) for point in own[:50]
                )
            seen.add(int(label))
        if task.condition == "clean" and not task.lost and not task.sensor.endswith("-real"):
            apart = clearance(prior.scene, (scene.scan - prior.origin).astype(np.float32), 1.0)
            gone = np.any([row[0] in (3, 4) for row in truth.objects])
            assert gone or apart[truth.scan == SAME].max() < 2e-3
    assert seen >= {1, 2, 3, 4}


def test_nothing_tells_by_its_number_what_is_gone():
    """Where rooms are made, what is removed comes last; where they are given, its place is as good as any."""
    from jaxmm.exchange.scenes import make_scene

    settings, places = ExportSettings(sensors=("velodyne-16",), erring_share=0.0, lost_share=0.0), []
    for index in range(400):
        task = task_of(settings, index)
        if task.scene in ("wall_removed", "pillar_removed") and len(places) < 12:
            labels = make_scene(settings, task, []).truth.elements
            gone = np.flatnonzero((labels != SAME) & (labels != UNOBSERVABLE))
            places += [float(gone[0]) / max(len(labels) - 1, 1)] * bool(len(gone))
    assert len(places) >= 10 and min(places) < 0.4 and max(places) > 0.6 and places.count(1.0) < len(places) / 2


def test_a_killed_export_goes_on_to_the_same_bytes_and_more_scenes_change_none(exported, tmp_path):
    folder = tmp_path / "scenes"
    export(SETTINGS, folder, Request(5, workers=1))
    shutil.rmtree(folder / "train" / "000001")  # what a kill leaves: scenes, one half-written, no table
    (folder / "train" / ".000001.abc").mkdir()
    (folder / "README.md").unlink()
    export(SETTINGS, folder, Request(10, workers=1))
    whole = files_of(exported)
    mine = {path: content for path, content in files_of(folder).items() if path.count("/")}
    assert len(mine) > 40 and not [path for path, content in mine.items() if whole[path] != content]
    with np.load(truth_path(exported)) as all_of_it, np.load(truth_path(folder)) as part:
        assert {key.split("/")[0] for key in part.files} == {"000004", "000009"}
        assert all(np.array_equal(part[key], all_of_it[key]) for key in part.files)


def test_truth_that_was_taken_away_is_made_again(tmp_path):
    folder = tmp_path / "scenes"
    export(SETTINGS, folder, Request(5, workers=1))
    before = truth_path(folder).read_bytes()
    truth_path(folder).unlink()
    export(SETTINGS, folder, Request(5, workers=1))
    with np.load(truth_path(folder)) as now:
        assert len(now.files) == 6
    assert truth_path(folder).read_bytes() == before


def test_scenes_in_building_files_lie_in_the_split_of_their_file(tmp_path, exported):
    (tmp_path / "ifc").mkdir()
    model = read_scene(exported, "train", "000000").model
    for name in ("a", "b"):
        shutil.copy(model, tmp_path / "ifc" / f"{name}.ifc")
    folder = tmp_path / "scenes"
    export(SETTINGS, folder, Request(10, buildings=tmp_path / "ifc", workers=1))
    used = {path.parts[-3]: json.loads(path.read_text())["model"] for path in folder.rglob("scene.json")
            if "buildings" in path.read_text()}  # fmt: skip
    assert used == {"train": "../../buildings/a.ifc", "test": "../../buildings/b.ifc"}
    scene = read_scene(folder, "train", "000001")
    assert scene.model.is_file() and scene.model.parent == folder / "buildings"
    (tmp_path / "ifc" / "c.ifc").write_bytes(model.read_bytes())
    with pytest.raises(InputError, match="other buildings"):
        export(SETTINGS, folder, Request(10, buildings=tmp_path / "ifc", workers=1))


@pytest.mark.parametrize(
    "request_, settings, word",
    [
        (Request(0), SETTINGS, "--count"), (Request(5, workers=0), SETTINGS, "--workers"),
        (Request(5), ExportSettings(seed=7), "other settings"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(exported, request_, settings, word):
    before = files_of(exported)
    with pytest.raises(InputError, match=word) as error:
        export(settings, exported, request_)
    assert "\n" not in str(error.value) and files_of(exported) == before


def test_folders_and_truth_of_others_are_left_alone(exported, tmp_path):
    (tmp_path / "photo.jpg").write_text("x")
    with pytest.raises(InputError, match=r"photo\.jpg"):
        export(SETTINGS, tmp_path, Request(1, truth=tmp_path.parent / "t.npz", workers=1))
    with pytest.raises(InputError, match="outside"):
        export(SETTINGS, exported, Request(15, truth=exported / "truth.npz"))
    with pytest.raises(InputError, match="new file"):
        export(SETTINGS, tmp_path / "new", Request(1, truth=truth_path(exported)))
    with pytest.raises(InputError, match="--ifc"):
        export(SETTINGS, tmp_path / "other", Request(1, buildings=tmp_path))
