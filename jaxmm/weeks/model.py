"""The model itself beside the reports: true outlines for the plans, and the schedule.

Reports alone know a box for each element. World frame: metres, z up.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.ifc.tasks import NO_PLAN, TaskPlan, read_tasks
from jaxmm.inputs import InputError
from jaxmm.learning.element_boxes import UprightBox, boxes_of
from jaxmm.reports.plan_cut import cut_surfaces
from jaxmm.verdicts.priors import digest_of
from jaxmm.weeks.reports import SAME, Key, Week
from warp_scanner.buildings import projects
from warp_scanner.buildings.ifc_zips import is_ifc, plain_file
from warp_scanner.buildings.model_files import model_of
from warp_scanner.scenes.building import Building, rows_by_key


class Model(NamedTuple):
    """The building in all files of one model, and their schedules."""

    building: Building
    plan: TaskPlan


class Cut(NamedTuple):
    """Closed and open lines of a cut [m] world, by the element that they are of."""

    followed: dict[Key, list[np.ndarray]]  # (n, 2) each
    others: list[np.ndarray]  # of elements that no report lists


def read_model(paths: Sequence[Path], weeks: Sequence[Week]) -> Model:
    """The model that some reports are on: one file, several, or folders of such.

    Raises:
        InputError: a file cannot be read, or is not of the reports' model.
    """
    for path in paths:
        if not path.exists():
            raise InputError(f"--model: expected a file or a folder, {path} is not there")
    first, *others = paths
    try:
        files = model_of(first, [file.path for path in others for file in model_of(path).files], "--model")
        building = projects.read_model(files)
    except (ValueError, ImportError) as error:
        raise InputError(str(error)) from error
    keys, own = (
        {guid for week in weeks for _, guid in week.elements},
        {guid for _, guid in rows_by_key(building.elements)},
    )
    own |= {whole.guid for whole in building.wholes}
    own |= {one.guid for whole in building.pieced for one in (whole.element, *whole.twins)}
    known = {week.model.sha256 for week in weeks} - {None}
    if len(keys & own) < SAME * len(keys) and digest_of(files) not in known:
        names = ", ".join(path.name or str(path) for path in paths)
        raise InputError(
            f"--model: expected the model of the reports, {names} has {len(keys & own)} of their {len(keys)} elements"
        )
    plan = NO_PLAN
    for file in files.files:
        if is_ifc(file.path):
            with plain_file(file.path) as plain:
                plan = _joined(plan, read_tasks(plain))
    return Model(building, plan)


def with_boxes(weeks: Sequence[Week], model: Model) -> list[Week]:
    """The same weeks, in which elements have their boxes where a report of an older format states none."""
    keys = {key for week in weeks for key, one in week.elements.items() if one.box is None}
    rows = [
        (row, known)
        for key, row in rows_by_key(model.building.elements).items()
        if (known := _key(key, keys)) is not None
    ]
    triangles, wanted = model.building.triangles, np.array([row for row, _ in rows], int)
    found = boxes_of(triangles.vertices, triangles.faces, triangles.element, wanted)
    boxes: dict[Key, UprightBox] = {
        key: box.shifted(model.building.origin) for (_, key), box in zip(rows, found, strict=True) if box is not None
    }
    return [
        week._replace(elements={
            key: one._replace(box=one.box or boxes.get(key)) for key, one in week.elements.items()
        })
        for week in weeks
    ]  # fmt: skip


def cut_at(model: Model, keys: set[Key], height: float) -> Cut:
    """All lines of the model at a height [m], of its surfaces as they are."""
    triangles, origin = model.building.triangles, model.building.origin
    names: dict[int, list[Key]] = {}
    for key, row in rows_by_key(model.building.elements).items():
        if (known := _key(key, keys)) is not None:
            names.setdefault(row, []).append(known)
    found = Cut({}, [])
    for line in cut_surfaces(triangles.vertices, triangles.faces, triangles.element, height - float(origin[2])):
        points = line.points + origin[:2]
        for key in names.get(line.element, ()):
            found.followed.setdefault(key, []).append(points)
        if line.element not in names:
            found.others.append(points)
    return found


def _key(key: Key, keys: set[Key]) -> Key | None:
    """How the reports know an element; None where they do not."""
    return next((known for known in (("", key[1]), key) if known in keys), None)


def _joined(plan: TaskPlan, other: TaskPlan) -> TaskPlan:
    shift = len(plan.tasks)
    tasks = tuple(task._replace(parent=None if task.parent is None else task.parent + shift) for task in other.tasks)
    of_element = dict(plan.of_element)
    for guid, numbers in other.of_element.items():
        of_element[guid] = (*of_element.get(guid, ()), *(number + shift for number in numbers))
    return TaskPlan((*plan.tasks, *tasks), of_element)
