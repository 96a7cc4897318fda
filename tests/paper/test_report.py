"""The report says what the results say: built anew it is the same text, and no number in its prose is typed by hand."""

import json
import re
import shutil
from pathlib import Path

import pytest

from jaxmm.files import write_json
from jaxmm.inputs import InputError
from jaxmm.runs.stages import STAGE, STAGES
from paper.report import HERE, RESULTS, TEMPLATE, as_html, report
from paper.report_values import Results
from paper.results import collect, date_of

# Numbers that are definitions or names rather than findings.
DEFINITIONS = ("95 %", "Equation 3", "Table I", "1 - alpha", "alpha above 1")
COMPUTED = re.compile(r"{{.*?}}|{%.*?%}|{#.*?#}|`[^`]*`", re.DOTALL)


def test_the_committed_report_is_what_the_results_give():
    assert (HERE / "report.md").read_text() == report(), "python -m paper.report --out paper/report.md"


def test_the_docs_show_the_rows_of_the_results():
    page = (HERE.parent / "docs" / "training-and-paper.md").read_text()
    assert Results(RESULTS).table("Individual Models") in page, (
        "docs/training-and-paper.md: the table is not the one of paper/results"
    )


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


def test_a_table_without_rows_is_one_line(results):
    for damage in ('{"rows": []}', "[]", '{"rows": 3}'):
        (results / "table_1.json").write_text(damage)
        with pytest.raises(InputError, match=r"table_1\.json: expected the rows"):
            report(results)


def test_without_the_released_scans_the_report_says_so(results):
    (results / "thesis_scans.json").unlink()
    told = report(results)
    assert "no released scans at hand" in told and "**Focal loss.**" in told and "released weights reach" not in told


def test_rows_that_are_not_won_are_marked():
    marked = [line for line in report().split("\n") if " † |" in line]
    behind = Results(RESULTS).behind().split("\n")[2:]
    assert len(marked) == len(behind) > 0
    for line in behind:
        case, _, best = [cell.strip() for cell in line.strip("| ").split(" | ")][1:4]
        assert any(row.startswith(f"| {case} |") and best in row for row in marked)


def test_wins_and_gains_are_counted_by_the_rows():
    found, groups = Results(RESULTS), {}
    for row in found.rows:
        if row["label_kind"] == "true" and row["roc_auc"] is not None:
            key = row["section"], row["test_case"], row["condition"], row["source"]
            groups.setdefault(key, {})[row["method"]] = row["roc_auc"]
    for method in ("evidence", "rule", "nn-raw"):
        won = sum(max(own.values()) - own[method] <= 5e-4 for own in groups.values())
        assert found.won(method) == f"{won} of {len(groups)}"
    noise = [own for key, own in groups.items() if key[0] == "Sensor Noise"]
    assert found.ahead("evidence", "rule", "Sensor Noise") == str(
        sum(own["evidence"] - own["rule"] > 5e-4 for own in noise)
    )


def test_every_row_is_in_one_table_of_its_own_source():
    text, rows = report(), Results(RESULTS).rows
    cases = {(row["section"], row["test_case"], row["condition"], row["source"]) for row in rows}
    for section in {case[0] for case in cases}:
        part = text.split(f"### {section}\n")[1].split("\n## ")[0].split("\n### ")[0]
        sources = sorted({case[3] for case in cases if case[0] == section})
        for source in sources:
            own = part.split(f"#### On {source}\n")[1].split("\n#### ")[0] if len(sources) > 1 else part
            names = [line.split(" | ")[0].removeprefix("| ") for line in own.split("\n") if line.startswith("| ")]
            wanted = {f"{case[1].lower()}, {case[2]}" for case in cases if (case[0], case[3]) == (section, source)}
            assert wanted <= set(names) and all(names.count(name) == 1 for name in wanted)


def test_the_appendix_holds_the_boxes_of_every_row():
    lines = report().split("\n## Appendix: boxes\n")[1].split("\n")
    lines = [line.strip("| ").split(" | ") for line in lines if line.startswith("| ")][2:]
    told, group = {}, ""
    for case, *cells in lines:
        if case.startswith("**"):
            group = case.strip("* |")
        else:
            told.update({(group, case, column): cell for column, cell in enumerate(cells)})
    order, wanted = ("nn-raw", "rule", "network", "evidence"), {}
    for row in Results(RESULTS).rows:
        if row["label_kind"] == "true":
            source = "" if row["source"] == "generated rooms" else f" ({row['source']})"
            case = f"{row['test_case'].lower()}, {row['condition']}"
            column = order.index(row["method"] if row["method"] in order else "network")
            shares = [row["box_recall"], row["box_precision"]]
            words = ["-" if share is None else f"{round(100 * share)} %" for share in shares]
            wanted[row["section"] + source, case, column] = ", ".join(words)
    assert told == wanted and len(wanted) == 4 * (len(lines) - len({group for group, *_ in wanted}))


def test_the_page_is_one_file_with_its_images_inside():
    page = as_html(report())
    assert page.count("<table>") == page.count("</table>") > 5
    assert not re.search(r'(src|href)="(?!data:|https://|#)', page.replace('href="../', 'href="https://'))
    assert as_html("# A\n\n![b](images/story.png)").count("data:image/png;base64,") == 1


def test_an_unfinished_run_is_not_collected(tmp_path):
    with pytest.raises(InputError, match=r"config\.toml"):
        collect(tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_run_whose_stages_tell_no_date_is_not_collected(results, tmp_path):
    write_json(results / STAGES / "models" / STAGE, {"key": "0"})
    with pytest.raises(InputError, match="tell their date"):
        collect(results, tmp_path / "out")
    assert not (tmp_path / "out").exists() and date_of(results) is None
    for name, date in (("clouds", "2024-02-29"), ("sweeps/furniture_2", "2024-03-01"), ("rooms", "2024-01-31")):
        write_json(results / STAGES / name / STAGE, {"date": date})
    assert date_of(results) == "2024-03-01"


def test_results_are_not_written_into_a_file(results, tmp_path):
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(InputError, match="expected a folder"):
        collect(results, tmp_path / "taken")
    assert (tmp_path / "taken").read_text() == "mine"
