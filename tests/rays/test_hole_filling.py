"""Hole interpolation: flat surfaces are restored, nothing known is touched, and a removed wall is no hole."""

import numpy as np

from jaxmm.rays.hole_filling import fill_holes

SENSOR = np.array([1.0, 2.0, 1.5])


def wall(distance, spacing=0.05):
    y, z = (axis.ravel() for axis in np.meshgrid(np.arange(-2, 2, spacing), np.arange(-1, 1, spacing)))
    return np.column_stack([np.full(y.size, distance), y, z]) + SENSOR


def test_a_hole_in_a_wall_is_filled_with_wall():
    whole = wall(3.0)
    offset = whole - SENSOR
    hidden = (np.abs(offset[:, 1]) < 0.5) & (np.abs(offset[:, 2]) < 0.4)
    filled = fill_holes(whole[~hidden], SENSOR, whole)
    np.testing.assert_array_equal(filled[: (~hidden).sum()], whole[~hidden].astype(np.float32))
    new = filled[(~hidden).sum() :] - SENSOR
    # Angles are not places, so a plane is restored to about a centimetre.
    assert len(new) > 100 and np.all(np.abs(new[:, 0] - 3.0) < 0.05)
    assert np.all(np.abs(new[:, 1]) < 0.5) and np.all(np.abs(new[:, 2]) < 0.4)


def test_what_is_whole_stays_and_so_does_what_is_next_to_nothing():
    whole = wall(3.0)
    assert len(fill_holes(whole, SENSOR, whole)) == len(whole)
    assert fill_holes(whole[:3], SENSOR, whole).shape == (3, 3)
    assert fill_holes(whole, SENSOR, whole[:0]).shape == whole.shape


def test_what_was_removed_is_seen_through_and_stays_changed():
    behind, before = wall(5.0, 0.08), wall(3.0)
    filled = fill_holes(behind, SENSOR, before)
    assert np.linalg.norm(filled - SENSOR, axis=1).min() > 4.5


def test_a_view_across_the_seam_of_azimuths():
    turned = (wall(3.0) - SENSOR) * [-1, 1, 1] + SENSOR
    hidden = np.linalg.norm((turned - SENSOR)[:, 1:], axis=1) < 0.5
    new = fill_holes(turned[~hidden], SENSOR, turned)[(~hidden).sum() :] - SENSOR
    assert len(new) > 50 and np.all(np.abs(new[:, 0] + 3.0) < 0.05)


def test_directions_on_one_line_surround_nothing():
    row = wall(3.0)[:40]
    for points in (row, np.repeat(row[:1], 50, axis=0)):
        assert len(fill_holes(points, SENSOR, wall(3.0))) == len(points)
