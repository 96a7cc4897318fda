"""The files of `jaxmm progress`: what they hold, that they are whole or not at all, and that names stay text."""

import csv
import hashlib
import io
import json
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import pytest

import jaxmm
from jaxmm.commands.cli import main
from jaxmm.weeks.history import follow
from jaxmm.weeks.outlines import outlines_of
from jaxmm.weeks.page import page_data, page_text
from jaxmm.weeks.reports import read_weeks
from jaxmm.weeks.shares import shares_of
from jaxmm.weeks.tables import elements_csv, shares_csv, to_json
from tests.cases.detections import HOSTILE
from tests.cases.four_weeks import DATES, SEEN, STATES, changed, report, write_reports
from tests.cases.pages import EVIL

SCHEMA = json.loads((Path(jaxmm.__file__).parent / "progress_schema.json").read_text(encoding="utf-8"))
FILES = {"progress.csv", "shares.csv", "progress.xlsx", "progress.json", "progress.html", "plan_1.png", "plan_2.png"}


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    return write_reports(tmp_path_factory.mktemp("four"))


@pytest.fixture(scope="module")
def four(paths):
    return follow(read_weeks(paths))


@pytest.fixture(scope="module")
def out(paths, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out") / "progress"
    assert main(["progress", *map(str, paths), "--out", str(folder)]) == 0
    return folder


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text, newline=""), strict=True))


def test_everything_is_written_and_nothing_else(out):
    pytest.importorskip("openpyxl")
    assert {path.name for path in out.iterdir()} == FILES
    assert list(out.parent.iterdir()) == [out]


def test_the_same_reports_give_the_same_bytes(out, paths, tmp_path):
    assert main(["progress", *map(str, reversed(paths)), "--out", str(tmp_path / "again")]) == 0
    for path in out.iterdir():
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes(), path.name


def test_the_table_says_what_the_case_is(out):
    rows = {row["name"]: row for row in rows_of((out / "progress.csv").read_bytes().decode())}
    assert rows.keys() == SEEN.keys()
    for name, states in STATES.items():
        cells = [rows[name][f"state {date}"] for date in DATES]
        assert [cell.strip("()") for cell in cells] == list(states) and rows[name]["state"] == states[-1]
        # In brackets where that week told nothing, and an earlier one had.
        told = [letter in "pdr" for letter in SEEN[name]]
        assert [cell.startswith("(") for cell in cells] == [
            not now and any(told[:week]) for week, now in enumerate(told)
        ]
    two = rows["B2"]
    assert (two["first_seen"], two["not_before"], two["displaced"]) == (DATES[2], DATES[1], DATES[2])
    assert float(two[f"offset_x {DATES[3]} [m]"]) == 0.061 and two[f"offset_y {DATES[3]} [m]"] == ""
    assert float(two["moved [m]"]) == pytest.approx(0.029)
    shares = rows_of((out / "shares.csv").read_bytes().decode())
    assert len(shares) == 4 * (1 + 2 + 2) and shares[3]["share_at_least"] == "0.666667"


def test_the_schema_takes_what_is_written(out, four):
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    told = json.loads((out / "progress.json").read_text())
    jsonschema.validate(told, SCHEMA)
    assert told == json.loads(json.dumps(to_json(four, shares_of(four))))
    assert [week["date"] for week in told["weeks"]] == list(DATES) and told["weeks"][0]["report"] == "week0"
    for wrong in (("weeks", 0, "date"), ("elements", 0, "state"), ("shares", 0, "kind")):
        assert not jsonschema.Draft202012Validator(SCHEMA).is_valid(changed(told, wrong, "other"))
        assert not jsonschema.Draft202012Validator(SCHEMA).is_valid(changed(told, wrong, ...))


def test_the_workbook_holds_four_tables(out):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.load_workbook(out / "progress.xlsx")
    sheets = {sheet.title: list(sheet.iter_rows(values_only=True)) for sheet in book}
    assert list(sheets) == ["Elements", "Changes", "Shares", "Offsets"]
    assert len(sheets["Elements"]) == 1 + len(SEEN)
    # Two files may use one GlobalId: an element is known by both.
    assert all(sheets[title][0][at + 3 : at + 5] == ("GlobalId", "file") for title, at in
               (("Elements", 0), ("Changes", 3), ("Offsets", 0)))  # fmt: skip
    changes = {(row[0], row[5]): row[1:3] for row in sheets["Changes"][1:]}
    assert changes[DATES[3], "A3"] == ("built", "removed") and (DATES[3], "A1") not in changes
    assert changes[DATES[0], "A1"] == ("not seen", "first seen to stand")
    assert changes[DATES[1], "A3"] == ("not built", "built")
    (two,) = [row for row in sheets["Offsets"] if row[2] == "B2" and row[5] == DATES[3]]
    assert two[6:9] == (61, 57, 65) and two[9:12] == (None,) * 3


def test_plans_are_drawn_in_the_colours_of_the_weeks(out):
    """The ground floor: two walls of the first week are darker than that of the third; the removed one is none."""
    picture = matplotlib.image.imread(out / "plan_1.png")[..., :3]
    flat = (picture * 255).round().astype(int).reshape(-1, 3)
    count = {colour: (flat == colour).all(axis=1).sum() for colour in ((0x47, 0x2A, 0x7A), (0x34, 0x60, 0x8D))}
    assert count[0x47, 0x2A, 0x7A] > 3000
    upper = (matplotlib.image.imread(out / "plan_2.png")[..., :3] * 255).round().astype(int).reshape(-1, 3)
    legend_only = (upper == (0x47, 0x2A, 0x7A)).all(axis=1).sum()
    assert 0 < legend_only < 2500  # nothing of it stood in the first week


def hostile(week: int) -> dict:
    content = report(week)
    for row, one in enumerate(content["elements"]):
        one["name"], one["storey"] = (EVIL, HOSTILE[row])[row % 2], (EVIL, "$x$ {{data}}")[row % 2]
    content["elements"][0]["guid"] = EVIL
    content["prior"]["file"] = EVIL
    content["scans"][0]["doubts"] = [EVIL]
    return content


def test_names_of_foreign_files_stay_text(tmp_path):
    paths = write_reports(tmp_path, [hostile(week) for week in range(2)])
    assert main(["progress", *map(str, paths), "--out", str(tmp_path / "out")]) == 0
    text = (tmp_path / "out" / "progress.html").read_text(encoding="utf-8")
    assert text.count("<script") == 2 and "<img" not in text
    data = json.loads(re.search(r'<script id="data" type="application/json">(.*?)</script>', text)[1])
    assert data["elements"][0]["guid"] == EVIL
    for row in rows_of((tmp_path / "out" / "progress.csv").read_bytes().decode()):
        assert not row["name"].startswith(("=", "+", "-", "@"))


def test_the_page_allows_its_own_script_alone_and_loads_nothing(out):
    import base64

    text = (out / "progress.html").read_text(encoding="utf-8")
    script = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script[0].encode()).digest()).decode()
    assert len(script) == 1 and f"script-src 'sha256-{digest}'" in text and "default-src 'none'" in text
    assert not re.search(r"(src|href)=(?!\"data:,\")|https?://(?!www\.w3\.org)", text)


def test_the_page_holds_every_week(four):
    data = page_data(four, outlines_of(four))
    assert [one["label"] for one in data["weeks"]] == list(DATES) and len(data["colours"]) == 4
    assert [(one["file"], one["guid"]) for one in data["elements"]] == [one.key for one in four.elements]
    for one in data["elements"]:
        assert tuple(data["states"][state] for state in one["states"]) == STATES[one["name"]]
        assert one["told"] == "".join(str(int(letter in "pdr")) for letter in SEEN[one["name"]])
    drawn = [row for storey in data["storeys"] for row, _ in storey["elements"]]
    assert sorted(drawn) == list(range(len(SEEN)))
    assert [len(week["added"]) for week in data["weeks"]] == [0, 1, 0, 0]


def test_reports_without_places_still_have_tables_and_a_page(tmp_path, capsys):
    contents = [report(week) for week in range(2)]
    for content in contents:
        for one in content["elements"]:
            del one["box"]
    paths = write_reports(tmp_path, contents)
    assert main(["progress", *map(str, paths), "--out", str(tmp_path / "out")]) == 0
    assert "no plan was drawn" in capsys.readouterr().out
    assert not list((tmp_path / "out").glob("plan*")) and (tmp_path / "out" / "progress.html").is_file()
    progress = follow(read_weeks(paths))
    assert page_text(progress, outlines_of(progress)) == (tmp_path / "out" / "progress.html").read_text()
    assert len(rows_of(elements_csv(progress))) == len(SEEN) and shares_csv(progress, shares_of(progress))


@pytest.mark.parametrize(
    "words, said",
    [
        (["--date", "week0"], "--date: expected REPORT=DATE"),
        (["--date", "week0=soon"], "--date week0: expected a date"),
        (["--date", "elsewhere=2026-03-02"], "expected one of the reports"),
        (["--model", "nowhere.ifc"], "--model: expected a file or a folder"),
        (["--model", __file__, "--model", jaxmm.__file__], "beside --model: expected a model ending in .ifc"),
        (["nowhere"], "nowhere: expected"),
    ],
)
def test_wrong_words_are_refused_before_anything_is_written(paths, tmp_path, capsys, words, said):
    code = main(["progress", *map(str, paths), *words, "--out", str(tmp_path / "out")])
    error = capsys.readouterr().err
    assert code == 2 and said in error and error.count("\n") == 1 and "Traceback" not in error
    assert not list(tmp_path.iterdir())


def test_a_folder_that_holds_something_is_left_alone(paths, tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["progress", *map(str, paths), "--out", str(tmp_path)]) == 2
    assert "--out" in capsys.readouterr().err and [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_it_starts_without_jax(paths, tmp_path):
    code = (
        "import sys; from jaxmm.commands.cli import main; code = main(sys.argv[1:]); "
        "assert 'jax' not in sys.modules and 'flax' not in sys.modules; sys.exit(code)"
    )
    words = ["progress", *map(str, paths), "--out", str(tmp_path / "out")]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == f"progress: {tmp_path / 'out'}"
