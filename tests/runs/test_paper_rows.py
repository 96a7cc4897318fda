"""The rows of Table I: what was reported, and that the descriptions of the rows cover exactly that."""

import re
import tomllib
from collections import Counter
from pathlib import Path

import pytest

from jaxmm.config import CONDITIONS, SCENARIOS, SCENES
from jaxmm.runs.paper.rows import EXTRA, MULTI, SECTIONS, TABLE_1, TRAININGS, needed_models, sets_of
from warp_scanner.rooms.changes import ADDED, PARTS
from warp_scanner.scenes.scenes import PILLAR

REPORTED = tomllib.loads((Path(__file__).resolve().parents[2] / "paper" / "reported.toml").read_text())["rows"]
VALUES = ("roc_auc", "thesis_fpr_at_95", "precision_at_95", "thesis_iou_at_95")
LETTERS = {"PR": "Pillar Removed", "WR": "Wall Removed", "PA": "Pillar Added", "WA": "Wall Added"}


def test_sections_have_the_rows_of_the_thesis():
    assert Counter(row["section"] for row in REPORTED) == dict(zip(SECTIONS, (8, 20, 8, 18), strict=False))
    assert all(set(row) == {"section", "test_case", "condition", *VALUES} for row in REPORTED)


@pytest.mark.parametrize(
    "section, test_case, condition, values",
    [
        ("Individual Models", "Pillar Added", "clean", (1.0, 0.0, 1.0, 0.9494)),
        ("Individual Models", "Wall Removed", "occluded", (0.8464, 0.2119, 0.7238, 0.6972)),
        ("Ablation Studies", "Removed NN-Distance", "clean", (0.7718, 0.2538, 0.1395, 0.1384)),
        (
            "Ablation Studies",
            "Removed X,Y,Z & No Augmented (Wall Removed)",
            "occluded",
            (0.9859, 0.1254, 0.858, 0.8206),
        ),
        ("Ablation Studies", "Misaligned Scans", "occluded", (0.9709, 0.1706, 0.2754, 0.2713)),
        ("Semi-Real-World Validation", "Wall Removed", "occluded", (0.4274, 0.4807, 0.0921, 0.0916)),
        ("Multi-Mismatch Testing", "Walls Added & Removed", "occluded", (0.4995, 0.4143, 0.216, 0.2155)),
        ("Multi-Mismatch Testing", "Objects Added & Removed", "clean", (0.5626, 0.396, 0.282, 0.2775)),
    ],
)
def test_some_values_are_those_that_were_printed(section, test_case, condition, values):
    (row,) = [
        row
        for row in REPORTED
        if (row["section"], row["test_case"], row["condition"]) == (section, test_case, condition)
    ]
    assert tuple(row[name] for name in VALUES) == values


def test_all_values_are_those_of_the_text(data_root):
    """Read the printed table again, by another way than by hand."""
    path = data_root.parent / "thesis" / "thesis.txt"
    if not path.is_file():
        pytest.skip(f"needs the text of the thesis ({path})")
    text = path.read_text()
    table = text[text.index("Table I: Summary") : text.index("2) Pillar-Added Model: [Click")]
    lines = re.findall(r"^(.+?)\s*\((?:(.+?)[ -])?(Clean|Occluded)\)" + r"\t([\d.]+)" * 4 + "$", table, re.MULTILINE)
    printed = []
    for name, inner, condition, *values in lines:
        scenario = f" ({LETTERS.get(inner, inner)})" if inner else ""
        printed.append((name + scenario, condition.lower(), *map(float, values)))
    found = [(row["test_case"], row["condition"], *(row[name] for name in VALUES)) for row in REPORTED]
    assert printed == found and len(printed) == 54


def test_every_reported_row_is_described_once_and_nothing_else_but_noise():
    described = [(row.section, row.test_case, row.scenes.condition) for row in TABLE_1 if row.section != EXTRA]
    assert described == [(row["section"], row["test_case"], row["condition"]) for row in REPORTED]
    assert len(set(described)) == 54
    assert [row.test_case for row in TABLE_1 if row.section == EXTRA] == [
        name.replace("_", " ").title() for name in SCENARIOS for _ in CONDITIONS
    ]


def test_the_averaged_models_are_those_of_the_changes_that_the_simulator_makes():
    for row in TABLE_1:
        assert row.scenes.scene in SCENES and row.training in TRAININGS
        parts = PARTS[row.scenes.scene]
        made = {
            f"{'pillar' if part.semantic == PILLAR else 'wall'}_{'added' if part.change == ADDED else 'removed'}"
            for part in parts
        }
        assert set(row.models) == made and len(set(row.models)) == len(row.models), row
        assert (row.section == MULTI) == (len(parts) > 1)


def test_the_words_of_an_ablation_are_what_its_training_does():
    for row in TABLE_1:
        training = TRAININGS[row.training]
        said = row.test_case
        if row.section != "Ablation Studies":
            assert (training.features, training.augmented) == (
                ("nn", False) if row.section in SECTIONS[2:4] else ("xyz_nn", True)
            )
            continue
        assert ("nn" not in training.features) == ("NN-Distance" in said)
        assert ("xyz" not in training.features) == ("X,Y,Z" in said)
        assert training.augmented != ("No Augmented" in said)
        assert (training.conditions == ("clean",)) == ("Clean Samples" in said)
        assert (row.scenes.change == "misaligned") == ("Misaligned" in said)
        scenario = re.search(r"\((.*)\)", said)
        assert row.models == ((scenario[1].lower().replace(" ", "_"),) if scenario else ("pillar_removed",))


def test_models_that_rows_need_are_trained_and_no_other():
    needed = needed_models()
    assert len(set(needed)) == len(needed) == 17
    assert {(row.training, name) for row in TABLE_1 for name in row.models} <= set(needed)
    # The thesis's rule asks all four models of a row with several changes.
    assert {("nn", name) for name in SCENARIOS} <= set(needed)


def test_scenes_are_shared_by_the_rows_that_ask_for_the_same():
    sets = sets_of()
    assert sum(map(len, sets.values())) == len(TABLE_1)
    assert len({scenes.name for scenes in sets}) == len(sets) == 8 + 2 + 8 + 18 + 8
