"""Reports in order of their dates, of one model; and what cannot be used is refused in one line."""

import itertools
import json

import pytest

from jaxmm.inputs import InputError
from jaxmm.weeks.reports import Key, labels_of, read_weeks
from tests.cases.four_weeks import DATES, changed, element, report, write_reports


@pytest.fixture
def paths(tmp_path):
    return write_reports(tmp_path)


def refused(reports, dates=None) -> str:
    with pytest.raises(InputError) as error:
        read_weeks(reports, dates)
    line = str(error.value)
    assert "\n" not in line and len(line) < 600
    return line


def test_dates_put_them_in_order_however_they_are_given(paths):
    expected = read_weeks(paths)
    assert [week.date for week in expected] == list(DATES) == labels_of(expected)
    for order in itertools.permutations(paths):
        assert read_weeks(order) == expected
    assert read_weeks([path / "report.json" for path in paths])[0].elements == expected[0].elements


def test_a_report_says_what_it_holds(paths):
    week = read_weeks(paths)[1]
    one = week.elements["", "guid-A1"]
    assert (one.guid, one.file, one.ifc_class, one.name) == ("guid-A1", "", "IfcWall", "A1")
    assert one.storey == "Ground floor" and one.verdict == "present" and one.probability == 0.02
    assert one.offset.offset == (0.002, 0.0, 0.0) and one.offset.interval == ((-0.002, 0.006), None, None)
    assert one.box.center == (4.0, 0.0, 1.5) and week.model.file == "house.ifc"
    assert [box.center for box in week.added] == [(6.0, 3.0, 1.0)]


def test_a_date_that_is_stated_counts_for_more(paths):
    weeks = read_weeks(paths, {paths[0]: "2026-04-01"})
    assert [week.date for week in weeks] == [*DATES[1:], "2026-04-01"]
    assert "expected one of the reports" in refused(paths, {paths[0].parent / "other": "2026-04-01"})


def test_two_of_one_day_need_times(paths):
    same = dict.fromkeys(paths[:2], "2026-03-02")
    line = refused(paths[:2], same)
    assert str(paths[0]) in line and str(paths[1]) in line and "--date" in line
    assert "same date" in refused(paths[:2], {paths[1]: "2026-03-02T10:00:00Z"})  # before or after the other?
    times = {path: f"2026-03-02T{hour}:00:00Z" for path, hour in zip(paths, ("16", "09"), strict=False)}
    weeks = read_weeks(paths[:2], times)
    assert [week.report for week in weeks] == [str(paths[1]), str(paths[0])]
    assert labels_of(weeks) == ["2026-03-02 09:00:00", "2026-03-02 16:00:00"]


def test_a_report_without_a_date_asks_for_one(tmp_path):
    (old,) = write_reports(tmp_path, [changed(changed(report(0), ("date",), ...), ("format",), ...)])
    assert f"--date {old}=" in refused([old])
    (week,) = read_weeks([old], {old: "2026-03-02"})
    assert len(week.elements) == 9


@pytest.mark.parametrize(
    "place, value, words",
    [
        pytest.param(("format",), 3, "newer jaxmm", id="a format to come"),
        pytest.param(("format",), "2", "format", id="a format that is text"),
        pytest.param(("date",), "soon", "date: expected a date", id="no date"),
        pytest.param(("date",), 20260302, "date", id="a number as date"),
        pytest.param(("elements",), {}, "elements", id="elements that are no list"),
        pytest.param(("elements",), [], "elements to follow", id="no elements"),
        pytest.param(("elements",), ..., "elements, found none", id="no list of elements"),
        pytest.param(("elements", 2), 5, "elements[2]", id="an element that is a number"),
        pytest.param(("elements", 2, "guid"), ..., "elements[2].guid", id="no GlobalId"),
        pytest.param(("elements", 2, "guid"), "guid-A1", "elements[2].guid", id="one GlobalId twice"),
        pytest.param(("elements", 2, "verdict"), "gone", "elements[2].verdict", id="unknown verdict"),
        pytest.param(("elements", 2, "verdict"), [], "elements[2].verdict", id="a verdict that is a list"),
        pytest.param(("elements", 2, "probability"), "high", "elements[2].probability", id="text as probability"),
        pytest.param(("elements", 2, "box", "center"), [1, 2], "elements[2].box.center", id="a place of two numbers"),
        pytest.param(("elements", 2, "box", "rotation"), None, "elements[2].box", id="a box without a turn"),
        pytest.param(("elements", 0, "deviation", "interval"), [[1], None, None], "interval[0]", id="half an interval"),
        pytest.param(("elements", 0, "deviation", "offset"), True, "deviation.offset", id="an offset that is true"),
        pytest.param(("prior", "kind"), "cloud", "point cloud", id="a cloud as prior"),
        pytest.param(("scans",), None, "scans", id="no scans"),
        pytest.param(("mismatches",), 7, "mismatches", id="a number of mismatches"),
    ],
)
def test_what_is_not_as_it_should_be_is_named(tmp_path, place, value, words):
    (path,) = write_reports(tmp_path, [changed(report(0), place, value)])
    line = refused([path])
    assert words in line and str(path) in line


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"7", b"\xff\xfe", b"[" * 100_000, b'{"format": 2}', b"null"])
def test_damaged_files_are_refused(tmp_path, content):
    (tmp_path / "report.json").write_bytes(content)
    assert str(tmp_path) in refused([tmp_path])


def test_what_is_not_there_is_refused(tmp_path, paths):
    assert "report.json" in refused([tmp_path])
    assert "found none" in refused([tmp_path / "nowhere"])
    assert "once" in refused([paths[0], paths[1], paths[0] / ".." / paths[0].name])


def with_model(week: int, names: str, **prior) -> dict:
    content = changed(report(week), ("elements",), [element(name, "present") for name in names.split()])
    content["prior"] |= prior
    return content


def test_reports_of_another_model_are_refused(tmp_path):
    paths = write_reports(
        tmp_path, [with_model(0, "A1 A2 A3 A4"), with_model(1, "B1 B2 B3 B4", sha256="cd" * 32, file="b.ifc")]
    )
    line = refused(paths)
    assert "house.ifc" in line and "b.ifc" in line and "0 of its" in line


def test_a_changed_model_is_followed(tmp_path):
    paths = write_reports(
        tmp_path, [with_model(0, "A1 A2 A3"), with_model(1, "A1 A2 B1", sha256="cd" * 32, file="b.ifc")]
    )
    one, other = read_weeks(paths)
    assert one.elements.keys() ^ other.elements.keys() == {("", "guid-A3"), ("", "guid-B1")}


def test_one_model_may_show_unlike_classes(tmp_path):
    """One report on columns, one on walls: nothing in common, but the file."""
    same = write_reports(tmp_path / "a", [with_model(0, "C"), with_model(1, "A1 A2")])
    assert len(read_weeks(same)) == 2
    project = write_reports(tmp_path / "b", [with_model(0, "C"), with_model(1, "A1 A2", sha256="cd" * 32)])
    assert len(read_weeks(project)) == 2
    other = write_reports(tmp_path / "c", [with_model(0, "C"), with_model(1, "A1 A2", sha256=None, project=None)])
    assert "has 0 of its 0 elements" in refused(other)


def test_nodes_of_other_meshes_have_the_same_names(tmp_path):
    mesh = {"kind": "mesh", "project": None}
    contents = [with_model(0, "A1 A2", **mesh), with_model(1, "A1 A2", sha256="cd" * 32, file="b.obj", **mesh)]
    line = refused(write_reports(tmp_path, contents))
    assert "expected a report on the model of" in line and "b.obj" in line


def test_an_element_is_known_by_its_file_only_where_two_files_have_it(tmp_path):
    def filed(week, files):
        content = report(week, {"A1": "pppp", "A2": "pppp"})
        content["elements"] += [json.loads(json.dumps(content["elements"][0]))] if len(files) == 3 else []
        for one, file in zip(content["elements"], files, strict=True):
            one["file"] = file
        return content

    paths = write_reports(tmp_path, [filed(0, ("a.ifc", "a.ifc")), filed(1, ("a.ifc", "a2.ifc", "b.ifc"))])
    keys: list[set[Key]] = [set(week.elements) for week in read_weeks(paths)]
    assert keys[0] == {("a.ifc", "guid-A1"), ("", "guid-A2")}
    assert keys[1] == {("a.ifc", "guid-A1"), ("b.ifc", "guid-A1"), ("", "guid-A2")}
