"""The figure of a building, on a generated room: what it draws is where the room has it, and what the labels say."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

pytest.importorskip("ifcopenshell")

from warp_scanner.buildings.files import read_building
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.scenes.scenes import GAP, PILLAR, WALL, take
from warp_scanner.sensors.sensors import Pinhole
from warp_scanner.sensors.triangles import prepare

ROOT = Path(__file__).parents[2]
POSE = np.array([-3.5, 0.5, -0.4, 10.0, 0.0])


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(ROOT / "paper" / "building.py"))


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Path of a generated room's file, its primitives, and the GlobalId of every element."""
    rooms = make_rooms(RoomConfig(), 11, np.arange(8))
    with_pillars = np.flatnonzero((rooms.semantic == PILLAR).any(axis=1))
    path, primitives = tmp_path_factory.mktemp("room") / "room.ifc", take(rooms, with_pillars[:1])
    return path, primitives, write_room(path, primitives, 0)


def view_of(script, path):
    building = read_building(path)
    return script["View"](building, prepare(building.triangles), script["pose_of"](building, POSE))


def test_the_plan_shows_every_wall_and_column_where_it_stands(script, room):
    path, table, guids = room
    view = view_of(script, path)
    plan = script["plan_of"](view, 300)
    left, right, bottom, top = plan.extent
    element, (rows, columns) = plan.scan.element.reshape(plan.shape), plan.shape
    cut = POSE[2] + script["CUT"]
    upright = np.isin(table.semantic[0], (WALL, PILLAR)) & (table.kind[0] != GAP)
    upright &= np.abs(table.center[0, :, 2] - cut) < table.half_size[0, :, 2]
    assert upright.sum() > 5
    for x, y, number in zip(*table.center[0, upright, :2].T, table.element[0, upright], strict=True):
        row, column = int((top - y) / (top - bottom) * rows), int((x - left) / (right - left) * columns)
        assert view.building.elements.guid[element[row, column]] == guids[int(number)]


def test_the_sphere_meets_the_ceiling_above_and_the_floor_below(script, room):
    view = view_of(script, room[0])
    scan, points = script["sphere_of"](view, (36, 19))
    assert np.isfinite(scan.distance).all()
    np.testing.assert_allclose(points.reshape(19, 36, 3)[0], [[*POSE[:2], 1.5]] * 36, atol=1e-4)
    np.testing.assert_allclose(points.reshape(19, 36, 3)[-1], [[*POSE[:2], -1.5]] * 36, atol=1e-4)
    ahead, left = points.reshape(19, 36, 3)[9, 17], points.reshape(19, 36, 3)[9, 8]
    for point, azimuth in ((ahead, 15.0), (left, 105.0)):  # columns fall by 10 degrees from 175; the pose's yaw is 10
        offset = point[:2] - POSE[:2]
        assert np.degrees(np.arctan2(offset[1], offset[0])) == pytest.approx(azimuth, abs=0.01)


@pytest.mark.parametrize("scenario", ["wall_added", "pillar_removed"])
def test_what_is_coloured_as_changed_is_what_the_labels_say(script, room, scenario):
    camera = Pinhole(64, 40)
    pairs = script["pair_of"](read_building(room[0]), scenario, camera)
    added = scenario.endswith("added")
    scan, changed = (pairs.robot, pairs.changed_robot) if added else (pairs.dt, pairs.changed_dt)
    name = "added" if added else "removed (seen in the prior)"
    picture = script["labelled"](scan, changed, name, camera.shape)
    colored = np.all(picture == to_rgb(script["LABELS"][name]), axis=-1).ravel()
    assert changed.mean() > 0.02 and not (colored & ~changed[0]).any()
    assert colored[changed[0]].mean() > 0.6  # the rest are the dark lines around it


def test_writes_a_page_whose_axes_all_say_their_unit(script, room, tmp_path):
    detail = script["Detail"]((72, 36), (48, 30), 100)
    figure = script["draw"](read_building(room[0]), "room", None, "wall_added", detail)
    drawn = [axes for axes in figure.axes if axes.images]
    assert len(drawn) == 6 and all("[" in axes.get_xlabel() for axes in drawn)
    assert {"x [m]", "azimuth [°], left of forward", "column [pixels]"} == {axes.get_xlabel() for axes in drawn}
    script["main"](room[0], tmp_path / "page.svg", POSE, "pillar_added", detail)
    text = (tmp_path / "page.svg").read_text()
    assert "full sphere from (-3.50, 0.50, -0.40) m" in text and "robot scan: column added" in text


def test_a_pose_outside_is_one_line(room, tmp_path):
    command = [sys.executable, "-m", "paper.building", room[0], "--out", tmp_path / "a.png", "--pose=99,0,0,0"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.startswith("paper.building: pose 99, 0, 0 is outside the building")
    assert len(done.stderr.splitlines()) == 1 and not (tmp_path / "a.png").exists()
