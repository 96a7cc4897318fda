"""Training batches: a pure function of (seed, step) that shows every cloud and copy once an epoch, points intact."""

import itertools

import numpy as np
import pytest

from jaxmm.config import TRAINED_METHODS
from jaxmm.inputs import InputError
from jaxmm.learning.batches import LabelledCloud, Sampler, features_of, labels_of, validation_batch

POINTS = 40


def cloud(number, count):
    """A cloud whose every value tells which cloud and point it is: x = point, y = cloud, distance = both."""
    point = np.arange(count, dtype=np.float32)
    points = np.stack([point, np.full(count, number, np.float32), point**2], axis=1)
    label = point % 3 == 0
    evidence = np.stack([points[:, 1], point], axis=1)
    return LabelledCloud(points, number + point / 1000, point.astype(np.int32), label, ~label, label, evidence)


def sampler(method="nn", seed=0, copies=1, batch_size=3, label_kind="heuristic"):
    counts = ((10, 100, 40, 55, 1), (30, 41, 80, 0))  # shorter and longer than POINTS, one alone, one empty
    clouds = [[cloud(100 * s + i, count) for i, count in enumerate(row)] for s, row in enumerate(counts)]
    return Sampler(clouds, method, label_kind, batch_size, POINTS, copies, seed)


def numbers(batch, scenario, slot):
    """Cloud number and point numbers of one place of an `nn` batch."""
    distance = batch.features[scenario, slot, :, 0][batch.mask[scenario, slot]].astype(np.float64)
    return np.unique(np.floor(distance + 1e-4)), np.rint(distance % 1 * 1000).astype(int) % 1000


def assert_same(a, b):
    for x, y in zip(a, b, strict=True):
        np.testing.assert_array_equal(x, y)
        assert x.dtype == y.dtype


@pytest.mark.parametrize("method, copies", [("nn", 1), ("xyz_nn", 4)])
def test_a_batch_depends_on_seed_and_step_and_on_nothing_drawn_before(method, copies):
    in_order = [sampler(method, copies=copies).batch(step) for step in range(30)]
    other = sampler(method, copies=copies)
    for step in reversed(range(30)):
        assert_same(other.batch(step), in_order[step])
        assert_same(other.batch(step), in_order[step])
    assert any((a.features != b.features).any() for a, b in itertools.pairwise(in_order))
    assert (sampler(method, seed=1, copies=copies).batch(0).features != in_order[0].features).any()


def test_one_scenario_never_sees_the_clouds_of_another_and_does_not_depend_on_them():
    both = sampler(batch_size=4)
    alone = both._replace(clouds=both.clouds[:1])
    for step in range(20):
        batch = both.batch(step)
        for slot in range(4):
            assert all(numbers(batch, 0, slot)[0] < 100) and all(numbers(batch, 1, slot)[0] >= 100)
        np.testing.assert_array_equal(alone.batch(step).features[0], batch.features[0])


@pytest.mark.parametrize("copies", [1, 4])
@pytest.mark.parametrize("batch_size", [1, 3, 8])
def test_every_epoch_shows_each_cloud_and_copy_once(copies, batch_size):
    made = sampler("xyz_nn", copies=copies, batch_size=batch_size)
    made = made._replace(clouds=[[cloud(i, 20) for i in range(6)]] * 2)
    total = 6 * copies
    for scenario in range(2):
        seen = [made.batch(step).features[scenario] for step in range(3 * total)]
        seen = np.concatenate(seen)[: 3 * total]  # three epochs, wherever the borders of batches fall
        orders = []
        for epoch in seen.reshape(3, total, -1):
            assert len(np.unique(epoch, axis=0)) == total
            orders.append(epoch.tobytes())
            np.testing.assert_array_equal(np.unique(epoch, axis=0), np.unique(seen.reshape(3, total, -1)[0], axis=0))
        assert len(set(orders)) == 3  # each in an order of its own


def test_thinning_keeps_each_point_with_its_label_and_distance():
    made = sampler("xyz_nn", label_kind="true")
    thinned = []
    for step in range(40):
        batch = made.batch(step)
        for features, labels, mask in zip(*(part.reshape(6, POINTS, -1) for part in batch[:3]), strict=True):
            x, y, z, distance = features[mask[:, 0]].T
            np.testing.assert_array_equal(labels[mask[:, 0], 0], x % 3 != 0)
            np.testing.assert_allclose(distance, y + x / 1000, atol=1e-4)
            np.testing.assert_array_equal(z, x**2)
            assert len(np.unique(x)) == len(x)
            if len(x) and y[0] == 1:
                assert len(x) == POINTS
                thinned.append(tuple(sorted(x)))
    assert len(thinned) > 5 and len(set(thinned)) == len(thinned)  # thinned anew each time
    assert {point for points in thinned for point in points} == set(range(100))


def test_padding_is_masked_and_nothing_else_is():
    made = sampler()
    expected = {100 * s + i: min(len(c.points), POINTS) for s, row in enumerate(made.clouds) for i, c in enumerate(row)}
    for step in range(20):
        batch = made.batch(step)
        for scenario, slot in np.ndindex(2, 3):
            (mask,) = {tuple(batch.mask[scenario, slot])}
            count = sum(mask)
            assert mask == (True,) * count + (False,) * (POINTS - count)
            number, _ = numbers(batch, scenario, slot)
            assert count == (expected[int(number[0])] if count else 0)
            assert not batch.features[scenario, slot, count:].any() and not batch.labels[scenario, slot, count:].any()


def test_moved_copies_are_fixed_and_rigid():
    rng = np.random.default_rng(0)
    original = cloud(7, POINTS)._replace(points=rng.uniform(-5, 5, (POINTS, 3)).astype(np.float32))
    made = sampler("xyz_nn", copies=4, batch_size=4)._replace(clouds=[[original]])
    epochs = [made.batch(step).features[0] for step in range(25)]  # one cloud and four copies: a step is an epoch
    between = np.linalg.norm(original.points[:, None] - original.points[None], axis=-1)
    for features in epochs[0]:
        points, distance = features[:, :3], features[:, 3]
        np.testing.assert_array_equal(distance, original.distance)
        np.testing.assert_allclose(np.linalg.norm(points[:, None] - points[None], axis=-1), between, atol=1e-4)
        axes, moved = (part[1:4] - part[0] for part in (original.points, points))
        assert np.linalg.det(np.linalg.solve(axes, moved)) == pytest.approx(1, abs=1e-3)  # turned, never mirrored
    copies = {features.tobytes() for features in epochs[0]}
    assert len(copies) == 4 and any((features[:, :3] == original.points).all() for features in epochs[0])
    assert all({features.tobytes() for features in epoch} == copies for epoch in epochs)


def test_dropout_differs_between_steps_clouds_and_models():
    seeds = np.concatenate([sampler(batch_size=8).batch(step).seeds.ravel() for step in range(50)])
    assert len(np.unique(seeds)) == len(seeds) and seeds.dtype == np.uint32


def test_validation_holds_every_cloud_once_and_is_always_the_same():
    made = sampler("xyz_nn")
    batch = validation_batch(made.clouds, "xyz_nn", "true", POINTS)
    assert_same(batch, validation_batch(made.clouds, "xyz_nn", "true", POINTS))
    assert batch.features.shape == (2, 5, POINTS, 4) and not batch.mask[1, 4].any()
    for scenario, row in enumerate(made.clouds):
        for slot, member in enumerate(row):
            count = min(len(member.points), POINTS)
            points = batch.features[scenario, slot, :count]
            assert batch.mask[scenario, slot].sum() == count and (points[:, 1] == 100 * scenario + slot).all()
            np.testing.assert_array_equal(batch.labels[scenario, slot, :count], points[:, 0] % 3 != 0)


def test_features_are_the_distance_after_the_coordinates_of_methods_that_see_them():
    points, distance = np.arange(6.0).reshape(2, 3), np.array([7.0, 8.0])
    np.testing.assert_array_equal(features_of("nn", points, distance), [[7], [8]])
    np.testing.assert_array_equal(features_of("xyz_nn", points, distance), [[0, 1, 2, 7], [3, 4, 5, 8]])
    assert features_of("xyz_nn", points, distance).dtype == np.float32


def test_evidence_of_another_width_than_the_method_takes_is_refused_in_one_line():
    points, distance = np.zeros((2, 3)), np.zeros(2)
    wanted = TRAINED_METHODS["evidence"]
    assert features_of("evidence", points, distance, np.zeros((2, wanted))).shape == (2, wanted)
    for evidence, got in (
        (np.zeros((2, wanted - 1)), f"got {wanted - 1}: .* made by another version"),
        (None, "got 0"),
    ):
        with pytest.raises(InputError, match=f"expected {wanted} features of each point for evidence, {got}"):
            features_of("evidence", points, distance, evidence)


@pytest.mark.parametrize("label_kind", ["heuristic", "true"])
def test_untestable_returns_are_seen_but_not_scored(label_kind):
    drawn = sampler(label_kind=label_kind)
    for step in range(10):
        batch = drawn.batch(step)
        assert not (batch.scored & ~batch.mask).any()
        for place in np.ndindex(batch.mask.shape[:2]):
            _, point = numbers(batch, *place)
            void = point % 3 != 0 if label_kind == "true" else np.zeros(len(point), bool)  # true, and not testable
            np.testing.assert_array_equal(batch.scored[place][batch.mask[place]], ~void)


def test_object_labels_make_examples_of_all_that_is_of_an_object_that_shows():
    element = np.repeat([0, 1, 2], 20)
    true, testable = element > 0, np.zeros(60, bool)
    testable[20:30] = True  # ten points of object 1 show
    testable[40:49] = True  # nine of object 2
    made = cloud(0, 60)._replace(element=element.astype(np.int32), true=true, testable=testable)
    label, void = labels_of(made, "object")
    np.testing.assert_array_equal(label, true)
    np.testing.assert_array_equal(void, element == 2)
    label, void = labels_of(made, "true")
    np.testing.assert_array_equal(void, true & ~testable)
    none = made._replace(true=np.zeros(60, bool))
    assert not labels_of(none, "object")[1].any()
