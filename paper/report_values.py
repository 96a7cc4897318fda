"""What the report is filled in with: numbers and tables out of `paper/results`, already as text.

Every function returns text that stands in the report as it is. A row of Table I has one thesis network, named by its
features; tables put it in one column, `network`.
"""

import math
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jaxmm.files import load_json
from jaxmm.inputs import InputError
from jaxmm.learning.box_match import MAX_DISTANCE, MIN_OVERLAP
from jaxmm.learning.result_tables import all_reported
from jaxmm.rays.evidence import FEATURES
from jaxmm.runs.paper.sweeps import as_markdown as study_as_markdown
from jaxmm.runs.paper.tables import BEHIND, not_best
from jaxmm.runs.paper.thesis_scans import as_markdown as thesis_as_markdown

ROOMS = "generated rooms"
FIXED = ("nn-raw", "rule", "evidence")  # methods of every row; the fourth is the row's network


class Results:
    """The tables of one finished run."""

    sure = 0.999  # a probability of a change that is wrong

    def __init__(self, folder: Path):
        """Read the folder.

        Raises:
            InputError: a file is missing or damaged.
        """
        self.tables = {name: _rows_of(folder / f"{name}.json") for name in ("table_1", "label_noise", "studies")}
        thesis = folder / "thesis_scans.json"
        self.thesis = _rows_of(thesis) if thesis.is_file() else []
        self.run = load_json(folder / "run.json")
        try:
            self.config = tomllib.loads((folder / "config.toml").read_text(encoding="utf-8"))
        except (OSError, tomllib.TOMLDecodeError) as error:
            raise InputError(f"{folder / 'config.toml'}: expected the settings of a run: {error}") from error
        self.rows = self.tables["table_1"]
        self.meta = load_json(folder / "table_1.json")["meta"]

    def reported(self, section: str, case: str, condition: str, metric: str = "roc_auc") -> str:
        """What the thesis printed."""
        return _number(all_reported()[section, case, condition][metric])

    def won(self, method: str = "evidence", labels: str = "true") -> str:
        """`A of B`: the rows in which no method ranks better than this one."""
        aucs = self._aucs(labels)
        return f"{sum(max(own.values()) - own.get(method, 0.0) <= BEHIND for own in aucs)} of {len(aucs)}"

    def ahead(self, method: str, other: str, section: str | None = None) -> str:
        """The rows, of all or of one section, in which a method ranks better than another, true labels."""
        return str(sum(own[method] - own[other] > BEHIND for own in self._aucs("true", section)))

    def counted_as_equal(self) -> str:
        """The difference of two AUC up to which neither ranks better."""
        return f"{BEHIND:g}"

    def _aucs(self, labels: str, section: str | None = None) -> list[dict[str, float]]:
        """By column, for every row in which evidence is scored."""
        found: dict[tuple, dict[str, float]] = {}
        for row in self.rows:
            if row["label_kind"] == labels and section in (None, row["section"]) and row["roc_auc"] is not None:
                found.setdefault(_key(row), {})[_column(row)] = row["roc_auc"]
        return [own for own in found.values() if "evidence" in own]

    def table(self, section: str, labels: str = "true", source: str | None = None) -> str:
        """A section: reported AUC, then AUC and precision at 95 % recall of every method; lines end without a break."""
        rows = list(self._of(section, labels, source))
        head = ["test case", "rooms", "reported", *FIXED[:2], "network", FIXED[2], "95 % of evidence"]
        lines = [_line(head), _line(["---"] * len(head))]
        for key in dict.fromkeys(map(_key, rows)):
            own = {_column(row): row for row in rows if _key(row) == key}
            best = own["evidence"]
            told = all_reported().get((section, best["test_case"], best["condition"]))
            network = own.get("network", {"roc_auc": None})
            cells = [_case(best), f"{best['scene_count']}/{best['room_count']}"]
            cells += [_number(told["roc_auc"]) if told else "-", _pair(own["nn-raw"]), _pair(own["rule"])]
            cells += [f"{_pair(network)} ({network.get('training')})" if network["roc_auc"] is not None else "-"]
            interval, behind = best["ci95"]["roc_auc"], {_key(row) for row in self._behind(labels)}
            cells += [_pair(best) + " †" * (key in behind), _outwards(*interval) if interval else "-"]
            lines.append(_line(cells))
        return "\n".join(lines)

    def tables_of(self, section: str) -> str:
        """A table for each source of a section, named where there are several."""
        sources = list(dict.fromkeys(row["source"] for row in self.rows if row["section"] == section))
        if len(sources) == 1:
            return self.table(section)
        return "\n\n".join(f"#### On {source}\n\n{self.table(section, source=source)}" for source in sources)

    def several(self, labels: str = "true") -> str:
        """Rows of several changes as the thesis averaged: over the models that found a box; and how many were right."""
        rows = [row for row in self.rows if row["selected"] and row["label_kind"] == labels]
        head = ["test case", "reported", *(f"{name}: AUC, right models" for name in ("network", "evidence"))]
        lines = [_line(head), _line(["---"] * len(head))]
        for key in dict.fromkeys(map(_key, rows)):
            own = {_column(row): row for row in rows if _key(row) == key}
            one = own["evidence"]
            cells = [_case(one), self.reported(one["section"], one["test_case"], one["condition"])]
            for name in ("network", "evidence"):
                told = own[name]["selected"]
                right = "-" if told["right_share"] is None else f"{100 * told['right_share']:.0f} %"
                cells.append(f"{_number(told['roc_auc'])}, {right}")
            lines.append(_line(cells))
        return "\n".join(lines)

    def label_noise(self) -> str:
        """The eight rows, network trained on true and on heuristic labels, scored on true ones, with boxes."""
        rows = [row for row in self.tables["label_noise"] if row["label_kind"] == "true"]
        names = list(dict.fromkeys(row["method"] for row in rows))
        head = ["test case", *(f"{name}: AUC / precision; boxes found, right" for name in names)]
        lines = [_line(head), _line(["---"] * len(head))]
        for key in dict.fromkeys((row["test_case"], row["condition"]) for row in rows):
            own = {row["method"]: row for row in rows if (row["test_case"], row["condition"]) == key}
            cells = [f"{_pair(own[name])}; {_found_and_right(own[name])}" for name in names]
            lines.append(_line([f"{key[0].lower()}, {key[1]}", *cells]))
        return "\n".join(lines)

    def boxes(self) -> str:
        """Every row: the share of changed objects that boxes of each method stand for, and of boxes that are right."""
        rows, columns = [row for row in self.rows if row["label_kind"] == "true"], (*FIXED[:2], "network", FIXED[2])
        head = ["test case", *(f"{name}: found, right" for name in columns)]
        lines, section = [_line(head), _line(["---"] * len(head))], ""
        for key in dict.fromkeys(map(_key, rows)):
            own = {_column(row): row for row in rows if _key(row) == key}
            if section != (section := _where(own["evidence"])):
                lines.append(_line([f"**{section}**", *[""] * len(columns)]))
            lines.append(_line([_case(own["evidence"]), *(_found_and_right(own[name]) for name in columns)]))
        return "\n".join(lines)

    def match(self) -> str:
        """In words: which boxes stand for one object."""
        overlap = f"intersection over union of at least {MIN_OVERLAP:g}"
        return f"an {overlap}, or centres within {MAX_DISTANCE:g} m"

    def study(self, name: str) -> str:
        """One study: a line a level and scenario."""
        rows = [row for row in self.tables["studies"] if row["study"] == name]
        if not rows:
            raise InputError(f"expected rows of the study {name}, found none")
        return "\n".join(study_as_markdown(rows).strip().split("\n")[4:])

    def thesis_scans(self) -> str:
        """The second table, or why there is none."""
        if not self.thesis:
            return "The run had no released scans at hand."
        return thesis_as_markdown(self.thesis).strip()

    def thesis_score(
        self, source: str, case: str, condition: str, method: str, metric: str = "roc_auc", labels: str = "released"
    ) -> str:
        """One number of the second table."""
        wanted = (source, case, condition, method, labels)
        names = ("source", "test_case", "condition", "method", "label_kind")
        found = [row for row in self.thesis if tuple(row[name] for name in names) == wanted]
        if len(found) != 1:
            raise InputError(f"expected one released pair for {wanted}, found {len(found)}")
        return _number(found[0][metric])

    def wrong_labels(self) -> str:
        """In words: the released pairs of which more than stray points carry a wrong label."""
        told = {}
        for row in self.thesis:
            if row["wrong_labels"] and row["label_kind"] == "by element" and row["wrong_labels"] > 0.01 * row["points"]:
                place = f"{row['source']}, {row['test_case'].lower()}, {row['condition']}"
                told[place] = f"{row['wrong_labels']:,} wrong labels of {row['positives']:,} positives ({place})"
        return "; ".join(told.values()) or "no pair"

    def ranks_by_any_change(self) -> bool:
        """Whether `evidence` ranks by the greater of the probabilities of pillars and of walls."""
        return "evidence_ranks_by" in self.meta

    def trainings(self) -> str:
        """In words: how many trainings the rows are of, and what intervals are over."""
        count = self.meta.get("trainings_per_network", 1)
        if count == 1:
            return (
                "Each network was trained once. Intervals are over rooms, not over trainings, and views of one building"
                " count as if they were of several."
            )
        return (
            f"Each network of the thesis was trained {count} times: rows are means, and `table_1.md` tells the worst "
            "and the best beside them. Intervals are over rooms, or over buildings where rooms are views of such. Of "
            "`evidence` rows are of the models that ship, and in brackets "
            f"{self.meta['further_trainings_of_evidence']} further trainings on fewer rooms."
        )

    def _behind(self, labels: str) -> list[dict[str, Any]]:
        return not_best([row for row in self.rows if row["label_kind"] == labels])

    def behind(self, labels: str = "true") -> str:
        """The rows in which another method ranks better than evidence."""
        rows = self._behind(labels)
        if not rows:
            return "There is none."
        head = ["section", "test case", "best", "its AUC", "evidence"]
        lines = [_line(head), _line(["---"] * len(head))]
        for row in rows:
            cells = [_where(row), _case(row), row["best"], _number(row["roc_auc"]), _number(row["evidence"])]
            lines.append(_line(cells))
        return "\n".join(lines)

    def network_gains(self, *trainings: str) -> str:
        """In words: in how many rows with a network of such a training it ranks better or worse than the distance."""
        pairs: dict[tuple, dict[str, Any]] = {}
        for row in self.rows:
            if row["label_kind"] == "true" and row["roc_auc"] is not None:
                pairs.setdefault(_key(row), {})[_column(row)] = row
        own = [one for one in pairs.values() if one.get("network", {}).get("training") in trainings]
        gains = [one["network"]["roc_auc"] - one["nn-raw"]["roc_auc"] for one in own]
        better, worse = sum(gain > BEHIND for gain in gains), sum(gain < -BEHIND for gain in gains)
        return f"better in {better}, worse in {worse} of {len(gains)} rows"

    def setting(self, path: str) -> str:
        """A setting of the run by its path, such as train.step_count."""
        value: Any = self.config
        for name in path.split("."):
            value = value[name]
        return f"{value:,}" if isinstance(value, int) else str(value)

    def least_positives(self) -> str:
        """Testable points that a room needs to count."""
        return str(self.meta["least_positives"])

    def run_fact(self, name: str) -> str:
        """Something about the run itself: date, commit, counts."""
        if name == "commit":
            return self.run["versions"]["git_commit"][:10]
        value = self.run[name]
        return str(len(value)) if isinstance(value, list) else f"{value:,}" if isinstance(value, int) else str(value)

    def evidence_columns(self) -> str:
        """How many kinds of evidence the network of ours sees."""
        return str(len(FEATURES))

    def literal_focal(self, alpha: float = 10.0, gamma: float = 2.0) -> str:
        """Equation 3 read literally, of an unchanged point that is given the probability `sure` of a change [nat]."""
        p_true = 1.0 - self.sure
        return f"{(1.0 - alpha) * (1.0 - p_true) ** gamma * -math.log(p_true):.1f}"

    def _of(self, section: str, labels: str, source: str | None = None) -> Iterable[dict[str, Any]]:
        return (
            row
            for row in self.rows
            if (row["section"], row["label_kind"]) == (section, labels) and source in (None, row["source"])
        )


def _key(row: dict[str, Any]) -> tuple:
    return row["section"], row["test_case"], row["condition"], row["source"]


def _column(row: dict[str, Any]) -> str:
    return row["method"] if row["method"] in FIXED else "network"


def _where(row: dict[str, Any]) -> str:
    return row["section"] if row["source"] == ROOMS else f"{row['section']} ({row['source']})"


def _case(row: dict[str, Any]) -> str:
    return f"{row['test_case'].lower()}, {row['condition']}"


def _rows_of(path: Path) -> list[dict[str, Any]]:
    """The rows of a table; InputError where the file holds none."""
    table = load_json(path)
    rows = table.get("rows") if isinstance(table, dict) else None
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{path}: expected the rows of a table, found none")
    return rows


def _outwards(low: float, high: float) -> str:
    """An interval rounded so that it holds what it held."""
    return f"{math.floor(low * 1e4 + 1e-6) / 1e4:.4f} to {math.ceil(high * 1e4 - 1e-6) / 1e4:.4f}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _pair(row: dict[str, Any]) -> str:
    return "-" if row["roc_auc"] is None else f"{row['roc_auc']:.4f} / {row['precision_at_95']:.3f}"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.0f} %"


def _found_and_right(row: dict[str, Any]) -> str:
    return f"{_share(row['box_recall'])}, {_share(row['box_precision'])}"


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"
