"""Figures: the files are whole, the same bytes for the same input, and show the data they were given."""

import io
import runpy
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxmm.learning.calibration import reliability
from jaxmm.reports import figures
from jaxmm.reports.figures import curves_from_records, loss_curves, reliability_curves, save, validation_curves
from jaxmm.reports.room_figures import (
    ScoredCloud,
    best_azimuth,
    outcome_map,
    precision_recall_curve,
    probability_heatmap,
    probability_histogram,
    roc_curve,
    room_report,
)

SCENARIOS = ("pillar_added", "wall_added", "pillar_removed", "wall_removed")
DPI = 50
ROOM_FIGURES = [
    probability_heatmap,
    outcome_map,
    probability_histogram,
    precision_recall_curve,
    roc_curve,
    room_report,
]


def records():
    """Three logged steps of `nn`, of which the first and last were validated, and one of another method."""
    base = {"method": "nn", "train_loss": [0.5, 0.4, 0.3, 0.2]}
    validation = {
        "validation_loss": [0.6, 0.5, 0.4, 0.3],
        "validation_precision": [0.1, None, 0.3, float("nan")],
        "validation_recall": [0.9, 0.8, 0.7, 0.6],
    }
    return [
        base | {"step": 0} | validation,
        base | {"step": 10, "train_loss": [0.05, 0.04, 0.03, 0.02]},
        {"method": "xyz_nn", "step": 5, "train_loss": [9.0] * 4},
        base | {"step": 20} | validation,
    ]


@pytest.fixture
def curves():
    return curves_from_records(records(), "nn", SCENARIOS)


@pytest.fixture
def cloud():
    """A floor, a ceiling and a pillar, scored rightly but for four points of each kind of mistake."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-5, -5, -1.5], [5, 5, 1.5], (400, 3))
    points[:150, 2], points[150:300, 2] = -1.5, 1.5
    label = (np.arange(400) >= 350).astype(int)
    points[label == 1, :2] = rng.uniform(0, 0.4, (50, 2))
    probability = np.where(label, rng.uniform(0.7, 1.0, 400), rng.uniform(0.0, 0.5, 400))
    probability[:4], probability[-3:] = 0.9, 0.1
    probability[4] = 0.6  # on the threshold, so counted as changed
    return ScoredCloud(points, probability, label)


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Few pixels, for speed."""
    monkeypatch.setitem(figures.STYLE, "savefig.dpi", DPI)


def decoded(path):
    return matplotlib.image.imread(io.BytesIO(path.read_bytes()), format="png")


def test_curves_take_one_method_and_mark_missing_values(curves):
    np.testing.assert_array_equal(curves.step, [0, 10, 20])
    np.testing.assert_array_equal(curves.train_loss[1], [0.05, 0.04, 0.03, 0.02])
    np.testing.assert_array_equal(curves.validation_step, [0, 20])
    np.testing.assert_array_equal(curves.validation_precision, [[0.1, np.nan, 0.3, np.nan]] * 2)


def test_curves_come_in_order_and_a_step_logged_again_counts_as_last_logged():
    again = [*reversed(records()), {"method": "nn", "step": 10, "train_loss": [1.0] * 4}]
    curves = curves_from_records(again, "nn", SCENARIOS)
    np.testing.assert_array_equal(curves.step, [0, 10, 20])
    np.testing.assert_array_equal(curves.train_loss[1], [1.0] * 4)


def test_curves_name_what_is_wrong():
    with pytest.raises(ValueError, match="method 'rule'"):
        curves_from_records(records(), "rule", SCENARIOS)
    with pytest.raises(ValueError, match="train_loss of step 0 must have 3 values, got 4"):
        curves_from_records(records(), "nn", SCENARIOS[:3])


def test_curves_without_any_validation_can_be_drawn(tmp_path):
    curves = curves_from_records([{"method": "nn", "step": 0, "train_loss": [1.0] * 4}], "nn", SCENARIOS)
    assert curves.validation_loss.shape == (0, 4)
    loss_curves(curves, tmp_path / "loss.png")
    validation_curves(curves, tmp_path / "validation.png")


def test_loss_panels_show_their_scenario_on_a_logarithmic_scale(curves, tmp_path):
    panels = loss_curves(curves, tmp_path / "loss.png").axes
    assert [axes.get_title() for axes in panels] == [name.replace("_", " ") for name in SCENARIOS]
    for index, axes in enumerate(panels):
        training, validation = axes.lines
        np.testing.assert_array_equal(
            training.get_xydata(), np.column_stack([curves.step, curves.train_loss[:, index]])
        )
        np.testing.assert_array_equal(validation.get_ydata(), curves.validation_loss[:, index])
        assert axes.get_yscale() == "log"


def test_validation_panels_show_precision_and_recall(curves, tmp_path):
    panels = validation_curves(curves, tmp_path / "validation.png").axes
    for index, axes in enumerate(panels):
        precision, recall = axes.lines
        np.testing.assert_array_equal(precision.get_ydata(), curves.validation_precision[:, index])
        np.testing.assert_array_equal(recall.get_ydata(), curves.validation_recall[:, index])


@pytest.mark.parametrize("draw", ROOM_FIGURES)
def test_room_figures_decode_at_their_size_and_repeat_to_the_byte(draw, cloud, tmp_path):
    first, second = tmp_path / "first.png", tmp_path / "new folder" / "second.png"
    figure = draw(cloud, first, "nn · pillar added, clean")
    draw(cloud, second, "nn · pillar added, clean")
    assert first.read_bytes() == second.read_bytes()
    width, height = figure.get_size_inches() * DPI
    pixels = decoded(first)
    assert pixels.shape[:2] == (round(height), round(width))
    assert len(np.unique(pixels.reshape(-1, pixels.shape[-1]), axis=0)) > 20  # not a blank page
    assert figure.get_suptitle() == "nn · pillar added, clean"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first.png", "new folder"]


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_training_figures_repeat_to_the_byte_in_every_format(suffix, curves, tmp_path):
    one, two = tmp_path / f"one{suffix}", tmp_path / f"two{suffix}"
    loss_curves(curves, one)
    loss_curves(curves, two)
    assert one.read_bytes() == two.read_bytes()
    assert len(one.read_bytes()) > 2_000
    assert b"Matplotlib v" not in one.read_bytes()


def test_the_users_own_style_changes_nothing(curves, tmp_path):
    loss_curves(curves, tmp_path / "ours.png")
    with figures.style.context({"font.size": 30, "lines.linewidth": 9, "axes.facecolor": "red"}):
        loss_curves(curves, tmp_path / "theirs.png")
    assert (tmp_path / "ours.png").read_bytes() == (tmp_path / "theirs.png").read_bytes()


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_a_failed_save_leaves_the_older_file_and_nothing_else(error, tmp_path, monkeypatch):
    path = tmp_path / "figure.png"
    path.write_bytes(b"older")

    def half_written(self, target, **options):
        target.write_bytes(b"half")
        raise error

    monkeypatch.setattr(Figure, "savefig", half_written)
    with pytest.raises(type(error)):
        save(Figure(), path)
    assert path.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [path]


def test_unknown_format_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"figure\.bmp: the suffix .* got '\.bmp'"):
        save(Figure(), tmp_path / "figure.bmp")


def test_outcome_map_counts_and_colours_what_it_draws(cloud, tmp_path):
    figure = outcome_map(cloud, tmp_path / "map.png", threshold=0.6)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["true negative: 345", "true positive: 47", "false positive: 5", "false negative: 3"]
    (axes,) = figure.axes
    drawn = {collection.get_label().split(":")[0]: collection for collection in axes.collections}
    x, y, z = drawn["false positive"]._offsets3d
    np.testing.assert_allclose(np.column_stack([x, y, z]), cloud.points[:5])
    assert len(drawn["false negative"]._offsets3d[0]) == 3
    assert np.max(drawn["true negative"]._offsets3d[2]) < 1.5 - 0.1  # no lid on the room


def test_wrong_points_on_the_ceiling_are_drawn_although_the_ceiling_is_not(cloud, tmp_path):
    cloud.probability[200] = 1.0  # on the ceiling
    figure = outcome_map(cloud, tmp_path / "map.png")
    (wrong,) = [item for item in figure.axes[0].collections if item.get_label().startswith("false positive")]
    assert np.sum(wrong._offsets3d[2] == 1.5) == 1


def test_heatmap_is_coloured_by_probability_over_the_whole_range(cloud, tmp_path):
    figure = probability_heatmap(cloud, tmp_path / "heat.png")
    (image,) = figure.axes[0].collections
    shown = (cloud.probability >= 0.6) | (cloud.label == 1) | (cloud.points[:, 2] < 1.35)
    np.testing.assert_array_equal(image.get_array(), cloud.probability[shown])
    assert image.get_clim() == (0.0, 1.0)
    assert figure.axes[1].get_ylabel() == "probability"
    assert figure.axes[0].get_xlabel() == "x [m]"


def test_histogram_holds_every_point_once(cloud, tmp_path):
    (axes,) = probability_histogram(cloud, tmp_path / "histogram.png").axes
    unchanged, changed = (patch.get_data().values for patch in axes.patches[::2])  # each is filled, then outlined
    assert (unchanged.sum(), changed.sum()) == (350, 50)
    edges = np.linspace(0, 1, 41)
    np.testing.assert_array_equal(changed, np.histogram(cloud.probability[cloud.label == 1], edges)[0])
    texts = {text.get_text() for text in axes.get_legend().get_texts()}
    assert texts == {"unchanged: 350", "changed: 50", "threshold 0.6"}
    assert axes.get_yscale() == "log"


def test_scores_other_than_probabilities_set_their_own_range(cloud, tmp_path):
    distance = cloud._replace(probability=3.0 * cloud.probability, score_name="NN distance [m]")
    figure = probability_heatmap(distance, tmp_path / "heat.png", threshold=0.09)
    assert figure.axes[0].collections[0].get_clim() == (0.0, distance.probability.max())
    (axes,) = probability_histogram(distance, tmp_path / "histogram.png", threshold=0.09).axes
    assert axes.get_xlabel() == "NN distance [m]"


def test_curves_of_a_known_ranking(tmp_path):
    # Ranked + + - + -: average precision (1 + 1 + 3/4) / 3, area 5/6; all recalled at the fourth, one of two wrong.
    cloud = ScoredCloud(np.zeros((5, 3)), np.array([0.9, 0.8, 0.7, 0.6, 0.1]), np.array([1, 1, 0, 1, 0]))
    (axes,) = precision_recall_curve(cloud, tmp_path / "pr.png").axes
    texts = [text.get_text() for text in axes.get_legend().get_texts()]
    assert texts[0] == f"average precision {11 / 12:.4f}"
    assert texts[2] == "95% recall: precision 0.7500\n(threshold 0.6)"
    (axes,) = roc_curve(cloud, tmp_path / "roc.png").axes
    texts = [text.get_text() for text in axes.get_legend().get_texts()]
    assert texts[0] == f"area {5 / 6:.4f}"
    assert texts[2] == "95% recall: false positives 50.00%"
    np.testing.assert_array_equal(axes.lines[2].get_xydata(), [[0.5, 1.0]])


@pytest.mark.parametrize("label, text", [(0, "no point is changed"), (1, "every point is changed")])
def test_a_room_of_one_class_says_so_instead_of_failing(label, text, cloud, tmp_path):
    figure = room_report(cloud._replace(label=np.full(400, label)), tmp_path / "report.png")
    assert sum(text in note.get_text() for axes in figure.axes for note in axes.texts) == 2


def test_room_report_joins_all_views(cloud, tmp_path):
    titles = {axes.get_title() for axes in room_report(cloud, tmp_path / "report.png").axes}
    expected = {"probability, ceiling left out", "changed where probability ≥ 0.6", "scores by true class"}
    assert titles >= expected | {"precision and recall", "receiver operating characteristic"}


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_view_is_from_the_side_where_nothing_hides_the_changed_points(side):
    y, z = (array.ravel() for array in np.meshgrid(np.arange(-3, 3, 0.05), np.arange(-1.5, 1.5, 0.05)))
    changed = np.column_stack([np.full_like(y, side), y, z])[::7]
    wall = np.column_stack([np.full_like(y, -side), y, z])
    notable = np.arange(len(wall) + len(changed)) >= len(wall)
    azimuth = best_azimuth(np.concatenate([wall, changed]), notable)
    assert np.cos(np.radians(azimuth)) * side > 0


@pytest.mark.parametrize(
    "change, message",
    [
        ({"points": np.zeros((0, 3))}, r"points must be \(N >= 1, 3\), got \(0, 3\)"),
        ({"probability": np.zeros(3)}, r"probability must be \(400,\)"),
        ({"label": np.full(400, 2)}, "label must be 0 or 1"),
        ({"probability": np.full(400, np.nan)}, "must be finite"),
    ],
)
@pytest.mark.parametrize("draw", [roc_curve, room_report])
def test_bad_clouds_are_named_and_nothing_is_written(draw, change, message, cloud, tmp_path):
    with pytest.raises(ValueError, match=message):
        draw(cloud._replace(**change), tmp_path / "figure.png")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def story():
    return runpy.run_path(str(Path(__file__).parents[2] / "paper" / "story.py"))


def test_story_repeats_to_the_byte(story, tmp_path):
    for name in ("one.png", "two.png"):
        story["main"](tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


@pytest.mark.parametrize("block, sign", [("REMOVED", 1), ("PRESENT", 0), ("HIDDEN", -1)])
def test_story_rays_find_what_its_labels_say(block, sign, story):
    sensor, target = story["SENSOR"], story[block]
    corners = np.array([[target.x, target.y + share * target.depth] for share in np.linspace(0.1, 0.9, 9)])
    direction = (corners - sensor) / np.linalg.norm(corners - sensor, axis=1, keepdims=True)
    prior, real = (story["cast"](direction, story[name]) for name in ("PRIOR", "REAL"))
    np.testing.assert_allclose(prior, np.linalg.norm(corners - sensor, axis=1))
    assert np.all(np.sign(np.round(real - prior, 6)) == sign)


def test_reliability_shows_frequencies_over_probabilities(tmp_path):
    rng = np.random.default_rng(3)
    probability = rng.random(50_000)
    sums = {
        "honest": reliability(probability, rng.random(50_000) < probability),
        "boastful": reliability(probability, rng.random(50_000) < probability / 2),
    }
    figure = reliability_curves(sums, tmp_path / "a.png", "title")
    _, honest, boastful = figure.axes[0].get_lines()
    np.testing.assert_allclose(honest.get_ydata(), honest.get_xdata(), atol=0.05)
    np.testing.assert_allclose(boastful.get_ydata(), boastful.get_xdata() / 2, atol=0.05)
    told = [text.get_text() for text in figure.legends[0].get_texts()]
    assert told[1].startswith("honest: ECE 0.0") and told[2].startswith("boastful: ECE 0.2")
    reliability_curves(sums, tmp_path / "b.png", "title")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
