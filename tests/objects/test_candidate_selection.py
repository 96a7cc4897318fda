"""Which candidates become objects, as what, and what is refused: bad input, and what nothing allows."""

import dataclasses

import numpy as np
import pytest

from jaxmm.objects.finder import Judged, ObjectSettings, find_objects
from jaxmm.objects.solids import solid_of
from tests.cases.known_rooms import NO_RAYS, judged, pillar, says, wall


@pytest.mark.parametrize(
    "change, message",
    [
        ({"points": np.zeros((4, 2))}, r"points must be \(N, 3\), got \(4, 2\)"),
        ({"points": np.full((4, 3), np.nan)}, "must be finite"),
        ({"pillar": np.zeros(3)}, r"pillar must be \(4,\), got \(3,\)"),
        ({"wall": np.full(4, 1.5)}, r"must lie in \[0, 1\]"),
        ({"wall": np.full(4, np.nan)}, r"must lie in \[0, 1\]"),
        ({"sensor": np.zeros(3)}, "sensor must be"),
        ({"apart": np.full(4, np.nan)}, "apart must not be negative or NaN"),
        ({"scan": np.array([0, 0, 0, 3])}, r"scan must be \(4,\) of 0 to 0"),
        ({"scan": np.zeros(3, int)}, r"scan must be \(4,\) of 0 to 0, got \(3,\)"),
        ({"rays": ()}, "rays must be those of 1 scans"),
        ({"rays": (NO_RAYS,)}, "rays must start at the sensor of their scan"),
        ({"rays": (NO_RAYS,), "sensor": NO_RAYS.origin[None].repeat(2, axis=0)}, "rays must be those of 2 scans"),
        ({"levels": np.zeros((4, 3))}, r"levels must be \(4, 2\) and finite, got \(4, 3\)"),
        ({"levels": np.full((4, 2), np.nan)}, r"levels must be \(4, 2\) and finite"),
        ({"floor": 3.0}, "floor must lie below ceiling, got 3.0 and 3.0"),
    ],
)
def test_bad_input_is_named(change, message):
    good = Judged(np.zeros((4, 3)), np.zeros(4), np.zeros(4), np.zeros(4), np.zeros((1, 3)), 0.0, 3.0)
    with pytest.raises(ValueError, match=message):
        find_objects(good._replace(**change))


@pytest.mark.parametrize(
    "change, message",
    [
        ({"threshold": 1.5}, r"threshold must lie in \[0, 1\]"),
        ({"hidden_gap": -1.0}, "hidden_gap must not be negative"),
        ({"link": 0.0}, "link and tolerance must be positive"),
    ],
)
def test_bad_settings_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(ObjectSettings(), **change)


def test_an_object_that_nothing_allows_takes_no_points_from_another(monkeypatch):
    """Of two objects the larger, made so here that it holds both, takes the smaller one's points, unless refused."""

    def swollen(*asked):
        solid = solid_of(*asked)
        return solid._replace(edges=np.array([9.0, 9.0])) if solid and solid.object_type == "wall" else solid

    seen = judged(pillar(3.0, 0.7, 0.5, 20), wall(3.6, -1.2, 2.0, 0.2, 90))
    monkeypatch.setattr("jaxmm.objects.finder.solid_of", swollen)
    assert [one.box.object_type for one in find_objects(seen)] == ["wall"]
    (left,) = find_objects(seen, allows=lambda found: [one.box.object_type != "wall" for one in found])
    assert left.box.object_type == "pillar" and np.linalg.norm(left.box.center[:2] - [3.0, 0.7]) < 0.1


@pytest.mark.parametrize(
    "odds, types",
    [((0.1, 0.6, 0.3), ["pillar", "wall"]), ((0.1, 0.3, 0.6), ["wall", "pillar"]), ((0.1, 0.88, 0.02), ["pillar"])],
)
def test_what_is_refused_as_the_likelier_type_is_tried_as_the_other_unless_that_is_hardly_possible(odds, types):
    seen, tried = judged(wall(3.2, 0.45, 1.3, 0.2, 80)), []

    def refuses(found):
        tried.extend(one.box.object_type for one in found)
        return [False] * len(found)

    assert not find_objects(seen, judge=says(*odds), allows=refuses)
    assert tried == types
    (found,) = find_objects(
        seen, judge=says(*odds), allows=lambda found: [one.box.object_type == types[-1] for one in found]
    )
    assert found.box.object_type == types[-1]
    assert found.box.probability == pytest.approx(0.9 / (0.9 + ObjectSettings().rarer * 0.1))
    assert found.type_probability == pytest.approx(1.0 if len(types) == 2 else 0.88 / 0.9)
    (both,) = find_objects(seen, judge=says(*odds))
    assert both.box.object_type == types[0] and both.type_probability == pytest.approx(max(odds[1:]) / 0.9)


def test_what_tells_nothing_of_its_shape_as_the_likelier_type_is_not_tried_as_the_other():
    """A post of 0.06 m, seen to go on nowhere, would be the end of a wall of 2 m."""
    assert find_objects(judged(pillar(1.5, 0.5, 0.06)), judge=says(0.1, 0.7, 0.2)) == []
    assert find_objects(judged(pillar(1.5, 0.5, 0.06)), judge=says(0.1, 0.2, 0.7)) != []
