"""The steps from points to objects, one by one: what each makes of what it is given, and what it refuses."""

import numpy as np
import pytest
import trimesh

from jaxmm.learning.upright_shapes import face_through
from jaxmm.objects.candidates import Candidate
from jaxmm.objects.clues import CLUES
from jaxmm.objects.finder import ObjectSettings, examine, find_objects
from jaxmm.objects.main_directions import uprights_of
from jaxmm.objects.object_heights import levels_of
from jaxmm.objects.patches import Patch, Sight, crossings
from jaxmm.objects.pieces import Piece
from jaxmm.objects.solids import SolidSettings, _angled, solid_of
from jaxmm.objects.walls import KnownBuilding, Solid, reach
from tests.cases.known_rooms import CEILING, FLOOR, SENSOR, judged, pillar, says, slab, wall
from warp_scanner.scenes.scenes import BOX, CYLINDER


def test_what_several_scans_see_alike_has_the_clues_of_what_one_sees():
    """A scan that is given twice doubles its points, and tells nothing more of lengths, counts and surroundings."""
    once = judged(pillar(3.0, 0.3, 0.7, 40), wall(3.6, -1.4, 2.0, 0.2, 80))
    twice = judged(
        pillar(3.0, 0.3, 0.7, 40), wall(3.6, -1.4, 2.0, 0.2, 80), poses=((*SENSOR, 0.0), (1e-6, *SENSOR[1:], 0.0))
    )
    clues = [examine(seen, ObjectSettings()).clues for seen in (once, twice)]
    assert len(twice.points) > 1.9 * len(once.points)
    np.testing.assert_allclose(*(np.sort(one, axis=0) for one in clues), atol=0.06)


def only(found, object_type):
    assert [one.box.object_type for one in found] == [object_type]
    return found[0].box


@pytest.mark.parametrize(
    "thing, is_wall, measured",
    [
        (wall(3.0, 0.0, 1.6, 0.2, 90), True, (True, False, True)),  # its face, whole
        (wall(3.0, 0.3, 1.6, 0.2, 55), True, (True, True, True)),  # and its end
        (wall(3.0, 0.0, 9.6, 0.2, 90), True, (False, False, True)),  # leaves the view on both sides
        (wall(4.0, 0.0, 2.0, 0.2, 0), True, (False, True, True)),  # its end alone
        (pillar(3.4, 0.0, 0.6), False, (True, False, True)),
        (pillar(3.0, 0.2, 0.6, 40), False, (True, True, True)),
        (pillar(3.0, 0.2, 0.6, 0, CYLINDER), False, (True, True, True)),
        (pillar(1.2, 0.0, 0.4, 45), False, (True, True, False)),  # too near to see its top
        (wall(3.18, 2.0, 1.91, 0.39, 10), True, (True, False, True)),  # and a part of its end
    ],
)
def test_what_is_measured_of_a_size_is_told_from_what_is_assumed(thing, is_wall, measured):
    (found,) = find_objects(judged(thing), judge=says(0.02, 0.02, 0.96) if is_wall else says(0.02, 0.96, 0.02))
    wide = np.argsort(-found.box.dimensions[:2], kind="stable") if is_wall else (0, 1)
    assert tuple(found.measured[axis] for axis in (*wide, 2)) == measured


@pytest.mark.parametrize("turn", [0.0, 30.0])
@pytest.mark.parametrize("way", [0.0, 0.02, 0.1, 0.25, 0.5, 0.9, 3.0, None])
@pytest.mark.parametrize(
    "x, y, yaw, shows_to, on",  # of one wall the picture ends 1 m before its end; of another its end alone shows
    [(3.0, 2.4, 90.0, (3.0, 2.4), (0.0, 1.0)), (4.0, 0.0, 0.0, (3.0, 0.0), (1.0, 0.0))],
)
def test_what_is_made_up_of_a_wall_ends_at_what_its_building_has_there(x, y, yaw, shows_to, on, way, turn):
    to_world = trimesh.transformations.rotation_matrix(np.radians(turn), [0, 0, 1])
    known = KnownBuilding()
    if way is not None:  # what stands across its line so far beyond what shows of it
        standing = trimesh.creation.box((0.2, 4.0, 3.0), trimesh.geometry.align_vectors([1, 0, 0], [*on, 0.0]))
        standing.apply_translation([*(np.array(shows_to) + (way + 0.1) * np.array(on)), 1.5])
        standing.apply_transform(to_world)
        element = np.zeros(len(standing.faces), int)
        known = KnownBuilding(uprights=uprights_of(standing.vertices.astype(np.float32), standing.faces, element))
    center = to_world[:2, :2] @ [x, y]
    seen = judged(wall(*center, 2.0, 0.2, yaw + turn), poses=((*SENSOR, turn),))
    judge = says(0.02, 0.02, 0.96)
    box = only(find_objects(seen, judge=judge, known=known), "wall")
    if way is not None:  # nothing ends at what is gone
        passes = find_objects(seen, judge=judge, known=known._replace(gone=np.array([True])))
        free = find_objects(seen, judge=judge, known=KnownBuilding())
        assert [one.box.center.tolist() for one in passes] == [one.box.center.tolist() for one in free]
    first, usual = (-1.0, 1.0) if yaw else (0.0, 2.0)  # [m] from there
    last = min(np.inf if way is None else way, usual)
    if last < SolidSettings().shown:  # nothing is made up of a face that ends so near, and of an end it is not nothing
        last = 0.0 if yaw else max(last, SolidSettings().least_thickness)
    place = (to_world[:2, :2].T @ box.center[:2] - shows_to) @ on
    along = int(abs((box.rotation - turn - yaw + 90.0) % 180.0 - 90.0) > 45.0)
    assert place == pytest.approx((first + last) / 2, abs=0.03)
    assert box.dimensions[along] == pytest.approx(last - first, abs=0.06)


def test_rays_beyond_before_and_on_a_patch_are_told_apart():
    points = np.array([[4.0, 0.0, 1.0], [2.0, 0.1, 1.0], [1.0, 0.0, 1.0], [4.0, 3.0, 1.0], [4.0, 0.0, 9.0], [-4, 0, 1]])
    sight = Sight(points, np.tile([0.0, 0.0, 1.0], (6, 1)), 0.0, 3.0)
    patch = Patch(np.array([2.0, -0.5]), np.array([2.0, 0.5]), 0.0, 3.0)
    assert crossings(sight, patch, 0.05) == (1, 1, 1)
    assert crossings(sight, patch._replace(low=1.5), 0.05).total == 0
    assert crossings(sight, Patch(patch.start, patch.start, 0.0, 3.0), 0.05).total == 0


def test_a_carton_in_line_with_a_pillar_does_not_make_it_furniture():
    """Both in one plane: what is looked over is left out of the face, and the face stays."""
    truth = pillar(3.25, 0.0, 0.5)
    box = slab((3.1, 0.2), (0.6, 0.7), FLOOR, 0.7)
    (one,) = [one for one in find_objects(judged(truth, box)) if one.box.probability > 0.5]
    assert one.box.object_type == "pillar"
    np.testing.assert_allclose(one.box.center[:2], [3.25, 0.0], atol=0.06)


@pytest.mark.parametrize("gap", [0.0, 0.15, 0.4])
@pytest.mark.parametrize("kind", [BOX, CYLINDER])
def test_a_pillar_behind_a_low_cabinet_stands_on_the_floor(gap, kind):
    """Rays that end on the cabinet do not show the pillar to end."""
    cabinet = slab((2.6 - gap - 0.2, 0.4), (0.3, 1.6), FLOOR, 0.9)
    (found,) = find_objects(judged(pillar(3.0, 0.3, 0.8, 0, kind), others=(cabinet,)))
    assert found.box.center[2] == pytest.approx(1.5) and found.box.dimensions[2] == pytest.approx(3.0)


def test_a_wall_does_not_go_on_to_where_the_robot_stands():
    """A face that leaves the picture right beside the sensor, in its line: nothing shows it to end, but it does."""
    points = np.column_stack([np.linspace(0.4, 1.3, 40), np.full(40, 0.05), np.linspace(0.5, 2.5, 40)])
    sight = Sight(points, np.tile([0.0, 0.0, 1.4], (40, 1)), FLOOR, CEILING)
    piece = Piece(np.arange(40), face_through(points[:, :2], np.arange(40)), None, 0, np.array([0.0, 0.0, 1.4]))
    near, far = (-1.0, 1.0) if piece.face.along[0] > 0 else (1.0, -1.0)
    assert reach(sight, piece, near, SolidSettings()) == 0.0
    assert reach(sight, piece, far, SolidSettings()) == np.inf
    aside = sight._replace(origin=np.tile([0.0, -2.0, 1.4], (40, 1)))
    assert reach(aside, piece, near, SolidSettings()) == np.inf


def test_rays_that_pass_beside_a_shaft_do_not_show_it_to_end():
    """They pass the front of the square around it, which one sees from its corner, and hardly miss the shaft."""
    center, toward, radius = np.array([2.3, 2.3]), np.array([0.5, 0.5]) ** 0.5, 0.45
    aside = np.array([-toward[1], toward[0]])
    top = [[*(center - radius * toward + side * aside), z] for side in (-0.1, 0.0, 0.1) for z in (2.0, 2.5, 2.95)]

    def past(offset):  # the line of sight at a distance from the shaft's axis
        far = (center + offset * aside) * 2.0
        return [[*far, z] for z in (0.2, 0.4, 0.6, 0.8)]

    shaft = Solid("pillar", "round", center, np.full(2, 2 * radius), np.array([1.0, 0.0]), np.arange(len(top)))
    for offsets, low in (((-0.5, 0.5), FLOOR), ((-0.2, 0.2), 2.0)):
        points = np.array(top + [point for offset in offsets for point in past(offset)])
        sight = Sight(points, np.tile([0.0, 0.0, 1.4], (len(points), 1)), FLOOR, CEILING)
        assert levels_of(sight, shaft, SolidSettings())[:2] == (low, CEILING)


@pytest.mark.parametrize(
    "known, usual, thickness",
    [((), 0.0, 0.15), ((0.1,), 0.1, 0.15), ((0.3,), 0.3, 0.3), ((0.1, 0.3), 0.3, 0.3), ((0.2, 0.25, 0.3), 0.2, 0.2)],
)
def test_a_thickness_that_nothing_shows_is_the_usual_one_of_the_building_if_no_shell(known, usual, thickness):
    """A wall across the whole view, of which only the face shows."""
    seen = judged(wall(3.0, 0.0, 9.6, 0.4, 90))
    (found,) = find_objects(seen, known=KnownBuilding(walls=known, usual_wall=usual))
    assert min(found.box.dimensions[:2]) == pytest.approx(thickness, abs=0.01)
    assert not found.measured[np.argmin(found.box.dimensions[:2])]


@pytest.mark.parametrize("x, y, least, most", [(3.2, 0.9, 0.0, 0.2), (2.7, 1.54, 2.9, 3.0)])
def test_how_far_the_side_of_a_thing_may_go_on_is_told(x, y, least, most):
    """One sees the end of a side, though it is so slanting that few rays pass right beside it; or the picture ends."""
    examined = examine(judged(pillar(x, y, 0.8)), ObjectSettings())
    told = dict(zip(CLUES, examined.clues[0], strict=True))
    assert told["side"] > 0.3 and least <= told["side_goes_on"] <= most


@pytest.mark.parametrize("x, y, yaw", [(2.1, -0.15, 5), (1.76, -0.48, 157), (3.09, -0.12, 7), (2.41, -0.91, 146)])
def test_a_short_wall_seen_slantwise_is_not_made_up_to_the_usual_length(x, y, yaw):
    """Right beside its ends hardly a thinned ray passes, yet those a little further show that it ends."""
    examined = examine(judged(wall(x, y, 1.0, 0.12, yaw)), ObjectSettings())
    (one,) = examined.candidates
    assert solid_of(examined.sight, one, True, ObjectSettings(), KnownBuilding()).edges.max() < 1.3


@pytest.mark.parametrize("seed", range(24))
def test_what_something_hides_most_of_is_the_side_of_a_wall_and_not_its_end(seed):
    """A strip as wide as walls are thick; where both of its ends are in view, it is the end of one."""
    rng = np.random.default_rng(seed)
    way, strip, turn = rng.choice([-1, 1]), rng.uniform(0.17, 0.24), rng.uniform(0.0, 8.0)
    length, thickness = rng.uniform(2.0, 3.0), rng.uniform(0.1, 0.3)
    # One end of the wall stands 4 m away; what hides the rest has its edge on the line of sight to short of that.
    along = np.array([np.sin(np.radians(turn)), way * np.cos(np.radians(turn))])
    end = np.array([4.0, way * rng.uniform(0.0, 0.3)])  # seen from its front alone
    edge = end - strip * along - np.array([thickness / 2, 0.0])
    hiding = slab((2.0, 0.02), (edge[1] * 2.0 / edge[0] - way * 0.8, 1.6), FLOOR, CEILING)
    yaw = float(np.degrees(np.arctan2(along[1], along[0])))
    sure = says(0.05, 0.05, 0.9)
    (one,) = find_objects(
        judged(wall(*(end - along * length / 2), length, thickness, yaw), others=(hiding,)), judge=sure
    )
    assert abs((one.box.rotation - yaw + 90.0) % 180.0 - 90.0) < 20.0 and one.box.dimensions[0] > one.box.dimensions[1]
    (lone,) = find_objects(judged(wall(4.0, 0.0, 2.0, strip, 0)), judge=sure)
    assert abs(lone.box.rotation) < 5.0 and lone.box.dimensions[0] > lone.box.dimensions[1]


SIDES = {
    "a corner": ([[0, 0.3], [0, 0]], [[0, 0], [0.3, 0]]),
    "flanges and a web": ([[0, 0], [0.3, 0]], [[0, 0.3], [0.3, 0.3]], [[0.15, 0], [0.15, 0.3]]),
}


@pytest.mark.parametrize("sides", SIDES)
def test_sides_that_passed_for_one_face_are_a_rectangle(sides):
    """Of flanges nobody knows how far they go on behind each other."""
    places = np.concatenate([np.linspace(*side, 25) for side in SIDES[sides]]) + np.array([2.0, 1.0])
    candidate = Candidate((piece_of(places),), np.arange(len(places)))
    found = _angled(places, candidate, ObjectSettings(), KnownBuilding())
    np.testing.assert_allclose(found.center, [2.15, 1.15], atol=0.02)
    np.testing.assert_allclose(found.edges, 0.3, atol=0.02)
    assert found.measured == ((True, True) if sides == "a corner" else (False, False))


@pytest.mark.parametrize("seed", range(20))
def test_a_face_that_noise_smears_is_no_rectangle(seed):
    rng = np.random.default_rng(seed)
    places = np.column_stack([rng.normal(2.0, 0.07, 150), rng.uniform(0.8, 1.3, 150)])
    candidate = Candidate((piece_of(places),), np.arange(len(places)))
    assert _angled(places, candidate, ObjectSettings(), KnownBuilding()) is None


def piece_of(places):
    members = np.arange(len(places))
    return Piece(members, face_through(places, members), None, 0, np.array([0.0, 0.0, 1.4]))
