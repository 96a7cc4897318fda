"""What it takes to draw figures of a detection: little more for each more station, and one figure at a time."""

import gc
import tracemalloc
import weakref

import numpy as np
import pytest

from jaxmm import vectors
from jaxmm.reports import detection_figures, snapshots
from jaxmm.reports.detection_figures import panels_of, write_figures
from tests.cases.detections import thinned, true_case

pytestmark = pytest.mark.usefixtures("coarse")


@pytest.fixture(scope="module")
def sparse(tmp_path_factory):
    """A pillar and a wall are gone; of the points there is a tenth, for speed."""
    return thinned(true_case(tmp_path_factory.mktemp("removed")).detection)


class Figure:
    """It refers to itself, as figures do."""

    def __init__(self):
        self.own = self


def test_a_figure_is_gone_before_the_next_is_drawn(sparse, tmp_path, monkeypatch):
    """Its points and its canvas are a third of the memory of the process that draws."""
    first = []
    monkeypatch.setattr(detection_figures, "evidence_figure", lambda *_: first.append(weakref.ref(Figure())))
    left = []
    monkeypatch.setattr(detection_figures, "probability_figure", lambda *_: left.append(first[0]()))
    gc.disable()
    try:
        write_figures(tmp_path, sparse, ("evidence.png", "probability.png"))
    finally:
        gc.enable()
    assert left == [None]


def many(detection, times):
    """As from so many times as many stations, all of which see the same."""
    drawing, count = detection.drawing, len(detection.scans)
    names = [f"{side}{name}" for side in ("robot", "prior") for name in ("", "_probability", "_evidence")]
    names.append("prior_element")
    fields = {name: np.concatenate([getattr(drawing, name)] * times) for name in names}
    scan = np.concatenate([drawing.robot_scan + count * number for number in range(times)])
    views = tuple(drawing.fields_of_view) * times
    drawn = drawing._replace(**fields, robot_scan=scan, fields_of_view=views)
    return detection._replace(drawing=drawn, scans=detection.scans * times)


def test_each_more_station_adds_little_to_what_drawing_takes(sparse, monkeypatch):
    """Stations hand over points; what is worked out of these on the way is of a part of them at a time."""
    monkeypatch.setattr(vectors, "BLOCK", 2000)
    for module, name in ((detection_figures, "MOST_POINTS"), (snapshots, "_MOST_POINTS")):
        monkeypatch.setattr(module, name, 500)
    one, points = sparse.mismatches[0], len(sparse.drawing.robot) + len(sparse.drawing.prior)
    camera = snapshots.camera_at(sparse.scans[0].pose, one.center)
    for draw in (panels_of, lambda detection: snapshots.snapshot(detection.drawing, one, camera)):
        peaks = []
        for count in (50_000, 150_000):
            detection = many(sparse, -(-count // points))
            tracemalloc.start()
            draw(detection)
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        assert (peaks[1] - peaks[0]) / 100_000 < 45, draw  # bytes of each point
