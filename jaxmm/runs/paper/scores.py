"""The stages that score test scenes: every method on every room, once for all rows that want it.

Each set of test scenes is a stage `rooms/<set>` with `rooms.json`, a list of rooms {"room", "place", "sides":
{scenario: evaluate.score_room}}, and `example.npz`: of the first scene that shows enough of every change, all that a
figure may want. Methods there are `nn-raw`, `rule`, names of trainings, and `evidence` with the models that ship: the
greater of what those for pillars and for walls say of a point, as in `jaxmm detect`; its boxes are of the one kind.
`evidence@1` and so on are further trainings (paper_evidence_models).
"""

import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmm.config import SCENARIOS, Config, NetworkConfig
from jaxmm.data.labelled_buildings import View
from jaxmm.files import load_json, write_arrays, write_json
from jaxmm.inputs import InputError
from jaxmm.learning import model_files
from jaxmm.learning.batches import LabelledCloud, features_of
from jaxmm.learning.model import Model, pick_model
from jaxmm.learning.room_scores import CONTROL, predict, score_room
from jaxmm.progress import progress
from jaxmm.rays.rule import RULE, rule_scores
from jaxmm.runs.paper.evidence_models import EVIDENCE
from jaxmm.runs.paper.models import WORDS, as_settings
from jaxmm.runs.paper.rows import (
    AGAIN,
    ALIGNED,
    BUILDINGS,
    LABEL_NOISE,
    MULTI,
    ROOMS,
    TRAININGS,
    Row,
    TestScenes,
    again,
    repeated,
    sets_of,
)
from jaxmm.runs.paper.scenes import Scene, building_scenes, ifc_files, read_file, scenes_of
from jaxmm.runs.stages import Stage, open_stage
from jaxmm.weights import DEFAULT

SCORES, EXAMPLE = "rooms.json", "example.npz"
CODE = ("jaxmm.runs.paper.scenes", "jaxmm.learning.room_scores")
APART = (*WORDS, "jaxmm.learning.result_tables", "jaxmm.runs.paper.rows")


class Judges(NamedTuple):
    """Everything that scores points."""

    networks: dict[str, Model]  # thesis networks by `<training>/<scenario>`
    network: NetworkConfig
    default: Model  # the four of the method evidence, stacked, as they ship
    default_network: NetworkConfig
    further: tuple[Model, ...] = ()  # other trainings of the same method and network


def default_judges(config: Config, networks: dict[str, Model], further: tuple[Model, ...] = ()) -> Judges:
    """The thesis networks of a run, the models that ship, and further trainings of these.

    Raises:
        InputError: those were trained or validated on rooms of this run's test seed.
    """
    models, trained = model_files.load_models(DEFAULT)
    seeds = {"training": trained.data.train_seed, "validation": trained.data.validation_seed}
    if clash := [name for name, seed in seeds.items() if seed == config.data.test_seed]:
        taken = f"{config.data.test_seed} is the {clash[0]} seed of the models in {DEFAULT.name}"
        raise InputError(f"data: test_seed: {taken}; choose another")
    return Judges(networks, config.network, models[EVIDENCE], trained.network, further)


def weights_digest() -> str:
    """sha256 of the models that ship."""
    return hashlib.sha256(DEFAULT.read_bytes()).hexdigest()


def trainings_of(scenes: TestScenes, rows: Iterable[Row]) -> dict[str, tuple[str, ...]]:
    """Which trainings score a set of scenes, by scenario; of several changes the thesis's rule asks all four models."""
    rows = tuple(rows)
    asked = {name: [row.training for row in rows if name in row.models] for name in SCENARIOS}
    if any(row.section == MULTI for row in rows):
        asked = {name: [row.training for row in rows] for name in SCENARIOS}
    elif scenes.kind == ROOMS and scenes.change == ALIGNED:
        asked = {name: [*trainings, *LABEL_NOISE] if trainings else [] for name, trainings in asked.items()}
    order = list(TRAININGS)
    return {name: tuple(sorted(set(found), key=order.index)) for name, found in asked.items() if found}


def _all_trainings(config: Config, scenes: TestScenes, rows: Iterable[Row]) -> dict[str, tuple[str, ...]]:
    """The same with every seed."""
    return {name: repeated(own, config.paper.seeds) for name, own in trainings_of(scenes, rows).items()}


def room_count(config: Config, rows: Iterable[Row]) -> int:
    """How many test rooms a set has."""
    return config.paper.multi_rooms if any(row.section == MULTI for row in rows) else config.data.test_rooms


def set_stage(config: Config, scenes: TestScenes, rows: tuple[Row, ...], models: str) -> Stage:
    """The stage of one set; `models` is the key of those that score it."""
    settings = as_settings(config, "scan", "room", "preprocess", "evaluate") | {
        "scenes": scenes,
        "trainings": _all_trainings(config, scenes, rows),
        "rooms": room_count(config, rows),
        "test_seed": config.data.test_seed,
        "weights": weights_digest(),
    }
    del settings["evaluate"]["resamples"]  # of intervals, which the tables make
    if scenes.kind != ROOMS:
        settings["buildings"] = [config.paper.buildings, config.paper.views]
    return Stage(f"rooms/{scenes.name}", settings, CODE, APART, (models,))


def scored_set(
    config: Config, run: Path, scenes: TestScenes, rows: tuple[Row, ...], judges: tuple[Judges, str]
) -> list[dict[str, Any]]:
    """Score a set of test scenes, or read what was scored before."""
    judge, models = judges
    folder = open_stage(run, set_stage(config, scenes, rows, models))
    if not (folder / SCORES).exists():
        trainings, count = _all_trainings(config, scenes, rows), room_count(config, rows)
        made = scenes_of(config, scenes, trainings, count)
        total = count if scenes.kind == ROOMS else config.paper.buildings * config.paper.views
        made = progress(made, f"score {scenes.name.replace('_', ' ')}", total)
        write_json(folder / SCORES, list(scored(config, made, trainings, judge, folder / EXAMPLE)))
    return load_json(folder / SCORES)


def file_scores(config: Config, run: Path, judges: tuple[Judges, str]) -> dict[str, list[dict[str, Any]]]:
    """Scores of views of the IFC files of JAXMM_DATA by the name of the semi-real set, all files together."""
    found: dict[str, list[dict[str, Any]]] = {}
    sets = {scenes: rows for scenes, rows in sets_of().items() if scenes.kind == BUILDINGS}
    for path in ifc_files() if config.paper.file_views else ():
        for name, rooms in _scored_file(config, run, path, (sets, *judges)).items():
            found[name] = found.get(name, []) + rooms
    return found


def _scored_file(config: Config, run: Path, path: Path, what: tuple) -> dict[str, list[dict[str, Any]]]:
    sets, judge, models = what
    settings = as_settings(config, "scan", "preprocess", "evaluate") | {
        "file": hashlib.sha256(path.read_bytes()).hexdigest(),
        "views": config.paper.file_views,
        "test_seed": config.data.test_seed,
        "weights": weights_digest(),
    }
    del settings["evaluate"]["resamples"]
    folder = open_stage(run, Stage(f"files/{path.stem}", settings, CODE, APART, (models,)))
    building, found = [], {}
    for scenes, rows in sets.items():
        target = folder / f"{scenes.name}.json"
        if not target.exists():
            building = building or [(path.stem, read_file(path))]
            views = config.paper.file_views
            made = progress(
                building_scenes(config, scenes, building, (1, views)), f"score {path.stem} {scenes.name}", views
            )
            write_json(target, list(scored(config, made, _all_trainings(config, scenes, rows), judge, None)))
        found[scenes.name] = load_json(target)
    return found


def scored(
    config: Config, scenes: Iterable[Scene], trainings: dict[str, tuple[str, ...]], judges: Judges, example: Path | None
) -> Iterator[dict[str, Any]]:
    """The scores of scene after scene; the first that shows enough of every change is kept whole in `example`."""
    for scene in scenes:
        sides, kept = {}, {}
        for scenario, view in scene.views.items():
            scores, of_kind = scores_of(view.cloud, scenario, trainings.get(scenario, ()), judges)
            sides[scenario] = score_room(view.cloud, view.truth, scenario, scores, config, of_kind)
            kept |= _arrays(scenario, view, scores)
        shown = [side["positives"]["true"] for side in sides.values() if side["true_box"] is not None]
        if example is not None and shown and min(shown) >= config.evaluate.least_positives:
            write_arrays(example, kept | {"room": np.array(scene.number), "place": np.array(scene.place)})
            example = None
        yield {"room": scene.number, "place": scene.place, "sides": sides}


def scores_of(
    cloud: LabelledCloud, scenario: str, trainings: tuple[str, ...], judges: Judges
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Score (N,) of every point by method: the control's is a distance [m], the others' are probabilities.

    Of `evidence` and its further trainings it is the probability of any change; behind them come those of the
    scenario's own kind.
    """
    scores = {CONTROL: cloud.distance, RULE: rule_scores(cloud.evidence, removed=scenario.endswith("removed"))}
    for name in trainings:
        features = features_of(TRAININGS[name.split(AGAIN)[0]].features, cloud.points, cloud.distance)
        scores[name] = predict(judges.networks[f"{name}/{scenario}"], features, judges.network)
    (kind, change), of_kind = scenario.split("_"), {}
    for number, models in enumerate((judges.default, *judges.further)):
        both = {
            one: predict(pick_model(models, f"{one}_{change}"), cloud.evidence, judges.default_network)
            for one in ("pillar", "wall")
        }
        name = again(EVIDENCE, number)
        scores[name], of_kind[name] = np.maximum(*both.values()), both[kind]
    return scores, of_kind


def _arrays(scenario: str, view: View, scores: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """One model's view of a scene, fields as `<scenario>/<name>`: its cloud, `score <method>`; and both clouds."""
    (dt,), (robot,) = view.sides
    found = {f"{scenario}/{name}": value for name, value in view.cloud._asdict().items()}
    found |= {f"{scenario}/score {method}": score for method, score in scores.items()}
    return found | {"dt": dt.points, "robot": robot.points}
