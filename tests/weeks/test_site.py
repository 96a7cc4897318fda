"""A site of two storeys, scanned and detected in four weeks, from scan files to what became of each element."""

import csv
import io
import json
import zipfile

import numpy as np
import pytest

from jaxmm.commands.cli import main
from jaxmm.commands.detect_files import Reading, detect
from jaxmm.files import write_json
from jaxmm.formats.poses import parse_pose
from jaxmm.ifc.tasks import read_tasks
from jaxmm.reports.report_json import to_json
from jaxmm.weeks.history import follow
from jaxmm.weeks.model import read_model, with_boxes
from jaxmm.weeks.outlines import outlines_of
from jaxmm.weeks.reports import read_weeks
from tests.cases.four_weeks import changed
from tests.cases.site import (
    COLUMN,
    DATES,
    HEIGHT,
    INNER,
    OFF,
    PARTS,
    SENSOR,
    UPPER,
    write_model,
    write_scans,
)  # fmt: skip

ifcopenshell = pytest.importorskip("ifcopenshell")
pytest.importorskip("openpyxl")
pytestmark = pytest.mark.long  # four detections: of made-up reports other files ask what follows from them


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the model, and the reports of the four weeks in it."""
    folder = tmp_path_factory.mktemp("site")
    write_model(folder / "site.ifc")
    for week in range(4):
        paths, poses = zip(*write_scans(folder, week), strict=True)
        poses, reading = [parse_pose(pose) for pose in poses], Reading(sensor=SENSOR)
        found = detect(folder / "site.ifc", paths, poses, reading=reading, date=DATES[week])
        write_json(folder / f"week{week}" / "report.json", to_json(found))  # what else detect writes takes seconds
    return folder


def reports(site):
    return [site / f"week{week}" for week in (2, 0, 3, 1)]


def test_what_was_built_torn_down_and_displaced_is_found(site, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["progress", *map(str, reports(site)), "--out", str(out)]) == 0
    text = (out / "progress.csv").read_bytes().decode()
    rows = {row["name"]: row for row in csv.DictReader(io.StringIO(text, newline=""))}
    assert rows.keys() == {name for name in PARTS if name not in ("slab", "ceiling", "roof")}
    for name, row in rows.items():
        first = DATES[2] if name in UPPER else DATES[1] if name in (INNER, COLUMN) else DATES[0]
        assert row["first_seen"] == first, name
        state = {INNER: "removed", COLUMN: "displaced"}.get(name, "built")
        assert row["state"] == state and row["storey"] == ("Upper floor" if name in UPPER else "Ground floor")
    assert (rows[INNER]["not_before"], rows[INNER]["removed"]) == (DATES[0], DATES[3])
    assert rows[COLUMN]["displaced"] == DATES[3] and float(rows[COLUMN]["moved [m]"]) == pytest.approx(OFF, abs=0.005)
    assert rows[UPPER[0]]["not_before"] == "" and rows[UPPER[0]][f"state {DATES[1]}"] == "not seen"
    assert "10 of 10 elements stand (100%)" in capsys.readouterr().out


def test_boxes_of_the_reports_are_those_of_the_model(site):
    told = json.loads((site / "week3" / "report.json").read_text())
    assert told["date"] == DATES[3] and told["scans"][0]["taken"]["source"] == "modified"
    boxes = {one["name"]: one["box"] for one in told["elements"]}
    for name, box in boxes.items():
        center, half, _ = PARTS[name]
        np.testing.assert_allclose(box["center"], center, atol=1e-5)
        np.testing.assert_allclose(sorted(box["dimensions"][:2]), sorted(2.0 * np.array(half[:2])), atol=1e-5)


def test_the_model_gives_tasks_and_outlines(site, tmp_path, capsys):
    words = ["progress", *map(str, reports(site)), "--model", str(site / "site.ifc"), "--out", str(tmp_path / "out")]
    assert main(words) == 0
    assert "0 elements are late" in capsys.readouterr().out
    told = json.loads((tmp_path / "out" / "progress.json").read_text())
    names = [task["name"] for task in told["tasks"]]
    by_task = {
        name: [one["done"] for one in told["shares"] if (one["kind"], one["name"]) == ("task", name)] for name in names
    }
    assert by_task == {
        "Shell": [4, 6, 10, 10], "Outer walls": [4] * 4, "Inner walls and columns": [0, 2, 2, 2],
        "Upper floor": [0, 0, 4, 4], "Take the inner wall down": [1, 0, 0, 1],
    }  # fmt: skip


def test_what_is_late_is_told_as_soon_as_it_is(site, tmp_path, capsys):
    """With the third week's report alone moved past the demolition: the inner wall still stands, 3 days late."""
    words = ["progress", str(site / "week2"), "--date", f"{site / 'week2'}=2026-03-23"]
    assert main([*words, "--model", str(site / "site.ifc"), "--out", str(tmp_path / "out")]) == 0
    assert "1 elements are late" in capsys.readouterr().out
    told = json.loads((tmp_path / "out" / "progress.json").read_text())
    (late,) = [one for one in told["elements"] if one["behind"]]
    assert (late["name"], late["behind"], late["days_behind"]) == (INNER, "late", 3)


def test_outlines_are_cut_through_the_model(site):
    weeks = read_weeks(reports(site))
    model = read_model([site / "site.ifc"], weeks)
    progress = follow(weeks, model.plan)
    boxes, cut = outlines_of(progress), outlines_of(progress, model)
    assert [one.name for one in cut.storeys] == ["Ground floor", "Upper floor"]
    assert [one.floor for one in cut.storeys] == pytest.approx([0.0, HEIGHT + 0.2], abs=1e-5)
    for one, other in zip(boxes.storeys, cut.storeys, strict=True):
        assert one.elements.keys() == other.elements.keys()
        for key, rings in one.elements.items():
            low, high = (np.concatenate(lines) for lines in (rings, other.elements[key]))
            np.testing.assert_allclose(np.ptp(low, axis=0), np.ptp(high, axis=0), atol=1e-4)
            np.testing.assert_allclose(low.min(axis=0), high.min(axis=0), atol=1e-4)


def test_reports_of_an_older_format_get_their_places_from_the_model(site, tmp_path):
    paths = []
    for week in range(2):
        told = json.loads((site / f"week{week}" / "report.json").read_text())
        told = changed(changed(told, ("format",), ...), ("date",), ...)
        for one in told["elements"]:
            del one["box"]
        paths.append(tmp_path / f"old{week}")
        paths[-1].mkdir()
        (paths[-1] / "report.json").write_text(json.dumps(told))
    weeks = read_weeks(paths, dict(zip(paths, DATES, strict=False)))
    boxed = with_boxes(weeks, read_model([site / "site.ifc"], weeks))
    new = read_weeks([site / "week0", site / "week1"])
    for one, other in zip(boxed, new, strict=True):
        for key, element in one.elements.items():
            np.testing.assert_allclose(element.box.center, other.elements[key].box.center, atol=1e-5)


def test_a_folder_is_one_model_whichever_of_its_files_has_the_schedule(site, tmp_path, capsys):
    folder = tmp_path / "model"
    (folder / "trades").mkdir(parents=True)
    whole = ifcopenshell.open(str(site / "site.ifc"))
    columns = ifcopenshell.open(str(site / "site.ifc"))
    for one in whole.by_type("IfcColumn"):
        whole.remove(one)
    for one in [one for one in columns.by_type("IfcProduct") if one.Representation and not one.is_a("IfcColumn")]:
        columns.remove(one)
    for one in columns.by_type("IfcTask"):
        columns.remove(one)
    columns.write(str(folder / "trades" / "columns.ifc"))
    with zipfile.ZipFile(folder / "site.ifczip", "w") as archive:
        archive.writestr("Site.IFC", whole.to_string())
    words = ["progress", *map(str, reports(site))]
    assert main([*words, "--model", str(folder), "--out", str(tmp_path / "out")]) == 0
    told = json.loads((tmp_path / "out" / "progress.json").read_text())
    done = {one["name"]: one["done"] for one in told["shares"] if one["kind"] == "task"}  # of the last week
    assert done["Outer walls"] == 4 and done["Upper floor"] == 4
    weeks = read_weeks(reports(site))
    model, alone = read_model([folder], weeks), read_model([site / "site.ifc"], weeks)
    progress = follow(weeks, model.plan)
    cut, same = outlines_of(progress, model), outlines_of(progress, alone)
    for one, other in zip(cut.storeys, same.storeys, strict=True):
        assert one.elements.keys() == other.elements.keys()
        for key, rings in one.elements.items():
            np.testing.assert_allclose(
                np.sort(np.concatenate(rings), axis=0), np.sort(np.concatenate(other.elements[key]), axis=0), atol=1e-5
            )
    capsys.readouterr()
    empty = tmp_path / "empty"
    empty.mkdir()
    assert main([*words, "--model", str(empty), "--out", str(tmp_path / "none")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1 and not (tmp_path / "none").exists()


def test_another_model_is_refused(site, tmp_path, capsys):
    other = (site / "site.ifc").read_text().replace("inner wall", "wall")
    (tmp_path / "renamed.ifc").write_text(other)
    plan = read_tasks(tmp_path / "renamed.ifc")
    assert len(plan.tasks) == 5  # the same elements: another state of the model
    guids = {one["guid"] for one in json.loads((site / "week0" / "report.json").read_text())["elements"]}
    for guid in guids:
        other = other.replace(guid, guid[::-1].replace(guid[-1], "3", 1))
    (tmp_path / "other.ifc").write_text(other)
    words = ["progress", str(site / "week0"), "--model", str(tmp_path / "other.ifc"), "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert "expected the model of the reports, other.ifc has" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
