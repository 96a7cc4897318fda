"""What every row of Table I compares: which test scenes, which models, trained how. Data only; nothing runs here.

The 54 rows of the thesis in its order, then sensor noise, which it tells in words and has no row for. The thesis says
what it trained in sections II-D and III-E to III-H; where it leaves something open, a comment says what was chosen.
"""

from collections.abc import Iterable
from typing import NamedTuple

from jaxmm.config import CONDITIONS, SCENARIOS

INDIVIDUAL, ABLATION, SEMI_REAL, MULTI, EXTRA = SECTIONS = (
    "Individual Models", "Ablation Studies", "Semi-Real-World Validation", "Multi-Mismatch Testing", "Sensor Noise",
)  # fmt: skip
ROOMS, BUILDINGS = "rooms", "buildings"
ALIGNED, MISALIGNED, NOISY = "", "misaligned", "noisy"


class Training(NamedTuple):
    """How a thesis network is trained; the number of updates is the same for all."""

    features: str  # "nn" | "xyz" | "xyz_nn", see batches.features_of
    augmented: bool  # with the three moved copies of each cloud
    conditions: tuple[str, ...] = CONDITIONS  # of the rooms that it learns from, and is validated on
    labels: str = "true"  # "true" | "heuristic"


# Retrained on one kind of sample after the other, as the thesis: first all features and augmentation, then less.
TRAININGS = {
    "xyz_nn": Training("xyz_nn", augmented=True),
    "xyz": Training("xyz", augmented=True),
    "nn_augmented": Training("nn", augmented=True),
    "nn": Training("nn", augmented=False),
    # Not said: whether clean samples were augmented and had coordinates. These ablations came before both were dropped.
    "clean_only": Training("xyz_nn", augmented=True, conditions=("clean",)),
    "not_augmented": Training("xyz_nn", augmented=False),
    "nn_heuristic": Training("nn", augmented=False, labels="heuristic"),
}
LABEL_NOISE = ("nn", "nn_heuristic")  # trained on true and on heuristic labels, all else equal


class TestScenes(NamedTuple):
    """Which test scenes a row is scored on."""

    __test__ = False  # no test class, whatever pytest makes of the name

    kind: str  # ROOMS | BUILDINGS
    scene: str  # one of config.SCENES
    condition: str  # "clean" | "occluded"
    change: str = ALIGNED  # ALIGNED | MISALIGNED | NOISY

    @property
    def name(self) -> str:
        """As files are called."""
        place = "building" if self.kind == BUILDINGS else ""
        return "_".join(filter(None, (place, self.change, self.scene, self.condition)))


class Row(NamedTuple):
    """One row of the table."""

    section: str  # one of SECTIONS
    test_case: str  # as paper/reported.toml has it
    scenes: TestScenes
    models: tuple[str, ...]  # scenarios of the models that are averaged: the changes that are truly present
    training: str  # key of TRAININGS, of the thesis networks of this row

    @property
    def method(self) -> str:
        """Name of the thesis network's method in the table: its features."""
        return TRAININGS[self.training].features


AGAIN = "@"  # between the name of a training and the number of its seed, where that is not the first


def repeated(trainings: Iterable[str], seeds: int) -> tuple[str, ...]:
    """Names of all trainings, each with so many seeds."""
    return tuple(again(name, number) for name in trainings for number in range(seeds))


def again(training: str, number: int) -> str:
    """Name of a training with seed `number` after the run's own."""
    return f"{training}{AGAIN}{number}" if number else training


def titled(name: str) -> str:
    """A scenario as the table writes it."""
    return name.replace("_", " ").title()


# Several changes: the table's name -> the simulator's scene, and the changes in it.
_SEVERAL = {
    "Pillars Added": ("pillars_added", ("pillar_added",)),
    "Walls Added": ("walls_added", ("wall_added",)),
    "Pillars Removed": ("pillars_removed", ("pillar_removed",)),
    "Walls Removed": ("walls_removed", ("wall_removed",)),
    "Objects Added": ("pillar_and_wall_added", ("pillar_added", "wall_added")),
    "Objects Removed": ("pillar_and_wall_removed", ("pillar_removed", "wall_removed")),
    "Pillars Added & Removed": ("pillar_added_and_removed", ("pillar_added", "pillar_removed")),
    "Walls Added & Removed": ("wall_added_and_removed", ("wall_added", "wall_removed")),
    "Objects Added & Removed": ("all_four", SCENARIOS),
}
# Test case -> scenario, training, how the test scenes differ. Where the table names no scenario, the text does.
_ABLATIONS = {
    "Removed NN-Distance": ("pillar_removed", "xyz", ALIGNED),
    "Removed X,Y,Z (Pillar Removed)": ("pillar_removed", "nn_augmented", ALIGNED),
    **{
        f"Removed X,Y,Z & No Augmented ({titled(scenario)})": (scenario, "nn", ALIGNED)
        for scenario in ("pillar_removed", "wall_removed", "pillar_added", "wall_added")
    },
    "Clean Samples Only (Pillar Removed)": ("pillar_removed", "clean_only", ALIGNED),
    "Clean Samples Only (Wall Removed)": ("wall_removed", "clean_only", ALIGNED),
    "Misaligned Scans": ("pillar_removed", "xyz_nn", MISALIGNED),
    "No Augmented Samples (Pillar Removed)": ("pillar_removed", "not_augmented", ALIGNED),
}


def _both(section: str, test_case: str, scenes: tuple[str, str, str], models: tuple[str, ...], training: str):
    kind, scene, change = scenes
    return [
        Row(section, test_case, TestScenes(kind, scene, condition, change), models, training)
        for condition in CONDITIONS
    ]


def _table() -> tuple[Row, ...]:
    rows = []
    for name in SCENARIOS:
        rows += _both(INDIVIDUAL, titled(name), (ROOMS, name, ALIGNED), (name,), "xyz_nn")
    for test_case, (name, training, change) in _ABLATIONS.items():
        rows += _both(ABLATION, test_case, (ROOMS, name, change), (name,), training)
    for name in SCENARIOS:
        rows += _both(SEMI_REAL, titled(name), (BUILDINGS, name, ALIGNED), (name,), "nn")
    for test_case, (scene, models) in _SEVERAL.items():
        rows += _both(MULTI, test_case, (ROOMS, scene, ALIGNED), models, "nn")
    for name in SCENARIOS:
        rows += _both(EXTRA, titled(name), (ROOMS, name, NOISY), (name,), "xyz_nn")
    return tuple(rows)


TABLE_1 = _table()


def needed_models() -> tuple[tuple[str, str], ...]:
    """Every (training, scenario) that the table and the ablation of labels need, in a fixed order."""
    wanted = {(row.training, scenario) for row in TABLE_1 for scenario in row.models}
    # All four of `nn`: which of them the thesis's rule selects is asked of all.
    wanted |= {(training, scenario) for training in LABEL_NOISE for scenario in SCENARIOS}
    order = {name: number for number, name in enumerate(TRAININGS)}
    return tuple(sorted(wanted, key=lambda one: (order[one[0]], SCENARIOS.index(one[1]))))


def sets_of() -> dict[TestScenes, tuple[Row, ...]]:
    """Test scenes -> the rows that are scored on them, so that each scene is made once."""
    found: dict[TestScenes, tuple[Row, ...]] = {}
    for row in TABLE_1:
        found[row.scenes] = (*found.get(row.scenes, ()), row)
    return found
