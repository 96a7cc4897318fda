"""The page of claims: commands that exist, figures that are where it says, and intervals that are what counts give."""

import importlib.util
import re
import shlex

import pytest
from scipy.stats import binomtest

from jaxmm.commands.cli import _glued, _parser
from tests.test_docs import ROOT, SHARED, _source

PAGE = ROOT / "docs" / "what-to-believe.md"
CELL = re.compile(r"\|(?=(?:[^`]*`[^`]*`)*[^`]*$)")  # between cells, not within backticks


def claims():
    """Cells of every row."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    rows = [[cell.strip() for cell in CELL.split(line)[1:-1]] for line in lines]
    return [row for row in rows if row[0] not in ("claim", "---")]


CLAIMS = claims()
each = pytest.mark.parametrize("row", CLAIMS, ids=[row[0][:50] for row in CLAIMS])


def sections():
    """Text of the sections of benchmarks/README.md by their anchors, each with what is below it."""
    lines, found, levels = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8").splitlines(), {}, []
    for line in lines:
        if mark := re.match(r"^(#+) (.+)$", line):
            anchor = re.sub(r"[^a-z0-9 _-]", "", mark[2].lower()).replace(" ", "-")
            levels = [one for one in levels if one[0] < len(mark[1])] + [(len(mark[1]), anchor)]
        for _, anchor in levels:
            found[anchor] = found.get(anchor, "") + " " + line
    return {anchor: " ".join(text.split()) for anchor, text in found.items()}


def test_the_page_has_claims_and_every_cell_of_them():
    assert len(CLAIMS) >= 25 and all(len(row) == 5 and all(row) for row in CLAIMS)


@each
def test_the_command_exists_and_knows_its_options(row):
    (command,) = re.findall(r"`([^`]+)`", row[3])
    words = shlex.split(command)
    if words[0] == "jaxmm":
        _parser().parse_args(_glued(words[1:]))
        return
    assert words[:2] == ["python", "-m"]
    if words[2] == "pytest":
        assert (ROOT / words[3]).is_file()
        return
    assert importlib.util.find_spec(words[2]) is not None
    known = _source(words).read_text(encoding="utf-8") + "".join(
        (ROOT / "benchmarks" / name).read_text(encoding="utf-8") for name in SHARED
    )
    for word in words[3:]:
        assert not word.startswith("--") or f'"{word}"' in known, word


@each
def test_the_figure_stands_where_the_row_says(row):
    places, figures = re.findall(r"benchmarks/README\.md#([\w-]+)\)", row[1]), re.findall(r"`([^`]+)`", row[1])
    assert places or row[1].startswith("no figure")
    text = " ".join(sections()[place] for place in places)
    for figure in figures:
        assert figure in text or figure == "nn-raw", figure


@each
def test_an_interval_of_counts_is_what_they_give(row):
    found = re.search(r"([\d.]+) to ([\d.]+) \((\d+)/(\d+)\)", row[2])
    assert found or "none" in row[2] or "lower ends" in row[2] or "by room" in row[2]
    if found:
        low, high = binomtest(int(found[3]), int(found[4])).proportion_ci(0.95, "exact")
        digits = len(found[1]) - 2
        assert digits >= 3 and (found[1], found[2]) == (f"{low:.{digits}f}", f"{high:.{digits}f}")
