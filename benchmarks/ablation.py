"""What evidence, and what imperfections of simulated scans, buy: the four models trained anew without them.

    python -m benchmarks.ablation runs/weights --out runs/ablation [--rooms 40] [--steps 1500]
    python -m benchmarks.ablation --imperfections --out runs/imperfections [--rooms 12] [--steps 400] [--only NAME ...]

Takes the training and validation clouds of a finished run, blanks some columns, trains as that run did but for fewer
steps, and scores varied test rooms with furniture left in (occluded rows, ideal sensor, true labels): once with the
prior's geometry, once with thinned clouds and no element ids. Prints mean ROC AUC / precision at 95 % recall. Beside
them stand the rule, the raw distance, and the raw distance after the holes of the robot's scan were filled.

With --imperfections the four models learn from rooms that three sensors see as built, without one of the errors of
sensors and poses, or without furniture, and are scored on furnished test rooms that four sensors see as built. What is
there is not made again. Prints Markdown: ROC AUC / precision at 95 % recall / F1 of what is called changed.
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.accuracy import PLAIN, condition_config
from benchmarks.command_line import CommandLine, end_without
from benchmarks.views.imperfect_training import VARIANTS as IMPERFECT
from benchmarks.views.imperfect_training import as_table, rooms_to_score, scores_of, taught_clouds
from jaxmm import run_folder
from jaxmm.config import SCENARIOS, Config, DataConfig, NetworkConfig, TrainConfig
from jaxmm.data import labelled_rooms
from jaxmm.data.preprocessed_pairs import sides_of
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.files import load_json, write_json
from jaxmm.inputs import InputError
from jaxmm.learning import model_files, room_scores
from jaxmm.learning.batches import LabelledCloud, Sampler, features_of, labels_of, validation_batch
from jaxmm.learning.fit import fit
from jaxmm.learning.metrics import point_metrics
from jaxmm.learning.model import Model, pick_model
from jaxmm.learning.preprocess import nearest_distance
from jaxmm.rays.evidence import FEATURES
from jaxmm.rays.hole_filling import fill_holes
from jaxmm.rays.rule import rule_scores
from jaxmm.runs.training_stage import training_clouds
from jaxmm.weights import DEFAULT

METHOD = "evidence"
FRACTIONS = ("through", "support", "blocked", "unseen")
RANGES = ("residual", "surprise")
HEIGHTS = ("height", "range", "facing")
# What is left to the network.
VARIANTS: dict[str, Callable[[str], bool]] = {
    "all": lambda name: True,
    "no pools": lambda name: not name.startswith("pool"),
    "no surfaces": lambda name: not name.startswith("surface"),
    "no columns": lambda name: not name.startswith("column"),
    "no distance to the other side": lambda name: name != "apart",
    "each point alone": lambda name: name in (*FRACTIONS, *RANGES, *HEIGHTS, "apart"),
    "distance and place alone": lambda name: name in (*HEIGHTS, "apart"),
}
FULL = {"rooms": 40, "steps": 1500, "variants": tuple(VARIANTS), "trainings": 3, "imperfect": tuple(IMPERFECT)}
SMOKE = {"rooms": 1, "steps": 2, "variants": ("all", "each point alone"), "trainings": 1, "imperfect": ("bias",)}
KINDS = {"geometry": {"object_filter": "none"}, "clouds, no ids": {"object_filter": "none", "evidence": "points"}}


def main(run: Path, out: Path, rooms: int, steps: int, variants: Sequence[str]) -> None:
    if out.exists() and any(out.iterdir()):
        raise SystemExit(f"{out}: expected a new folder, for checkpoints in it may be of other settings")
    try:
        config = run_folder.read_config(run)
    except InputError as error:
        end_without(str(error))
    splits = [[training_clouds(config, run, name, split) for name in SCENARIOS] for split in ("train", "validation")]
    short = dataclasses.replace(config, train=dataclasses.replace(config.train, step_count=steps))
    rows = {}
    scored = {kind: _test_clouds(config, changes, rooms) for kind, changes in KINDS.items()}
    for name in variants:
        blank = np.array([not VARIANTS[name](column) for column in FEATURES])
        models = _trained(short, splits, blank, out / name.replace(" ", "_"))
        rows[name] = {kind: _model_row(models, config, clouds, blank) for kind, clouds in scored.items()}
        print(_line(name, rows[name]), flush=True)
    for name, score in {"rule": _rule, "raw distance": _raw, "raw distance, holes filled": _filled}.items():
        rows[name] = {kind: _row(clouds, score) for kind, clouds in scored.items()}
        print(_line(name, rows[name]), flush=True)
    write_json(out / "ablation.json", {"rooms": rooms, "steps": steps, "rows": rows})


def _small_run(folder: Path) -> Path:
    """A run folder of settings alone, which say one room: its clouds are made where they are asked for."""
    data = DataConfig(train_rooms=1, validation_rooms=1, unchanged_rooms=0)
    train = TrainConfig(methods=(METHOD,), augment=(), labels="true", batch_size=1, points_per_cloud=64)
    preprocess = dataclasses.replace(Config().preprocess, evidence="exact")
    network = NetworkConfig(encoder=(4, 8), head=(4,))
    with run_folder.open_run(folder, Config(data=data, train=train, preprocess=preprocess, network=network)):
        return folder


Scored = dict[str, list[tuple[LabelledCloud, np.ndarray]]]  # scenario -> clouds, and distances once holes are filled
Row = dict[str, tuple[float, float] | None]  # None where no room shows enough of the change


def _test_clouds(config: Config, changes: dict, rooms: int) -> Scored:
    base = condition_config(config, "varied", rooms)
    base = dataclasses.replace(base, preprocess=dataclasses.replace(base.preprocess, **changes))
    return {scenario: list(_with_filled(base, scenario, rooms)) for scenario in SCENARIOS}


def _with_filled(config: Config, scenario: str, rooms: int) -> Iterator[tuple[LabelledCloud, np.ndarray]]:
    """Test clouds of one occluded row; holes are those that the thesis's object filter leaves."""
    source = CloudSource(scenario, scenario, "occluded", config.data.test_seed)
    filtered = dataclasses.replace(config, preprocess=dataclasses.replace(config.preprocess, object_filter="height"))
    for start in range(0, rooms, 16):
        index = np.arange(start, min(start + 16, rooms))
        pairs = labelled_rooms.pairs_of(config, source, index)
        dt, robot = sides_of(filtered, pairs)
        for row, cloud in enumerate(labelled_rooms.clouds_of(config, source, pairs)):
            if scenario.endswith("removed"):
                other = fill_holes(robot[row].points, pairs.pose.position[row], dt[row].points)
            else:
                yield cloud, cloud.distance  # the DT scan has no holes to fill
                continue
            far = np.full(len(cloud.points), 50.0, np.float32)
            yield cloud, nearest_distance(cloud.points, other) if len(other) else far


def _trained(config: Config, splits: list, blank: np.ndarray, folder: Path) -> Model:
    training, validation = ([[_blanked(cloud, blank) for cloud in clouds] for clouds in split] for split in splits)
    settings = config.train
    shape = (settings.batch_size, settings.points_per_cloud)
    sampler = Sampler(training, METHOD, settings.labels, *shape, 1, config.seed)
    held_out = validation_batch(validation, METHOD, settings.labels, settings.points_per_cloud)
    return fit(sampler, held_out, config, folder, lambda step, records: None)[0]


def _blanked(cloud: LabelledCloud, blank: np.ndarray) -> LabelledCloud:
    return cloud._replace(evidence=np.where(blank, np.float32(0.0), cloud.evidence))


def _model_row(models: Model, config: Config, scored: Scored, blank: np.ndarray) -> Row:
    def score(cloud: LabelledCloud, scenario: str, _: np.ndarray) -> np.ndarray:
        features = features_of(METHOD, cloud.points, cloud.distance, _blanked(cloud, blank).evidence)
        return room_scores.predict(pick_model(models, scenario), features, config.network)

    return _row(scored, score)


def _rule(cloud: LabelledCloud, scenario: str, _: np.ndarray) -> np.ndarray:
    return rule_scores(cloud.evidence, removed=scenario.endswith("removed"))


def _raw(cloud: LabelledCloud, *_) -> np.ndarray:
    return cloud.distance


def _filled(cloud: LabelledCloud, scenario: str, distance: np.ndarray) -> np.ndarray:
    return distance


def _row(scored: Scored, score: Callable[[LabelledCloud, str, np.ndarray], np.ndarray]) -> Row:
    """Mean ROC AUC and precision at 95 % recall of each scenario."""
    row = {}
    for scenario, clouds in scored.items():
        found = []
        for cloud, filled in clouds:
            label, void = labels_of(cloud, "true")
            if np.sum(label & ~void) >= 20:
                metrics = point_metrics(score(cloud, scenario, filled), label, void)
                found.append((metrics.roc_auc, metrics.precision_at_95))
        row[scenario] = tuple(np.mean(found, axis=0).tolist()) if found else None
    return row


def _line(name: str, kinds: dict[str, Row]) -> str:
    def told(scores: tuple[float, float] | None) -> str:
        return "-" if scores is None else f"{scores[0]:.4f}/{scores[1]:.3f}"

    cells = [f"{kind}: " + "  ".join(map(told, row.values())) for kind, row in kinds.items()]
    return f"{name:30s} {'   '.join(cells)}"


def without_imperfections(out: Path, rooms: int, steps: int, trainings: int, variants: Sequence[str]) -> None:
    base = _base(rooms, steps)
    seen = rooms_to_score(base, rooms)
    number = {sensor: [one.number for one in own] for sensor, own in seen.items()}
    scores = {}
    for name in variants:
        folder = out / name.replace(" ", "_")
        splits = [taught_clouds(base, name, folder, split) for split in ("train", "validation")]
        scores[name] = []
        for seed in range(trainings):
            path = folder / f"scores_{seed}.json"
            if not path.exists():
                config = dataclasses.replace(base, seed=seed)
                models = _trained(config, splits, np.zeros(len(FEATURES), bool), folder / f"training_{seed}")
                write_json(path, scores_of(models, config, seen))
            scores[name].append(load_json(path))
        print(f"without {name}: {trainings} trainings", flush=True)
    print(as_table(scores, number))


def _base(rooms: int, steps: int) -> Config:
    """Settings of the models that ship, on few rooms, whose points are all there."""
    _, shipped = model_files.load_models(DEFAULT)
    return dataclasses.replace(
        shipped,
        data=DataConfig(train_rooms=rooms, validation_rooms=max(1, rooms // 4), unchanged_rooms=rooms // 3),
        preprocess=dataclasses.replace(shipped.preprocess, **PLAIN | {"object_filter": "none"}),
        train=dataclasses.replace(
            shipped.train, step_count=steps, points_per_cloud=1024, validate_every=max(1, steps // 4)
        ),
    )


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("run", type=Path, nargs="?", metavar="RUN", help="finished run folder of configs/weights.toml")
    parser.add_out(about="folder of checkpoints and what was found")
    parser.add_argument("--rooms", type=int, help="test rooms a row")
    parser.add_argument("--steps", type=int, help="training steps of each variant")
    parser.add_argument("--imperfections", action="store_true", help="of simulated scans, instead of evidence")
    parser.add_argument("--trainings", type=int, help="without each imperfection, by another seed")
    parser.add_argument("--only", nargs="+", choices=IMPERFECT, help="imperfections, after `nothing`")
    options = parser.parse_args()
    if not options.imperfections:
        if options.run is None and not parser.smoke:
            parser.error("the following arguments are required: RUN")
        run = options.run or _small_run(parser.scratch / "run")
        main(run, options.out, options.rooms, options.steps, options.variants)
    if options.imperfections or parser.smoke:
        without = dict.fromkeys(("nothing", *(options.only or options.imperfect)))
        sizes = options.rooms, options.steps, options.trainings
        without_imperfections(options.out / "imperfections", *sizes, tuple(without))
