"""Shares by task, and what is behind a schedule: fabricated schedules on the case of four weeks."""

import pytest

from jaxmm.ifc.tasks import Task, TaskPlan, with_parents
from jaxmm.weeks.history import follow
from jaxmm.weeks.outlines import outlines_of
from jaxmm.weeks.page import page_data
from jaxmm.weeks.plans import draw_plan
from jaxmm.weeks.reports import read_weeks
from jaxmm.weeks.shares import LATE, OPEN, due_of, shares_of, storeys_of
from jaxmm.weeks.summary import lines_of
from tests.cases.four_weeks import DATES, changed, report, write_reports

BUILD = Task("t0", "walls", "2026-03-01", "2026-03-16", False, None)
PLAN = TaskPlan(
    (BUILD, BUILD._replace(guid="t1", name="take down", removes=True, finish="2026-03-20"),
     BUILD._replace(guid="t2", name="", finish=None), BUILD._replace(guid="t3", finish="2026-04-01", parent=2)),
    {"guid-A1": (0,), "guid-A3": (0, 1), "guid-B3": (0,), "guid-B4": (0,), "guid-B2": (2, 3), "guid-C": (1,),
     "guid-nowhere": (0,)},
)  # fmt: skip


@pytest.fixture(scope="module")
def weeks(tmp_path_factory):
    return read_weeks(write_reports(tmp_path_factory.mktemp("four")))


@pytest.mark.parametrize(
    "name, tasks, finish, behind, days",
    [
        pytest.param("A1", (0,), "2026-03-16", "", 0, id="stands"),
        pytest.param("A3", (0, 1), "2026-03-20", "", 0, id="stood, and was taken away in time"),
        pytest.param("B3", (0,), "2026-03-16", LATE, 7, id="not built"),
        pytest.param("B4", (0,), "2026-03-16", OPEN, 7, id="nobody saw it"),
        pytest.param("B2", (2, 3), "2026-04-01", "", 0, id="not due yet"),
        pytest.param("C", (1,), "2026-03-20", LATE, 3, id="should be gone"),
        pytest.param("A2", (), None, "", 0, id="no task"),
    ],
)
def test_what_is_behind(weeks, name, tasks, finish, behind, days):
    progress = follow(weeks, PLAN)
    (one,) = [one for one in progress.elements if one.latest.name == name]
    due = due_of(one, progress)
    assert (due.tasks, due.finish, due.behind, due.days) == (tasks, finish, behind, days)


def test_tasks_count_what_they_do(weeks):
    progress = follow(weeks, PLAN)
    told = {}
    for one in shares_of(progress):
        if one.kind == "task":
            told.setdefault(one.name, []).append((one.done, one.elements))
    assert told["walls"][:4] == [(1, 4), (2, 4), (2, 4), (2, 4)]  # A3 counts as built when it is gone again
    # Its place is empty, then the wall stands, then it is gone; the column is there from the second week on.
    assert told["take down"] == [(2, 2), (0, 2), (0, 2), (1, 2)]
    assert told["t2"] == [(0, 1), (0, 1), (1, 1), (1, 1)]  # by its own elements and those of its part
    assert "2 elements are late, and 1 that" in lines_of(progress)[-1]
    assert len(lines_of(follow(weeks))) == 4


def test_parents_that_run_in_a_circle_end():
    plan = TaskPlan((BUILD._replace(parent=1), BUILD._replace(parent=0)), {})
    assert with_parents(plan, (0,)) == {0, 1}


def test_storeys_go_up_by_their_places_whatever_their_names(tmp_path):
    contents = [report(0)]
    for row, one in enumerate(contents[0]["elements"]):
        storey = "Z below" if one["name"][0] in "AC" else "A above"
        contents[0] = changed(contents[0], ("elements", row, "storey"), storey if one["name"] != "B4" else "")
    progress = follow(read_weeks(write_reports(tmp_path, contents)))
    assert storeys_of(progress) == ["Z below", "A above", "without a storey"]


REST = ["A4", "B1", "B2", "B3", "B4", "C"]  # counted beside A1, which A2 is again; A3 is B1 and B2


def named(name):
    return {"file": "other.ifc" if name[0] == "B" or name == "A2" else "house.ifc", "guid": f"guid-{name}"}


def test_what_two_files_have_counts_once(tmp_path):
    """A1 and A2 are one wall, of two files; A3 is what B1 and B2 are the pieces of."""
    contents = [report(week) for week in range(4)]
    for content in contents:
        for one in content["elements"]:
            name = one["name"]
            one |= {"file": named(name)["file"], "same_as": [], "parts": []}
            if name in ("A1", "A2"):
                one["same_as"] = [named("A2" if name == "A1" else "A1")]
            if name == "A3":
                one["parts"] = [named("B1"), named("B2")]
    progress = follow(read_weeks(write_reports(tmp_path, contents)))
    shares = shares_of(progress)
    # A3 stands in the second week, when neither of its pieces does, and in the third, when both do.
    assert progress.notes == (
        f"{DATES[1]}: stands as a whole, but not in all its parts: 'A3' (guid-A3): 'B1' (guid-B1) not built, "
        "'B2' (guid-B2) not built",
    )
    # The page counts as the shares do, and lists every element.
    outlines = outlines_of(progress, None)
    page = page_data(progress, outlines)
    named_once = sorted(page["elements"][row]["name"] for row in page["counted"])
    assert len(page["elements"]) == 9 and named_once in [["A1", *REST], ["A2", *REST]]
    assert [one.elements for one in shares if one.kind == "all"] == [7] * 4
    by_name = {one.name: one for one in shares if one.week == 0}
    assert by_name["Upper floor"].elements == 4  # its pieces are there, the whole is below
    assert by_name["Ground floor"].elements == 4  # A1 or A2, A3, A4, C
    assert by_name["IfcWall"].elements == 6
    # So do legends of plans, which draw every element.
    legends = [draw_plan(progress, outlines, one, tmp_path / "plan.png").legends[0] for one in outlines.storeys]
    words = [text.get_text() for legend in legends for text in legend.get_texts() if "displaced" not in text.get_text()]
    assert sum(int(one.rsplit(": ", 1)[1]) for one in words) == 7
