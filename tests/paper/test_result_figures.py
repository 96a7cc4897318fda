"""Figures of results: they show every row, and know the thesis's failures when they see them."""

import json
import re

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from jaxmm import run_folder
from jaxmm.files import write_json
from jaxmm.learning.boxes import Box
from jaxmm.learning.calibration import reliability
from jaxmm.reports import figures
from jaxmm.runs.paper.rows import BUILDINGS, ROOMS, TestScenes
from jaxmm.runs.stages import STAGES
from paper.figures import boxes as boxes_figure
from paper.figures import failures, network_rooms, studies, table
from paper.figures import reliability as reliability_figure
from paper.figures.examples import example_of
from paper.figures.failures import FAILURES, connected_walls, one_face, shadow_box, split_wall
from paper.figures.network_rooms import Found
from paper.figures.panels import COLUMNS
from paper.figures.plan import TRUE, draw_found, draw_true
from paper.report import RESULTS
from tests.cases.figure_run import far, small_config, write_networks, write_scenes, write_training

pytestmark = pytest.mark.long


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


@pytest.mark.parametrize("row, metric", [(0, "roc_auc"), (1, "precision_at_95")])
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


@pytest.fixture(scope="module")
def scored(tmp_path_factory):
    """A run with the scenes that the figure of boxes wants, and networks that call changed what is far."""
    path, config = tmp_path_factory.mktemp("scored") / "paper", small_config()
    with run_folder.open_run(path, config, staged=True):
        for name, scenario in {(case.scenes, case.scenario) for case in boxes_figure.CASES}:
            kind = BUILDINGS if name.startswith("building_") else ROOMS
            scene, condition = name.removeprefix("building_").rsplit("_", 1)
            write_scenes(path, config, TestScenes(kind, scene, condition), scenario)
        write_training(path)
        write_networks(path, config)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(figures.STYLE, "savefig.dpi", 40.0)
        patch.setattr(network_rooms, "predict", lambda network, features, _: far(features[:, -1]))
        for module in (network_rooms, failures):
            patch.setattr(module, "TRIED", 4)
        yield path


@pytest.fixture(scope="module")
def boxes_drawn(scored, tmp_path_factory):
    """The figure of boxes, and its file."""
    path = tmp_path_factory.mktemp("boxes") / "boxes.png"
    return boxes_figure.draw(scored, path), path


def boxes_of(axes):
    """How many true boxes, and how many outlines, a panel shows."""
    true = [patch for patch in axes.patches if patch.get_fill() and patch.get_facecolor() == to_rgba(TRUE)]
    return len(true), sum(not patch.get_fill() for patch in axes.patches)


def test_panels_of_boxes_show_what_their_titles_count(boxes_drawn):
    figure, path = boxes_drawn
    assert len(figure.axes) == len(boxes_figure.CASES) and path.stat().st_size > 20_000
    counts = {}
    for axes, case in zip(figure.axes, boxes_figure.CASES, strict=True):
        title, _, counted = axes.get_title().partition("\n")
        found, true = map(int, re.search(r"(\d+) box(?:es)?, (\d+) true", counted).groups())
        assert (title, (true, found)) == (case.title, boxes_of(axes)) and true >= 1
        counts[title] = found
    assert counts["pieces apart"] >= counts["pieces merged"] and sum(map(bool, counts.values())) > 6


def test_a_stretched_box_reaches_from_floor_to_ceiling(scored, boxes_drawn):
    axes = {one.get_title().split("\n")[0]: one for one in boxes_drawn[0].axes}
    seen, stretched = (
        [patch for patch in axes[title].patches if not patch.get_fill()]
        for title in ("as high as it is seen", "stretched to the room")
    )
    low, high = np.percentile(example_of(scored, "wall_added_occluded", "wall_added").points[:, 2], (1, 99))
    assert [(one.get_y(), one.get_y() + one.get_height()) for one in stretched] == [pytest.approx((low, high))]
    assert all(low <= one.get_y() and one.get_y() + one.get_height() <= high for one in seen)


def test_failures_are_drawn_beside_ours_or_told_missing(scored, tmp_path):
    figure = failures.draw(scored, tmp_path / "failures.png")
    shown = 0
    for column, failure in enumerate(FAILURES):
        above, below = figure.axes[column], figure.axes[column + len(FAILURES)]
        if not above.axison:
            assert {text.get_text() for one in (above, below) for text in one.texts} == {
                f"{failure.name}:\nin none of 4 rooms"
            }
            continue
        shown += 1
        assert above.get_title().startswith(f"thesis: {failure.name}\ntest room ")
        assert below.get_title() == "ours: default preset"
        assert boxes_of(above)[0] == boxes_of(below)[0] >= 1
        assert above.get_xlim() == below.get_xlim() and above.get_ylim() == below.get_ylim()
    assert 0 < shown and (tmp_path / "failures.png").stat().st_size > 10_000


def test_true_boxes_are_those_of_the_scene_that_is_shown(tmp_path):
    case = boxes_figure.CASES[0]._replace(scenes="pillar_added_clean", scenario="pillar_added")
    path = tmp_path / STAGES / "rooms" / case.scenes / "rooms.json"
    one = {"object_type": "pillar", "center": [1, 2, 0], "dimensions": [1, 1, 3], "rotation": 10.0}
    side = {"true_box": one, "other_boxes": [one | {"center": [4, 2, 0]}]}
    write_json(path, [{"room": 7, "place": "", "sides": {"pillar_added": side}}])
    assert [box.center[0] for box in boxes_figure.true_boxes(tmp_path, case, 7, "")] == [1, 4]
    assert boxes_figure.true_boxes(tmp_path, case, 8, "") == []


def test_joined_bins_hold_enough_and_not_more_than_needed():
    rng = np.random.default_rng(0)
    for _ in range(500):
        count = rng.integers(0, 200, 15)
        first = reliability_figure.joined(count, 300)
        runs_of = np.split(count, first[1:])
        assert first[0] == 0 and sum(map(len, runs_of)) == 15
        assert all(own.sum() >= 300 for own in runs_of) or len(runs_of) == 1
        assert all(own[:-1].sum() < 300 for own in runs_of[:-1])
    assert reliability_figure.joined(np.full(15, 300), 300) == list(range(15))


def sides_of(rng, rooms, points, together):
    """Scores of rooms whose points changed as often as predicted: each by itself, or all of a room together."""
    for _ in range(rooms):
        probability = rng.random(points)
        label = (rng.random() if together else rng.random(points)) < probability
        told = {name: value.tolist() for name, value in reliability(probability, label)._asdict().items()}
        yield {"methods": {name: {"reliability": told} for name in reliability_figure.METHODS}}


@pytest.mark.parametrize("together", [False, True])
def test_intervals_of_shares_are_as_wide_as_rooms_are_different(together):
    curve = reliability_figure.curve_of(list(sides_of(np.random.default_rng(1), 400, 150, together)), "evidence")
    assert curve.count.sum() == 400 * 150 and len(curve.count) == 15
    independent = 400 if together else curve.count
    width = 2 * 1.96 * np.sqrt(curve.predicted * (1 - curve.predicted) / independent)
    np.testing.assert_allclose(curve.found, curve.predicted, atol=width.max())
    np.testing.assert_allclose(curve.interval[1] - curve.interval[0], width, rtol=0.25)


def test_reliability_shows_both_methods_in_both_conditions(tmp_path):
    rng = np.random.default_rng(2)
    for scenario, condition in COLUMNS:
        rooms = [{"sides": {scenario: side}} for side in sides_of(rng, 20, 100, False)]
        write_json(tmp_path / STAGES / "rooms" / f"{scenario}_{condition}" / "rooms.json", rooms)
    shares, counts = reliability_figure.draw(tmp_path, tmp_path / "reliability.png").axes
    shown = [line.get_label().split(":")[0] for line in shares.lines[1:]]
    assert shown == [f"{name}, {kind}" for name in ("thesis's network", "evidence") for kind in ("clean", "occluded")]
    for line, count in zip(shares.lines[1:], counts.lines, strict=False):
        np.testing.assert_allclose(line.get_ydata(), line.get_xdata(), atol=0.1)
        assert sum(count.get_ydata()) == 4 * 20 * 100
