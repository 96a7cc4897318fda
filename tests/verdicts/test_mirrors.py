"""Mirror images of a generated room: named, left out, and never taken for new walls; the mirror stands."""

import dataclasses

import numpy as np
import pytest

from jaxmm.learning.prediction import read_judges
from jaxmm.rays.scan_rays import rays_of_scan
from jaxmm.runs.room_scans import as_cloud, cases_of
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.mirrors import unmirrored
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.mirrors import MIRROR, sheen_of
from warp_scanner.rooms.pairs import PRESETS
from warp_scanner.rooms.scenarios import make_scenes
from warp_scanner.sensors.reflections import reflected, room_caster
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import Spinning

SEED, NUMBER = 42, np.array([2])
SENSOR = Spinning(700, 64, (-30.0, 30.0))


@pytest.fixture(scope="module")
def case():
    """A room whose wall 4 mirrors, scanned, against its own model."""
    settings = dataclasses.replace(
        PRESETS["varied"], scenario="unchanged", condition="occluded", seed=SEED, sensor=SENSOR
    )
    scenes = make_scenes(settings.scene, SEED, NUMBER)
    (found,) = cases_of(settings, range(2, 3))
    sheen = sheen_of(int(scenes.primitives.element.max()) + 1, {4: MIRROR})
    rays = rays_of(SENSOR, scenes.pose)
    seen = reflected(room_caster(scenes.primitives, scenes.in_real), rays, sheen, (SEED, NUMBER)).scan.distance
    points = points_of(scenes.pose, SENSOR.directions(), seen)[0]
    return found._replace(scan=found.scan._replace(points=points[np.isfinite(points[:, 0])]))


def detected(case, **how):
    scan = NamedScan(case.scan, "scan", len(case.scan.points), "given")
    settings = DetectSettings(refine=False, propose_views=False, **how)
    return detect_scans(case.prior, [scan], read_judges(DEFAULT), settings)


@pytest.mark.long
def test_the_wall_that_mirrors_stands_and_is_named(case):
    with_it, without = detected(case), detected(case, mirrors=False)
    note = "% of its points are mirror images in 'element 4' and were left out"
    assert any(note in one for one in with_it.scans[0].notes)
    assert not any("mirror" in one for one in without.scans[0].notes)
    verdict = {one.guid: one.verdict for one in with_it.elements}
    assert verdict["element 4"] == "present" and not with_it.mismatches
    assert {one.guid: one.verdict for one in without.elements}["element 4"] == "removed"


def test_the_thesiss_preset_takes_scans_as_they_are(case):
    found = detected(case, preset="thesis")
    assert not any("mirror" in one for one in found.scans[0].notes)


def test_of_a_cloud_the_place_is_named(case):
    scan, notes = unmirrored(as_cloud(case), case.scan, rays_of_scan(case.scan))
    assert "mirror images in a surface at" in notes[0]
    assert len(scan.points) > 0 and scan is not case.scan
