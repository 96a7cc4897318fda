"""What all faces but some tell of a pose."""

import numpy as np
import pytest

from jaxmm.deviations.deviation import faces_of
from jaxmm.deviations.pose_errors import KEPT, REGISTERED
from jaxmm.rays.open_directions import GIVEN
from tests.cases.box_building import building_of
from tests.deviations.test_deviation import HALL, moved, seen
from warp_scanner.sensors.triangles import prepare


def all_poses(seed, rows, trust=REGISTERED):
    """The faces of a hall of which two elements moved, and every pose that one scan of it may have."""
    rng = np.random.default_rng(seed)
    real = model = building_of([HALL[row] for row in rows]).triangles
    for row in rng.permutation(range(2, len(rows)))[:2]:
        real = moved(real, row, (*rng.uniform(-0.02, 0.02, 2), 0.0))
    found = faces_of(prepare(model), seen(real, noise=0.003, seed=seed), trust)
    return found, [each.fit for each in found.seen], [*found.poses, *found.unlikely]


@pytest.mark.parametrize("rows", [range(len(HALL)), range(6)])
@pytest.mark.parametrize("seed", range(6))
def test_without_any_face_a_pose_is_as_it_was_known_before(seed, rows):
    """Also where a face was asked to be silent: a vote that it did not have is not taken back."""
    found, fits, poses = all_poses(seed, rows)
    assert len(poses) > 1
    for pose in poses:
        correction, spread = pose.without(fits, found.sensor)
        assert correction == pytest.approx(np.zeros(6), abs=1e-6)
        assert np.sqrt(np.diag(spread)) == pytest.approx(GIVEN, rel=1e-3)


@pytest.mark.parametrize("trust", [KEPT, REGISTERED])
@pytest.mark.parametrize("seed", range(4))
def test_what_has_a_vote_leaves_a_pose_less_sure_and_what_has_none_as_it_is(seed, trust):
    found, fits, poses = all_poses(seed, range(6), trust)
    for pose in poses:
        for fit in fits:
            _, spread = pose.without([fit], found.sensor)
            assert np.linalg.eigvalsh((spread - pose.covariance) / np.outer(GIVEN, GIVEN)).min() > -1e-9
            correction, spread = pose.without([fit._replace(number=-1)], found.sensor)
            assert correction == pytest.approx(pose.correction, abs=1e-9)
            assert spread == pytest.approx(pose.covariance, abs=1e-12)
