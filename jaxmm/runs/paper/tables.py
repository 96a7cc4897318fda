"""Table I and its companions out of the scores of single scenes: pure, quick, and never the reason to train again.

A row of several changes is the mean over the models of the changes that are truly present, room by room. Beside it,
under `selected`, stands what the thesis did: the mean over the models that found at least one valid box.
"""

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.config import EvaluateConfig
from jaxmm.files import write_json, write_text
from jaxmm.learning.metrics import METRICS
from jaxmm.learning.result_tables import (
    LABEL_KINDS,
    LABEL_TITLES,
    NAMES,
    SHOWN,
    Room,
    all_reported,
    row_of,
    short_table,
)
from jaxmm.learning.room_scores import CONTROL
from jaxmm.rays.rule import RULE
from jaxmm.runs.paper.rows import AGAIN, BUILDINGS, LABEL_NOISE, MULTI, SECTIONS, TABLE_1, TRAININGS, Row
from jaxmm.runs.paper.scores import EVIDENCE

Scenes = list[dict[str, Any]]  # rooms.json of a set
SOURCES = {"rooms": "generated rooms", "buildings": "generated rooms through IFC files", "files": "IFC files"}
BEHIND = 5e-4  # of an AUC, from which on a row counts as not won


def table_1(scores: dict[str, Scenes], config: EvaluateConfig) -> list[dict[str, Any]]:
    """All rows, for each the four methods on both kinds of labels.

    Args:
        scores: of every set, by name.
        config: what counts as a scored room.
    """
    reported = all_reported()
    found = []
    for row in TABLE_1:
        told = reported.get((row.section, row.test_case, row.scenes.condition))
        source = SOURCES[row.scenes.kind]
        found += rows_of(row, scores[row.scenes.name], config, (source, told))
    return found


def file_rows(scores: dict[str, Scenes], config: EvaluateConfig) -> list[dict[str, Any]]:
    """The semi-real rows again, on the IFC files of JAXMM_DATA; `scores` by name of the set, files together."""
    found = []
    for row in TABLE_1:
        if row.scenes.kind == BUILDINGS and scores.get(row.scenes.name):
            found += rows_of(row, scores[row.scenes.name], config, (SOURCES["files"], None))
    return found


def label_noise(scores: dict[str, Scenes], config: EvaluateConfig) -> list[dict[str, Any]]:
    """Trained on true and on heuristic labels, all else equal; `method` is the name of the training."""
    found = []
    for row in TABLE_1:
        if row.section == SECTIONS[0]:
            methods = {name: name for name in (CONTROL, *LABEL_NOISE)}
            found += _rows(row, scores[row.scenes.name], config, methods)
    return [one | {"section": "Label Noise"} for one in found]


def rows_of(
    row: Row, scenes: Scenes, config: EvaluateConfig, told: tuple[str, dict[str, float] | None]
) -> list[dict[str, Any]]:
    """One described row: methods side by side, on both kinds of labels."""
    source, reported = told
    methods = {CONTROL: CONTROL, RULE: RULE, row.method: row.training, EVIDENCE: EVIDENCE}
    found = []
    for one in _rows(row, scenes, config, methods):
        own = one["method"] == row.method
        one["reported"] = reported if own and one["label_kind"] == "heuristic" else None
        found.append(one | {"training": row.training if own else None, "source": source})
    return found


def _rows(row: Row, scenes: Scenes, config: EvaluateConfig, methods: dict[str, str]) -> list[dict[str, Any]]:
    found = []
    for kind in LABEL_KINDS:
        for method, scored in methods.items():
            names = dict(zip(NAMES, (row.section, row.test_case, row.scenes.condition, method, kind), strict=True))
            of_seeds = [
                [_averaged(scene, row.models, (name, kind), config) for scene in scenes]
                for name in seeds_of(scenes, scored)
            ]
            # What ships is a row by itself; its further trainings are only told of.
            shown, told = (of_seeds[:1], of_seeds[1:]) if method == EVIDENCE else (of_seeds, of_seeds)
            one = row_of(names, [_mean_room(rooms) for rooms in zip(*shown, strict=True)], config, None)
            selected = _selected(scenes, row.models, (scored, kind), config) if row.section == MULTI else None
            found.append(one | {"selected": selected, "trainings": over_seeds(names, told, config)})
    return found


def seeds_of(scenes: Scenes, scored: str) -> list[str]:
    """Under which names a method's scores stand: one for each seed of its training."""
    there = next(iter(scenes[0]["sides"].values()))["methods"] if scenes else {}
    return [scored, *(name for name in there if name.startswith(scored + AGAIN))]


def _mean_room(rooms: tuple[Room, ...]) -> Room:
    """One room as all trainings of a method score it: the mean of ranks, boxes of all together."""
    told = [room for room in rooms if room["positives"]]
    return rooms[0] | {
        **{name: sum(room[name] for room in rooms) for name in ("boxes_matched", "boxes_found", "boxes_true")},
        **{name: float(np.mean([room[name] for room in told])) if told else None for name in METRICS},
    }


def over_seeds(names: dict[str, str], of_seeds: list[list[Room]], config: EvaluateConfig) -> dict[str, Any] | None:
    """How many trainings there are to tell apart, and from what to what their rows go; None of less than two."""
    if len(of_seeds) < 2:
        return None
    rows = [row_of(names, rooms, config, None) for rooms in of_seeds]
    told = {name: [row[name] for row in rows if row[name] is not None] for name in METRICS}
    return {"count": len(rows)} | {name: [min(all_), max(all_)] if all_ else None for name, all_ in told.items()}


def _averaged(scene: dict[str, Any], models: Iterable[str], what: tuple[str, str], config: EvaluateConfig) -> Room:
    """One room as result_tables.row_of wants it: the mean over models of what each of them scores."""
    (method, kind), sides = what, [scene["sides"][name] for name in models]
    scored = [side["methods"][method] for side in sides]
    counted = [
        one["metrics"][kind]
        for one, side in zip(scored, sides, strict=True)
        if side["positives"][kind] >= config.least_positives and one["metrics"][kind]["roc_auc"] is not None
    ]
    shares = [side["observable_fraction"] for side in sides if side["observable_fraction"] is not None]
    return {
        "place": scene["place"],
        # A model that sees too little of its change is left out of the mean, and a room where all do out of the row.
        "positives": config.least_positives if counted else 0,
        "observable_fraction": float(np.mean(shares)) if shares else None,
        **{name: sum(one[name] for one in scored) for name in ("boxes_matched", "boxes_found", "boxes_true")},
        **{name: float(np.mean([one[name] for one in counted])) if counted else None for name in METRICS},
    }


def _selected(
    scenes: Scenes, present: tuple[str, ...], what: tuple[str, str], config: EvaluateConfig
) -> dict[str, Any]:
    """Means over the models that found a box, by room; how many rooms have one, and how often it was the right one."""
    (method, _), rooms, chosen, right = what, [], 0, 0
    for scene in scenes:
        models = [name for name, side in scene["sides"].items() if side["methods"][method]["boxes_found"]]
        chosen, right = chosen + len(models), right + sum(name in present for name in models)
        room = _averaged(scene, models, what, config) if models else None
        rooms += [room] if room and room["positives"] else []
    means = {name: float(np.mean([room[name] for room in rooms])) if rooms else None for name in METRICS}
    share = len(rooms) / len(scenes) if scenes else 0.0
    return means | {"room_share": share, "right_share": right / chosen if chosen else None}


def not_best(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows in which another method ranks better than `evidence` does, with by how much; labels of both kinds."""
    groups: dict[tuple, dict[str, dict]] = {}
    for row in rows:
        key = (*(row[name] for name in ("section", "test_case", "condition", "label_kind")), row.get("source"))
        groups.setdefault(key, {})[row["method"]] = row
    found = []
    for key, methods in groups.items():
        scored = {name: row["roc_auc"] for name, row in methods.items() if row["roc_auc"] is not None}
        if EVIDENCE in scored and (best := max(scored, key=scored.get)) and scored[best] - scored[EVIDENCE] > BEHIND:
            names = dict(zip(("section", "test_case", "condition", "label_kind", "source"), key, strict=True))
            found.append(names | {"best": best, "roc_auc": scored[best], EVIDENCE: scored[EVIDENCE]})
    return found


def write_table(folder: Path, name: str, rows: list[dict[str, Any]], meta: dict[str, Any], text: str) -> None:
    """Write <name>.json, .csv (nested values in columns of their own) and .md."""
    write_json(folder / f"{name}.json", {"rows": rows, "meta": meta})
    write_text(folder / f"{name}.csv", as_csv(rows))
    write_text(folder / f"{name}.md", text)


def as_csv(rows: list[dict[str, Any]]) -> str:
    """Rows in flat columns: `ci95_roc_auc_low` and so on."""
    flat = [dict(_flat("", row)) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return text.getvalue()


def _flat(prefix: str, value: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _flat(f"{prefix}_{name}" if prefix else name, inner)
    elif isinstance(value, list):
        yield from zip((f"{prefix}_low", f"{prefix}_high"), value, strict=True)
    elif value is not None:
        yield prefix, value


def as_markdown(rows: list[dict[str, Any]]) -> str:
    """By section: ranking and precision on both kinds of labels; for several changes also as the thesis averaged."""
    blocks = []
    for section, source in dict.fromkeys((row["section"], row.get("source")) for row in rows):
        own = [row for row in rows if (row["section"], row.get("source")) == (section, source)]
        blocks.append(f"## {section}" + (f" ({source})" if source else "") + "\n")
        blocks += [short_table(own, kind, metric) for kind in LABEL_KINDS for metric in SHOWN]
        if section == MULTI:
            blocks.append("Means over the models that found a box, as the thesis averaged:\n")
            blocks += [_selected_table(own, kind) for kind in LABEL_KINDS]
    return "\n".join(filter(None, blocks)) + "\n"


def as_summary(rows: list[dict[str, Any]]) -> str:
    """For the terminal: by section the ranking on true labels."""
    blocks = []
    for section, source in dict.fromkeys((row["section"], row["source"]) for row in rows):
        own = [row for row in rows if (row["section"], row["source"]) == (section, source)]
        blocks += [f"{section} ({source})\n", short_table(own, "true", "roc_auc")]
    return "\n".join(blocks)


def _selected_table(rows: list[dict[str, Any]], kind: str) -> str:
    rows = [row for row in rows if row["label_kind"] == kind]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    heads = ["test case", *(f"{name}: AUC / precision / right" for name in methods)]
    lines = [f"{LABEL_TITLES[kind]}", "", f"| {' | '.join(heads)} |", "|" + " --- |" * len(heads)]
    for case in dict.fromkeys((row["test_case"], row["condition"]) for row in rows):
        cells = [f"{case[0].lower()} {case[1]}"]
        for method in methods:
            told = next(r["selected"] for r in rows if (r["test_case"], r["condition"], r["method"]) == (*case, method))
            cells.append(" / ".join(_number(told[key]) for key in ("roc_auc", "precision_at_95", "right_share")))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def trainings_told() -> dict[str, dict[str, Any]]:
    """What each training is, for the table's meta."""
    return {name: training._asdict() for name, training in TRAININGS.items()}
