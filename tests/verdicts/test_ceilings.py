"""Heights are judged against the ceiling above each place: seen from a hall, a gallery has one of its own."""

import numpy as np
import pytest

from jaxmm.learning.prediction import read_judges
from jaxmm.objects.clues import CLUES
from jaxmm.objects.finder import ObjectSettings, examine, find_objects
from jaxmm.objects.patches import Sight
from jaxmm.rays.evidence import FEATURES, Frame, View, features_of
from jaxmm.rays.hits import hits_of
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.floor_levels import ceilings_over
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from tests.cases.box_building import building_of
from tests.cases.known_rooms import judged, pillar, slab, wall
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, TABLE, WALL
from warp_scanner.sensors.sensors import Spinning
from warp_scanner.sensors.triangles import prepare

# A hall of 8 m; above where x < 0 a gallery, from 3.0 to 3.2 m, and over that a roof at 6 m.
HALL = (
    ((0, 0, -0.1), (6, 5, 0.1), FLOOR), ((3, 0, 8.1), (3, 5, 0.1), CEILING), ((-3, 0, 3.1), (3, 5, 0.1), FLOOR),
    ((-3, 0, 6.1), (3, 5, 0.1), CEILING), ((6.1, 0, 4), (0.1, 5, 4), WALL), ((-6.1, 0, 4), (0.1, 5, 4), WALL),
    ((0, 5.1, 4), (6, 0.1, 4), WALL), ((0, -5.1, 4), (6, 0.1, 4), WALL), ((-2, 0, 2.4), (0.2, 1, 0.1), TABLE),
)  # fmt: skip
SENSOR = np.array([3.0, -1.0, 1.5])
OPEN = Frame(SENSOR, 0.0, 8.0, np.full(180, np.inf), np.full(180, -np.inf))  # sees up and down everywhere


@pytest.mark.parametrize(
    "place, ceiling",
    [
        pytest.param((2, 2, 0.5), 8.0, id="in the hall"),
        pytest.param((2, 2, 7.99), 8.0, id="on its ceiling"),
        pytest.param((-2, 2, 0.5), 3.0, id="under the gallery"),
        pytest.param((-2, 2, 3.0), 3.0, id="on its lower side"),
        pytest.param((-2, 2, 4.5), 6.0, id="above it"),
        pytest.param((-2, 0.5, 0.5), 3.0, id="under what is no ceiling"),
        pytest.param((0.2, 2, 1.0), 3.0, id="of a column that carries the edge of the gallery"),
        pytest.param((0.4, 2, 1.0), 8.0, id="farther from that edge than a column is wide"),
        pytest.param((2, 9, 1.0), 8.0, id="in the open"),
    ],
)
def test_the_ceiling_is_what_the_building_has_above(place, ceiling):
    scene = prepare(building_of(HALL).triangles)
    assert ceilings_over(scene, np.array([place], float), OPEN) == pytest.approx([ceiling], abs=1e-4)


def test_the_ceiling_above_a_gallery_that_one_looks_down_on():
    """What is lower than the sensor is under whatever is above the sensor's height."""
    scene = prepare(building_of(HALL).triangles)
    above = OPEN._replace(sensor=np.array([3.0, -1.0, 5.0]))
    assert ceilings_over(scene, np.array([[-2, 2, 3.2], [2, 2, 0.0]]), above) == pytest.approx([6.0, 8.0], abs=1e-4)


@pytest.mark.parametrize("x, ceiling", [(0.1, 3.0), (0.25, 3.0), (-0.15, 2.4), (-1.0, 2.4)])
@pytest.mark.parametrize("z", [0.5, 2.2])
def test_behind_a_wall_is_another_room(x, ceiling, z):
    """Two rooms with a partition of 0.1 m between them; the ceiling of one is lower."""
    rooms = (
        ((0, 0, -0.1), (6, 5, 0.1), FLOOR), ((3, 0, 3.1), (3, 5, 0.1), CEILING), ((-3, 0, 2.5), (3, 5, 0.1), CEILING),
        ((0, 0, 1.5), (0.05, 5, 1.5), WALL),
    )  # fmt: skip
    scene = prepare(building_of(rooms).triangles)
    frame = OPEN._replace(ceiling=3.0)
    assert ceilings_over(scene, np.array([[x, 2.0, z]]), frame) == pytest.approx([ceiling], abs=1e-4)


def test_one_point_alone_tells_nothing_of_the_ceiling():
    """What errs may lie above its ceiling, and see the next one."""
    z = np.linspace(0.1, 2.9, 29)
    sight = Sight(
        np.column_stack([np.ones(29), np.zeros(29), z]), np.zeros((29, 3)), 0.0, 8.0, between(0, np.full(29, 3.0))
    )
    levels = sight.levels.copy()
    levels[-1, 1] = 3.2
    assert sight._replace(levels=levels).around(np.arange(29)).ceiling == 3.0


def test_what_hardly_differs_is_the_ceiling_above_the_sensor():
    """So a room with one ceiling has one height, to the last bit."""
    scene = prepare(building_of(HALL).triangles)
    places = np.random.default_rng(0).uniform([0.5, -4, 0], [5, 4, 7], (1000, 3))
    assert np.all(ceilings_over(scene, places, OPEN._replace(ceiling=8.03)) == 8.03)
    assert len(ceilings_over(scene, np.zeros((0, 3)), OPEN)) == 0


def test_features_under_a_lower_ceiling_are_those_of_a_lower_room():
    z = np.linspace(0.1, 2.9, 29)
    points, rays, one = (
        np.column_stack([np.full(29, -1.0), np.zeros(29), z]),
        np.tile([0, 0, 1, 0], (29, 1)),
        np.ones(29),
    )
    column = View(points, np.full(29, -1), rays, -one, 0.03 * one, one, one, np.ones(29, bool))
    hall, low = features_of(column, OPEN), features_of(column, OPEN._replace(ceiling=3.0))
    np.testing.assert_array_equal(features_of(column._replace(levels=between(0, np.full(29, 3.0))), OPEN), low)
    np.testing.assert_array_equal(features_of(column._replace(levels=between(0, np.full(29, 8.0))), OPEN), hall)
    some = column._replace(levels=between(0, np.full(29, 3.0))).at(np.arange(9))
    assert len(some.points) == len(some.levels) == 9 and column.at(np.arange(9)).levels is None
    gap = FEATURES.index("pool ceiling gap")
    assert hall[0, gap] == pytest.approx(5.1 / 8) and low[0, gap] == pytest.approx(0.1 / 3, rel=1e-5)


def looked_over(seen):
    """The same from a hall of 8 m into a gallery of 3 m, with what one sees over that: the far wall above it."""
    y, z = (grid.ravel() for grid in np.meshgrid(np.arange(-5, 5, 0.1), np.arange(4.8, 8, 0.1)))
    return joined(seen, np.column_stack([np.full(len(y), 5.0), y, z]), apart=0.0)


def between(floor, ceilings):
    """Levels (N, 2) of one floor and some ceilings (N,)."""
    return np.column_stack([np.full(len(ceilings), float(floor)), ceilings])


def joined(seen, points, apart):
    """A scan with points that hardly anyone holds for changed, under the ceiling of the hall; its own under another."""
    more, nothing = len(points), np.zeros(len(points))
    return seen._replace(
        points=np.concatenate([seen.points, points]), ceiling=8.0, rays=seen.rays if apart == 0.0 else None,
        pillar=np.append(seen.pillar, nothing), wall=np.append(seen.wall, nothing),
        apart=np.append(seen.apart, nothing + apart), scan=np.append(seen.scan, np.zeros(more, int)),
        levels=between(0, np.append(np.full(len(seen.points), 3.0), nothing + 8.0)),
    )  # fmt: skip


# Objects that the camera sees whole and in part, behind each other and with low things before them.
SCENES = (
    (pillar(3.0, 1.0, 0.6, 25), wall(3.6, -0.8, 2.0, 0.2, 80)),
    (wall(4.0, 0.0, 3.5, 0.2, 90), wall(2.6, 0.2, 0.9, 0.1, 90), slab((3.9, 0.3), (1.9, 0.6), 0.0, 1.2)),
    (pillar(3.0, -1.2, 0.9), pillar(3.0, 0.6, 0.4), wall(4.4, 0.5, 3.0, 0.12, 60)),
    (wall(4.2, 1.3, 1.2, 0.2, 90), wall(4.2, -1.3, 1.2, 0.2, 90), slab((2.2, 0.8), (0.0, 0.9), 0.0, 2.0)),
)


BEAM = slab((2.0, 0.1), (0.0, 3.0), 1.5, 3.0)  # hides what is high
POST = slab((2.0, 0.1), (0.68, 0.39), 0.0, 3.0)  # hides most of a wall's end


@pytest.mark.parametrize(
    "changed, others",
    [
        *((changed, ()) for changed in SCENES),
        ((pillar(3.5, 0.0, 0.5), wall(4.2, 1.4, 1.8, 0.2, 90)), (BEAM,)),
        ((wall(4.2, 0.0, 4.0, 0.2, 90),), (POST,)),
    ],
)
def test_objects_under_a_lower_ceiling_are_those_of_a_lower_room(changed, others):
    """To the last bit, whatever one sees above that ceiling: but it makes the view wider."""
    seen = judged(*changed, others=others)
    hall = looked_over(seen)
    told = [number for number, name in enumerate(CLUES) if not name.endswith("_in_view")]
    np.testing.assert_array_equal(*(examine(one, ObjectSettings()).clues[:, told] for one in (seen, hall)))
    plain, same = find_objects(seen), find_objects(hall)
    assert len(plain) == len(same) > 0
    for a, b in zip(plain, same, strict=True):
        np.testing.assert_array_equal(a.members, b.members)
        np.testing.assert_array_equal(a.box.center, b.box.center)
        np.testing.assert_array_equal(a.box.dimensions, b.box.dimensions)
    assert not np.array_equal(
        examine(hall._replace(levels=None), ObjectSettings()).clues, examine(hall, ObjectSettings()).clues
    )


def test_what_stands_on_a_gallery_is_no_part_of_what_carries_it():
    """New points above a column, in line with its face, where a railing may be: the column ends at its ceiling."""
    seen = judged(pillar(3.0, 0.0, 0.6))
    front = seen.points[(seen.pillar > 0.5) & (np.abs(seen.points[:, 0] - 2.7) < 0.01)]
    above = front + np.array([0.0, 0.0, 3.2])
    more = joined(seen, above, apart=1.0)
    (found,) = find_objects(more)
    assert found.members.max() < len(seen.points)
    assert found.box.dimensions[2] == pytest.approx(3.0, abs=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("x", [-1.5, -0.2], ids=["well under the gallery", "at its edge"])
def test_a_column_under_a_gallery_is_found_from_the_hall(x):
    """The ceiling above the sensor is 5 m higher than the column is."""
    prior = prior_of_building(building_of(HALL))
    real = prior_of_building(building_of((*HALL, ((x, 1.0, 1.5), (0.2, 0.2, 1.5), PILLAR))))
    place, sensor = SENSOR - real.origin, Spinning(720, 240, (-80.0, 80.0))
    directions = sensor.directions()
    reach = hits_of(real.scene, place, directions).distance
    back = np.isfinite(reach)
    points = (SENSOR - prior.origin + directions[back] * reach[back, None]).astype(np.float32)
    scan = PosedScan(points, SENSOR - prior.origin, np.eye(3), sensor)
    settings = DetectSettings(refine=False, propose_views=False)
    (found,) = detect_scans(
        prior, [NamedScan(scan, "hall", len(points), "given")], read_judges(DEFAULT), settings
    ).mismatches
    assert (found.object_type, found.mismatch_type) == ("pillar", "added")
    np.testing.assert_allclose(found.center, [x, 1.0, 1.5], atol=0.1)
    np.testing.assert_allclose(found.dimensions, [0.4, 0.4, 3.0], atol=0.1)
