"""Settings: every default stands once, and whatever a file says wrongly ends as one line that says where."""

import dataclasses
import re
from pathlib import Path

import pytest
import tomli_w

from jaxmm import run_folder
from jaxmm.config import CONDITIONS, MULTI_SCENARIOS, SCENARIOS, SCENES, Config, ConfigError, NetworkConfig, load, parse
from jaxmm.data import simulator_settings
from jaxmm.learning.shards import MOST_CHANGES
from warp_scanner.rooms import scenarios
from warp_scanner.rooms.pairs import PRESETS
from warp_scanner.scenes import scenes
from warp_scanner.sensors.sensors import OAK_D_PRO, Pinhole, sensor_named

FOLDER = Path(__file__).resolve().parents[1] / "configs"
SECTIONS = ("data", "scan", "preprocess", "network", "loss", "train", "evaluate")


def test_an_empty_file_gives_the_thesis_settings():
    config = parse("", "empty.toml")
    assert config == Config()
    assert config.network == NetworkConfig((64, 128, 256, 512), (256, 128), 0.3)
    assert (config.train.learning_rate, config.train.weight_decay, config.train.batch_size) == (5e-5, 1e-4, 8)
    assert (config.loss.form, config.loss.alpha, config.loss.gamma) == ("released", 10.0, 2.0)
    assert (config.preprocess.voxel_size, config.preprocess.label_distance) == (0.1, 0.09)
    assert (config.preprocess.object_filter, config.preprocess.filter_height) == ("height", 2.0)
    assert not config.preprocess.outlier_removal and config.evaluate.threshold == 0.6


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_configs_are_valid_and_open_with_how_to_run_them(path):
    simulator_settings.load_config(path)
    opening = path.read_text().partition("\n\n")[0]
    assert opening.startswith("#") and re.search(rf"jaxmm (reproduce|generate|train) configs/{path.name}", opening)


def test_a_file_changes_what_it_names_and_nothing_else():
    text = "seed = 7\n[train]\nmethods = ['nn']\nlearning_rate = 1\n[room]\nsize = [8.0, 8, 3]\n"
    config = parse(text, "some.toml")
    assert config.seed == 7 and config.train.methods == ("nn",) and config.room == (("size", (8.0, 8, 3)),)
    assert type(config.train.learning_rate) is float  # a whole number is as good
    train = dataclasses.replace(Config().train, methods=("nn",), learning_rate=1.0)
    assert config == dataclasses.replace(Config(), seed=7, train=train, room=config.room)
    assert hash(config) == hash(parse(text, "other.toml"))


def test_settings_written_to_a_run_folder_read_back_equal():
    text = "seed = 3\n[room]\nsize = [8.0, 9.0, 3.0]\nwall_count_x = [1, 1]\n[network]\nencoder = [4]\ndropout = 0\n"
    for config in (Config(), parse(text, "some.toml")):
        assert parse(tomli_w.dumps(run_folder.as_table(config)), "again.toml") == config


@pytest.mark.parametrize(
    "text, words",
    [
        pytest.param("sead = 1", ["unknown sead", "seed"], id="unknown key"),
        pytest.param("[train]\nsteps = 1", ["train: unknown steps", "step_count"], id="unknown key in a table"),
        pytest.param("[wat]\nx = 1", ["unknown wat"], id="unknown table"),
        pytest.param("seed = 'a'", ["seed: expected int, got 'a'"], id="text for a number"),
        pytest.param("seed = true", ["seed: expected int, got True"], id="true is no whole number"),
        pytest.param("[evaluate]\nthreshold = true", ["threshold: expected float"], id="true is no number"),
        pytest.param(
            "[preprocess]\noutlier_removal = 1", ["outlier_removal: expected bool, got 1"], id="1 is not true"
        ),
        pytest.param("[train]\nstep_count = 1.0", ["step_count: expected int, got 1.0"], id="1.0 is no whole number"),
        pytest.param("[train]\nstep_count = 0", ["train: step_count: expected from 1 to 1e+09, got 0"], id="too small"),
        pytest.param(f"[train]\nstep_count = {10**400}", ["step_count: expected from 1"], id="too many steps"),
        pytest.param(f"[network]\nhead = [{10**400}]", ["head: expected from 1 to 16384"], id="too wide"),
        pytest.param(f"[train]\nstep_count = 0x{'f' * 5000}", ["thousands of digits"], id="a number nobody can write"),
        pytest.param(f"[network]\nhead = {[64] * 65}", ["network", "at most 64"], id="too many layers"),
        pytest.param(f"seed = '{'a' * 5000}'", ["seed: expected int, got 'aaa"], id="a long text"),
        pytest.param(f"{'a' * 5000} = 1", ["unknown aaa"], id="a long key"),
        pytest.param("[train]\nlearning_rate = -1e-9", ["from 0 to 1, got -1e-09"], id="below zero"),
        pytest.param("[train]\nlearning_rate = nan", ["learning_rate", "got nan"], id="nan"),
        pytest.param("[loss]\nalpha = inf", ["loss: alpha", "got inf"], id="infinity"),
        pytest.param(f"[loss]\nalpha = {10**400}", ["loss: alpha"], id="too large for a float"),
        pytest.param(f"seed = {'9' * 5000}", ["not valid TOML"], id="a number of 5000 digits"),
        pytest.param("seed = -1", ["seed: expected from 0"], id="negative seed"),
        pytest.param("[network]\nencoder = 64", ["encoder: expected a list, got 64"], id="no list"),
        pytest.param("[network]\nencoder = [64, 'x']", ["encoder: expected int, got 'x'"], id="text in a list"),
        pytest.param("[network]\nencoder = [64, 0]", ["encoder: expected from 1 to 16384, got 0"], id="an empty layer"),
        pytest.param("[network]\nhead = []", ["network: encoder and head"], id="no layer"),
        pytest.param("[network]\ndropout = 1.0", ["dropout: expected from 0 to 0.99"], id="drop everything"),
        pytest.param("train = 3", ["train: expected a table, got 3"], id="no table"),
        pytest.param("room = 3", ["room: expected a table, got 3"], id="no room table"),
        pytest.param("[preprocess]\nobject_filter = 'all'", ["none, mixed, got 'all'"], id="another word"),
        pytest.param("[train]\nlabels = 'both'", ["heuristic, true, object, got 'both'"], id="other labels"),
        pytest.param("[train]\nmethods = ['knn']", ["train: methods", "xyz_nn", "got ['knn']"], id="other method"),
        pytest.param("[train]\nmethods = []", ["methods", "at least one"], id="no method"),
        pytest.param("[train]\nmethods = ['nn', 'nn']", ["each method once"], id="a method twice"),
        pytest.param("[train]\naugment = ['x']", ["augment", "x"], id="augment an unknown method"),
        pytest.param("[data]\ntrain_seed = 3", ["data: ", "must differ, got (3, 2, 3)"], id="test rooms to train on"),
        pytest.param("[loss]\nform = 'balanced'", ["alpha must lie in [0, 1]", "got 10.0"], id="unbounded loss"),
        pytest.param("seed = ", ["not valid TOML"], id="broken TOML"),
        pytest.param(f"seed = {'[' * 5000}", ["not valid TOML"], id="too deep"),
    ],
)
def test_bad_settings_are_refused_in_one_line_that_names_file_and_key(tmp_path, text, words):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message and message.count(str(path)) == 1
    assert len(message) < len(str(path)) + 600
    for word in words:
        assert word in message, message


@pytest.mark.parametrize(
    "text, words",
    [
        pytest.param("[room]\nwidth = 3", ["room: unknown width", "wall_count_x"], id="unknown"),
        pytest.param("[room]\nsize = 3", ["room: size", "got 3"], id="a number for three"),
        pytest.param("[room]\nsize = [3, 3]", ["room: size", "got (3, 3)"], id="two numbers for three"),
        pytest.param("[room]\nsize = [[3, 3], 3, 3]", ["room: size"], id="ragged"),
        pytest.param("[room]\nsize = ['a', 'b', 'c']", ["room: size"], id="text"),
        pytest.param("[room]\nsize = [nan, 10.0, 3.0]", ["room: size"], id="nan"),
        pytest.param("[room]\nsize = [inf, 10.0, 3.0]", ["room: size"], id="infinity"),
        pytest.param("[room]\nsize = [10.0, 10.0, -3.0]", ["room"], id="negative"),
        pytest.param("[room]\ndoor_height = true", ["room: door_height"], id="true is no number"),
        pytest.param("[room]\ndoor_height = {a = 1}", ["room: door_height"], id="a table"),
        pytest.param("[room]\nwall_count_x = [0.5, 1.5]", ["room: wall_count_x"], id="half a wall"),
        pytest.param("[room]\npillar_width = [1.3, 0.3]", ["room", "pillar_width"], id="upside down"),
        pytest.param("[scan]\nrange_noise = true", ["scan: range_noise"], id="true is no noise"),
        pytest.param("[scan]\nrange_noise = -1", ["scan: range_noise", "-1"], id="negative noise"),
        pytest.param("[scan]\nwidth = 0", ["scan: sensor width", "got 0"], id="no pixels"),
        pytest.param("[scan]\nwidth = 1.5", ["scan: width: expected int, got 1.5"], id="half a pixel"),
        pytest.param("[scan]\nsensor = 'tls'\nwidth = 64", ["scan: width: expected only with a pinhole"], id="pixels"),
        pytest.param(
            "[scan]\npreset = 'house'", ["scan: preset: expected one of thesis, varied, got 'house'"], id="preset"
        ),
        pytest.param("[scan]\nsensor = 'kinect'", ["scan: sensor", "oak-d-pro", "got 'kinect'"], id="sensor"),
        pytest.param("[scan]\nsensor = 3", ["scan: sensor", "got 3"], id="a number for a sensor"),
        pytest.param(
            "[scan.sensor]\nkind = 'pinhole'\nwidth = 4", ["scan: sensor: missing height"], id="half a sensor"
        ),
        pytest.param("[scan]\nseed = 3", ["scan: unknown seed"], id="the seed has its own place"),
        pytest.param("[scan]\ntouching = 'ground'", ["scan: touching", "'ground'"], id="touching"),
        pytest.param("[scan]\ntouching = 3", ["scan: touching", "got 3"], id="a number for a word"),
        pytest.param("[scan]\nposition_error = [1, 2]", ["scan: position_error"], id="two errors"),
        pytest.param("scan = 3", ["scan: expected a table, got 3"], id="no scan table"),
        pytest.param("[scan]\nsensor_height = 2.4\n[room]\nsize = [9.0, 9.0, 2.3]", ["sensor_height"], id="no air"),
    ],
)
def test_bad_room_settings_are_refused_too(tmp_path, text, words):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        simulator_settings.load_config(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_the_scan_table_sets_preset_sensor_and_every_field_of_a_pair():
    text = """[scan]
    preset = "varied"
    sensor_height = 1.4
    position_error = 0.02
    prior_furniture = "moved"
    [scan.sensor]
    kind = "spinning"
    channels = 8
    azimuth_steps = 90
    elevation_range = [-20, 20]
    [scan.sensor.imperfections]
    noise = 0.02
    [scan.sensor.imperfections.class_dropout]
    door = 0.5
    [room]
    wall_count_x = [1, 1]
    """
    config = parse(text, "some.toml")
    source = simulator_settings.CloudSource("wall_added", "all_four", "occluded", 5)
    pair = simulator_settings.pair_config(config, source)
    start = PRESETS["varied"]
    assert (pair.seed, pair.scenario, pair.condition) == (5, "all_four", "occluded")
    assert (pair.sensor_height, pair.position_error, pair.prior_furniture) == (1.4, 0.02, "moved")
    assert pair.sensor_pitch_spread == start.sensor_pitch_spread  # what the file does not name is the preset's
    assert pair.room == dataclasses.replace(start.room, wall_count_x=(1, 1))
    assert pair.sensor.shape == (8, 90) and pair.sensor.imperfections.class_dropout == ((scenes.DOOR, 0.5),)
    again = parse(tomli_w.dumps(run_folder.as_table(config)), "again.toml")
    assert again == config and hash(again) == hash(config)


def test_the_default_scan_is_the_thesis_preset():
    source = simulator_settings.CloudSource("pillar_added", "pillar_added", "clean", 3)
    assert simulator_settings.pair_config(Config(), source) == dataclasses.replace(PRESETS["thesis"], seed=3)
    small = parse("[scan]\nwidth = 64\nheight = 40\n", "small.toml")
    assert simulator_settings.pair_config(small, source).sensor == Pinhole(64, 40, range_limits=OAK_D_PRO.range_limits)
    real = parse("[scan]\nsensor = 'velodyne-16-real'\n", "real.toml")
    assert simulator_settings.pair_config(real, source).sensor == sensor_named("velodyne-16-real")
    assert "noise 0.015" in simulator_settings.errors_of(real) and simulator_settings.errors_of(small) == "none"


def test_scenarios_have_the_names_of_the_simulator():
    assert (SCENARIOS, CONDITIONS) == (scenarios.SCENARIOS, scenarios.CONDITIONS)
    assert scenarios.MULTI_SCENARIOS == MULTI_SCENARIOS
    assert all(len(scenarios.PARTS[name]) <= MOST_CHANGES for name in SCENES)


def test_an_unreadable_file_is_refused(tmp_path):
    (tmp_path / "latin.toml").write_bytes(b"# \xe9\n")
    for path, reason in ((tmp_path / "none.toml", "No such file"), (tmp_path, "directory"), ("latin", "not UTF-8")):
        path = tmp_path / "latin.toml" if path == "latin" else path
        with pytest.raises(ConfigError, match=reason) as caught:
            load(path)
        assert str(path) in str(caught.value)
