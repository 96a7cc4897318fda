"""Heights are judged against the floor under each place: a hall has a platform, a gallery, and a storey below."""

import numpy as np
import pytest

from jaxmm.learning.prediction import read_judges
from jaxmm.objects.patches import Sight
from jaxmm.rays.evidence import FEATURES, Frame, View, features_of
from jaxmm.rays.hits import hits_of
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.floor_levels import ceilings_over, floors_under, levels_at
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from tests.cases.box_building import building_of
from warp_scanner.scenes.scenes import CEILING, FLOOR, FURNITURE, PILLAR, TABLE, WALL
from warp_scanner.sensors.sensors import Spinning
from warp_scanner.sensors.triangles import prepare

# A hall from 0 to 3.6 m with a platform of 0.9 m where x < 0, a gallery, and another storey 3 m below. Its slab ends at
# the walls.
HALL = (
    ((3, 0, -0.1), (3, 5, 0.1), FLOOR), ((-3, 0, 0.8), (3, 5, 0.1), FLOOR), ((0.1, 0, 0.35), (0.1, 5, 0.35), WALL),
    ((0, 0, 3.7), (6.2, 5.2, 0.1), CEILING), ((0, 0, -3.1), (8, 8, 0.1), FLOOR), ((6.1, 0, 0.2), (0.1, 5, 3.4), WALL),
    ((-6.1, 0, 0.2), (0.1, 5, 3.4), WALL), ((0, 5.1, 0.2), (6, 0.1, 3.4), WALL), ((0, -5.1, 0.2), (6, 0.1, 3.4), WALL),
    ((-4, 3, 1.3), (0.5, 1, 0.4), TABLE), ((4, 4, 2.4), (1, 1, 0.1), FLOOR),
)  # fmt: skip
BELOW, ABOVE = np.array([3.5, -1.0, 1.5]), np.array([-3.5, -1.0, 2.4])
OPEN = Frame(BELOW, 0.0, 3.6, np.full(180, np.inf), np.full(180, -np.inf))  # sees up and down everywhere


def seen_from(place, things=()):
    """What the models call of a scan of the hall with some things that its file lacks."""
    prior, real = (prior_of_building(building_of(boxes)) for boxes in (HALL, (*HALL, *things)))
    sensor = Spinning(720, 240, (-80.0, 80.0))
    directions = sensor.directions()
    reach = hits_of(real.scene, place - real.origin, directions).distance
    back = np.isfinite(reach)
    points = (place - prior.origin + directions[back] * reach[back, None]).astype(np.float32)
    scan = PosedScan(points, place - prior.origin, np.eye(3), sensor)
    settings = DetectSettings(refine=False, propose_views=False)
    return detect_scans(prior, [NamedScan(scan, "hall", len(points), "given")], read_judges(DEFAULT), settings)


@pytest.mark.parametrize(
    "place, floor",
    [
        pytest.param((2, 2, 0.5), 0.0, id="in the hall"),
        pytest.param((2, 2, 0.0), 0.0, id="on its floor"),
        pytest.param((2, 2, -0.3), 0.0, id="measured under its floor"),
        pytest.param((-2, 2, 1.0), 0.9, id="on the platform"),
        pytest.param((-2, 2, 3.55), 0.9, id="right under the ceiling"),
        pytest.param((4, 4, 3.0), 2.5, id="on a gallery, higher than the sensor"),
        pytest.param((4, 4, 2.0), 0.0, id="under it"),
        pytest.param((-4, 3, 1.7), 0.9, id="on a table there"),
        pytest.param((-2, 2, 0.62), -3.0, id="right under its slab"),
        pytest.param((5.99, 2, 1.0), 0.0, id="beside a wall"),
        pytest.param((6.01, 2, 1.0), 0.0, id="in a wall, under which the slab ends"),
        pytest.param((7.5, 2, 1.0), -3.0, id="outside, above the storey below"),
        pytest.param((20, 2, 1.0), 0.0, id="where there is no floor"),
    ],
)
def test_the_floor_is_what_the_building_has_beneath(place, floor):
    scene = prepare(building_of(HALL).triangles)
    places = np.array([place], float)
    ceiling = ceilings_over(scene, places, OPEN)
    assert floors_under(scene, places, ceiling, OPEN) == pytest.approx([floor], abs=1e-4)


def test_what_hardly_differs_is_the_floor_under_the_sensor():
    """So a room with one floor has one height, to the last bit."""
    scene = prepare(building_of(HALL).triangles)
    places = np.random.default_rng(0).uniform([0.3, -4, 0], [5.9, 2.5, 3.5], (1000, 3))
    assert np.all(levels_at(scene, places, OPEN._replace(floor=0.03)) == (0.03, 3.6))
    assert levels_at(scene, np.zeros((0, 3)), OPEN).shape == (0, 2)


def test_one_point_alone_tells_nothing_of_the_floor():
    z = np.linspace(0.1, 2.9, 29)
    levels = np.tile([0.9, 3.6], (29, 1))
    levels[0, 0] = -3.0
    sight = Sight(np.column_stack([np.ones(29), np.zeros(29), z]), np.zeros((29, 3)), 0.0, 3.6, levels)
    assert sight.around(np.arange(29)).floor == 0.9


def test_features_on_a_platform_are_those_of_a_room_with_a_higher_floor():
    z = np.linspace(1.0, 3.5, 29)
    points = np.column_stack([np.full(29, -1.0), np.zeros(29), z])
    rays, one = np.tile([0, 0, 1, 0], (29, 1)), np.ones(29)
    column = View(points, np.full(29, -1), rays, -one, 0.03 * one, one, one, np.ones(29, bool))
    own = column._replace(levels=np.tile([0.9, 3.6], (29, 1)))
    np.testing.assert_array_equal(features_of(own, OPEN), features_of(column, OPEN._replace(floor=0.9)))
    gap = FEATURES.index("pool floor gap")
    assert features_of(own, OPEN)[0, gap] == pytest.approx(0.1 / 2.7, rel=1e-5)
    assert features_of(column, OPEN)[0, gap] == pytest.approx(1.0 / 3.6, rel=1e-5)


@pytest.mark.long
@pytest.mark.parametrize(
    "sensor, x, low",
    [
        pytest.param(BELOW, -2.0, 0.9, id="from the hall onto the platform"),
        pytest.param(BELOW, -0.3, 0.9, id="at its edge"),
        pytest.param(ABOVE, 2.5, 0.0, id="from the platform down into the hall"),
        pytest.param(ABOVE, -1.5, 0.9, id="on the platform"),
    ],
)
def test_a_column_stands_on_its_own_floor(sensor, x, low):
    (found,) = seen_from(sensor, [((x, 1.0, (low + 3.6) / 2), (0.2, 0.2, (3.6 - low) / 2), PILLAR)]).mismatches
    assert (found.object_type, found.mismatch_type) == ("pillar", "added")
    np.testing.assert_allclose(found.center, [x, 1.0, (low + 3.6) / 2], atol=0.1)
    np.testing.assert_allclose(found.dimensions, [0.4, 0.4, 3.6 - low], atol=0.1)


def test_furniture_on_a_platform_is_no_higher_than_it_is():
    """A cupboard of 2 m there ends 2.9 m above the floor of the sensor, where only walls and columns do."""
    assert not seen_from(BELOW, [((-3.0, 0.0, 1.9), (0.3, 1.0, 1.0), FURNITURE)]).mismatches
