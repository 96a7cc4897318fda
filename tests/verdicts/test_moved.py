"""What moved: linked by size and place, told once, and never across kinds or storeys."""

import numpy as np
import pytest

from jaxmm.verdicts.moved import is_off_its_place, linked, with_more
from jaxmm.verdicts.results import Mismatch


def mismatch(change, edges=(0.5, 0.5), kind="pillar", shape="rectangular", height=3.0, shaft=None):
    shaft = None if shaft is None else np.array(shaft)
    return Mismatch(kind, change, np.zeros(3), np.array([*edges, height]), 0.0, 0.9, shape=shape, shaft=shaft)


@pytest.mark.parametrize(
    "old, new, links",
    [
        pytest.param({}, {}, True, id="the same"),
        pytest.param({"edges": (0.5, 0.8)}, {"edges": (0.8, 0.5)}, True, id="turned by a right angle"),
        pytest.param({"edges": (0.5, 0.5)}, {"edges": (0.58, 0.5)}, True, id="fitted a little too large"),
        pytest.param({"edges": (0.5, 0.5)}, {"edges": (0.9, 0.5)}, False, id="larger"),
        pytest.param({}, {"height": 1.0}, False, id="lower"),
        pytest.param({}, {"height": 2.8}, True, id="up to another ceiling"),
        pytest.param({"edges": (4.0, 0.2)}, {"edges": (3.6, 0.2), "kind": "wall"}, False, id="of another kind"),
        pytest.param({"shape": "round"}, {}, False, id="of another shape"),
        pytest.param({"edges": (1.1, 1.1), "shaft": (0.5, 0.5)}, {}, True, id="with a capital"),
        pytest.param({"shaft": (0.3, 0.3)}, {}, False, id="with a shaft of another size"),
    ],
)
def test_what_moved(old, new, links):
    _, found = linked([mismatch("removed", **old), mismatch("added", **new)])
    assert found.moved_from == (0 if links else None)


def test_each_is_linked_once_and_the_likest_first():
    found = linked([
        mismatch("removed", (0.5, 0.5)), mismatch("removed", (0.52, 0.5)),
        mismatch("added", (0.52, 0.5)), mismatch("added", (0.53, 0.5)), mismatch("added", (0.51, 0.5)),
    ])  # fmt: skip
    assert [one.moved_from for one in found[2:]] == [1, None, 0] or [one.moved_from for one in found[2:]] == [
        1,
        0,
        None,
    ]
    assert len({one.moved_from for one in found[2:]}) == 3


def test_of_columns_that_are_alike_each_is_linked_to_the_nearest():
    """Sizes are measured to centimetres: they tell rows of columns apart only where they clearly differ."""
    old = [mismatch("removed", (0.4, 0.4))._replace(center=np.array([6.0 * number, 0.0, 1.5])) for number in range(4)]
    new = [
        mismatch("added", (0.4 + 0.01 * number, 0.4))._replace(center=np.array([6.0 * number + 1.0, 0.5, 1.5]))
        for number in range(4)
    ]
    found = linked([*old, *reversed(new)])
    assert [one.moved_from for one in found[4:]] == [3, 2, 1, 0]
    wide = new[0]._replace(dimensions=np.array([0.49, 0.4, 3.0]))
    far = mismatch("removed", (0.49, 0.4))._replace(center=np.array([2.0, 0.5, 1.5]))
    assert linked([old[0], far, wide])[2].moved_from == 1


def test_what_is_seen_whole_takes_the_place_of_its_parts():
    wall = mismatch("added", (6.0, 0.2), kind="wall")
    part = wall._replace(dimensions=np.array([1.5, 0.2, 3.0]))
    parts = [part._replace(center=np.array([x, 0.02, 0.0])) for x in (-2.0, 2.0)]
    beside = wall._replace(center=np.array([0.0, 0.45, 0.0]))
    pilaster = mismatch("added", (0.4, 0.4))._replace(center=np.array([1.0, 0.15, 0.0]))
    assert with_more([*parts, beside, pilaster], [wall]) == [beside, pilaster, wall]
    assert with_more([beside], [wall]) == with_more([beside], []) == [beside]
    columns = [pilaster._replace(center=np.array([x, 3.0, 0.0])) for x in (0.0, 0.45)]
    assert with_more([columns[0]], columns) == columns


def test_two_of_a_kind_of_change_are_no_move():
    assert all(one.moved_from is None for one in linked([mismatch("removed"), mismatch("removed")]))
    assert all(one.moved_from is None for one in linked([mismatch("added"), mismatch("added")]))


def test_what_is_off_its_place_is_of_its_kind_and_storey():
    gone = mismatch("removed", (0.4, 0.4))
    moved = mismatch("added", (0.4, 0.4))._replace(center=np.array([0.6, 0.3, 0.0]))
    assert is_off_its_place(moved, gone)
    for other in (
        moved._replace(center=np.array([0.6, 0.3, 3.2])), moved._replace(shape="round"),
        moved._replace(dimensions=np.array([0.4, 0.6, 3.0])), moved._replace(center=np.array([1.1, 0.6, 0.0])),
        moved._replace(object_type="wall"), moved._replace(dimensions=np.array([0.4, 0.4, 2.0])),
    ):  # fmt: skip
        assert not is_off_its_place(other, gone)


def test_parts_of_a_bent_wall_stand_in_any_direction():
    """An arc of 6 m, 2.6 m deep: what is seen of it off its place is straight, and along none of its box."""
    gone = mismatch("removed", (6.0, 2.6), kind="wall")
    part = mismatch("added", (2.5, 0.4), kind="wall")._replace(center=np.array([1.0, 2.0, 0.0]), rotation=50.0)
    assert is_off_its_place(part, gone)
    for size in ([6.0, 0.3, 3.0], [15.0, 12.0, 3.0]):
        assert not is_off_its_place(part, gone._replace(dimensions=np.array(size)))
    assert not is_off_its_place(part._replace(dimensions=np.array([6.5, 0.4, 3.0])), gone)
    for center in ([1.0, 2.6, 0.0], [4.3, 0.0, 0.0], [1.0, 2.0, 3.2]):
        assert not is_off_its_place(part._replace(center=np.array(center)), gone)
