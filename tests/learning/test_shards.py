"""The shard format: every pair number has its place, bytes are a pure function of it, and damage is found and named."""

import json
import platform
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from jaxmm.config import CONDITIONS, MULTI_SCENARIOS, SCENARIOS, SCENES, UNCHANGED, Config, DataConfig, Table
from jaxmm.data import dataset, labelled_rooms
from jaxmm.data.data_card import text
from jaxmm.data.simulator_settings import MULTI, CloudSource, pair_config, scene_of
from jaxmm.inputs import InputError
from jaxmm.learning import shards
from jaxmm.learning.batches import LabelledCloud
from jaxmm.learning.shards import FIELDS, RAW_FIELDS, Manifest
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms import scenarios
from warp_scanner.rooms.pairs import make_pairs
from warp_scanner.scenes import scenes
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.poses import Pose

CONFIG = Config(
    data=DataConfig(train_rooms=2, unchanged_rooms=1, multi_rooms=1, train_seed=4),
    scan=Table.of({"width": 80, "height": 50}),
)
PAIRS = 32  # two rounds of changes, one without and one with several


def is_sought(mapped, pair, scenario):
    """Which of the changed objects are those that a scenario's model looks for."""
    kind, change = scenario.split("_")
    wanted = {"pillar": PILLAR, "wall": WALL}[kind], {"added": 1, "removed": -1}[change]
    return (mapped["box_type"][pair] == wanted[0]) & (mapped["box_change"][pair] == wanted[1])


def written(folder, content, raw, span=(0, PAIRS)):
    """A folder that holds one shard of that content, and its entry."""
    path = shards.shard_path(folder, 0)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return shards.entry_of(folder, 0, span, content)


@pytest.fixture(scope="module")
def raw_shard():
    return dataset.make_shard(CONFIG, True, 0, PAIRS)


@pytest.fixture
def mapped(raw_shard, tmp_path):
    return shards.map_shard(tmp_path, 0, written(tmp_path, raw_shard, True), True)


@pytest.mark.parametrize("rooms, unchanged, multi", [(96, 24, 0), (5, 3, 11), (7, 0, 2), (1, 1, 1), (2, 9, 0)])
def test_every_pair_has_a_place_of_its_own_and_rooms_are_counted_without_gaps(rooms, unchanged, multi):
    data = DataConfig(train_rooms=rooms, unchanged_rooms=unchanged, multi_rooms=multi)
    total = 8 * (rooms + unchanged + multi)
    places = shards.places(data, np.arange(3 * total))
    assert len(set(zip(*(field.tolist() for field in places), strict=True))) == 3 * total
    own, none = places.scene == places.scenario, places.scene == SCENES.index(UNCHANGED)
    for kind, count in ((own, 3 * rooms), (none, 3 * unchanged), (~own & ~none, 3 * multi)):
        for scenario in range(4):
            for condition in range(2):
                chosen = kind & (places.scenario == scenario) & (places.condition == condition)
                assert places.room[chosen].tolist() == list(range(count))
    several = np.flatnonzero(~own & ~none)
    for i in several[:: max(1, len(several) // 50)]:
        assert SCENES[places.scene[i]] == scene_of(MULTI, int(places.room[i])) in MULTI_SCENARIOS
    # Any start: a place is a function of its number alone.
    for start in (0, 17, 10**12):
        for name, a, b in zip(
            places._fields, shards.places(data, np.arange(start, start + 50)),
            shards.places(data, np.arange(start - start % 8, start + 50)), strict=True,
        ):  # fmt: skip
            np.testing.assert_array_equal(a, b[start % 8 :], err_msg=name)


def test_the_mix_follows_the_ratio_all_along():
    places = shards.places(DataConfig(train_rooms=96, unchanged_rooms=24), np.arange(4000))
    for start in range(0, 4000, 40):
        own = places.scene[start : start + 40] == places.scenario[start : start + 40]
        assert Counter(own.tolist()) == {True: 32, False: 8}


def test_a_shard_holds_what_the_pipeline_makes_of_each_pair(mapped):
    places = shards.places(CONFIG.data, np.arange(PAIRS))
    for i in range(PAIRS):
        scenario, condition = SCENARIOS[places.scenario[i]], CONDITIONS[places.condition[i]]
        source = CloudSource(scenario, SCENES[places.scene[i]], condition, CONFIG.data.train_seed)
        ((cloud, truth),) = labelled_rooms.clouds(CONFIG, source, places.room[i : i + 1])
        rows = slice(*mapped["offset"][i : i + 2])
        for name, field in zip(LabelledCloud._fields, cloud, strict=True):
            np.testing.assert_array_equal(mapped[name][rows], field, err_msg=f"{i} {name}")
        sought = np.flatnonzero(is_sought(mapped, i, scenario))
        first = sought[0] if len(sought) else shards.MOST_CHANGES - 1  # the last of all is never filled here
        share = mapped["observable_fraction"][i, sought].mean() if len(sought) else np.nan
        np.testing.assert_allclose(share, truth.observable_fraction, rtol=1e-6)
        np.testing.assert_array_equal(mapped["box_center"][i, first], truth.box.center)
        np.testing.assert_array_equal(mapped["box_size"][i, first], truth.box.dimensions)
        np.testing.assert_array_equal(mapped["box_yaw"][i, first], np.float32(truth.box.rotation))
        # What is true of the points follows from what is told of the objects.
        expected = np.isin(mapped["element"][rows], mapped["box_element"][i][sought])
        np.testing.assert_array_equal(mapped["true"][rows], expected)
        assert [mapped[name][i] for name in ("index", *places._fields)] == [i, *(field[i] for field in places)]
        pairs = make_pairs(pair_config(CONFIG, source), places.room[i : i + 1])
        for side in ("dt", "robot"):
            for name, field in getattr(pairs, side)._asdict().items():
                np.testing.assert_array_equal(mapped[f"{side}_{name}"][i], field[0])


def test_every_changed_object_of_a_pair_is_told_of(mapped):
    for i in range(PAIRS):
        parts = scenarios.PARTS[SCENES[mapped["scene"][i]]]
        there = mapped["box_change"][i] != 0
        least = sum(not part.optional for part in parts)
        assert least <= there.sum() <= len(parts)
        told = {"change": "box_change", "semantic": "box_type"}
        for name, field in told.items():
            assert [getattr(part, name) for part, here in zip(parts, there, strict=False) if here] == (
                mapped[field][i][there].tolist()
            )
        for name, gap in (("box_type", 0), ("box_element", -1), ("box_moved_from", -1)):
            assert np.all(mapped[name][i][~there] == gap)
        for name in ("box_center", "box_size", "box_yaw", "observable_fraction"):
            assert np.isnan(mapped[name][i][~there]).all() and np.isfinite(mapped[name][i][there]).all()
    assert (mapped["box_change"] != 0).sum(axis=1).max() > 1


def test_clouds_are_points_of_the_raw_scans(mapped):
    """The stored pose, directions and ranges give back every stored point."""
    pose = Pose(mapped["sensor_position"], mapped["sensor_yaw"], mapped["sensor_pitch"])
    for i in range(PAIRS):
        side = "dt" if SCENARIOS[mapped["scenario"][i]].endswith("removed") else "robot"
        one = Pose(*(field[i : i + 1] for field in pose))
        points = points_of(one, mapped["directions"], mapped[f"{side}_distance"][i : i + 1])[0]
        seen = {point.tobytes() for point in points}
        start, end = mapped["offset"][i : i + 2]
        assert all(point.tobytes() in seen for point in mapped["points"][start:end])


@pytest.mark.parametrize("cut", [1, 8, 19, 31])
def test_a_pair_does_not_depend_on_the_others_of_its_shard(cut, mapped, tmp_path):
    content = dataset.make_shard(CONFIG, True, cut, PAIRS)
    part = shards.map_shard(tmp_path / "part", 0, written(tmp_path / "part", content, True, (cut, PAIRS)), True)
    start = mapped["offset"][cut]
    for name, field in (FIELDS | RAW_FIELDS).items():
        whole = mapped[name]
        if name == "offset":
            whole = whole[cut:] - start
        elif name != "directions":
            whole = whole[start:] if field.shape[0] == "P" else whole[cut:]
        np.testing.assert_array_equal(part[name], whole, err_msg=name)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="tunes the heap of glibc")
def test_a_shard_leaves_no_hole_in_the_heap(raw_shard):
    def memory():
        return int(Path("/proc/self/status").read_text().partition("VmRSS:")[2].split()[0]) / 1024

    before = memory()
    pieces = [bytes(4000) for _ in range(50_000)]
    last = pieces[-1]  # at the heap's end, so that what is free lies below
    del pieces
    assert memory() > before + 100  # 200 MB, but for what fits into other holes
    dataset.make_shard(CONFIG, False, 0, 8)
    assert memory() < before + 50 and last is not None


def test_a_shard_without_raw_scans_has_the_same_clouds(raw_shard):
    plain, raw = (safetensors.numpy.load(content) for content in (dataset.make_shard(CONFIG, False, 0, 8), raw_shard))
    assert set(plain) == set(FIELDS) and set(raw) == set(FIELDS | RAW_FIELDS)
    np.testing.assert_array_equal(plain["points"], raw["points"][: len(plain["points"])])


def test_the_card_tells_how_to_map_a_field_with_numpy_alone(raw_shard, tmp_path):
    path = tmp_path / "shard"
    path.write_bytes(raw_shard)
    length = int.from_bytes(raw_shard[:8], "little")
    header = json.loads(raw_shard[8 : 8 + length])
    for name, field in (FIELDS | RAW_FIELDS).items():
        told, dtype = header[name], np.dtype(shards.DTYPES[field.dtype])
        assert told["dtype"] == field.dtype and (8 + length + told["data_offsets"][0]) % dtype.itemsize == 0
        array = np.memmap(path, dtype, "r", 8 + length + told["data_offsets"][0], tuple(told["shape"]))
        np.testing.assert_array_equal(array, safetensors.numpy.load(raw_shard)[name], err_msg=name)
        sizes = {
            "n": PAIRS,
            "n+1": PAIRS + 1,
            "P": header["points"]["shape"][0],
            "R": 4000,
            "M": shards.MOST_CHANGES,
            "F": 0,
        }
        assert told["shape"] == [sizes.get(size, size) for size in field.shape]


def test_clouds_without_points_keep_their_truth(monkeypatch, tmp_path):
    whole = labelled_rooms.clouds_of

    def emptied(*args, **more):
        return [LabelledCloud(*(field[:0] for field in cloud)) for cloud in whole(*args, **more)]

    monkeypatch.setattr(labelled_rooms, "clouds_of", emptied)
    entry = written(tmp_path, dataset.make_shard(CONFIG, False, 0, 3), False, (0, 3))
    arrays = shards.map_shard(tmp_path, 0, entry, False)
    assert arrays["points"].shape == (0, 3) and arrays["offset"].tolist() == [0] * 4 and entry.points == 0
    assert np.isfinite(arrays["box_size"][:, 0]).all()


def refused(call, *words):
    with pytest.raises(InputError) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert all(str(word) in str(caught.value) for word in words), caught.value


def test_no_byte_of_a_shard_changes_unnoticed(raw_shard, tmp_path):
    entry = written(tmp_path, raw_shard, True)
    path = shards.shard_path(tmp_path, 0)
    assert entry.bytes == len(raw_shard) and shards.damage_of(tmp_path, 0, entry, thorough=True) is None
    rng = np.random.default_rng(0)
    for place in [0, 7, 8, 50, *rng.integers(0, len(raw_shard), 20).tolist(), len(raw_shard) - 1]:
        content = bytearray(raw_shard)
        content[place] ^= 1 << rng.integers(8)
        path.write_bytes(content)
        assert shards.damage_of(tmp_path, 0, entry, thorough=False) is None  # its size tells nothing
        refused(lambda: shards.map_shard(tmp_path, 0, entry, True), path, "sha256", "--repair")
    for content in (b"", raw_shard[:-1], raw_shard[:100], raw_shard + b"\0"):
        path.write_bytes(content)
        assert "bytes" in shards.damage_of(tmp_path, 0, entry, thorough=False)
        refused(lambda: shards.map_shard(tmp_path, 0, entry, True), path, f"found {len(content)}", "--repair")
    path.unlink()
    refused(lambda: shards.map_shard(tmp_path, 0, entry, True), path, "No such file", "--repair")


def test_a_whole_file_of_other_fields_is_refused(tmp_path):
    arrays = {"points": np.zeros((2, 3), np.float32)}
    entry = written(tmp_path, shards.encode(arrays), False)
    assert shards.damage_of(tmp_path, 0, entry, thorough=True) is None  # whole, as its size and sum say
    refused(lambda: shards.map_shard(tmp_path, 0, entry, False), "fields", "index")


MANIFEST = Manifest(10, 4, False, {"seed": 0}, {"python": "3"}, {})


def listed(*numbers):
    names = (f"shard-{n:06d}.safetensors" for n in numbers)
    spans = ((4 * n, min(4 * n + 4, 10)) for n in numbers)
    entries = (shards.Entry(name, *span, 7, 8, "ab") for name, span in zip(names, spans, strict=True))
    return MANIFEST._replace(shards=dict(zip(numbers, entries, strict=True)))


def test_a_manifest_comes_back_as_it_went_whatever_the_order_of_its_shards(tmp_path):
    for numbers in ((), (1,), (2, 0, 1)):
        manifest = listed(*numbers)
        shards.write_manifest(tmp_path, manifest)
        assert shards.read_manifest(tmp_path) == manifest
    content = (tmp_path / "manifest.json").read_bytes()
    shards.write_manifest(tmp_path, listed(0, 1, 2))
    assert (tmp_path / "manifest.json").read_bytes() == content
    assert [MANIFEST.span(n) for n in range(MANIFEST.shard_count)] == [(0, 4), (4, 8), (8, 10)]


@pytest.mark.parametrize(
    "change, word",
    [
        pytest.param({"format": "x"}, "something else", id="other format"),
        pytest.param({"format_version": 3}, "version 2", id="later version"),
        pytest.param({"shards": None}, "damaged", id="no list"),
        pytest.param({"shards": [{"file": "a"}]}, "damaged", id="half an entry"),
        pytest.param({"shards": [listed(1).shards[1]._asdict() | {"file": "../../secret"}]}, "place", id="other file"),
        pytest.param({"shards": [listed(1).shards[1]._asdict() | {"stop": 9}]}, "place", id="other span"),
        pytest.param({"pairs_per_shard": 0, "shards": [listed(1).shards[1]._asdict()]}, "damaged", id="no size"),
    ],
)
def test_a_damaged_or_foreign_manifest_is_refused(change, word, tmp_path):
    path = tmp_path / "manifest.json"
    shards.write_manifest(tmp_path, listed(0))
    assert shards.read_manifest(tmp_path) == listed(0)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    refused(lambda: shards.read_manifest(tmp_path), path, word)
    path.write_text("[1")
    refused(lambda: shards.read_manifest(tmp_path), path, "damaged")
    path.unlink()
    refused(lambda: shards.read_manifest(tmp_path), tmp_path, "manifest.json", "found none")


def test_class_ids_are_those_of_the_scanner():
    assert shards.CLASSES == ", ".join(f"{number} {name}" for number, name in enumerate(scenes.CLASS_NAMES))
    for number, name in enumerate(scenes.CLASS_NAMES):
        assert getattr(scenes, name.upper()) == number


@pytest.mark.parametrize("raw", [False, True])
def test_the_card_names_every_field_and_no_other(raw):
    config = {"data": {"train_seed": 4, "train_rooms": 2, "unchanged_rooms": 1, "multi_rooms": 0}}
    card = text(MANIFEST._replace(raw=raw, config=config), "noise 0.01")
    rows = {line.split("`")[1] for line in card.splitlines() if line.startswith("| `")}
    assert rows == set(FIELDS | RAW_FIELDS if raw else FIELDS)
    assert "{" not in card and "noise 0.01" in card and "2 : 1 : 0" in card
