"""What report.html carries: the whole detection, nothing that could run, and no more than a browser can bear."""

import base64
import hashlib
import html
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from jaxmm.reports.page import page_text, write_page
from jaxmm.reports.page_data import Limits, as_script, decoded, encoded, page_data, surface_of
from jaxmm.reports.report_json import to_json
from jaxmm.reports.verdict_words import PROBABILITY_OF_MISMATCH, PROBABILITY_WORDS, VERDICT_WORDS
from jaxmm.verdicts.results import Detection, Drawing, ElementVerdict, Mismatch, PriorFile, ScanRecord
from jaxmm.verdicts.verdicts import PRESENT
from tests.cases.detections import true_case
from tests.cases.pages import EVIL, hostile


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return true_case(tmp_path_factory.mktemp("case"))


def carried(text: str) -> dict:
    """The data of a page, from its HTML."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1])


def corners_of(vertices, faces, element):
    """Every triangle as its element and corners, sorted: the same surface whatever the order."""
    rows = np.concatenate([element[:, None], vertices[faces].reshape(-1, 9)], axis=1)
    return rows[np.lexsort(rows.T)]


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        self.found.append((tag, dict(attributes)))


@pytest.mark.parametrize("kind", ["float32", "int32", "uint8"])
def test_arrays_survive_base64(kind):
    rng = np.random.default_rng(5)
    for shape in [(0, 3), (1,), (7, 3), (2, 3, 5)]:
        array = rng.integers(0, 200, shape).astype(kind)
        again = decoded(encoded(array))
        assert again.dtype == kind and np.array_equal(again, array)
    big_endian = np.array([1.0, 256.5], ">f4")
    assert np.array_equal(decoded(encoded(big_endian)), [1.0, 256.5])


def test_a_page_explains_verdicts_where_there_are_some(case):
    told, silent = (carried(page_text(one))["words"] for one in (case.detection, case.detection._replace(elements=())))
    assert told["verdicts"] == VERDICT_WORDS and told["probability"] == PROBABILITY_WORDS
    assert silent["verdicts"] == {} and silent["probability"] == PROBABILITY_OF_MISMATCH
    assert PROBABILITY_OF_MISMATCH in PROBABILITY_WORDS != PROBABILITY_OF_MISMATCH


def test_page_carries_the_whole_detection(case):
    detection, drawing = case.detection, case.detection.drawing
    found = carried(page_text(detection))
    array = {name: decoded(one) for name, one in found["arrays"].items()}
    assert found["report"] == json.loads(json.dumps(to_json(detection)))
    assert found["key"] == list(drawing.guid) and not found["thinned"]
    for side in ("robot", "prior"):
        assert np.array_equal(array[side], getattr(drawing, side))
        assert np.array_equal(array[f"{side}_evidence"], getattr(drawing, f"{side}_evidence"))
        error = array[f"{side}_probability"] / 255.0 - getattr(drawing, f"{side}_probability")
        assert np.abs(error).max() <= 0.5 / 255 + 1e-6
    element = np.repeat(np.arange(len(drawing.guid)), np.diff(array["first"]))
    drawn = corners_of(array["vertices"], array["faces"], element)
    assert np.array_equal(drawn, corners_of(drawing.vertices, drawing.faces, drawing.face_element))


def test_robot_points_are_carried_scan_by_scan(case):
    detection = hostile(case.detection)
    array = {name: decoded(one) for name, one in page_data(detection)["arrays"].items()}
    order = np.concatenate([np.flatnonzero(detection.drawing.robot_scan == scan) for scan in (0, 1)])
    assert np.array_equal(array["robot"], detection.drawing.robot[order])
    assert np.array_equal(array["robot_scan"], detection.drawing.robot_scan[order])


def test_text_in_the_data_can_neither_end_nor_open_an_element():
    for text in (EVIL, "</ScRiPt >", "<!--<script>", "]]>&lt;", "\ud800 alone", "\x00\u2029"):
        script = as_script({text: [text]})
        assert json.loads(script) == {text: [text]}
        assert script.isascii() and not set("<>&") & set(script)


def test_page_names_the_file_that_was_compared_with(case):
    def header(prior):
        return re.search(r'<p id="prior">(.*?)</p>', page_text(case.detection._replace(prior=prior)), re.S)[1]

    told = "Compared with: building model room.ifc, in metres, IfcProject "
    assert html.unescape(header(case.detection.prior)) == told + case.detection.prior.project
    assert header(PriorFile("a.npy", "cloud", 0.3048)) == "Compared with: point cloud a.npy, in feet"
    assert html.unescape(header(PriorFile(EVIL, "mesh", 0.02))) == f"Compared with: mesh {EVIL}, in units of 0.02 m"
    assert header(None) == ""


def test_page_stands_alone_and_allows_only_its_own_script(case):
    text = page_text(hostile(case.detection))
    tags = Tags()
    tags.feed(text)
    names = [name for name, _ in tags.found]
    assert names.count("script") == 2 and names.count("style") == 1 and names.count("html") == 1
    assert not {"img", "iframe", "object", "embed", "base", "form"} & set(names)
    for tag, attributes in tags.found:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
        assert attributes.get("src") is None and attributes.get("href") in (None, "data:,")
    assert not re.search(r"https?://|@import|url\(", text.replace(json.dumps(EVIL)[1:-1], ""))
    policy = next(one["content"] for tag, one in tags.found if one.get("http-equiv") == "Content-Security-Policy")
    script = text[text.rindex("<script>") + len("<script>") : text.rindex("</script>")]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy and "default-src 'none'" in policy and "unsafe" not in policy


def random_detection(rng, points: int, boxes: int) -> Detection:
    """Points and boxes anywhere in a hall of 40 m, and a sensor in its middle."""
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) - 0.5
    sides = [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 4, 5], [0, 5, 1],
             [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
    vertices = (rng.uniform(-20, 20, (boxes, 1, 3)) + 0.4 * cube).reshape(-1, 3).astype(np.float32)
    faces = (8 * np.arange(boxes)[:, None, None] + sides).reshape(-1, 3).astype(np.int32)
    guid = tuple(f"{number:022d}" for number in range(boxes))

    def cloud():
        place, chance = rng.uniform(-20, 20, (points, 3)), rng.random(points)
        return place.astype(np.float32), chance.astype(np.float32), rng.integers(0, 4, points).astype(np.uint8)

    drawing = Drawing(
        np.zeros(3), *cloud(), np.zeros(points, np.int32), *cloud(), np.zeros(points, np.int32),
        guid, vertices, faces, np.repeat(np.arange(boxes, dtype=np.int32), 12), (np.zeros((0, 3), np.float32),),
    )  # fmt: skip
    elements = tuple(ElementVerdict(name, "IfcWall", "w", "s", PRESENT, 0.1, 1, (1, 2, 3, 4)) for name in guid[:50])
    gone = Mismatch("wall", "removed", np.zeros(3), np.ones(3), 0.0, 0.9, guid[-1])
    scan = ScanRecord("hall.ply", points, (1.0, 2.0, 0.0, 0.0, 0.0), "given", None, {}, {})
    return Detection((gone,), elements, (scan,), {}, {}, {"total": 1.0}, (), drawing)


def test_surface_keeps_what_is_nearest_and_what_is_gone():
    rng = np.random.default_rng(3)
    place = np.array([[1.0, 2.0, 0.0]])
    for limits in [Limits(0, 600, 10**6), Limits(0, 10**6, 240), Limits(0, 101, 10**6), Limits(0, 10**6, 103)]:
        drawing = random_detection(rng, 10, 100).drawing
        kept = surface_of(drawing, place, np.array([99]), limits)
        assert len(kept.faces) <= limits.triangles and len(kept.vertices) <= limits.vertices
        count = np.diff(kept.first)
        assert count[99] == 12 and count.sum() == len(kept.faces)
        assert np.array_equal(np.unique(kept.faces), np.arange(len(kept.vertices)))
        middle = drawing.vertices[drawing.faces].mean(axis=1).reshape(100, 12, 3)
        away = np.linalg.norm(middle - place[0], axis=-1).min(axis=1)
        whole, none = np.flatnonzero(count[:99] == 12), np.flatnonzero(count[:99] == 0)
        assert away[whole].max() < away[none].min() and len(whole) + len(none) >= 98


def test_size_is_bounded_and_the_page_says_so():
    detection = random_detection(np.random.default_rng(4), 310_000, 34_000)
    text = page_text(detection)
    found = carried(text)
    shape = {name: one["shape"] for name, one in found["arrays"].items()}
    assert shape["robot"] == shape["prior"] == [300_000, 3] and shape["faces"][0] == 400_000
    assert len(text) < 30e6
    told = "\n".join(found["thinned"])
    assert "300,000 of 310,000 points of the robot" in told and "400,000 of 408,000 triangles" in told
    assert shape["vertices"][0] <= Limits().vertices


def test_frame_holds_the_room_and_cuts_it_above_the_head(case):
    frame = page_data(case.detection)["frame"]
    building = case.building.triangles.vertices
    floor = building[:, 2].min()
    assert frame["floor"] == pytest.approx(-1.5, abs=0.05) and floor < frame["floor"] + 0.5
    assert 1.8 < frame["cut"] - frame["floor"] < 2.6 and frame["cut"] < frame["ceiling"]
    for scan in case.detection.scans:
        assert all(
            low <= value <= high for low, value, high in zip(frame["low"], scan.pose, frame["high"], strict=False)
        )


def test_points_that_are_left_out_are_passed_by_in_strides_that_webgl_allows(case):
    steps = [int(step) for step in re.findall(r"share: [\d.]+, step: (\d+)", page_text(case.detection))]
    assert len(steps) > 3 and steps[0] == 1 and 12 * max(steps) <= 255


def test_page_replaces_an_old_file_and_leaves_nothing_else(case, tmp_path):
    path = tmp_path / "report.html"
    path.write_text("old")
    write_page(path, case.detection)
    assert path.read_text(encoding="utf-8") == page_text(case.detection)
    assert [one.name for one in tmp_path.iterdir()] == ["report.html"]
