"""What people read of a detection, as Markdown and in notebooks: all that is known, and nothing that runs."""

from collections import Counter
from html.parser import HTMLParser

import numpy as np
import pytest

from jaxmm.reports.bcf_topics import topics_of
from jaxmm.reports.markdown import as_markdown, escaped, number, percent, printable
from jaxmm.reports.notebook import detection_html
from jaxmm.reports.page import page_text
from jaxmm.reports.page_data import page_data
from jaxmm.reports.plain_files import mismatches_csv
from jaxmm.reports.report_json import to_json
from jaxmm.reports.verdict_words import (
    ASSUMED_WORDS,
    EVIDENCE_WORDS,
    IN_FRONT,
    LEFT_OPEN,
    NOTHING_BACK,
    OBSERVABLE_WORDS,
    OTHER_TYPE_WORDS,
    PASSES,
    ROBOT_EVIDENCE_WORDS,
    VERDICT_WORDS,
)
from jaxmm.verdicts.results import ElementVerdict, PriorFile, ScanRecord
from jaxmm.verdicts.verdicts import OCCLUDED, PRESENT, VERDICTS
from tests.cases.detections import HOSTILE, named, rows_of
from tests.verdicts.test_results import random_detection


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


@pytest.mark.parametrize(
    "rays, why",
    [
        pytest.param((0, 4, 20, 900), NOTHING_BACK, id="dark, or a mirror"),
        pytest.param((3, 0, 500, 20), IN_FRONT, id="behind a cupboard"),
        pytest.param((700, 600, 20, 0), LEFT_OPEN, id="partly of glass"),
        pytest.param((9, 0, 0, 0), LEFT_OPEN, id="few rays"),
        pytest.param((1000, 0, 0, 0), PASSES, id="all of glass"),
    ],
)
def test_what_is_occluded_says_why(rays, why):
    """In the report, the notebook and the page: whether to look again from there is another thing each time."""
    detection = random_detection(np.random.default_rng(5))
    one = detection.elements[0]._replace(verdict=OCCLUDED, rays=rays, next_view=None)
    detection = detection._replace(
        elements=(one, *(other._replace(verdict=PRESENT) for other in detection.elements[1:]))
    )
    assert f"| {why} | none found |" in as_markdown(detection)
    assert why in Page(detection_html(detection)).texts
    told = page_data(detection)["why"]
    assert told[0] == why and not any(told[1:])


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


def test_a_size_that_is_assumed_is_marked_in_every_report(added):
    one = added.mismatches[0]._replace(dimensions=np.array([2.0, 0.15, 2.5]), measured=(True, False, True))
    told = added._replace(mismatches=(one,))
    assert rows_of(mismatches_csv([one]))[0]["measured"] == "x z"
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
    verdicts = [VERDICTS[index] for index in rng.choice(5, 3000, p=[0.7, 0.0, 0.01, 0.01, 0.28])]
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


def test_numbers_are_those_of_the_page():
    """It reads six digits from report.json, and its toFixed rounds halves up."""
    told = {2.125: "2.13", 1.4249999996: "1.43", 1.4249: "1.42", -0.001: "0.00", -2.125: "-2.13"}
    assert [number(value) for value in told] == list(told.values()) and percent(0.425) == "43 %"
