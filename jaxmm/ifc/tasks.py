"""The schedule in a model: which tasks build, or take away, which elements, and when.

Elements are assigned to a task as what it works on (IfcRelAssignsToProcess) or as what comes out of it
(IfcRelAssignsToProduct); an assembly or a storey stands for all that is in it. Dates are days in ISO 8601.
"""

from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

from jaxmm.inputs import InputError
from warp_scanner.buildings.ifc_model import identity_of, open_model

REMOVALS = ("DEMOLITION", "DISMANTLE", "DISPOSAL", "REMOVAL")


class Task(NamedTuple):
    """One IfcTask."""

    guid: str
    name: str
    start: str | None  # day, as planned
    finish: str | None
    removes: bool  # whether what it works on is gone when it is done
    parent: int | None  # number of the task that it is a part of


class TaskPlan(NamedTuple):
    """The tasks of a model, and of each element the numbers of those that it is assigned to itself."""

    tasks: tuple[Task, ...]
    of_element: dict[str, tuple[int, ...]]  # by GlobalId


NO_PLAN = TaskPlan((), {})


def read_tasks(path: Path) -> TaskPlan:
    """The schedule of an IFC file; NO_PLAN where it has none.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        model, *_ = open_model(path)
    except (ValueError, ImportError) as error:
        raise InputError(str(error)) from error
    found = model.by_type("IfcTask")
    if not found:
        return NO_PLAN
    row = {task.id(): number for number, task in enumerate(found)}
    times = _times_of_2x3(model) if model.schema == "IFC2X3" else {}
    tasks = tuple(_task(task, row, times) for task in found)
    of_element: dict[str, dict[int, None]] = {}
    for task, product in _assignments(model):
        for part in _parts(product):
            of_element.setdefault(identity_of(part), {})[row[task.id()]] = None
    return TaskPlan(tasks, {guid: tuple(sorted(numbers)) for guid, numbers in of_element.items()})


def with_parents(plan: TaskPlan, numbers: tuple[int, ...]) -> set[int]:
    """Some tasks, and all that they are parts of."""
    found, left = set(), list(numbers)
    while left:
        number = left.pop()
        if number not in found:
            found.add(number)
            if plan.tasks[number].parent is not None:
                left.append(plan.tasks[number].parent)
    return found


def _task(task: Any, row: dict[int, int], times: dict[int, Any]) -> Task:
    time = getattr(task, "TaskTime", None)
    if time is not None:
        start, finish = _day(time.ScheduleStart), _day(time.ScheduleFinish)
    else:
        old = times.get(task.id())
        start, finish = (_day_of_2x3(getattr(old, name, None)) for name in ("ScheduleStart", "ScheduleFinish"))
    parents = [relation.RelatingObject for relation in getattr(task, "Nests", None) or task.Decomposes or ()]
    parent = next((row[one.id()] for one in parents if one.id() in row), None)
    return Task(
        identity_of(task), task.Name or "", start, finish, getattr(task, "PredefinedType", None) in REMOVALS, parent
    )


def _assignments(model: Any) -> list[tuple[Any, Any]]:
    pairs = []
    for relation in model.by_type("IfcRelAssignsToProcess"):
        task = relation.RelatingProcess  # nothing in files out of which tasks were taken
        if task is not None and task.is_a("IfcTask"):
            pairs += [(task, one) for one in relation.RelatedObjects if one.is_a("IfcProduct")]
    for relation in model.by_type("IfcRelAssignsToProduct"):
        product = relation.RelatingProduct
        if product is not None and product.is_a("IfcProduct"):
            pairs += [(one, product) for one in relation.RelatedObjects if one.is_a("IfcTask")]
    return pairs


def _parts(product: Any) -> list[Any]:
    from ifcopenshell.util.element import get_decomposition

    return [product, *get_decomposition(product)]


def _day(text: str | None) -> str | None:
    """The day of a date or a time in ISO 8601; None where it is none."""
    try:
        return date.fromisoformat((text or "")[:10]).isoformat()
    except ValueError:
        return None


def _times_of_2x3(model: Any) -> dict[int, Any]:
    """IfcScheduleTimeControl by the number of the task that it is of."""
    return {
        task.id(): relation.TimeForTask
        for relation in model.by_type("IfcRelAssignsTasks")
        if relation.TimeForTask is not None
        for task in relation.RelatedObjects
    }


def _day_of_2x3(moment: Any) -> str | None:
    """Of an IfcCalendarDate, or of an IfcDateAndTime that holds one."""
    day = getattr(moment, "DateComponent", moment)
    try:
        return date(day.YearComponent, day.MonthComponent, day.DayComponent).isoformat()
    except (AttributeError, TypeError, ValueError):
        return None
