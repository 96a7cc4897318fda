"""The figures of the paper on data and learning: they draw from a run folder, and show what its arrays hold."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from sklearn import metrics

from jaxmm import run_folder
from jaxmm.config import CONDITIONS, SCENARIOS
from jaxmm.learning.network import PointNetwork
from jaxmm.reports import figures, room_figures
from jaxmm.reports.room_figures import ScoredCloud
from jaxmm.runs.paper.rows import ROOMS, TestScenes, needed_models
from paper.figures import __main__ as folder
from paper.figures import curves, network, outcomes, threshold_curves, verdicts
from paper.figures import object_filter as filter_figure
from paper.figures.examples import example_of, raw_pair, training_curves
from paper.figures.panels import COLUMNS, METHODS, few, mixed
from tests.cases.figure_run import small_config, write_scenes, write_training
from warp_scanner.scenes.scenes import STRUCTURE

pytestmark = pytest.mark.long

FROM_ROOMS = (
    "curves", "evidence_maps", "heatmaps", "histograms", "instances", "labels", "network", "object_filter", "outcomes",
    "raw_pairs", "scenario_rooms", "threshold_curves", "voxels",
)  # fmt: skip
FROM_TRAINING = ("losses", "validation")
ELSEWHERE = ("boxes", "failures", "reliability", "studies", "table", "verdicts")  # drawn in tests of their own


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A run folder with one example of every set that the figures want, and made-up records; nothing was trained."""
    path, config = tmp_path_factory.mktemp("run") / "paper", small_config()
    with run_folder.open_run(path, config, staged=True):
        for scenario, condition in COLUMNS:
            write_scenes(path, config, TestScenes(ROOMS, scenario, condition), scenario)
        write_training(path)
    return path


@pytest.fixture(scope="module")
def drawn(run, tmp_path_factory):
    """Every figure by name, drawn once, in few pixels and from one side; beside their files."""
    target, scripts = tmp_path_factory.mktemp("figures"), folder.figure_scripts()
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(figures.STYLE, "savefig.dpi", 30.0)
        patch.setattr(room_figures, "best_azimuth", lambda points, notable: 37.5)
        made = {name: scripts[name](run, target / f"{name}.png") for name in (*FROM_ROOMS, *FROM_TRAINING)}
    return made, target


def test_every_script_is_drawn_by_some_test():
    assert sorted((*FROM_ROOMS, *FROM_TRAINING, *ELSEWHERE)) == sorted(folder.figure_scripts())


def titles_of(figure):
    return [axes.get_title() for axes in figure.axes]


@pytest.mark.parametrize("name", [*FROM_ROOMS, *FROM_TRAINING])
def test_every_figure_is_an_image_with_something_on_it(drawn, name):
    from matplotlib.image import imread

    picture = imread(drawn[1] / f"{name}.png")[:, :, :3]
    share = np.mean(picture.min(axis=2) < 0.98)
    assert min(picture.shape[:2]) > 100 and 0.01 < share < 0.9


@pytest.mark.parametrize("name", [name for name in FROM_ROOMS if name != "network"])
def test_every_scenario_has_its_panels(drawn, name):
    conditions = ("occluded",) if name in ("labels", "object_filter") else CONDITIONS
    titles = " ".join(titles_of(drawn[0][name]))
    for scenario in SCENARIOS:
        for condition in conditions:
            assert f"{scenario.replace('_', ' ')}, {condition}" in titles


def test_points_of_an_example_are_raw_points_bit_by_bit(run):
    for scenario, condition in COLUMNS:
        example = example_of(run, f"{scenario}_{condition}", scenario)
        pair = raw_pair(run, scenario, condition, example.room)
        for raw, kept in ((pair.dt, example.dt), (pair.robot, example.robot)):
            assert 0 < len(kept) < len(raw.points)
            assert {*map(bytes, kept)} <= {*map(bytes, raw.points)}
        changed = pair.dt if scenario.endswith("removed") else pair.robot
        assert {*map(bytes, example.points[example.true])} <= {*map(bytes, changed.points[changed.changed])}


def test_outcomes_told_are_those_of_a_confusion_matrix(run, drawn):
    told = titles_of(drawn[0]["outcomes"])
    for scenario, condition in COLUMNS:
        for method, words in METHODS.items():
            cloud = example_of(run, f"{scenario}_{condition}", scenario).scored(method)
            (tn, fp), (fn, tp) = metrics.confusion_matrix(cloud.label, cloud.probability >= 0.6, labels=[False, True])
            counts = f"TN {tn:,}  TP {tp:,}  FP {fp:,}  FN {fn:,}"
            (own,) = [t for t in told if words in t and f"{scenario.replace('_', ' ')}, {condition}" in t]
            assert own.endswith(counts)
            assert np.sum([*outcomes.outcomes(cloud).values()], axis=0).tolist() == [1] * len(cloud.points)


def test_threshold_curves_hit_sklearn(run):
    for scenario, condition in COLUMNS:
        for method in METHODS:
            cloud = example_of(run, f"{scenario}_{condition}", scenario).scored(method)
            curve = threshold_curves.curve_of(cloud)
            for at in (0, 40, 100, 150, 199):
                called = cloud.probability >= threshold_curves.THRESHOLDS[at]
                right = metrics.precision_recall_fscore_support(
                    cloud.label, called, average="binary", zero_division=np.nan
                )
                assert (curve.precision[at], curve.recall[at]) == pytest.approx(right[:2], nan_ok=True)
                assert not called.any() or curve.f1[at] == pytest.approx(right[2])


def test_a_score_that_equals_a_threshold_counts_as_changed():
    scores = threshold_curves.THRESHOLDS[[39, 99]]
    curve = threshold_curves.curve_of(ScoredCloud(np.zeros((2, 3)), scores, np.array([False, True])))
    assert curve.precision[[39, 40, 99]].tolist() == [0.5, 1.0, 1.0] and np.isnan(curve.precision[100])
    assert curve.recall[[39, 99, 100]].tolist() == [1.0, 1.0, 0.0]


def test_curves_tell_areas_of_sklearn(run, drawn):
    for axes in drawn[0]["curves"].axes:
        title = axes.get_title()
        scenario, condition = re.match(r"(\w+ \w+), (\w+)", title).groups()
        scenario = scenario.replace(" ", "_")
        score = metrics.roc_auc_score if "ROC" in title else metrics.average_precision_score
        told = [text.get_text() for text in axes.get_legend().get_texts()]
        for method, text in zip(curves.LOOKS, told, strict=True):
            cloud = example_of(run, f"{scenario}_{condition}", scenario).scored(method)
            assert float(text.rsplit(maxsplit=1)[1]) == pytest.approx(score(cloud.label, cloud.probability), abs=6e-5)


def test_filtered_furniture_is_told_from_what_the_filter_cannot_know(run):
    dropped = 0
    for scenario in SCENARIOS:
        room = example_of(run, f"{scenario}_occluded", scenario).room
        robot = raw_pair(run, scenario, "occluded", room).robot
        pair = raw_pair(run, scenario, "occluded", room)
        kind, structure = filter_figure.kinds_of(pair), np.isin(robot.semantic, STRUCTURE)
        np.testing.assert_array_equal(np.isin(kind, (0, 3)), structure)
        np.testing.assert_array_equal(np.isin(kind, (0, 2)), filter_figure.kept_of(pair))
        dropped += np.sum(kind == 1)
        left = {*map(bytes, example_of(run, f"{scenario}_occluded", scenario).robot)}
        assert left <= {*map(bytes, robot.points[filter_figure.kept_of(pair)])}
        low = [robot.points[robot.element == one, 2].max() for one in np.unique(robot.element[kind == 1])]
        assert np.all(np.array(low) + pair.pairs.size[0, 2] / 2 < 2.0)
    assert dropped > 0


def test_blocks_of_the_network_have_the_shapes_of_the_network(run):
    """Every width that the figure tells is that of a kernel of the network, in the order of its layers."""
    import jax

    settings = run_folder.read_config(run).network
    clouds = np.zeros((1, 8, 4), np.float32), np.ones((1, 8), bool)
    net = jax.vmap(
        lambda x, mask: PointNetwork(settings).init(jax.random.key(0), x, mask, train=False)["params"],
        axis_name="clouds",
    )
    layers = {name: part["kernel"].shape[1:] for name, part in jax.eval_shape(net, *clouds).items() if "conv" in name}
    above, below = network.blocks_of(settings, 4)
    encoder = [above[0].shape] + [block.shape for block in above if block.kind == "layer"]
    head = [below[0].shape] + [block.shape for block in below if block.kind == "head"]
    width = [[int(n) for n in re.findall(r"\d+", " ".join(shapes))] for shapes in (encoder, head)]
    width[1].append(1)  # a logit for every point
    told = [pair for row in width for pair in itertools.pairwise(row)]
    order = sorted(layers, key=lambda name: (name.startswith("seg"), name))
    assert told == [layers[name] for name in order]
    assert above[-1].shape == f"({settings.encoder[-1]},)"


def test_training_curves_are_those_of_the_entries_asked_for(run, drawn):
    entries = [f"{name}/{scenario}" for name, scenario in needed_models()]
    for training in ("xyz_nn", "nn"):
        expected = [entries.index(f"{training}/{scenario}") + 1 for scenario in SCENARIOS]
        curve = training_curves(run, training)
        np.testing.assert_allclose(curve.train_loss * curve.step[:, None], [expected] * 2)
        np.testing.assert_allclose(curve.validation_recall * curve.step[:, None] * 4, [expected] * 2)
    lines = [axes.lines[0].get_ydata() for axes in drawn[0]["losses"].axes]
    np.testing.assert_allclose(lines, training_curves(run, "xyz_nn").train_loss.T)


def test_mixed_clouds_keep_their_colours():
    for count in ((50, 300), (300, 50)):
        points, color = mixed({"a": np.zeros((count[0], 3)), "b": np.ones((count[1], 3))}, most=200)
        assert [np.sum(color == name) for name in "ab"] == np.minimum(count, 100).tolist()
        np.testing.assert_array_equal(points[:, 0] == 1, color == "b")
    assert len(np.unique(few(500, 100))) == 100


def test_verdicts_are_drawn_of_the_first_room_that_has_all_kinds_or_the_last_that_was_tried(run, tmp_path, monkeypatch):
    monkeypatch.setattr(verdicts, "TRIED", 2)
    figure = verdicts.draw(run, tmp_path / "verdicts.png")
    told = {text.get_text() for legend in figure.legends for text in legend.get_texts()}
    assert {"present", "sensor and its heading"} <= told and (tmp_path / "verdicts.png").stat().st_size > 5_000
