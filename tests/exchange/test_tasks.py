"""Which scene has which number: always the same, and evenly shared out."""

from collections import Counter

import pytest

from jaxmm.config import SCENARIOS, UNCHANGED, ConfigError
from jaxmm.exchange.tasks import SPLITS, ExportSettings, load_export_settings, split_of_building, task_of

MANY = [task_of(ExportSettings(), index) for index in range(2000)]


def test_splits_are_three_to_one_to_one_and_share_no_room():
    assert Counter(task.split for task in MANY) == {"train": 1200, "validation": 400, "test": 400}
    assert len({(task.seed, task.number) for task in MANY}) == len(MANY)
    assert all(len({task.seed for task in MANY if task.split == split}) == 1 for split in SPLITS)
    for split in SPLITS:  # numbered without gaps
        assert sorted(task.number for task in MANY if task.split == split) == list(
            range(len(MANY) // 5 * (3 if split == "train" else 1))
        )


def test_shares_are_those_asked_for_and_every_scenario_has_its_turn():
    asked = ExportSettings(occluded_share=0.3, erring_share=0.6, lost_share=0.1)
    tasks = [task_of(asked, index) for index in range(2000)]
    for share, held in (
        (0.3, [task.condition == "occluded" for task in tasks]),
        (0.6, [task.sensor.endswith("-real") for task in tasks]),
        (0.1, [task.lost for task in tasks]),
    ):
        assert sum(held) / len(held) == pytest.approx(share, abs=4.0 * (share * (1 - share) / 2000) ** 0.5)
    for split in SPLITS:
        counts = Counter(task.scene for task in MANY if task.split == split)
        total = sum(counts.values())
        assert all(counts[scene] == pytest.approx(total * 2 / 13, abs=2) for scene in (*SCENARIOS, UNCHANGED))
        assert len(counts) == 16


def test_a_building_is_in_one_split_only_and_in_every_second_scene_of_it():
    tasks = [task_of(ExportSettings(), index, buildings=4) for index in range(500)]
    for task in tasks:
        assert task.building is None or split_of_building(task.building) == task.split
        assert (task.building is None) == (task.number % 2 == 0)
        assert task.building is None or (task.scene in (*SCENARIOS, UNCHANGED) and not task.lost)
    assert {task.building for task in tasks} == {None, 0, 1, 2, 3}


@pytest.mark.parametrize(
    "text, word",
    [
        ("seed = -1", "seed"), ("seeds = 1", "unknown seeds"), ("sensors = []", "sensors"),
        ('sensors = ["tls", "lidar"]', "lidar"), ("occluded_share = 1.5", "occluded_share"),
        ("seed =", "not valid TOML"),
    ],
)  # fmt: skip
def test_wrong_settings_are_one_line(tmp_path, text, word):
    path = tmp_path / "settings.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=word) as error:
        load_export_settings(path)
    assert "\n" not in str(error.value) and str(path) in str(error.value)
