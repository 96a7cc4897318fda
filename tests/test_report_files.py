"""The plain files of a detection, read back by other readers: every number, every name, and nothing that runs."""

import csv
import io
import struct
from collections import Counter
from html.parser import HTMLParser

import numpy as np
import pytest
import trimesh
from detections import true_case
from test_report import random_detection

from jaxmm.evidence import SUPPORT
from jaxmm.mismatch_points import MARGIN, inside, mismatch_points
from jaxmm.notebook import detection_html
from jaxmm.page import page_text
from jaxmm.report import ElementVerdict, Mismatch, PriorFile, ScanRecord, to_json
from jaxmm.report_files import (
    ADDED_COLOR,
    PLAIN_FILES,
    REMOVED_COLOR,
    elements_csv,
    mismatches_csv,
    write_mismatch_points,
    write_plain,
)
from jaxmm.report_text import as_markdown, escaped, percent, printable
from jaxmm.topics import topics_of
from jaxmm.verdict_words import (
    ASSUMED_WORDS,
    EVIDENCE_WORDS,
    OBSERVABLE_WORDS,
    OTHER_TYPE_WORDS,
    ROBOT_EVIDENCE_WORDS,
    VERDICT_WORDS,
)
from jaxmm.verdicts import VERDICTS

GRID = np.array([192_340.125, 444_123.375, 12.5])  # [m] a place on a national grid
HOSTILE = (
    "=HYPERLINK(1)", "+1", "-1", "@SUM(A1)", "\t=1", 'a "quoted", name', "two\r\nlines", "a|b | c", "`code`",
    "**bold**", "_under_", "snake_case", "<img src=x onerror=alert(1)>", "[link](http://x)", "# heading", "- item",
    "1. item", "2) x", "&amp;", "$x$", "\\", "~~gone~~", "Stütze Ø 30", "柱", "![i](x)", "<!-- -->", "</table>", "---",
    "1.5 m", "a\\|b",
)  # fmt: skip


class Page(HTMLParser):
    """The text of every cell and paragraph, and all tags."""

    def __init__(self, html: str):
        super().__init__()
        self.tags, self.texts = Counter(), [""]
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.tags[tag] += 1
        if tag in ("td", "th", "li", "p", "h1", "h2", "h3", "summary"):
            self.texts.append("")

    def handle_data(self, data):
        self.texts[-1] += data


@pytest.fixture(scope="module")
def removed(tmp_path_factory):
    """A pillar and a wall are gone."""
    return true_case(tmp_path_factory.mktemp("removed")).detection


@pytest.fixture(scope="module")
def added(tmp_path_factory):
    return true_case(tmp_path_factory.mktemp("added"), "pillar_added").detection


def named(names):
    """Occluded elements of some names, which a report lists in full."""
    return tuple(ElementVerdict(name, name, name, name, "occluded", 0.02, 3, (1, 2, 3, 4)) for name in names)


def hostile(detection):
    """The same with names that would break a table or run."""
    mismatches = tuple(one._replace(element=name) for one, name in zip(detection.mismatches, HOSTILE, strict=False))
    scans = tuple(detection.scans[0]._replace(file=name, notes=(name,)) for name in HOSTILE)
    settings = {name: name for name in HOSTILE}
    return detection._replace(
        mismatches=mismatches,
        elements=named(HOSTILE),
        scans=scans,
        notes=HOSTILE,
        settings=settings,
        prior=PriorFile("".join(HOSTILE), "ifc", 1.0, HOSTILE[0]),
    )


def moved_to_grid(detection):
    """The same, far from the origin."""
    mismatches = tuple(one._replace(center=one.center + GRID) for one in detection.mismatches)
    drawing = detection.drawing._replace(origin=detection.drawing.origin + GRID)
    return detection._replace(mismatches=mismatches, drawing=drawing)


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text, newline=""), strict=True))


def test_all_files_are_there_and_no_others(removed, tmp_path):
    write_plain(tmp_path, removed)
    write_plain(tmp_path, removed)  # older files are replaced
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(PLAIN_FILES)
    assert (tmp_path / "sentences.txt").read_text().splitlines() == list(removed.sentences)


def test_whatever_was_found_can_be_written(tmp_path):
    for seed in range(30):
        detection = random_detection(seed)
        write_plain(tmp_path, detection)
        elements = (tmp_path / "elements.csv").read_bytes().decode("utf-8")
        assert len(rows_of(elements)) == len(detection.elements)
        (tmp_path / "report.md").read_bytes().decode("utf-8")


def test_the_csv_of_mismatches_says_all(removed):
    rows = rows_of(mismatches_csv(removed.mismatches))
    assert len(rows) == len(removed.mismatches) == 2
    for index, (row, one) in enumerate(zip(rows, removed.mismatches, strict=True), 1):
        center = [float(row[f"center_{axis} [m]"]) for axis in "xyz"]
        size = [float(row[f"dimension_{axis} [m]"]) for axis in "xyz"]
        np.testing.assert_allclose([*center, *size], [*one.center, *one.dimensions], atol=1e-6)
        assert (row["number"], row["element"], row["mismatch_type"]) == (str(index), one.element, "removed")
        assert float(row["observable_fraction"]) == pytest.approx(one.observable_fraction, abs=1e-6)
        assert row["measured"] == "yes yes yes"


def test_a_size_that_is_assumed_is_marked_in_every_report(added):
    one = added.mismatches[0]._replace(dimensions=np.array([2.0, 0.15, 2.5]), measured=(True, False, True))
    told = added._replace(mismatches=(one,))
    assert rows_of(mismatches_csv([one]))[0]["measured"] == "yes no yes"
    assert "2.00, \\~0.15, 2.50" in as_markdown(told) and ASSUMED_WORDS[1:] in as_markdown(told)
    assert "2.00, ~0.15, 2.50" in detection_html(told)
    assert any("2.00, ~0.15, 2.50 m: ~ before" in topic.description for topic in topics_of(told, "house"))


def test_what_speaks_against_a_place_stands_before_all_that_it_tells(removed):
    """People look at a table, an image or a topic first, and the notes come last."""
    (scan,) = removed.scans
    doubt = "half of <b>its</b> points lie elsewhere: is the place right?"
    told = removed._replace(scans=(scan._replace(notes=("err by 4 mm", doubt), doubts=(doubt,)),))
    assert scan.doubts == () == removed.doubts and told.doubts == (f"robot.ply: {doubt}",)
    text = as_markdown(told)
    assert text.index("**In doubt:** robot.ply: half of") < text.index("## Mismatches") < text.index("err by 4 mm")
    assert "In doubt" not in as_markdown(removed) and "In doubt" not in detection_html(removed)
    for html in (page_text(told), detection_html(told)):
        line = html.index("In doubt: robot.ply: half of &lt;b&gt;its")
        assert line < html.index("<main>" if "<main>" in html else "<table>")
    assert all(f"In doubt: robot.ply: {doubt}" in topic.description for topic in topics_of(told, "a"))
    gone = tuple(one for one in removed.elements if one.verdict != "present")
    assert gone and "nothing to be present" in removed._replace(elements=gone).doubts[0]
    assert not any("In doubt" in topic.description for topic in topics_of(removed, "a"))


def test_a_moved_object_names_the_number_that_it_was():
    gone = Mismatch("pillar", "removed", np.zeros(3), np.ones(3), 0.0, 0.9, "abc")
    new = Mismatch("pillar", "added", np.ones(3), np.ones(3), 0.0, 0.9, None, 0)
    rows = rows_of(mismatches_csv([gone, new]))
    assert [row["moved_from"] for row in rows] == ["", "1"] and rows[0]["number"] == "1"


def test_what_is_not_known_is_an_empty_cell():
    (row,) = rows_of(mismatches_csv([Mismatch("wall", "added", np.full(3, np.nan), np.ones(3), np.inf, 0.5)]))
    assert [row[name] for name in ("center_x [m]", "rotation [deg]", "element", "observable_fraction")] == [""] * 4


def test_names_survive_in_the_csv_and_none_is_a_formula():
    text = elements_csv(named(HOSTILE))
    assert text.replace("two\r\nlines", "").count("\r\n") == text.replace("two\r\nlines", "").count("\n")
    for row, name in zip(rows_of(text), HOSTILE, strict=True):
        for column in ("guid", "ifc_class", "name", "storey"):
            assert row[column][0] not in "=+-@\t\r\n"
            assert row[column].removeprefix("'") == name
        assert row["rays_through"] == "1" and row["rays_unseen"] == "4" and row["next_view_x [m]"] == ""


def test_points_of_the_true_objects_are_told_apart(removed, added):
    assert (mismatch_points(removed).robot == -1).all()
    gone = removed.drawing.prior_probability > 0.5
    np.testing.assert_array_equal(mismatch_points(removed).prior >= 0, gone)
    new = added.drawing.robot_probability > 0.5
    assert new.sum() > 50
    np.testing.assert_array_equal(mismatch_points(added).robot >= 0, new)
    assert (mismatch_points(added).prior == -1).all()


def test_what_the_model_has_in_an_added_box_is_not_of_it(added):
    """The floor below a new pillar and the wall beside it lie in its box, or nearly."""
    drawing = added.drawing
    chosen = np.flatnonzero(mismatch_points(added).robot >= 0)[::2]
    evidence = drawing.robot_evidence.copy()
    evidence[chosen] = SUPPORT
    shown = mismatch_points(added._replace(drawing=drawing._replace(robot_evidence=evidence)))
    assert (shown.robot[chosen] == -1).all() and (shown.robot >= 0).any()


def test_without_elements_a_removed_box_owns_what_rays_went_through(removed):
    cloud = removed._replace(mismatches=tuple(one._replace(element=None) for one in removed.mismatches))
    expected = mismatch_points(removed).prior
    np.testing.assert_array_equal(mismatch_points(cloud).prior, expected)
    np.testing.assert_array_equal(mismatch_points(moved_to_grid(cloud)).prior, expected)


def test_a_turned_box_holds_what_its_own_axes_reach():
    rng = np.random.default_rng(0)
    for _ in range(50):
        yaw, size, center = rng.uniform(-360, 360), rng.uniform(0.2, 3, 3), rng.uniform(-5, 5, 3)
        one = Mismatch("wall", "added", center + GRID, size, yaw, 0.9)
        local = rng.uniform(-2.5, 2.5, (500, 3))
        turn = np.array([np.exp(1j * np.radians(yaw))])
        level = (local[:, 0] + 1j * local[:, 1]) * turn
        points = np.column_stack([level.real, level.imag, local[:, 2]]) + center
        within = (np.abs(local) <= size / 2 + MARGIN).all(axis=1)
        np.testing.assert_array_equal(inside(one, points, GRID), within)


def test_the_ply_loses_nothing_and_its_colours_tell_the_objects(added, tmp_path):
    path, detection = tmp_path / "points.ply", moved_to_grid(added)
    write_mismatch_points(path, detection)
    drawing, shown = detection.drawing, mismatch_points(detection)
    data = trimesh.load(path).metadata["_ply_raw"]["vertex"]["data"]
    points = np.concatenate([drawing.robot, drawing.prior]).astype(np.float64) + drawing.origin
    np.testing.assert_array_equal(np.stack([data[axis] for axis in "xyz"], axis=1), points)
    np.testing.assert_array_equal(data["side"], np.repeat([0, 1], [len(drawing.robot), len(drawing.prior)]))
    np.testing.assert_array_equal(
        data["probability"], np.concatenate([drawing.robot_probability, drawing.prior_probability])
    )
    color = np.stack([data[name] for name in ("red", "green", "blue")], axis=1)
    robot, prior = np.split(color, [len(drawing.robot)])
    np.testing.assert_array_equal((robot == ADDED_COLOR).all(axis=1), shown.robot >= 0)
    np.testing.assert_array_equal((prior == REMOVED_COLOR).all(axis=1), shown.prior >= 0)
    grey = robot[shown.robot < 0]
    assert (grey == grey[:, :1]).all()
    kinds = {kind: set(grey[drawing.robot_evidence[shown.robot < 0] == kind][:, 0]) for kind in range(4)}
    assert all(len(values) <= 1 for values in kinds.values()) and len(set().union(*kinds.values())) >= 2


def test_open3d_reads_the_same_points(removed, tmp_path):
    open3d = pytest.importorskip("open3d")
    detection = moved_to_grid(removed)
    write_mismatch_points(tmp_path / "points.ply", detection)
    cloud = open3d.io.read_point_cloud(str(tmp_path / "points.ply"))
    drawing = detection.drawing
    points = np.concatenate([drawing.robot, drawing.prior]).astype(np.float64) + drawing.origin
    np.testing.assert_array_equal(np.asarray(cloud.points), points)
    gone = (np.round(np.asarray(cloud.colors) * 255) == REMOVED_COLOR).all(axis=1)
    assert gone.sum() == (mismatch_points(detection).prior >= 0).sum() > 100


def test_the_ply_is_as_long_as_its_header_says(removed, tmp_path):
    write_mismatch_points(tmp_path / "points.ply", removed)
    header, body = (tmp_path / "points.ply").read_bytes().split(b"end_header\n", 1)
    count = len(removed.drawing.robot) + len(removed.drawing.prior)
    assert f"element vertex {count}\n".encode() in header and len(body) == count * struct.calcsize("<3d3BfB")


def rendered(markdown):
    return Page(pytest.importorskip("markdown_it").MarkdownIt("gfm-like", {"linkify": False}).render(markdown))


def test_the_markdown_shows_hostile_names_as_they_are(removed):
    page = rendered(as_markdown(hostile(removed)))
    plain = rendered(as_markdown(removed._replace(elements=named(["x"] * len(HOSTILE)))))
    assert not page.tags.keys() & {"img", "a", "em", "s", "script", "hr"}
    for tag in ("table", "h1", "h2", "h3"):
        assert page.tags[tag] == plain.tags[tag]
    for name in HOSTILE:
        shown = " ".join(name.split())
        assert sum(text.strip() == shown for text in page.texts) >= 5, name  # four columns, and a note


def test_every_row_of_a_table_has_as_many_cells_as_its_head(removed):
    columns = None
    for line in as_markdown(hostile(removed)).splitlines():
        count = line.replace("\\|", "").count("|") if line.startswith("|") else None
        assert columns is None or count is None or count == columns, line
        columns = count


def test_long_tables_are_counted_not_listed(removed):
    rng = np.random.default_rng(0)
    verdicts = [VERDICTS[index] for index in rng.choice(4, 3000, p=[0.7, 0.01, 0.01, 0.28])]
    elements = tuple(
        ElementVerdict(f"guid{index}", "IfcWall", "", f"level {index % 3}", name, 0.02, 3, (1, 2, 3, 4))
        for index, name in enumerate(verdicts)
    )
    text = as_markdown(removed._replace(elements=elements))
    assert len(text.splitlines()) < 300
    for index, name in enumerate(verdicts):
        assert (f"`guid{index}`" in text) == (name in ("removed", "occluded"))
    told = [
        line.split(" | ") for line in text.splitlines() if line.startswith(("| present | Ifc", "| unscanned | Ifc"))
    ]
    assert sum(int(cells[-1].strip(" |")) for cells in told) == sum(n in ("present", "unscanned") for n in verdicts)


def test_the_report_explains_what_it_says(removed):
    text = as_markdown(removed)
    assert all(words in text for words in VERDICT_WORDS.values())
    assert all(line in text for line in removed.sentences) and all(note in text for note in removed.notes)
    assert "2 % here" in text and "97 %" in text
    assert "None was found" in as_markdown(removed._replace(mismatches=()))
    without = as_markdown(removed._replace(elements=()))  # as of a point cloud: no verdict is told, nor explained
    assert "no elements" in without and OBSERVABLE_WORDS in without and "keeps the probability" not in without
    assert not any(words in without for words in VERDICT_WORDS.values())


def test_a_single_scan_shows_nothing_alone(removed):
    """There is no other that could show too little."""
    one = removed.scans[0]._replace(shows=2, alone=2)
    for count, said in ((1, False), (2, True)):
        text = as_markdown(removed._replace(scans=(one,) * count))
        assert "Mismatches that it shows: 2" in text and ("2 of them alone" in text) == said


def test_words_cover_all_verdicts_and_all_evidence():
    assert tuple(VERDICT_WORDS) == VERDICTS
    assert tuple(EVIDENCE_WORDS) == tuple(ROBOT_EVIDENCE_WORDS) == ("through", "support", "blocked", "unseen")


@pytest.mark.parametrize(
    "share, told",
    [(0.0, "0 %"), (0.004, "< 1 %"), (0.5, "50 %"), (0.994, "> 99 %"), (1.0, "100 %"), (None, "-"), (np.nan, "-")],
)
def test_nearly_sure_is_not_rounded_to_sure(share, told):
    assert percent(share) == told


def test_text_of_other_encodings_can_be_written():
    for text in ("\udcff", "a\ud800b", "\U0001f3e0", "Ø"):
        assert printable(text).encode("utf-8")
    assert printable("Ø \U0001f3e0 柱") == "Ø \U0001f3e0 柱" and escaped("a\r\n\u2028b\x00") == "a b"


def test_a_notebook_shows_it_and_runs_nothing(removed):
    html = detection_html(hostile(removed))
    page = Page(html)
    assert page.tags["img"] == 1 and not page.tags.keys() & {"script", "a", "link", "iframe"}
    texts = [text.strip() for text in page.texts]
    for name in HOSTILE:
        assert sum(text == name.strip() for text in texts) >= 4, name
    assert "http" not in html.replace("http://x", "") and "onerror" not in html.replace("onerror=alert(1)&gt;", "")


def test_a_notebook_says_of_each_scan_file_nothing_that_is_not_known():
    scan = ScanRecord("a.ply", 1, (0.0, 0.0, 1.0, 0.0, 0.0), "given", None, {}, {})
    empty = random_detection(0)._replace(mismatches=(), elements=(), notes=(), scans=(scan,))
    assert "no mismatch" in detection_html(empty)


def test_what_may_be_of_the_other_type_says_so_in_every_report(added):
    one = added.mismatches[0]._replace(object_type="wall", shape="rectangular", type_probability=0.78)
    told = added._replace(mismatches=(one,))
    assert rows_of(mismatches_csv([one]))[0]["type_probability"] == "0.78"
    assert to_json(told)["mismatches"][0]["type_probability"] == 0.78
    assert "| wall, or pillar (22 %) |" in as_markdown(told) and "wall, or pillar (22 %)" in detection_html(told)
    assert OTHER_TYPE_WORDS in as_markdown(told) and OTHER_TYPE_WORDS in detection_html(told)
    (topic,) = topics_of(told, "house")
    assert "The probability that it is a pillar instead is 0.220." in topic.description


@pytest.mark.parametrize("sure", [None, 0.95, 1.0, float("nan")])
def test_a_type_that_is_sure_or_was_never_asked_for_stands_alone(added, sure):
    one = added.mismatches[0]._replace(object_type="pillar", shape="round", type_probability=sure)
    told = added._replace(mismatches=(one,))
    assert "| round pillar |" in as_markdown(told) and ", or wall" not in detection_html(told)
    assert OTHER_TYPE_WORDS not in as_markdown(told) + detection_html(told)
    assert "instead" not in topics_of(told, "house")[0].description
    assert rows_of(mismatches_csv([one]))[0]["type_probability"] == ("" if sure is None or sure != sure else str(sure))
