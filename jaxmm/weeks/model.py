"""The model itself beside the reports: true outlines for the plans, and the schedule.

Reports alone know a box for each element. World frame: metres, z up.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.files import sha256_of
from jaxmm.ifc.tasks import NO_PLAN, TaskPlan, read_tasks
from jaxmm.inputs import InputError
from jaxmm.learning.element_boxes import UprightBox, boxes_of
from jaxmm.reports.plan_cut import cut_surfaces
from jaxmm.weeks.reports import SAME, Key, Week
from warp_scanner.buildings.files import read_building
from warp_scanner.scenes.building import Building


class Model(NamedTuple):
    """The files of one model."""

    files: tuple[str, ...]  # names, without folders
    buildings: tuple[Building, ...]
    plan: TaskPlan


class Cut(NamedTuple):
    """Closed and open lines of a cut [m] world, by the element that they are of."""

    followed: dict[Key, list[np.ndarray]]  # (n, 2) each
    others: list[np.ndarray]  # of elements that no report lists


def read_model(paths: Sequence[Path], weeks: Sequence[Week]) -> Model:
    """The model that some reports are on, in one file or several.

    Raises:
        InputError: a file cannot be read, or is not of the reports' model.
    """
    keys = {guid for week in weeks for _, guid in week.elements}
    known = {week.model.sha256 for week in weeks} - {None}
    buildings = []
    for path in paths:
        if not path.is_file():
            raise InputError(f"--model: expected a file, {path} is {'a folder' if path.is_dir() else 'not there'}")
        try:
            building = read_building(path)
        except (ValueError, ImportError) as error:
            raise InputError(str(error)) from error
        buildings.append(building)
    both = keys & {guid for building in buildings for guid in building.elements.guid}
    if len(both) < SAME * len(keys) and not known & {sha256_of(path) for path in paths}:
        names = ", ".join(path.name for path in paths)
        raise InputError(
            f"--model: expected the model of the reports, {names} has {len(both)} of their {len(keys)} elements"
        )
    plan = NO_PLAN
    for path in paths:
        if path.suffix.lower() == ".ifc":
            plan = _joined(plan, read_tasks(path))
    return Model(tuple(path.name for path in paths), tuple(buildings), plan)


def with_boxes(weeks: Sequence[Week], model: Model) -> list[Week]:
    """The same weeks, in which elements have their boxes where a report of an older format states none."""
    keys = {key for week in weeks for key, one in week.elements.items() if one.box is None}
    boxes: dict[Key, UprightBox] = {}
    for file, building in zip(model.files, model.buildings, strict=True):
        guids, triangles = building.elements.guid, building.triangles
        rows = [(row, key) for row, guid in enumerate(guids) if (key := _key(file, guid, keys)) is not None]
        wanted = np.array([row for row, _ in rows], int)
        found = boxes_of(triangles.vertices, triangles.faces, triangles.element, wanted)
        for (_, key), box in zip(rows, found, strict=True):
            if box is not None:
                boxes[key] = box.shifted(building.origin)
    return [
        week._replace(elements={
            key: one._replace(box=one.box or boxes.get(key)) for key, one in week.elements.items()
        })
        for week in weeks
    ]  # fmt: skip


def cut_at(model: Model, keys: set[Key], height: float) -> Cut:
    """All lines of the model at a height [m], of its surfaces as they are."""
    found = Cut({}, [])
    for file, building in zip(model.files, model.buildings, strict=True):
        triangles, origin = building.triangles, building.origin
        lines = cut_surfaces(triangles.vertices, triangles.faces, triangles.element, height - float(origin[2]))
        for line in lines:
            key = _key(file, building.elements.guid[line.element], keys)
            place = found.others if key is None else found.followed.setdefault(key, [])
            place.append(line.points + origin[:2])
    return found


def _key(file: str, guid: str, keys: set[Key]) -> Key | None:
    """How the reports know an element of a file; None where they do not."""
    return next((key for key in (("", guid), (file, guid)) if key in keys), None)


def _joined(plan: TaskPlan, other: TaskPlan) -> TaskPlan:
    shift = len(plan.tasks)
    tasks = tuple(task._replace(parent=None if task.parent is None else task.parent + shift) for task in other.tasks)
    of_element = dict(plan.of_element)
    for guid, numbers in other.of_element.items():
        of_element[guid] = (*of_element.get(guid, ()), *(number + shift for number in numbers))
    return TaskPlan((*plan.tasks, *tasks), of_element)
