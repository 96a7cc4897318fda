"""`jaxmm detect` with a model in several files: verdicts as of one file, every element under its file, all put back."""

import csv
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

import jaxmm
from jaxmm import detect
from jaxmm.commands.detect_files import Reading, write_all
from jaxmm.commands.scanning import scan
from jaxmm.formats.poses import parse_pose
from jaxmm.formats.writers import write_scan
from jaxmm.ifc.undo import UNDO, revert
from jaxmm.reports.page_data import page_data
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import shell_of, table_of
from warp_scanner.buildings.ifc_files import read_ifc
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.sensors import sensor_named

jsonschema = pytest.importorskip("jsonschema")
BELIEVED = DetectSettings(refine=False, propose_views=False)
POSE, SENSOR = parse_pose("-2,-1,1.5,0"), sensor_named("ouster-64")
SHELL = shell_of(6.0, 5.0, 3.0)
WALL_GONE, COLUMN_GONE = ((1.0, 2.0, 1.5), (1.5, 0.1, 1.5), WALL), ((2.5, -2.0, 1.5), (0.2, 0.2, 1.5), PILLAR)
STANDS, NEW = ((-3.0, 3.0, 1.5), (0.2, 0.2, 1.5), PILLAR), ((3.5, 1.0, 1.5), (0.2, 0.2, 1.5), PILLAR)


def detected(prior, scans, also=()):
    return detect(prior, scans, [POSE], also=also, reading=Reading(sensor=SENSOR), settings=BELIEVED)


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A folder of three files: shell and wall; the same wall, by another trade, packed; columns. GlobalIds repeat."""
    folder = tmp_path_factory.mktemp("project")
    model = folder / "model"
    (model / "mason").mkdir(parents=True)
    write_room(model / "shell.ifc", table_of((*SHELL, WALL_GONE)), 0)
    write_room(folder / "walls.ifc", table_of((WALL_GONE,)), 0)
    write_room(model / "columns.ifc", table_of((STANDS, COLUMN_GONE)), 0)
    # Of files that were copied and edited: what is gone has the GlobalId of something that stands.
    standing, (there, gone) = (
        read_ifc(model / "shell.ifc").elements.guid[2],
        read_ifc(model / "columns.ifc").elements.guid,
    )
    rename(model / "columns.ifc", gone, standing)
    rename(folder / "walls.ifc", read_ifc(folder / "walls.ifc").elements.guid[0], there)
    with zipfile.ZipFile(model / "mason" / "walls.ifczip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(folder / "walls.ifc", "Model.IFC")
    write_room(folder / "built.ifc", table_of((*SHELL, STANDS, NEW)), 0)
    write_room(folder / "whole.ifc", table_of((*SHELL, WALL_GONE, STANDS, COLUMN_GONE)), 0)
    write_scan(folder / "scan.ply", scan(folder / "built.ifc", POSE, SENSOR))
    return folder, detected(model, folder / "scan.ply")


def rename(path, guid, other):
    path.write_text(path.read_text().replace(guid, other))


def told(detection):
    return sorted(
        (one.mismatch_type, one.object_type, *np.round(one.center, 2).tolist()) for one in detection.mismatches
    )


@pytest.mark.long
def test_what_changed_is_what_one_file_tells(project):
    folder, detection = project
    whole = detected(folder / "whole.ifc", folder / "scan.ply")
    assert told(detection) == told(whole)
    assert [one[:2] for one in told(detection)] == [("added", "pillar"), ("removed", "pillar"), ("removed", "wall")]
    assert {one.file for one in whole.elements} == {"whole.ifc"}


def test_one_wall_of_two_trades_gets_one_verdict(project):
    _, detection = project
    gone = {one.key: one for one in detection.elements if one.verdict == "removed"}
    files = sorted(file for file, _ in gone)
    assert files == ["columns.ifc", "mason/walls.ifczip", "shell.ifc"]
    walls = [one for one in gone.values() if one.same_as]
    assert len(walls) == 2 and walls[0].same_as == (walls[1].key,) and walls[1].same_as == (walls[0].key,)
    assert walls[0].probability == walls[1].probability and walls[0].rays == walls[1].rays
    # Two GlobalIds stand for two elements each, one gone and one there.
    guids = [one.guid for one in detection.elements]
    assert len(set(guids)) == len(guids) - 2 and len({one.key for one in detection.elements}) == len(guids)
    verdicts = {guid: {one.verdict for one in detection.elements if one.guid == guid} for guid in guids}
    assert sum(one == {"removed", "present"} for one in verdicts.values()) == 2


def test_files_one_by_one_and_in_any_order_tell_the_same(project):
    folder, detection = project
    model = folder / "model"
    shell, walls, columns = model / "shell.ifc", model / "mason/walls.ifczip", model / "columns.ifc"
    other = detected(columns, folder / "scan.ply", [walls, shell])
    assert told(other) == told(detection)
    assert sorted((one.guid, one.verdict) for one in other.elements) == sorted(
        (one.guid, one.verdict) for one in detection.elements
    )


def test_all_reports_name_the_file(project, tmp_path):
    folder, detection = project
    write_all(detection, folder / "model", tmp_path / "out", as_built=True)
    report = json.loads((tmp_path / "out/report.json").read_text())
    jsonschema.validate(report, json.loads(Path(jaxmm.__file__).with_name("report_schema.json").read_text()))
    assert [one["file"] for one in report["prior"]["files"]] == ["columns.ifc", "mason/walls.ifczip", "shell.ifc"]
    rows = list(csv.DictReader((tmp_path / "out/elements.csv").open(newline="")))
    assert [row["file"] for row in rows] == [one["file"] for one in report["elements"]]
    with zipfile.ZipFile(tmp_path / "out/mismatches.bcf") as archive:
        markups = [archive.read(name).decode() for name in archive.namelist() if name.endswith("markup.bcf")]
    headers = [text.split("</Header>")[0] for text in markups if "Overview" not in text]
    assert sum("columns.ifc</Filename>" in text and "shell.ifc" not in text for text in headers) == 1
    assert sum("walls.ifczip</Filename>" in text and "shell.ifc</Filename>" in text for text in headers) == 2


def test_each_file_that_changes_is_written_and_put_back(project, tmp_path):
    folder, detection = project
    said = write_all(detection, folder / "model", tmp_path / "out")
    updated = tmp_path / "out/updated"
    assert sorted(path.relative_to(updated).as_posix() for path in updated.rglob("*.ifc")) == [
        "columns.ifc", "mason/walls.ifc", "shell.ifc",
    ]  # fmt: skip
    assert any(line.startswith("updated: ") for line in said)
    assert (
        not (tmp_path / "out/updated.ifc").exists()
        and (updated / UNDO).exists()
        and (updated / "mason" / UNDO).exists()
    )
    before = {"columns.ifc": "model/columns.ifc", "mason/walls.ifc": "walls.ifc", "shell.ifc": "model/shell.ifc"}
    for name, original in before.items():
        text = (updated / name).read_text()
        assert "'DEMOLISH'" in text.replace("IFCLABEL(", "")
        revert(updated / name, tmp_path / "back.ifc")
        assert (tmp_path / "back.ifc").read_bytes() == (folder / original).read_bytes()
        (tmp_path / "back.ifc").unlink()
    added = [name for name in before if any("added pillar" in one for one in read_ifc(updated / name).elements.name)]
    assert added == ["columns.ifc"]  # where the nearest of its kind is


def test_deleting_what_is_gone_deletes_it_in_every_file(project, tmp_path):
    folder, detection = project
    write_all(detection, folder / "model", tmp_path / "out", apply=True)
    shell = read_ifc(tmp_path / "out/updated/shell.ifc")
    assert len(shell.elements.guid) == len(SHELL)
    with pytest.raises(ValueError, match="expected a building with surfaces, found none"):
        read_ifc(tmp_path / "out/updated/mason/walls.ifc")


def test_the_page_tells_elements_of_one_id_apart(project):
    _, detection = project
    data = page_data(detection)
    assert len(set(data["key"])) == len(data["key"])
    assert len(set(data["element_key"])) == len(detection.elements)
    ((twin, row),) = data["twins"]
    assert twin in data["element_key"] and data["key"][row] in data["mismatch_key"]
    assert all(
        (key is None) == (one.element is None)
        for key, one in zip(data["mismatch_key"], detection.mismatches, strict=True)
    )


def test_what_is_wrong_is_one_line_and_nothing_is_written(project, tmp_path, said):
    folder, _ = project
    (tmp_path / "empty").mkdir()
    write_room(tmp_path / "far.ifc", table_of([((x + 500.0, y, z), half, kind) for (x, y, z), half, kind in SHELL]), 0)
    (tmp_path / "notes.docx").write_bytes(b"x")
    model = folder / "model"
    for prior, also, words in (
        (tmp_path / "empty", [], "expected a folder with models"),
        (model, ["--also", tmp_path / "far.ifc"], "488 m away"),
        (model, ["--also", tmp_path / "notes.docx"], "--also: expected a model ending in .ifc"),
        (tmp_path / "nothing", [], "expected a file or a folder of models, found nothing there"),
    ):
        arguments = ("detect", prior, folder / "scan.ply", *also, "--pose=-2,-1,1.5,0", "--sensor", "ouster-64")
        code, lines = said(*arguments, "--out", tmp_path / "out")
        assert code == 2 and len(lines) == 1 and words in lines[0]
        assert not (tmp_path / "out").exists()
