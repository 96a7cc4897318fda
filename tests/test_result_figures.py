"""Figures of results: they show every row, and know the thesis's failures when they see them."""

import json

import numpy as np
import pytest

from jaxmm.boxes import Box
from paper.figures import studies, table
from paper.figures.failures import FAILURES, connected_walls, one_face, shadow_box, split_wall
from paper.figures.network_rooms import Found
from paper.figures.plan import draw_found, draw_true
from paper.report import RESULTS


def found(boxes=(), true=(), changed=500):
    return Found(np.zeros((changed, 3)), np.ones(changed), np.ones(changed, bool), list(boxes), list(true))


def box(x, y, length, width, kind="wall"):
    return Box(kind, np.array([x, y, 0.0]), np.array([length, width, 3.0]))


METHODS = ("nn-raw", "rule", "evidence")
WALL = box(0.0, 0.0, 4.0, 0.2)
PILLAR = box(0.0, 0.0, 0.6, 0.6, "pillar")


@pytest.mark.parametrize(
    "shows, boxes, true, told",
    [
        (split_wall, [box(-1, 0, 1, 0.2), box(1, 0, 1, 0.2)], [WALL], True),
        (split_wall, [box(0, 0, 3.8, 0.2)], [WALL], False),
        (split_wall, [box(-1, 0, 1, 0.2), box(1, 3, 1, 0.2)], [WALL], False),
        (one_face, [box(0.25, 0.0, 0.1, 0.6, "pillar")], [PILLAR], True),
        (one_face, [box(0.05, 0.0, 0.6, 0.6, "pillar")], [PILLAR], False),
        (one_face, [], [PILLAR], False),
        (connected_walls, [], [WALL, box(2.0, 1.0, 0.2, 2.0)], True),
        (connected_walls, [], [WALL, box(6.0, 1.0, 0.2, 2.0)], False),
        (connected_walls, [WALL], [WALL, box(2.0, 1.0, 0.2, 2.0)], False),
        (connected_walls, [], [WALL], False),
        (shadow_box, [WALL, box(0, 5, 2, 0.2)], [WALL], True),
        (shadow_box, [WALL], [WALL], False),
        (shadow_box, [], [WALL], False),
    ],
)
def test_a_failure_is_known_by_its_boxes(shows, boxes, true, told):
    assert shows(found(boxes, true)) == told


def test_nothing_called_changed_is_no_failure_of_boxes():
    assert not connected_walls(found([], [WALL, box(2.0, 1.0, 0.2, 2.0)], changed=20))
    assert {failure.shows for failure in FAILURES} == {split_wall, one_face, connected_walls, shadow_box}


def test_boxes_are_drawn_where_they_are():
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    draw_true(axes, [WALL])
    draw_found(axes, [PILLAR], "removed")
    true, outline = (patch.get_path().vertices[:-1] for patch in axes.patches)
    np.testing.assert_allclose(np.ptp(true, axis=0), [4.0, 0.2])
    np.testing.assert_allclose(np.ptp(outline, axis=0), [0.6, 0.6])
    assert axes.patches[0].get_fill() and not axes.patches[1].get_fill()


def test_every_scored_row_has_the_mark_of_its_method(tmp_path):
    figure = table.draw(RESULTS, tmp_path / "table.png")
    rows = [row for row in json.loads((RESULTS / "table_1.json").read_text())["rows"] if row["label_kind"] == "true"]
    lines = [line for axes in figure.findobj(type(figure.subfigs[0].axes[0])) for line in axes.lines]
    for method, marker in {"nn-raw": "s", "rule": "D", "evidence": "o", "network": "^"}.items():
        shown = [float(line.get_xdata()[0]) for line in lines if line.get_marker() == marker]
        own = [row for row in rows if (row["method"] if row["method"] in METHODS else "network") == method]
        wanted = [row["precision_at_95"] for row in own if row["precision_at_95"] is not None]
        np.testing.assert_allclose(np.sort(shown), np.sort(wanted))
    assert (tmp_path / "table.png").stat().st_size > 50_000


@pytest.mark.parametrize("row, metric", enumerate(("roc_auc", "precision_at_95")))
def test_every_study_has_its_curves(tmp_path, row, metric):
    figure = studies.draw(RESULTS, tmp_path / "studies.png")
    rows = json.loads((RESULTS / "studies.json").read_text())["rows"]
    names = [name for name in studies.STUDIES if name in {one["study"] for one in rows}]
    assert len(figure.axes) == 2 * len(names) and len(names) == len({one["study"] for one in rows})
    for axes, name in zip(figure.axes[row * len(names) : (row + 1) * len(names)], names, strict=True):
        for method in ("evidence", "nn"):
            own = [one for one in rows if (one["study"], one["method"]) == (name, method) and one[metric] is not None]
            levels = sorted({one["level"] for one in own})
            mean = [np.mean([one[metric] for one in own if one["level"] == level]) for level in levels]
            curve = next(bars for bars in axes.containers if bars.get_label() == method).lines[0]
            np.testing.assert_allclose(np.asarray(curve.get_xdata(), float), levels)
            np.testing.assert_allclose(np.asarray(curve.get_ydata(), float), mean)
