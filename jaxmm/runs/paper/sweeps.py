"""How accuracy falls as scenes get harder: more furniture, noisier ranges, robots that are not where they think.

Test scenes only, occluded, on true labels; the models are those of Table I (the thesis's features without coordinates)
and those that ship. Each level of each study is a stage `sweeps/<study>_<level>` with `<scenario>.json`, a list of
rooms as in `rooms.json` (paper_scores).
"""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from jaxmm.config import SCENARIOS, Config, Table
from jaxmm.files import load_json, write_json
from jaxmm.learning.metrics import METRICS
from jaxmm.learning.result_tables import NAMES, row_of
from jaxmm.learning.room_scores import CONTROL
from jaxmm.progress import progress
from jaxmm.rays.rule import RULE
from jaxmm.runs.paper.models import as_settings
from jaxmm.runs.paper.rows import ROOMS, TestScenes, titled
from jaxmm.runs.paper.scaling import METHODS
from jaxmm.runs.paper.scenes import room_scenes, scan_errors
from jaxmm.runs.paper.scores import APART, CODE, EVIDENCE, Judges, scored, weights_digest
from jaxmm.runs.paper.tables import over_seeds, seeds_of
from jaxmm.runs.stages import Stage, open_stage

TRAINING = "nn"  # of Table I
SCALING = "training rooms"
UNITS = {"furniture": "places for tables and chairs", "range noise": "m", "misalignment": "m, with 20 degrees a metre",
         "misalignment, registered": "m, with 20 degrees a metre", SCALING: "pairs of scans"}  # fmt: skip


class Level(NamedTuple):
    """One point of one study."""

    study: str  # key of UNITS
    value: float
    scan: dict[str, float]  # by which robot scans err
    room: dict[str, int]
    furniture_share: float | None = None  # of the rays, at least; None: as elsewhere
    registration: str = "none"

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.study.replace(', ', ' ').replace(' ', '_')}_{self.value:g}"


def levels(config: Config) -> list[Level]:
    """All points of all studies."""
    paper, found = config.paper, []
    for count in paper.furniture:
        tables = count // 2
        room = {"table_limit": tables, "chair_limit": count - tables}
        found.append(Level("furniture", count, {}, room, furniture_share=0.0))
    found += [Level("range noise", sigma, scan_errors(sigma), {}) for sigma in paper.range_noise]
    for study, registration in (("misalignment", "none"), ("misalignment, registered", "refine")):
        errors = [(metres, scan_errors(metres=metres)) for metres in paper.misalignment]
        found += [Level(study, metres, scan, {}, registration=registration) for metres, scan in errors]
    return found


def sweep_scores(config: Config, run: Path, judges: tuple[Judges, str]) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """Scores of rooms by level's name and scenario."""
    if not config.paper.sweep_rooms:
        return {}
    return {level.name: _of_level(config, run, level, judges) for level in levels(config)}


def _of_level(config: Config, run: Path, level: Level, judges: tuple[Judges, str]) -> dict[str, list[dict[str, Any]]]:
    judge, models = judges
    own = _config(config, level)
    settings = as_settings(own, "scan", "room", "preprocess", "evaluate") | {"errors": level.scan}
    settings |= {"test_seed": config.data.test_seed, "weights": weights_digest(), "rooms": config.paper.sweep_rooms}
    del settings["evaluate"]["resamples"]
    folder = open_stage(run, Stage(f"sweeps/{level.name}", settings, CODE, APART, (models,)))
    found = {}
    for scenario in SCENARIOS:
        path = folder / f"{scenario}.json"
        if not path.exists():
            scenes, count = TestScenes(ROOMS, scenario, "occluded"), config.paper.sweep_rooms
            made = room_scenes(own, scenes, (scenario,), count, level.scan)
            made = progress(made, f"score {level.name.replace('_', ' ')}: {scenario.replace('_', ' ')}", count)
            write_json(path, list(scored(own, made, {scenario: (TRAINING,)}, judge, None)))
        found[scenario] = load_json(path)
    return found


def _config(config: Config, level: Level) -> Config:
    scan = config.scan.thawed()
    if level.furniture_share is not None:
        scan["furniture_share"] = level.furniture_share
    return dataclasses.replace(
        config, scan=Table.of(scan), room=Table.of(config.room.thawed() | level.room),
        preprocess=dataclasses.replace(config.preprocess, registration=level.registration),
    )  # fmt: skip


def study_rows(
    config: Config, sweeps: dict[str, dict[str, list[dict[str, Any]]]], scaling: dict[str, list[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """Rows of all studies, to draw curves from: the usual columns on true labels, with `study`, `level` and `unit`.

    What does not learn has no level in the study of training rooms: null.
    """
    found = []
    for level in levels(config) if sweeps else ():
        methods = {CONTROL: CONTROL, RULE: RULE, TRAINING: TRAINING, EVIDENCE: EVIDENCE}
        for scenario, rooms in sweeps[level.name].items():
            found += [_row(config, (level.study, level.value, *one), scenario, rooms) for one in methods.items()]
    sizes = [(size, method, f"{method}_{size}") for method in METHODS for size in config.paper.scaling_rooms]
    for scenario, rooms in scaling.items():
        for one in [(None, CONTROL, CONTROL), (None, RULE, RULE), *sizes]:
            found.append(_row(config, (SCALING, *one), scenario, rooms))
    return found


def _row(config: Config, what: tuple, scenario: str, rooms: list[dict[str, Any]]) -> dict[str, Any]:
    study, level, method, scored_as = what
    names = dict(zip(NAMES, (study, titled(scenario), "occluded", method, "true"), strict=True))
    first, *further = (_members(scenario, rooms, name) for name in seeds_of(rooms, scored_as))
    told = {"study": study, "level": level, "unit": UNITS[study]} | row_of(names, first, config.evaluate, None)
    return told | {"trainings": over_seeds(names, further, config.evaluate)}


def _members(scenario: str, rooms: list[dict[str, Any]], scored_as: str) -> list[dict[str, Any]]:
    """Each room as result_tables.row_of wants it."""
    members = []
    for room in rooms:
        side = room["sides"][scenario]
        one = side["methods"][scored_as]
        members.append(
            {
                "positives": side["positives"]["true"],
                "observable_fraction": side["observable_fraction"],
                **{name: one[name] for name in ("boxes_matched", "boxes_found", "boxes_true")},
                **{name: one["metrics"]["true"][name] for name in METRICS},
            }
        )
    return members


def as_markdown(rows: list[dict[str, Any]]) -> str:
    """By study: ROC AUC and precision at 95 % recall, a line a level and scenario, a column a method."""
    lines = []
    for study in dict.fromkeys(row["study"] for row in rows):
        own = [row for row in rows if row["study"] == study]
        methods = list(dict.fromkeys(row["method"] for row in own))
        lines += [
            f"## {study.capitalize()} [{UNITS[study]}]",
            "",
            "ROC AUC / precision at 95 % recall, true labels; in brackets the worst of further trainings",
            "",
        ]
        lines += [f"| test case | level | rooms | {' | '.join(methods)} |", "|" + " --- |" * (3 + len(methods))]
        for case, level in dict.fromkeys((row["test_case"], row["level"]) for row in own):
            at = {row["method"]: row for row in own if (row["test_case"], row["level"]) == (case, level)}
            one = next(iter(at.values()))
            cells = [case.lower(), "-" if level is None else f"{level:g}", f"{one['scene_count']}/{one['room_count']}"]
            lines.append(f"| {' | '.join(cells + [_cell(at.get(name)) for name in methods])} |")
        lines.append("")
    return "\n".join(lines)


def _cell(row: dict[str, Any] | None) -> str:
    if row is None or row["roc_auc"] is None:
        return "-"
    further = row.get("trainings")  # of the method whose models ship
    worst = f" [{further['roc_auc'][0]:.4f} / {further['precision_at_95'][0]:.3f}]" if further else ""
    return f"{row['roc_auc']:.4f} / {row['precision_at_95']:.3f}{worst}"
