"""The report says what the results say: built anew it is the same text, and no number in its prose is typed by hand."""

import json
import re
import shutil
from pathlib import Path

import pytest

from jaxmm.inputs import InputError
from paper.report import HERE, RESULTS, TEMPLATE, as_html, report
from paper.report_values import Results
from paper.results import collect

# Numbers that are definitions or names rather than findings.
DEFINITIONS = ("95 %", "Equation 3", "Table I", "1 - alpha", "alpha above 1")
COMPUTED = re.compile(r"{{.*?}}|{%.*?%}|{#.*?#}|`[^`]*`", re.DOTALL)


def test_the_committed_report_is_what_the_results_give():
    assert (HERE / "report.md").read_text() == report(), "python -m paper.report --out paper/report.md"


def test_the_readme_shows_the_rows_of_the_results():
    readme = (HERE.parent / "README.md").read_text()
    assert Results(RESULTS).table("Individual Models") in readme, "README.md: the table is not the one of paper/results"


def test_no_number_in_the_prose_is_typed_by_hand():
    prose = COMPUTED.sub("", (HERE / TEMPLATE).read_text())
    for words in DEFINITIONS:
        prose = prose.replace(words, "")
    found = re.findall(r".{0,20}\d.{0,20}", prose)
    assert prose.strip() and not found


@pytest.fixture
def results(tmp_path):
    return Path(shutil.copytree(RESULTS, tmp_path / "results"))


def test_a_changed_number_changes_the_report(results):
    table = json.loads((results / "table_1.json").read_text())
    row = next(row for row in table["rows"] if row["method"] == "evidence" and row["label_kind"] == "true")
    row["roc_auc"] = 0.123456
    (results / "table_1.json").write_text(json.dumps(table))
    changed = report(results)
    assert "0.1235 / " in changed and changed != report()


def test_a_run_without_what_the_text_asks_for_is_one_line(results):
    (results / "run.json").unlink()
    with pytest.raises(InputError, match=r"run\.json"):
        report(results)


def test_a_row_that_is_not_there_is_named(results):
    with pytest.raises(InputError, match="No Such Row"):
        Results(results).score("Individual Models", "No Such Row", "clean", "evidence")


def test_every_row_is_in_one_table_of_the_report():
    text, rows = report(), Results(RESULTS).rows
    cases = {(row["section"], row["test_case"], row["condition"], row["source"]) for row in rows}
    for section in {case[0] for case in cases}:
        part = text.split(f"### {section}\n")[1].split("\n#")[0]
        own = [case for case in cases if case[0] == section]
        lines = [line for line in part.split("\n") if line.startswith("| ")]
        assert sum(any(line.startswith(f"| {case[1].lower()}, {case[2]} |") for case in own) for line in lines) >= len(
            own
        )


def test_the_page_is_one_file_with_its_images_inside():
    page = as_html(report())
    assert page.count("<table>") == page.count("</table>") > 5
    assert not re.search(r'(src|href)="(?!data:|https://|#)', page.replace('href="../', 'href="https://'))
    assert as_html("# A\n\n![b](images/story.png)").count("data:image/png;base64,") == 1


def test_an_unfinished_run_is_not_collected(tmp_path):
    with pytest.raises(InputError, match=r"no table_1\.json"):
        collect(tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()
