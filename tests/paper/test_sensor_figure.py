"""The figure of the sensors shows what was scanned: no point lies in front of the room that is drawn behind it."""

import runpy
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="module")
def figure():
    return runpy.run_path(str(Path(__file__).parents[2] / "paper" / "sensors.py"))


def test_the_drawing_is_the_surface_that_the_points_lie_on(figure):
    room = figure["make_room"]()
    figure["render"].__globals__["PIXEL"] = 0.05
    drawing = figure["render"](room)
    left, right, bottom, top = drawing.extent
    height, width = drawing.depth.shape
    np.testing.assert_allclose(room.view @ room.view.T, np.eye(3), atol=1e-12)
    scan, points = figure["scan_of"](room, "velodyne-16")
    kept = ~np.isin(scan.element[0], figure["LEFT_OUT"]) & np.isfinite(scan.distance[0])
    x, y, depth = room.view @ points[kept].T
    row = np.floor((top - y) / (top - bottom) * height).astype(int)
    column = np.floor((x - left) / (right - left) * width).astype(int)
    behind = depth - drawing.depth[row, column]
    # Half a pixel beside an edge the drawing may show what lies behind it.
    assert np.mean(behind > -0.15) > 0.98
    assert np.mean(np.abs(behind) < 0.15) > 0.3


def test_elements_of_a_class_differ_in_lightness_alone(figure):
    import colorsys

    wall = np.full(6, 3, np.uint8)
    hue = [colorsys.rgb_to_hls(*color) for color in figure["colors_of"](np.arange(6), wall)]
    np.testing.assert_allclose([h for h, _, _ in hue], hue[0][0], atol=1e-6)
    assert len({round(lightness, 3) for _, lightness, _ in hue}) == 6
