"""The way of clouds to training: Grain adds nothing to the bits, hosts share a batch out, shards equal fresh rooms."""

import dataclasses
import json

import jax
import numpy as np
import pytest

from jaxmm import config as settings
from jaxmm import run_folder
from jaxmm.config import CONDITIONS, SCENARIOS, UNCHANGED, Config, ConfigError, DataConfig, Table
from jaxmm.data import labelled_rooms
from jaxmm.data.generation import Request, generate
from jaxmm.data.simulator_settings import MULTI, CloudSource
from jaxmm.inputs import InputError
from jaxmm.learning import shards
from jaxmm.learning.batches import LabelledCloud, Sampler
from jaxmm.learning.loading import Host, batches, shard_clouds
from jaxmm.runs.training_stage import train_stage

CONFIG = Config(
    data=DataConfig(train_rooms=2, unchanged_rooms=1, multi_rooms=1, train_seed=11),
    scan=Table.of({"width": 96, "height": 60}),
)
PAIRS = 32  # two changed rooms, an unchanged one and one with several changes, of four scenarios in two conditions


def cloud(number, count):
    rng = np.random.default_rng(number)
    label = rng.random(count) < 0.5
    points, distance = rng.normal(size=(count, 3)), rng.random(count)
    element, evidence = np.zeros(count, "i4"), np.zeros((count, 0), "f4")
    return LabelledCloud(points.astype("f4"), distance.astype("f4"), element, label, label, label, evidence)


SAMPLER = Sampler([[cloud(i + 9 * s, 20 + 7 * i) for i in range(5)] for s in range(3)], "xyz_nn", "true", 6, 30, 4, 1)


def assert_same(a, b):
    jax.tree.map(np.testing.assert_array_equal, a, b)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Shards of all rooms that CONFIG trains on; read, do not write."""
    folder = tmp_path_factory.mktemp("data") / "shards"
    generate(CONFIG, folder, Request(PAIRS, workers=1))
    return folder


@pytest.fixture(scope="module")
def rooms():
    """The training clouds of each scenario as a run makes them from rooms, in its order."""
    data = CONFIG.data
    return [
        [
            made
            for scene, count in (
                (scenario, data.train_rooms),
                (UNCHANGED, data.unchanged_rooms),
                (MULTI, data.multi_rooms),
            )
            for condition in CONDITIONS
            for made, _ in labelled_rooms.clouds(
                CONFIG, CloudSource(scenario, scene, condition, data.train_seed), np.arange(count)
            )
        ]
        for scenario in SCENARIOS
    ]


def test_every_batch_is_the_samplers_bit_for_bit_from_any_step_on():
    for first, stop in ((0, 12), (5, 9), (7, 7)):
        drawn = list(batches(SAMPLER, first, stop))
        assert len(drawn) == stop - first
        for step, batch in zip(range(first, stop), drawn, strict=True):
            assert_same(batch, SAMPLER.batch(step))


def test_a_stored_state_goes_on_with_the_next_batch():
    drawn = batches(SAMPLER, 3, 20)
    for _ in range(4):
        next(drawn)
    state = json.loads(json.dumps(drawn.get_state()))
    again = batches(SAMPLER, 3, 20)
    again.set_state(state)
    for step in range(7, 20):
        assert_same(next(again), SAMPLER.batch(step))


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_hosts_side_by_side_draw_the_whole_batch(count):
    parts = [list(batches(SAMPLER, 2, 6, Host(index, count))) for index in range(count)]
    for step, own in zip(range(2, 6), zip(*parts, strict=True), strict=True):
        assert_same(type(own[0])(*(np.concatenate(fields, axis=1) for fields in zip(*own, strict=True))),
                    SAMPLER.batch(step))  # fmt: skip


@pytest.mark.parametrize("host", [Host(0, 4), Host(3, 3), Host(-1, 2)])
def test_a_host_that_cannot_be_is_refused(host):
    with pytest.raises(ValueError, match="divides 6 slots"):
        batches(SAMPLER, 0, 1, host)


def test_clouds_from_shards_equal_those_made_on_the_spot(folder, rooms, tmp_path):
    stored = shard_clouds(CONFIG, folder, tmp_path / "seal.json")
    assert [len(clouds) for clouds in stored] == [len(clouds) for clouds in rooms] == [8] * 4
    for ours, theirs in zip(stored, rooms, strict=True):
        for a, b in zip(ours, theirs, strict=True):
            assert_same(a, b)
            assert all(x.dtype == y.dtype for x, y in zip(a, b, strict=True))
            with pytest.raises(ValueError, match="read-only"):
                a.points[:] = 0


def test_batches_from_shards_equal_those_from_rooms(folder, rooms, tmp_path):
    stored = shard_clouds(CONFIG, folder, tmp_path / "seal.json")
    settings = ("xyz_nn", "heuristic", 4, 200, 4, 7)
    for a, b in zip(batches(Sampler(stored, *settings), 0, 9), batches(Sampler(rooms, *settings), 0, 9), strict=True):
        assert_same(a, b)


def test_a_damaged_shard_is_named_when_its_first_cloud_is_drawn(folder, tmp_path):
    copy = tmp_path / "shards"
    generate(CONFIG, copy, Request(PAIRS, workers=1))
    path = shards.shard_path(copy, 0)
    content = bytearray(path.read_bytes())
    content[-5] ^= 1
    path.write_bytes(content)
    sampler = Sampler(shard_clouds(CONFIG, copy, tmp_path / "seal.json"), "nn", "true", 2, 50, 1, 0)
    with pytest.raises(InputError, match=r"shard-000000.*sha256") as caught:
        next(batches(sampler, 0, 3))
    assert "\n" not in str(caught.value)


def refusal(config, folder, seal) -> str:
    """The one line in which loading ends."""
    with pytest.raises(InputError) as caught:
        shard_clouds(config, folder, seal)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_shards_that_do_not_fit_the_run_are_refused(folder, tmp_path):
    seal = tmp_path / "seal.json"
    scan = dataclasses.replace(CONFIG, scan=Table.of({"width": 97, "height": 60}))
    said = refusal(scan, folder, seal)
    assert str(folder) in said and "other scan settings" in said
    seed = dataclasses.replace(CONFIG, data=DataConfig(train_seed=12))
    said = refusal(seed, folder, seal)
    assert str(folder) in said and "train_seed" in said
    said = refusal(CONFIG, tmp_path, seal)
    assert str(tmp_path) in said and "manifest.json" in said and "found none" in said
    few = tmp_path / "few"
    generate(CONFIG, few, Request(6, workers=1))
    said = refusal(CONFIG, few, seal)
    assert str(few) in said and "6 pairs are too few" in said
    seal.unlink()
    manifest = shards.read_manifest(folder)
    (tmp_path / "part").mkdir()
    shards.write_manifest(tmp_path / "part", manifest._replace(shards={}))
    said = refusal(CONFIG, tmp_path / "part", seal)
    assert "0 of 1 shards" in said
    shard_clouds(CONFIG, folder, seal)
    shard_clouds(dataclasses.replace(CONFIG, seed=5), folder, seal)  # settings of other stages say nothing about clouds
    seal.write_text('["another"]')
    said = refusal(CONFIG, folder, seal)
    assert str(seal) in said and "other shards" in said


def test_source_and_folder_go_together():
    for wrong in ({"source": "shards"}, {"shards": "somewhere"}):
        with pytest.raises(ConfigError, match="shards must name a folder"):
            DataConfig(**wrong)
    assert DataConfig(source="shards", shards="somewhere").shards == "somewhere"


@pytest.mark.long
def test_training_from_shards_gives_the_weights_that_training_from_rooms_gives(tiny_config, tmp_path):
    rooms = settings.load(tiny_config)
    generate(rooms, tmp_path / "data", Request(16, workers=1))
    stored = dataclasses.replace(rooms.data, source="shards", shards=str(tmp_path / "data"))
    results = []
    for name, config in (("rooms", rooms), ("shards", dataclasses.replace(rooms, data=stored))):
        with run_folder.open_run(tmp_path / name, config):
            results.append(train_stage(config, tmp_path / name))
    assert_same(*results)
    lines = [(tmp_path / name / run_folder.METRICS).read_bytes() for name in ("rooms", "shards")]
    assert lines[0] == lines[1] and lines[0].count(b"\n") == 6
