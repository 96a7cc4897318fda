"""What tells a pillar, a wall and neither apart: the clues, the trees that weigh them, and how they were grown."""

import hashlib
import json

import numpy as np
import pytest
import safetensors.numpy

from jaxmm.inputs import InputError
from jaxmm.learning.boxes import MISMATCH_TYPES, Box
from jaxmm.learning.prediction import read_judges
from jaxmm.learning.upright_shapes import Circle, face_through, outside
from jaxmm.objects.candidates import candidates_of
from jaxmm.objects.clues import CLUES, Opinions, Surroundings, clues_of
from jaxmm.objects.face_ends import Look
from jaxmm.objects.finder import ObjectSettings, examine
from jaxmm.objects.judge import KINDS, ObjectJudge, default_judge, judge_objects, load_judge, save_judge
from jaxmm.objects.main_directions import grid_near
from jaxmm.objects.patches import Sight
from jaxmm.objects.pieces import Piece
from jaxmm.objects.solids import SolidSettings
from jaxmm.objects.usual_sizes import Habits, habits_around
from jaxmm.rays.scan_rays import rays_of_scan
from jaxmm.runs import flat_training, object_training
from jaxmm.runs.object_training import (
    SMALL_ROOM,
    STRAIGHT_ROOM,
    Examples,
    boosted_trees,
    examples_of_draw,
    fit,
    kind_of,
)
from jaxmm.runs.room_scans import room_cases
from jaxmm.verdicts.scan_fusion import judged_side
from jaxmm.verdicts.station_steps import look_at
from jaxmm.weights import DEFAULT, OBJECTS
from tests.cases.known_rooms import NO_RAYS, judged, pillar, slab, wall
from warp_scanner.rooms.scenarios import CROWDED
from warp_scanner.scenes.scenes import CYLINDER


@pytest.fixture
def few_rounds(monkeypatch):
    """All 500 take seconds to grow, and nothing that is asked here depends on their number."""
    monkeypatch.setattr(object_training, "ROUNDS", 60)


@pytest.fixture(scope="module")
def examples():
    """Kinds that go by two clues, one of them at random for a tenth."""
    rng = np.random.default_rng(0)
    clues = rng.normal(size=(900, len(CLUES)))
    kind = np.where(clues[:, 3] > 0.5, 0, np.where(clues[:, 7] > 0.0, 1, 2))
    return Examples(clues, np.where(rng.random(900) < 0.1, rng.integers(0, 3, 900), kind))


def test_the_arrays_say_what_the_trees_say_that_they_were_made_of(examples, few_rounds):
    judge = fit(examples)
    witness = boosted_trees().fit(examples.clues.astype(np.float32), examples.kind)
    new = np.random.default_rng(1).normal(size=(4000, len(CLUES)))
    np.testing.assert_allclose(judge_objects(judge, new), witness.predict_proba(new.astype(np.float32)), atol=1e-6)
    # A clue that equals a limit goes on to the same side in both.
    limits = judge.limit[np.isfinite(judge.limit)]
    edge = np.repeat(new[:1], len(limits), axis=0)
    edge[np.arange(len(limits)), judge.clue[np.isfinite(judge.limit)]] = limits
    np.testing.assert_allclose(judge_objects(judge, edge), witness.predict_proba(edge.astype(np.float32)), atol=1e-6)


def test_probabilities_sum_to_one_and_follow_what_was_learnt(examples, few_rounds):
    share = judge_objects(fit(examples), examples.clues)
    assert share.shape == (900, len(KINDS))
    np.testing.assert_allclose(share.sum(axis=1), 1.0)
    assert np.mean(share.argmax(axis=1) == examples.kind) > 0.85
    assert judge_objects(default_judge(), np.zeros((0, len(CLUES)))).shape == (0, len(KINDS))


def test_a_judge_comes_back_as_it_was_saved(examples, few_rounds, tmp_path):
    judge, path = fit(examples), tmp_path / "objects.safetensors"
    save_judge(judge, path, {"rooms": "0"})
    for kept, back in zip(judge, load_judge(path), strict=True):
        np.testing.assert_array_equal(kept, back)
        assert kept.dtype == back.dtype


@pytest.mark.parametrize("wrong", ["empty", "cut", "other clues", "other tensors"])
def test_a_file_that_holds_no_judge_is_refused_in_one_line(wrong, tmp_path):
    path, whole = tmp_path / "objects.safetensors", OBJECTS.read_bytes()
    judge = load_judge(OBJECTS)
    path.write_bytes(
        {
            "empty": b"", "cut": whole[: len(whole) // 2],
            "other clues": safetensors.numpy.save(judge._asdict(), {"clues": "length width"}),
            "other tensors": safetensors.numpy.save({"start": judge.start}, {"clues": " ".join(CLUES)}),
        }[wrong]
    )  # fmt: skip
    with pytest.raises(InputError, match=str(path)) as refused:
        load_judge(path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "wrong",
    [
        {"start": np.zeros(2, np.float32)}, {"start": np.zeros(1, np.float32)},
        {"clue": np.full((2, 3, 7), 200, np.uint8)}, {"clue": np.zeros((2, 3, 7), np.float32)},
        {"clue": np.zeros((2, 3, 3), np.uint8)}, {"limit": np.zeros((2, 3, 3), np.float32)},
        {"limit": np.full((2, 3, 7), np.nan, np.float32)}, {"leaf": np.full((2, 3, 8), np.nan, np.float32)},
        {"leaf": np.zeros((1, 3, 8), np.float32)}, {"leaf": np.zeros((2, 3, 16), np.float32)},
        {"leaf": np.zeros((2, 3, 7), np.float32)}, {"low": np.zeros(3, np.uint8)}, {"low": np.zeros(2, bool)},
        {"low": np.full(2, 3, np.uint8)},
    ],
    ids=lambda wrong: "{} {}".format(*next((name, array.shape) for name, array in wrong.items())),
)  # fmt: skip
def test_trees_whose_parts_disagree_are_refused(wrong, tmp_path):
    parts = ObjectJudge(
        np.zeros(3, np.float32), np.zeros((2, 3, 7), np.uint8), np.zeros((2, 3, 7), np.float32),
        np.zeros((2, 3, 8), np.float32), np.zeros(2, np.uint8),
    )  # fmt: skip
    path = tmp_path / "objects.safetensors"
    save_judge(parts, path, {})
    assert load_judge(path).leaf.shape == (2, 3, 8)
    save_judge(parts._replace(**wrong), path, {})
    with pytest.raises(InputError, match="expected trees for 3 kinds whose parts agree, got start"):
        load_judge(path)


def test_the_shipped_judge_is_the_one_that_its_card_tells_of():
    judge, card = load_judge(OBJECTS), (OBJECTS.parent / "README.md").read_text()
    assert np.bincount(judge.low).tolist() == [object_training.ROUNDS, flat_training.MORE, flat_training.MORE]
    metadata = safetensors.safe_open(OBJECTS, framework="numpy").metadata()
    kept, *bands = (json.loads(metadata[key]) for key in ("kept", "band_1", "band_2"))
    assert metadata["seed"] == str(object_training.SEED)
    assert metadata["models"] == hashlib.sha256(DEFAULT.read_bytes()).hexdigest()
    told = [f"{int(metadata['rooms']):,} rooms", f"{kept['candidates']:,} candidates", f"{len(CLUES)} clues"]
    told += [f"{object_training.ROUNDS} rounds, {object_training.DEPTH} deep", f"{flat_training.MORE} further rounds"]
    told += [f"{one['flats']:,} flats" for one in bands]
    scores = [kept, *(one for band in bands for one in band["kept"].values())]
    told += [f"{one[name]:.3f}" for one in scores for name in ("precision", "recall", "right_type")]
    assert [one for one in told if one not in card] == []


@pytest.mark.parametrize(
    "thing, kind",
    [
        (wall(3.0, 0.0, 2.4, 0.2, 80), "wall"), (pillar(3.0, 0.5, 0.5, 40), "pillar"),
        (pillar(3.0, 0.5, 0.5, 0, CYLINDER), "pillar"), (slab((2.5, 0.9), (0.3, 0.5), 0.0, 2.3, 20), "nothing"),
    ],
)  # fmt: skip
def test_the_shipped_judge_tells_a_wall_from_a_pillar_from_a_cabinet(thing, kind):
    """Where nothing is in doubt: both ends are in view, and of a cabinet that one looks over its top."""
    seen = judged(thing)
    examined = examine(seen, ObjectSettings())
    share = judge_objects(default_judge(), examined.clues)
    assert KINDS[share[0].argmax()] == kind if len(share) else kind == "nothing"


def seen_from(points, members, sensor=(0.0, 0.0, 1.4)):
    """A face through some points, and the sight of all."""
    face = face_through(points[:, :2], members)
    return Piece(members, face, None, 0, np.array(sensor)), Sight(points, np.tile(sensor, (len(points), 1)), 0.0, 3.0)


def test_clues_of_a_face_are_its_length_height_distance_and_angles():
    rng = np.random.default_rng(2)
    points = np.column_stack([np.full(50, 2.0), np.linspace(-0.5, 0.5, 50), rng.permutation(np.linspace(0.2, 1.7, 50))])
    piece, sight = seen_from(points, np.arange(50))
    opinions = Opinions(np.full(50, 0.5), np.full(50, 0.9), np.repeat([0.05, 0.6], 25))
    (one,) = candidates_of(sight, [piece], SolidSettings())
    looks, building = (
        [Look(sight, None, lambda: NO_RAYS)],
        Surroundings(np.radians(20.0), Habits(2.0, 1.6, 1.0, 0.3, 0.5, 7.0, 2.0)),
    )
    told = dict(zip(CLUES, clues_of(sight, looks, one, opinions, building, SolidSettings()), strict=True))
    expected = {
        "round": 0, "length": 1.0, "span": 1.0, "side": 0, "pieces": 1, "points": np.log(50), "pillar": 0,
        "wall": np.log(9), "top": 1.7, "bottom": 0.2, "left": 1.3, "range": 2.0, "slant": 0, "off_grid": 20,
        "onto": 0.5, "arc": 0, "filled": 50 / (100 * 1.1 * 1.6), "over": 0, "free_over": 0, "around": 0,
        "near_goes_on": 3.0, "far_goes_on": 3.0, "longest": 7.0, "thin": 0, "flat": 0, "bulge": 0, "bearing": 0,
        "beyond": -0.5, "near_deep": 3.0, "far_deep": 3.0,
        "back": 3.0, "near_in_view": 3.0, "far_in_view": 3.0, "wall_share": 1, "pillar_spread": 0,
        "wall_spread": 0, "apart_least": 0.05, "own_walls": 2.0, "own_shortest": 1.6, "own_columns": 1.0,
        "own_slimmest": 0.3, "own_widest": 0.5, "own_columns_askew": 7.0, "own_walls_askew": 2.0,
    }  # fmt: skip
    assert {name: told[name] for name in expected} == pytest.approx(expected, abs=1e-9)
    assert told["apart"] == pytest.approx(0.325)
    assert sorted([told["near_apart"], told["far_apart"]]) == pytest.approx([0.05, 0.6])


def test_clues_of_a_shaft_are_its_diameter_and_arc():
    turn = np.linspace(np.pi / 2, 3 * np.pi / 2, 40)
    points = np.column_stack([2.0 + 0.3 * np.cos(turn), 0.3 * np.sin(turn), np.linspace(0.1, 2.9, 40)])
    members = np.arange(40)
    circle = Circle(np.array([2.0, 0.0]), 0.3, np.ones(40, bool), np.pi)
    piece = Piece(members, None, circle, 0, np.array([0.0, 0.0, 1.4]))
    sight = Sight(points, np.zeros((40, 3)), 0.0, 3.0)
    (one,) = candidates_of(sight, [piece], SolidSettings())
    opinions = Opinions(*np.full((3, 40), 0.5))
    looks = [Look(sight, None, lambda: NO_RAYS)]
    told = dict(zip(CLUES, clues_of(sight, looks, one, opinions, Surroundings(0.0), SolidSettings()), strict=True))
    assert (told["round"], told["length"], told["arc"]) == pytest.approx((1.0, 0.6, np.pi))
    # What is told of a face is told of the line through its points: its ends, and how far off they are.
    assert told["bulge"] == pytest.approx(0.3 * 2.0 / np.pi, abs=0.01)
    assert (told["near_goes_on"], told["longest"]) == pytest.approx((3.0, 6.6), abs=0.01)


def test_a_candidate_is_the_object_in_whose_box_most_of_its_points_lie():
    boxes = [
        Box("wall", np.array([2.0, 0.0, 1.5]), np.array([2.0, 0.2, 3.0]), 90.0),
        Box("pillar", np.array([0.0, 2.0, 1.5]), np.array([0.4, 0.4, 3.0]), 0.0),
    ]
    on_wall = np.column_stack([np.full(10, 1.9), np.linspace(-1, 1, 10), np.ones(10)])
    on_pillar = np.column_stack([np.linspace(-0.2, 0.2, 10), np.full(10, 1.8), np.ones(10)])
    assert KINDS[kind_of(on_wall, boxes)] == "wall" and KINDS[kind_of(on_pillar, boxes)] == "pillar"
    assert KINDS[kind_of(np.concatenate([on_wall[:7], on_pillar[:3]]), boxes)] == "wall"
    assert KINDS[kind_of(np.add(on_wall, [5.0, 0.0, 0.0]), boxes)] == KINDS[kind_of(on_wall, [])] == "nothing"


def test_places_are_outside_of_a_rectangle_by_the_axis_that_they_are_furthest_on():
    along = np.array([np.cos(0.3), np.sin(0.3)])
    across = np.array([-along[1], along[0]])
    center = np.array([1.0, 2.0])
    places = center + np.array([1.5 * along, 0.7 * across, 0.5 * along + 0.1 * across])
    np.testing.assert_allclose(outside(places, center, np.array([2.0, 1.0]), along), [0.5, 0.2, -0.4])


@pytest.mark.long
def test_rooms_of_a_draw_give_the_same_candidates_each_time_and_all_kinds_among_them(monkeypatch):
    monkeypatch.setattr(object_training, "AT_ONCE", 3)
    draws = [examples_of_draw(number) for number in (0, 1, 2, object_training.MIXED + 1)]
    np.testing.assert_array_equal(draws[1].clues, (again := examples_of_draw(1)).clues)
    np.testing.assert_array_equal(draws[1].kind, again.kind)
    assert all(np.isfinite(draw.clues).all() and draw.clues.shape == (len(draw.kind), len(CLUES)) for draw in draws)
    assert len(set(np.concatenate([draw.kind for draw in draws]).tolist())) > 1


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.5])
def test_a_building_that_is_turned_keeps_its_habits(angle):
    place, heights = np.zeros(2), (-1.0, 1.0)
    for case in room_cases("pillar_added", "clean", 6, range(20)):
        known = case.prior.known
        turned = object_training._turned(known, angle)
        before, after = (grid_near(one.uprights, place, *heights) for one in (known, turned))
        off = (after - before - angle + np.pi / 4) % (np.pi / 2) - np.pi / 4
        assert abs(off) < np.radians(1.1)  # the grid is the median of walls within a degree
        usual, same = (habits_around(one.own, place, grid) for one, grid in ((known, before), (turned, after)))
        assert same[:5] == usual[:5] and same[5:] == pytest.approx(usual[5:], abs=1.1)


@pytest.mark.parametrize("scene", ["pillar_and_wall_added", "all_four"])
def test_what_is_learnt_of_added_things_is_what_detect_sees(scene):
    """The side of the prior's points is left out, and nothing else."""
    judges = read_judges(DEFAULT)
    for case in room_cases(scene, "occluded", 6, range(3), sensor=object_training.SENSORS[0]):
        rays = rays_of_scan(case.scan)
        (whole, told), (added, nothing) = (
            look_at(case.prior, rays, judges, one) for one in (MISMATCH_TYPES, ("added",))
        )
        assert told is not None and nothing is None and not added.removed.probability.any()
        seen, expected = (judged_side([one], "added") for one in (added, whole))
        for field in ("points", "pillar", "wall", "apart", "sensor", "floor", "ceiling", "scan", "levels"):
            np.testing.assert_array_equal(getattr(seen, field), getattr(expected, field))
        np.testing.assert_array_equal(seen.rays[0].distance, expected.rays[0].distance)


def test_the_first_rooms_to_learn_from_are_mixed():
    """Small things go with small ones of the building; in some straight buildings what is new is turned."""
    draws = [object_training.drawn(number) for number in range(object_training.MIXED)]
    rooms = [draw.changed["room"] for draw in draws]
    small, straight = (np.array([name in room for room in rooms]) for name in ("pillar_width", "wall_rotation"))
    assert [bool(one) for one in small] == ["wall_length" in draw.changed for draw in draws]
    turned, angle = np.array([np.mean(draw.turned > 0.0) for draw in draws]), np.stack([one.turned for one in draws])
    assert not turned[~straight].any() and angle.min() >= 0.0 and 1.4 < angle.max() < np.pi / 2
    assert small.mean() == pytest.approx(object_training.SMALL, abs=0.05)
    assert straight.mean() == pytest.approx(object_training.STRAIGHT, abs=0.05)
    assert np.mean([draw.of_cloud for draw in draws]) == pytest.approx(object_training.CLOUDS, abs=0.03)
    assert turned[straight].mean() == pytest.approx(object_training.ANYHOW, abs=0.05)
    assert {draw.changed["preset"] for draw in draws} == {"varied", "thesis"}


def test_the_other_rooms_to_learn_from_are_plain():
    draws = [object_training.drawn(number) for number in range(object_training.MIXED, object_training.MIXED + 400)]
    for draw in draws:
        assert draw.changed.keys() == {"preset", "sensor", "room"} and draw.changed["preset"] == "varied"
        assert draw.changed["room"] == {} and not draw.of_cloud and not draw.turned.any()
    crowded = np.mean([draw.scene == CROWDED for draw in draws])
    assert crowded == pytest.approx(8 / len(object_training.SCENES), abs=0.08)


def test_small_rooms_have_short_walls_and_slim_columns_and_straight_ones_stand_along_their_shell():
    """Of `varied` rooms at least half have no wall below 1.5 m, of the small ones at least half have some."""
    shortest, widest, askew = {}, {}, {}
    for name, room in (("as it is", {}), ("small", SMALL_ROOM), ("straight", STRAIGHT_ROOM)):
        cases = room_cases("unchanged", "clean", 6, range(40), room=room)
        usual = [habits_around(case.prior.known.own, np.zeros(2), 0.0) for case in cases]
        shortest[name] = np.median([one.shortest for one in usual])
        widest[name] = max(one.widest for one in usual)
        askew[name] = max(max(one.walls_askew, one.columns_askew) for one in usual)
    assert shortest["small"] < 1.5 < shortest["as it is"]
    assert widest["small"] <= 0.901 < widest["as it is"]
    assert 0.0 <= askew["straight"] < 0.01 and askew["as it is"] > 10.0


def test_what_is_turned_is_the_building_below_what_is_new(monkeypatch):
    """The angles of faces to the building change by what is drawn, and nothing that does not hang on them."""
    monkeypatch.setattr(object_training, "AT_ONCE", 4)
    judges, number = read_judges(DEFAULT), object_training.MIXED + 1
    draw = object_training.drawn(number)
    case = next(room_cases("wall_added", "clean", 6, range(1), sensor=object_training.SENSORS[0]))
    angle = np.radians(10.0)
    as_it_is, turned = (
        object_training._examples_of_room(case, judges, draw._replace(turned=np.full(4, one))).clues
        for one in (0.0, angle)
    )
    off = CLUES.index("off_grid")
    assert len(as_it_is) and np.all(as_it_is[:, off] >= 0.0)
    assert np.abs(turned[:, off] - as_it_is[:, off]).max() > 5.0
    others = [place for place, name in enumerate(CLUES) if name != "off_grid" and not name.endswith("askew")]
    np.testing.assert_array_equal(turned[:, others], as_it_is[:, others])


def test_of_clouds_what_was_removed_is_learnt_too(monkeypatch):
    monkeypatch.setattr(object_training, "AT_ONCE", 2)
    judges, draw = read_judges(DEFAULT), object_training.drawn(object_training.MIXED + 1)
    case = next(room_cases("pillar_removed", "clean", 6, range(1), sensor=object_training.SENSORS[0]))
    of_building, of_cloud = (
        object_training._examples_of_room(case, judges, draw._replace(of_cloud=one)) for one in (False, True)
    )
    assert not of_building.kind.any() and KINDS.index("pillar") in of_cloud.kind
    assert np.all(of_cloud.clues[:, CLUES.index("own_walls")] == 0.0)


def test_a_draw_that_is_kept_is_read_and_not_made_again(monkeypatch, tmp_path):
    made = []

    def draw(number):
        made.append(number)
        return Examples(np.full((number, len(CLUES)), 0.5), np.arange(number))

    monkeypatch.setattr(object_training, "examples_of_draw", draw)
    for folder, calls in ((tmp_path, [2, 3]), (None, [2, 3, 2, 3, 2, 3])):
        for number in (2, 3, 2, 3):
            found = object_training.kept_draw(folder, number)
            np.testing.assert_array_equal(found.kind, np.arange(number))
            assert found.clues.shape == (number, len(CLUES)) and np.all(found.clues == 0.5)
        assert made == calls
    (tmp_path / "000002.npz").write_bytes(b"half")
    with pytest.raises(InputError, match="damaged"):
        object_training.kept_draw(tmp_path, 2)
