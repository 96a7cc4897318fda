"""Training on the thesis's rooms: which of them train, which validates, and that `[data] source = "thesis"` does it."""

import numpy as np
import pytest
import tomli_w

from jaxmm import run_folder
from jaxmm.config import SCENARIOS, ConfigError, parse
from jaxmm.inputs import InputError
from jaxmm.runs.training_stage import train_stage
from jaxmm.thesis.training_clouds import thesis_clouds

ROOMS = ("room_1", "room_2", "room_10", "room_test_1")


@pytest.fixture
def repository(tmp_path):
    """The thesis's layout: of each scenario three training rooms and a test room, clean and occluded, 40 points."""
    rng = np.random.default_rng(0)
    for scenario in SCENARIOS:
        folder = tmp_path / "thesis" / "datasets" / f"dataset_{scenario}" / "clean_and_occluded"
        scans, labels = folder / "npy_files_no_augmented", folder / "labels_no_augmented"
        for place in (scans, labels):
            place.mkdir(parents=True)
        for number, room in enumerate(ROOMS):
            for condition in ("clean", "occluded"):
                points = rng.uniform(-1, 1, (40, 3)).astype(np.float32) + 10 * number
                for side in ("dt", "robot"):
                    np.save(scans / f"{room}_{condition}_{side}_scan_x.npy", points)
                    changed = (np.arange(40) >= 30).astype(np.float32)
                    np.save(labels / f"{room}_{condition}_{side}_scan_x_labels.npy", changed)
    return tmp_path / "thesis"


def numbers(clouds):
    return sorted({round(float(cloud.points.mean()) / 10) for cloud in clouds})


def test_the_last_room_validates_and_test_rooms_never_come_near(repository):
    training, validation = thesis_clouds(repository)
    assert len(training) == len(validation) == len(SCENARIOS)
    for some, held_out in zip(training, validation, strict=True):
        assert len(some) == 4 and len(held_out) == 2
        assert not set(numbers(some)) & set(numbers(held_out))
        assert 3 not in numbers(some + held_out)  # the test room
        for cloud in some:
            assert cloud.heuristic.sum() == 10 and cloud.evidence.shape == (40, 0)


def test_a_scenario_with_a_single_room_is_refused(repository):
    for path in repository.rglob("dataset_wall_added/*/*/room_*"):
        if not path.name.startswith(("room_1_", "room_test")):
            path.unlink()
    with pytest.raises(InputError, match="two training rooms of wall_added, found 1"):
        thesis_clouds(repository)


@pytest.mark.long
def test_a_training_can_ask_for_it(repository, tmp_path):
    text = f"""
    [data]
    source = "thesis"
    thesis = "{repository}"
    [network]
    encoder = [4]
    head = [4]
    [train]
    methods = ["nn"]
    step_count = 2
    batch_size = 2
    points_per_cloud = 32
    validate_every = 2
    """
    config = parse(text, "config")
    assert parse(tomli_w.dumps(run_folder.as_table(config)), "again") == config
    folder = tmp_path / "run"
    with run_folder.open_run(folder, config):
        models = train_stage(config, folder)
    assert models["nn"].params["conv1"]["kernel"].shape == (4, 1, 4)
    assert not (folder / "data").exists()


@pytest.mark.parametrize(
    "text, words",
    [
        ('[data]\nsource = "thesis"', "thesis must name a folder"),
        ('[data]\nthesis = "x"', "thesis must name a folder"),
        ('[data]\nsource = "thesis"\nthesis = "x"\n[train]\nlabels = "true"', "labels"),
    ],
)
def test_settings_that_do_not_fit_are_one_line(text, words):
    with pytest.raises(ConfigError, match=words) as error:
        parse(text, "config")
    assert "\n" not in str(error.value)
