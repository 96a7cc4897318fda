"""Where a sensor stands indoors: on decks without facades, under slabs, in rooms; and where it does not."""

import numpy as np
import pytest

from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.outdoors import OUTDOORS, is_outdoors
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import building_of, scan_of
from warp_scanner.scenes.scenes import CEILING, FLOOR, OTHER, PILLAR, WALL
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

HEIGHT, EYE = 3.5, 1.5  # [m] of a storey, of a sensor above its floor


def box(x, y, z, semantic):
    """From lowest to highest along each axis."""
    low, high = np.array([x, y, z], float).T
    return (low + high) / 2, (high - low) / 2, semantic


def skeleton(slab=FLOOR, ground=True):
    """Three slabs of 20 x 15 m on a grid of columns 6 m apart, the outer ones 1 m from the edge."""
    slabs = [box((0, 20), (0, 15), (HEIGHT * s - 0.3, HEIGHT * s), slab) for s in range(0 if ground else 1, 3)]
    feet = [(x, y, s * HEIGHT) for s in range(2) for x in (1, 7, 13, 19) for y in (1, 7.5, 14)]
    columns = [box((x - 0.2, x + 0.2), (y - 0.2, y + 0.2), (z, z + HEIGHT - 0.3), PILLAR) for x, y, z in feet]
    return [*slabs, *columns]


def walls(x, y, height, thick=0.2):
    """Around a rectangle, on its inside."""
    return [
        box(x, (y[0], y[0] + thick), (0, height), WALL), box(x, (y[1] - thick, y[1]), (0, height), WALL),
        box((x[0], x[0] + thick), y, (0, height), WALL), box((x[1] - thick, x[1]), y, (0, height), WALL),
    ]  # fmt: skip


ROOM = walls((-4, 4), (-3, 3), 2.6)
GROUND = box((-4, 4), (-3, 3), (-0.2, 0), FLOOR)
LANDING = box((2, 3), (2, 2.6), (1, 1.2), FLOOR)


def house(eaves=0.0):
    """A room with a floor, and a roof that reaches beyond its walls."""
    return [GROUND, *ROOM, box((-4 - eaves, 4 + eaves), (-3 - eaves, 3 + eaves), (2.6, 2.8), CEILING)]


TERRACE = [*house(), box((-8, -4), (-3, 3), (2.6, 2.8), FLOOR), box((-7.8, -7.6), (-2.8, -2.6), (-0.2, 2.6), PILLAR)]


def ring(half, height=9.0, deep=5.0, ground=()):
    """A building around a square courtyard, `half` [m] from its middle to its walls."""
    out, found = half + deep, [*ground]
    for z, kind in [*((z, FLOOR) for z in np.arange(0.0, height, 3.0)), (height, CEILING)]:
        sides = ((-out, out), (-out, -half)), ((-out, out), (half, out)), ((-out, -half), (-half, half)), (
            (half, out), (-half, half))  # fmt: skip
        found += [box(*side, (z - 0.2, z), kind) for side in sides]
    inner = walls((-half - 0.2, half + 0.2), (-half - 0.2, half + 0.2), height)
    return [*found, *inner, *walls((-out, out), (-out, out), height)]


def yard(kind):
    return [box((-10, 10), (-10, 10), (-0.2, -0.1), kind)]


INDOORS = {
    **{
        f"deck {s} of {name} at {x}, {y}": (skeleton(kind), (x, y, HEIGHT * s + EYE))
        for s in range(3) for x, y in ((10, 7), (0.6, 0.6), (4, 14.6)) for kind, name in ((FLOOR, "slabs"),)
    },
    "deck of planks, at its edge": ([*skeleton(OTHER), LANDING], (0.5, 0.5, 2 * HEIGHT + EYE)),
    "on the ground below a deck": (skeleton(ground=False), (10, 7, EYE)),
    "on the ground at the corner of a deck": (skeleton(ground=False), (0.6, 0.6, EYE)),
    "roof deck": (house(), (0, 0, 2.8 + EYE)),
    "below a terrace": (TERRACE, (-6, 0, EYE)),
    "below a terrace, at its edge": (TERRACE, (-7.5, 0, EYE)),
    "upon a terrace": (TERRACE, (-6, 2.8, 2.8 + EYE)),
    "under slabs of which no wall is modelled": ([GROUND, house()[-1]], (-3.8, 0, EYE)),
    "in a house": (house(), (0, 0, EYE)),
    "in a ring": (ring(7.5), (10, 0, EYE)),
    "courtyard on a slab": (ring(10, ground=yard(FLOOR)), (0, 0, EYE)),
    "light well": (ring(3.0), (0, 0, EYE)),
    "room without floor and ceiling": (ROOM, (0, 0, EYE)),
    "room without floor and ceiling, but a landing": ([*ROOM, LANDING], (-2, -1, EYE)),
    "beside the one wall of a model": (ROOM[:1], (0, -1.5, EYE)),
}  # fmt: skip
STREET = {
    **{f"{off} m from a facade": (house(), (-4 - off, 0, EYE)) for off in (0.1, 0.3, 0.4, 1.0, 3.0)},
    **{f"{off} m from a facade, beneath eaves": (house(0.5), (-4 - off, 0, EYE)) for off in (0.1, 0.25, 0.45)},
    "beneath wide eaves": (house(0.9), (-4.6, 0, EYE)),
    "beneath eaves, at a corner": (house(0.5), (-4.2, -3.2, EYE)),
    "before a deck": (skeleton(), (-0.4, 7, EYE)),
    "beside a terrace": (TERRACE, (-9, 0, EYE)),
    "beside a room without floor and ceiling": (ROOM, (-5.0, 0, EYE)),
    "courtyard": (ring(10), (0, 0, EYE)),
    "courtyard, near a wall": (ring(10), (7, 3, EYE)),
}


def prior_with(boxes, terrain=()):
    """A building whose last boxes are its terrain."""
    building = building_of([*boxes, *terrain])
    classes = [*building.elements.ifc_class[: len(boxes)], *["IfcSite"] * len(terrain)]
    return prior_of_building(building._replace(elements=building.elements._replace(ifc_class=tuple(classes))))


@pytest.mark.parametrize("case", INDOORS)
def test_a_place_in_on_or_under_a_building_is_indoors_whatever_walls_are_modelled(case):
    boxes, place = INDOORS[case]
    assert not is_outdoors(prior_with(boxes), np.array(place, float))


@pytest.mark.parametrize("case", STREET)
def test_a_place_in_the_street_is_outdoors_with_and_without_terrain(case):
    boxes, place = STREET[case]
    for terrain in ((), (box((-30, 30), (-30, 30), (-0.4, -0.3), OTHER),)):
        if boxes is not ROOM or not terrain:  # which would be in the box of what a model without floors spans
            assert is_outdoors(prior_with(boxes, terrain), np.array(place, float))


def test_a_garden_is_outdoors_over_a_cellar_and_a_floor_under_thin_terrain_is_none():
    garage = box((-20, -4), (-10, 10), (-2.0, -1.8), FLOOR)
    lawn = box((-30, 30), (-30, 30), (-0.2, -0.1), OTHER)
    place = np.array([-10.0, 0.0, EYE])
    assert is_outdoors(prior_with([*house(), garage], (lawn,)), place)
    deck = box((-20, -4), (-10, 10), (-0.4, -0.15), FLOOR)  # which a surface of the site cuts
    assert not is_outdoors(prior_with([*house(), deck], (lawn,)), place)


def test_what_is_new_on_a_deck_is_told(judges):
    slabs, place = [*skeleton(OTHER), LANDING], np.array([0.5, 4.0, 2 * HEIGHT + EYE])
    new = box((4.0, 4.4), (3.8, 4.2), (2 * HEIGHT, 2 * HEIGHT + 3.0), PILLAR)
    prior = prior_with(slabs)
    found = detect_scans(prior, [scan_of([*slabs, new], place, OAK_D_PRO_SMALL)], judges, DetectSettings(refine=False))
    assert OUTDOORS not in found.scans[0].notes
    assert [(one.object_type, one.mismatch_type) for one in found.mismatches] == [("pillar", "added")]
