"""Settings of a run: one frozen dataclass per stage, filled from a TOML file that says only what differs."""

import dataclasses
import math
import tomllib
import typing
from pathlib import Path
from typing import Any

from jaxmm.inputs import InputError, clipped, one_line

SCENARIOS = ("pillar_added", "wall_added", "pillar_removed", "wall_removed")
CONDITIONS = ("clean", "occluded")
UNCHANGED = "unchanged"
# Several changes at once, named and drawn by the simulator.
MULTI_SCENARIOS = (
    "pillars_added", "walls_added", "pillars_removed", "walls_removed", "pillar_and_wall_added",
    "pillar_and_wall_removed", "pillar_added_and_removed", "wall_added_and_removed", "all_four", "pillar_moved",
    "wall_moved",
)  # fmt: skip
SCENES = (*SCENARIOS, UNCHANGED, *MULTI_SCENARIOS)
TRAINED_METHODS = {"nn": 1, "xyz_nn": 4, "evidence": 29, "xyz": 3}  # method -> features per point


class ConfigError(InputError):
    """A setting that is unknown, of the wrong type, or out of range; one line that says where."""


class Table(tuple):
    """A TOML table as (key, value) pairs sorted by key, so that settings that hold one can be hashed."""

    @classmethod
    def of(cls, values: dict[str, Any]) -> "Table":
        """Freeze a table and all that is in it."""
        return cls((key, _frozen(value)) for key, value in sorted(values.items()))

    def thawed(self) -> dict[str, Any]:
        """The table as TOML gives it, but with tuples for lists."""
        return {key: value.thawed() if isinstance(value, Table) else value for key, value in self}


def _frozen(value: Any) -> Any:
    if isinstance(value, dict):
        return Table.of(value)
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


MOST_WIDTH, MOST_LAYERS = 2**14, 64  # of a network
MOST_COUNT = 10**9  # of steps, points and the like: more is a mistake
MOST_ROOMS = 1_000_000  # of one kind; they are held in memory


def quoted(value: Any) -> str:
    """A value of a user's file as it stands there, clipped; Python writes no whole number of thousands of digits."""
    try:
        return clipped(repr(value))
    except ValueError:
        return "a number of thousands of digits"


def bounded(default: Any, low: float = -math.inf, high: float = math.inf) -> Any:
    """A field whose numbers must lie within [low, high]."""
    return dataclasses.field(default=default, metadata={"low": low, "high": high})


def one_of(default: str, *choices: str) -> Any:
    """A field that takes one of a few words."""
    return dataclasses.field(default=default, metadata={"choices": choices})


@dataclasses.dataclass(frozen=True)
class DataConfig:
    """How many rooms, from which seeds. Each scenario has its own count of rooms, each room clean and occluded."""

    train_rooms: int = bounded(96, 1, MOST_ROOMS)
    validation_rooms: int = bounded(24, 1, MOST_ROOMS)
    test_rooms: int = bounded(100, 1, MOST_ROOMS)
    # Rooms without a mismatch, and with several at once, to train every model with; a quarter of as many to validate.
    unchanged_rooms: int = bounded(24, 0, MOST_ROOMS)
    multi_rooms: int = bounded(0, 0, MOST_ROOMS)
    train_seed: int = bounded(1, 0, 2**63 - 1)
    validation_seed: int = bounded(2, 0, 2**63 - 1)
    test_seed: int = bounded(3, 0, 2**63 - 1)
    # Of training clouds: rooms made as asked above, stored ones, or the scans of the thesis's repository.
    source: str = one_of("rooms", "rooms", "shards", "thesis")
    shards: str = ""  # folder that `jaxmm generate` wrote; all its pairs train, whatever train_rooms says
    thesis: str = ""  # folder of that repository; its last training room validates, the others train

    def __post_init__(self):
        for name in ("shards", "thesis"):
            if (self.source == name) != bool(getattr(self, name)):
                got = repr(getattr(self, name))
                raise ConfigError(f"{name} must name a folder if, and only if, source is {name}, got {got}")
        seeds = (self.train_seed, self.validation_seed, self.test_seed)
        if len(set(seeds)) < 3:
            raise ConfigError(f"train, validation and test seeds must differ, got {seeds}")


@dataclasses.dataclass(frozen=True)
class PreprocessConfig:
    """From a raw scan to the cloud that a network sees."""

    # height: by the ids of elements, as the thesis; semantic: by the simulator's classes; mixed: by height in half of
    # the rooms, not at all in the others.
    object_filter: str = one_of("height", "height", "semantic", "none", "mixed")
    filter_height: float = bounded(2.0, 0.0, 10.0)  # [m] above the floor that an object's top must reach
    voxel_size: float = bounded(0.1, 0.001, 10.0)  # [m]
    outlier_removal: bool = False
    label_distance: float = bounded(0.09, 0.0, 10.0)  # [m] NN distance beyond which a point is labelled
    # Where the cluster filter thins heuristic labels of removed objects. It is there for the shadows of furniture;
    # clean scans have none, and the filter could only lose parts of the object (paper/README.md).
    label_filter: str = one_of("occluded", "occluded", "always", "never")
    # What rays say of every point, for the method of that name. exact: ray by ray against the prior's geometry; cloud:
    # as if only both filtered clouds were known, and the prior's elements; points: those neither; mixed: a half exact,
    # the rest of the two others, room by room.
    evidence: str = one_of("none", "none", "exact", "cloud", "points", "mixed")
    registration: str = one_of("none", "none", "refine")  # of the robot scan, before the DT scan is taken from its pose
    viewpoint_error: float = bounded(0.03, 0.0, 1.0)  # [m] standard deviation of each coordinate, for cloud and points
    # Share of those whose viewpoint is estimated from the clouds themselves instead, where they tell it; pinholes only.
    viewpoint_estimated: float = bounded(0.0, 0.0, 1.0)


@dataclasses.dataclass(frozen=True)
class NetworkConfig:
    """Widths of the per-point network; the defaults are the thesis's."""

    encoder: tuple[int, ...] = bounded((64, 128, 256, 512), 1, MOST_WIDTH)
    head: tuple[int, ...] = bounded((256, 128), 1, MOST_WIDTH)
    dropout: float = bounded(0.3, 0.0, 0.99)

    def __post_init__(self):
        if not (1 <= len(self.encoder) <= MOST_LAYERS and 1 <= len(self.head) <= MOST_LAYERS):
            raise ConfigError(f"encoder and head must have at least one layer each, and at most {MOST_LAYERS}")


# Networks of one shape and different width; a config says `encoder` and `head` itself.
THESIS = NetworkConfig()
COMPACT = NetworkConfig(encoder=(32, 64, 64, 128), head=(64, 32))


@dataclasses.dataclass(frozen=True)
class LossConfig:
    """Focal loss; see losses.focal_loss for the two forms."""

    form: str = one_of("released", "released", "balanced")
    alpha: float = bounded(10.0, 0.0, 1e6)
    gamma: float = bounded(2.0, 0.0, 10.0)

    def __post_init__(self):
        if self.form == "balanced" and self.alpha > 1:
            raise ConfigError(f"alpha must lie in [0, 1] in the balanced form, got {self.alpha}")


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """The joint training of the four models. Adam and weight decay (added to the gradient) as in the thesis."""

    methods: tuple[str, ...] = ("nn", "xyz_nn")
    labels: str = one_of("heuristic", "heuristic", "true", "object")  # see batches.labels_of
    step_count: int = bounded(3000, 1, MOST_COUNT)
    batch_size: int = bounded(8, 1, 4096)  # clouds a step and model
    points_per_cloud: int = bounded(4096, 16, MOST_COUNT)  # a longer cloud is thinned at random, anew at every step
    learning_rate: float = bounded(5e-5, 0.0, 1.0)
    schedule: str = one_of("constant", "constant", "cosine")  # of the learning rate; cosine: down to 0 at the last step
    weight_decay: float = bounded(1e-4, 0.0, 1.0)
    augment: tuple[str, ...] = ("xyz_nn",)  # methods that also see the three moved copies of each cloud
    validate_every: int = bounded(100, 1, MOST_COUNT)  # [steps]; a checkpoint is written at each validation
    calibrate: tuple[str, ...] = ("evidence",)  # methods whose probabilities are made frequencies, on validation rooms
    patience: int = bounded(10, 0, MOST_COUNT)  # validations without improvement after which a model stops; 0: never
    # What a running average of the weights keeps of itself at each step; it is then what is validated, and what a
    # training ends with. 0: the weights themselves.
    average: float = bounded(0.0, 0.0, 0.9999)
    # Of the rule's log-odds in the logits of `evidence`, which its network then corrects. 0: it starts from nothing.
    rule_scale: float = bounded(0.0, 0.0, 10.0)
    map_models: str = one_of("map", "map", "vmap")  # one after the other, or side by side, inside the one step

    def __post_init__(self):
        if "evidence" in self.augment:
            raise ConfigError("augment: evidence is gathered in place, and moved copies have none")
        for name in ("methods", "augment", "calibrate"):
            if unknown := set(getattr(self, name)) - set(TRAINED_METHODS):
                raise ConfigError(f"{name} must be some of {sorted(TRAINED_METHODS)}, got {sorted(unknown)}")
        if not self.methods or len(set(self.methods)) < len(self.methods):
            raise ConfigError(f"methods must name each method once, at least one, got {list(self.methods)}")


@dataclasses.dataclass(frozen=True)
class EvaluateConfig:
    """How a row of a table is made."""

    threshold: float = bounded(0.6, 0.0, 1.0)  # probability from which a point counts as changed
    least_positives: int = bounded(20, 1, MOST_COUNT)  # testable ones of a room, to enter the mean of a row
    resamples: int = bounded(2000, 100, 10**6)  # of the bootstrap over rooms


@dataclasses.dataclass(frozen=True)
class PaperConfig:
    """What `jaxmm reproduce` makes beyond the eight rows of the individual models, when rows is "all"."""

    rows: str = one_of("individual", "individual", "all")  # of Table I; all: with everything below
    seeds: int = bounded(1, 1, 9)  # trainings of every thesis network of Table I, from the run's seed on
    evidence_seeds: int = bounded(0, 0, 9)  # trainings of `evidence` to set beside the models that ship
    evidence_rooms: int = bounded(60, 1, MOST_ROOMS)  # that these learn from; those that ship learned from 240
    evidence_steps: int = bounded(1000, 1, MOST_COUNT)
    multi_rooms: int = bounded(40, 1, MOST_ROOMS)  # test rooms of each row with several changes
    buildings: int = bounded(20, 1, MOST_ROOMS)  # procedural ones, for the semi-real rows
    views: int = bounded(2, 1, 1000)  # of each building and row
    file_views: int = bounded(4, 0, 1000)  # of each IFC file of JAXMM_DATA and row
    # The compact networks of the scaling study, all with the same number of updates.
    scaling_rooms: tuple[int, ...] = bounded((12, 100, 1_000, 10_000), 1, MOST_ROOMS)  # of each model, nested
    scaling_steps: int = bounded(1250, 1, MOST_COUNT)
    scaling_batch: int = bounded(8, 1, 4096)
    scaling_points: int = bounded(512, 16, MOST_COUNT)  # that are kept of each cloud
    scaling_test_rooms: int = bounded(40, 1, MOST_ROOMS)
    # How accuracy falls: test scenes only, each level with so many occluded rooms of every scenario.
    sweep_rooms: int = bounded(20, 0, MOST_ROOMS)
    furniture: tuple[int, ...] = bounded((2, 8, 20, 44), 0, 200)  # places for tables and chairs
    range_noise: tuple[float, ...] = bounded((0.0, 0.02, 0.05, 0.1), 0.0, 1.0)  # [m] standard deviation
    misalignment: tuple[float, ...] = bounded((0.0, 0.02, 0.05, 0.1, 0.3), 0.0, 1.0)  # [m], with 20 degrees a metre

    def __post_init__(self):
        if list(self.scaling_rooms) != sorted(set(self.scaling_rooms)):
            raise ConfigError(f"scaling_rooms must grow, got {list(self.scaling_rooms)}")


@dataclasses.dataclass(frozen=True)
class Config:
    """Everything a run needs. `scan` and `room` are the simulator's: jaxmm/data/simulator_settings.py checks them."""

    seed: int = bounded(0, 0, 2**31 - 1)  # of the models' initial weights, batches and dropout
    data: DataConfig = DataConfig()
    scan: Table = Table()  # preset, sensor, width, height, and fields of warp_scanner's PairConfig
    room: Table = Table()  # fields of warp_scanner's RoomConfig
    preprocess: PreprocessConfig = PreprocessConfig()
    network: NetworkConfig = NetworkConfig()
    loss: LossConfig = LossConfig()
    train: TrainConfig = TrainConfig()
    evaluate: EvaluateConfig = EvaluateConfig()
    paper: PaperConfig = PaperConfig()

    def __post_init__(self):
        if self.data.source == "thesis" and (self.train.labels != "heuristic" or "evidence" in self.train.methods):
            raise ConfigError('data: source thesis needs train.labels = "heuristic", and knows no evidence')
        if "evidence" in self.train.methods and self.preprocess.evidence == "none":
            raise ValueError("train: the method evidence needs some evidence in [preprocess], got none")


def load(path: Path | str) -> Config:
    """Read a Config from a TOML file; keys left out keep their defaults.

    Raises:
        ConfigError: the file is missing or no TOML, or a setting is unknown, of the wrong type, or out of range.
    """
    return build(Config, read_toml(Path(path), "config"), str(path))


def parse(text: str, where: str) -> Config:
    """Read a Config from TOML text; `where` opens the messages of errors."""
    return build(Config, _toml(text, where), where)


def read_toml(path: Path, what: str = "settings") -> dict[str, Any]:
    """The values in a TOML file; `what` it holds is a word for errors.

    Raises:
        ConfigError: the file is missing, or no TOML.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise ConfigError(f"{path}: cannot read the {what}: {reason}") from error
    return _toml(text, str(path))


def _toml(text: str, where: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # numbers of too many digits, and lists nested too deeply
        raise ConfigError(f"{where}: not valid TOML: {one_line(error)}") from error


def build(kind: type, values: dict[str, Any], where: str, others: Any = None) -> Any:
    """Fill the settings class `kind`, checking names, types and ranges; what is not said is of `others`, or a default.

    Raises:
        ConfigError: one line that names the setting, what was expected and what came.
    """
    fields = {field.name: field for field in dataclasses.fields(kind)}
    if unknown := values.keys() - fields.keys():
        raise ConfigError(
            f"{where}: unknown {clipped(', '.join(sorted(unknown)))}; expected some of {', '.join(fields)}"
        )
    converted = {key: _convert(fields[key], value, f"{where}: {key}") for key, value in values.items()}
    try:
        return kind(**converted) if others is None else dataclasses.replace(others, **converted)
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from error


def _convert(field: dataclasses.Field, value: Any, where: str) -> Any:
    if dataclasses.is_dataclass(field.type):
        if not isinstance(value, dict):
            raise ConfigError(f"{where}: expected a table, got {quoted(value)}")
        try:
            return build(field.type, value, where, None if field.default is dataclasses.MISSING else field.default)
        except ConfigError as error:
            message = str(error)
            raise ConfigError(message if message.startswith(where) else f"{where}: {message}") from error
    if field.type is Table:
        if not isinstance(value, dict):
            raise ConfigError(f"{where}: expected a table, got {quoted(value)}")
        return Table.of(value)
    value = _typed(field.type, value, where)
    _check_range(field, value, where)
    return value


def _typed(kind: Any, value: Any, where: str) -> Any:
    if typing.get_origin(kind) is tuple:
        if not isinstance(value, list):
            raise ConfigError(f"{where}: expected a list, got {quoted(value)}")
        return tuple(_typed(typing.get_args(kind)[0], item, where) for item in value)
    if kind is float and type(value) is int and abs(value) < 2**63:
        return float(value)
    if type(value) is not kind:  # exactly: True is an int to isinstance
        raise ConfigError(f"{where}: expected {kind.__name__}, got {quoted(value)}")
    return value


def _check_range(field: dataclasses.Field, value: Any, where: str) -> None:
    choices = field.metadata.get("choices")
    if choices and value not in choices:
        raise ConfigError(f"{where}: expected one of {', '.join(choices)}, got {quoted(value)}")
    low, high = field.metadata.get("low", -math.inf), field.metadata.get("high", math.inf)
    for number in value if isinstance(value, tuple) else (value,):
        # Any int is finite, and one of 400 digits is no float.
        if isinstance(number, int | float) and not (low <= number <= high and abs(number) != math.inf):
            above = "a finite number" if low == -math.inf else f"at least {low:g}"
            bounds = above if high == math.inf else f"from {low:g} to {high:g}"
            raise ConfigError(f"{where}: expected {bounds}, got {quoted(number)}")
