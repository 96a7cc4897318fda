"""The schedule in a model, in the ways in which files state it."""

import pytest

from jaxmm.ifc.tasks import NO_PLAN, Task, read_tasks
from jaxmm.inputs import InputError
from tests.cases.site import COLUMN, INNER, UPPER, write_model

ifcopenshell = pytest.importorskip("ifcopenshell")


def test_tasks_and_what_they_work_on(tmp_path):
    guids = write_model(tmp_path / "site.ifc")
    plan = read_tasks(tmp_path / "site.ifc")
    told = {task.name: task for task in plan.tasks}
    assert told["Outer walls"] == Task(told["Outer walls"].guid, "Outer walls", "2026-02-16", "2026-03-02", False, 0)
    assert plan.tasks[0].name == "Shell" and plan.tasks[0].parent is None
    assert [task.name for task in plan.tasks if task.removes] == ["Take the inner wall down"]
    named = {
        name: [plan.tasks[number].name for number in plan.of_element.get(guid, ())] for name, guid in guids.items()
    }
    assert named["wall 0"] == ["Outer walls"] and named[COLUMN] == ["Inner walls and columns"]
    assert named[INNER] == ["Inner walls and columns", "Take the inner wall down"]
    assert all(named[name] == ["Upper floor"] for name in UPPER)  # by their storey
    assert named["slab"] == []


def test_tasks_of_ifc2x3_have_their_dates_elsewhere(tmp_path):
    model = ifcopenshell.file(schema="IFC2X3")
    number = iter(range(1, 99))

    def root(kind, **values):
        return model.create_entity(kind, ifcopenshell.guid.compress(f"{next(number):032x}"), **values)

    wall = root("IfcWall", Name="wall")
    task = root("IfcTask", Name="build", TaskId="1", IsMilestone=False)
    part = root("IfcTask", Name="part", TaskId="2", IsMilestone=False)
    day = model.create_entity("IfcCalendarDate", DayComponent=2, MonthComponent=3, YearComponent=2026)
    hour = model.create_entity("IfcLocalTime", HourComponent=17)
    end = model.create_entity("IfcDateAndTime", DateComponent=day, TimeComponent=hour)
    control = root("IfcScheduleTimeControl", ScheduleStart=day, ScheduleFinish=end)
    root("IfcRelAssignsTasks", RelatedObjects=[task], RelatingControl=root("IfcWorkSchedule", Identifier="s"),
         TimeForTask=control)  # fmt: skip
    root("IfcRelNests", RelatingObject=task, RelatedObjects=[part])
    root("IfcRelAssignsToProcess", RelatedObjects=[wall], RelatingProcess=part)
    (tmp_path / "old.ifc").write_text(model.to_string())
    plan = read_tasks(tmp_path / "old.ifc")
    assert [(one.name, one.start, one.finish, one.parent) for one in plan.tasks] == [
        ("build", "2026-03-02", "2026-03-02", None), ("part", None, None, 0),
    ]  # fmt: skip
    assert plan.of_element == {wall.GlobalId: (1,)}


@pytest.mark.parametrize("text", ["", "soon", "2026-02-30T10:00:00", None])
def test_a_date_that_is_none_is_none(tmp_path, text):
    model = ifcopenshell.file(schema="IFC4")
    time = model.create_entity("IfcTaskTime", ScheduleFinish=text)
    model.create_entity("IfcTask", ifcopenshell.guid.compress("1" * 32), IsMilestone=False, TaskTime=time)
    (tmp_path / "a.ifc").write_text(model.to_string())
    (task,) = read_tasks(tmp_path / "a.ifc").tasks
    assert (task.name, task.start, task.finish) == ("", None, None)


def test_a_model_without_tasks_has_no_plan_and_damage_is_told(tmp_path):
    (tmp_path / "a.ifc").write_text(ifcopenshell.file(schema="IFC4").to_string())
    assert read_tasks(tmp_path / "a.ifc") == NO_PLAN
    (tmp_path / "b.ifc").write_text("no model")
    with pytest.raises(InputError):
        read_tasks(tmp_path / "b.ifc")
