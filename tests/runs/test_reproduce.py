"""The main job as a user starts it: what it leaves behind, and that no kill at any moment changes a bit of it."""

import json
import random
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from jaxmm import run_folder
from jaxmm.config import CONDITIONS, SCENARIOS, load
from jaxmm.learning import model_files, result_tables
from jaxmm.learning.metrics import METRICS

METHODS = ("nn", "xyz_nn")
# What a run says. Checkpoints hold the time of day, so they are compared by what grows from them.
RESULTS = ("config.toml", "versions.json", "metrics.jsonl", "models.safetensors", "sentences.json", "reliability.json")
RESULTS += ("table_1.json", "table_1.csv", "table_1.md", "figures/*", "rooms/*", "data/*")


def results(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for name in RESULTS for path in folder.glob(name)}


def start(config, folder):
    command = [sys.executable, "-m", "jaxmm", "reproduce", config, "--out", folder]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def test_a_run_folder_holds_all_that_is_promised(finished_run, tiny_config):
    expected = {".lock", "checkpoints", "data", "rooms", "figures"} | {name for name in RESULTS if "*" not in name}
    assert {path.name for path in finished_run.iterdir()} == expected
    rows = {f"{scenario}_{condition}" for scenario in SCENARIOS for condition in CONDITIONS}
    drawn = {path.name for path in (finished_run / "figures").iterdir()}
    assert drawn >= {f"{kind}_{method}.png" for kind in ("loss", "validation", "reliability") for method in METHODS}
    examples = {path.stem for path in (finished_run / "rooms").glob("*.npz")}
    assert examples <= rows and drawn >= {f"{row}_{method}.png" for row in examples for method in METHODS}
    assert {path.stem for path in (finished_run / "rooms").glob("*.json")} == rows
    assert {path.name for path in (finished_run / "checkpoints").iterdir()} == set(METHODS)
    assert run_folder.read_config(finished_run) == load(tiny_config)
    models, config = model_files.load_models(finished_run)
    assert list(models) == list(METHODS) and config == load(tiny_config)


def test_the_table_is_whole(finished_run):
    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    table = json.loads((finished_run / "table_1.json").read_text(), parse_constant=refuse)
    rows = table["rows"]
    assert len(rows) == 8 * 3 * 2 and set(table) == {"rows", "meta"}
    found = {(row["test_case"], row["condition"], row["method"], row["label_kind"]) for row in rows}
    cases = [scenario.replace("_", " ").title() for scenario in SCENARIOS]
    assert found == {
        (case, condition, method, kind)
        for case in cases
        for condition in CONDITIONS
        for method in ("nn-raw", *METHODS)
        for kind in result_tables.LABEL_KINDS
    }
    for row in rows:
        assert all(0 <= row[name] <= 1 for name in METRICS if row[name] is not None)
        assert 0 <= row["scene_count"] <= 2 and row["scene_count"] == round(2 * (1 - row["left_out_share"]))
        if row["method"] == "nn-raw" and row["condition"] == "clean" and row["label_kind"] == "heuristic":
            assert row["roc_auc"] == 1.0
    assert table["meta"]["versions"] == json.loads((finished_run / "versions.json").read_text())
    assert table["meta"]["test_rooms_per_row"] == 2


def test_training_is_told_step_by_step(finished_run):
    records = [json.loads(line) for line in (finished_run / "metrics.jsonl").read_text().splitlines()]
    assert [(record["method"], record["step"]) for record in records] == [
        (method, step) for method in METHODS for step in (2, 4, 6)
    ]
    assert all(np.isfinite(record["train_loss"]).all() and len(record["train_loss"]) == 4 for record in records)


def test_the_terminal_ends_with_table_folder_and_sentences(finished_run):
    said = (finished_run.parent / "stdout").read_text()
    assert result_tables.as_terminal(result_tables.read_rows(finished_run)) in said
    lines = said.partition(f"run folder: {finished_run}\n")[2].splitlines()
    sentences = json.loads((finished_run / "sentences.json").read_text())
    if not sentences:
        assert lines == ["no model found a box in any test room, so there is no sentence to show"]
    else:
        assert len(lines) == min(3, len(sentences))
        for line in lines:
            assert any(item["sentence"] in line and item["scenario"] in line for item in sentences)
    stages = (finished_run.parent / "stderr").read_text().splitlines()
    assert all(line.startswith(("scan ", "train ", "score ", "draw ")) for line in stages), stages  # and no chatter


def kill_when(process, seen, delay):
    """SIGKILL `delay` seconds after `seen()` first holds; False when the process ended before."""
    end = time.monotonic() + 120
    while not seen() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.005)
    time.sleep(delay)
    running = process.poll() is None
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stderr.close()
    return running


@pytest.mark.long
def test_a_run_that_is_killed_again_and_again_ends_in_the_same_bits(finished_run, tiny_config, tmp_path):
    folder = tmp_path / "killed"
    moments = ("checkpoints/xyz_nn/[0-9]*", "rooms/*", "figures/*_xyz_nn.png")
    rng = random.Random(0)
    killed = 0
    for moment in moments:
        killed += kill_when(start(tiny_config, folder), lambda m=moment: any(folder.glob(m)), rng.uniform(0, 0.4))
    assert killed >= 2  # a fast machine may finish a stage within the delay
    process = start(tiny_config, folder)
    _, said = process.communicate()
    assert process.returncode == 0, said
    expected, found = results(finished_run), results(folder)
    assert found.keys() == expected.keys()
    assert [name for name in expected if found[name] != expected[name]] == []
    assert not list(folder.rglob(".*.tmp")) and not list(folder.rglob("*orbax-checkpoint-tmp*"))


@pytest.mark.long
@pytest.mark.parametrize("lost", ["table_1.json", "rooms/wall_added_clean.json", "rooms/*.npz"])
def test_what_is_missing_from_a_run_is_made_again_the_same(finished_run, tmp_path, lost, monkeypatch):
    """In this process, hence with other threads and caches: the results are those of another process."""
    from jaxmm.reports import figures, room_figures
    from jaxmm.runs import main_job

    drawn = [(figures, f"{name}_curves") for name in ("loss", "validation", "reliability")]
    for module, name in ((room_figures, "room_report"), *drawn):
        monkeypatch.setattr(module, name, lambda *_: None)  # they are there already
    folder = tmp_path / "run"
    shutil.copytree(finished_run, folder)
    lost_files = list(folder.glob(lost))
    assert lost_files
    for path in lost_files:
        path.unlink()
    main_job.reproduce(run_folder.read_config(folder), folder)
    expected, found = results(finished_run), results(folder)
    assert [name for name in expected if found[name] != expected[name]] == []
