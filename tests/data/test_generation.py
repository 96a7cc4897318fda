"""`jaxmm generate`: the same bits whatever the workers, the order and the kills, and one line for what is wrong."""

import errno
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from jaxmm import run_folder
from jaxmm.commands import cli
from jaxmm.config import Config, Table, load
from jaxmm.data import dataset, generation, local_engine
from jaxmm.data.generation import Request
from jaxmm.files import MANIFEST
from jaxmm.learning import shards

SETTINGS = "[data]\ntrain_rooms = 2\nunchanged_rooms = 1\n[scan]\nwidth = 64\nheight = 40\n"
COUNT, SIZE = 26, 4  # pairs, and pairs a shard in these tests: seven shards, the last one short


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "small.toml"
    path.write_text(SETTINGS)
    return path


@pytest.fixture(autouse=True)
def small_shards(monkeypatch):
    monkeypatch.setattr(generation, "PAIRS_PER_SHARD", SIZE)


@pytest.fixture(scope="module")
def expected(config, tmp_path_factory):
    """Files of a folder that one process wrote undisturbed."""
    folder = tmp_path_factory.mktemp("expected") / "shards"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generation, "PAIRS_PER_SHARD", SIZE)
        generation.generate(load(config), folder, Request(COUNT, workers=1))
    return files(folder)


def files(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def start(config, folder, *options, file_limit=None):
    """`jaxmm generate` in a process of its own, with the small shards of these tests."""
    code = "import sys; from jaxmm.commands import cli; from jaxmm.data import generation\n"
    code += f"generation.PAIRS_PER_SHARD = {SIZE}\n"
    if file_limit:
        code += f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({file_limit}, {file_limit}))\n"
    # A process in the background ignores Ctrl-C, and its children with it, unless they are told otherwise.
    code += "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    # Spawned workers import the main module anew, so it must be one that does nothing then.
    code += "if __name__ == '__main__': sys.exit(cli.main(sys.argv[1:]))"
    arguments = ["generate", config, "--out", folder, "--count", COUNT, *options]
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip


def made(folder):
    return sorted((folder / "shards").glob("shard-*")) if (folder / "shards").is_dir() else []


def wait_for(condition, process, seconds=60):
    end = time.monotonic() + seconds
    while not condition() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.005)


def assert_only_whole_shards_are_listed(folder):
    if (folder / MANIFEST).exists():
        for number, entry in shards.read_manifest(folder).shards.items():
            assert shards.damage_of(folder, number, entry, thorough=True) is None


def test_a_folder_holds_all_that_is_promised(expected, config, tmp_path):
    names = [f"shards/shard-{n:06d}.safetensors" for n in range(7)]
    assert sorted(expected) == sorted([".lock", "card.md", "config.toml", "manifest.json", "versions.json", *names])
    manifest = json.loads(expected["manifest.json"])
    assert manifest["count"] == COUNT and [entry["first"] for entry in manifest["shards"]] == list(range(0, 26, 4))
    assert manifest["shards"][-1]["stop"] == COUNT and manifest["versions"] == json.loads(expected["versions.json"])
    assert manifest["points"] == sum(entry["points"] for entry in manifest["shards"]) > 1000
    assert f"{COUNT} pairs" in expected["card.md"].decode()


@pytest.mark.long
def test_two_workers_write_the_same_bits(config, expected, tmp_path):
    generation.generate(load(config), tmp_path / "out", Request(COUNT, workers=2))
    assert files(tmp_path / "out") == expected


def test_any_order_of_the_shards_gives_the_same_bits(config, expected, tmp_path, monkeypatch):
    def shuffled(function, tasks, workers):
        order = np.random.default_rng(1).permutation(list(tasks)).tolist()
        return ((tuple(task), function(*task)) for task in order)

    monkeypatch.setattr(local_engine, "results", shuffled)
    generation.generate(load(config), tmp_path / "out", Request(COUNT))
    assert files(tmp_path / "out") == expected


@pytest.mark.long
def test_a_run_that_is_killed_again_and_again_ends_in_the_same_bits(config, expected, tmp_path):
    folder, rng = tmp_path / "out", np.random.default_rng(2)
    for kill in range(2):
        process = start(config, folder, "--workers", 2 if kill else 1)
        before = len(made(folder))
        wait_for(lambda before=before: len(made(folder)) > before, process)
        time.sleep(rng.uniform(0, 0.05))
        process.kill()  # -9, to the parent alone: its workers have to notice
        process.communicate(timeout=60)
        assert_only_whole_shards_are_listed(folder)
    (folder / "shards" / ".shard-000006.safetensors.tmp").write_bytes(b"half")
    process = start(config, folder, "--workers", 1)
    assert process.communicate(timeout=60)[0].endswith("in 7 files)\n") and process.returncode == 0
    assert files(folder) == expected


def test_what_is_there_is_not_made_again(config, expected, tmp_path, monkeypatch):
    asked, make = [], dataset.make_shard

    def count(config, raw, first, stop):
        asked.append((first, stop))
        if len(asked) == 4:
            raise KeyboardInterrupt
        return make(config, raw, first, stop)

    monkeypatch.setattr(dataset, "make_shard", count)
    with pytest.raises(KeyboardInterrupt):
        generation.generate(load(config), tmp_path / "out", Request(COUNT, workers=1))
    generation.generate(load(config), tmp_path / "out", Request(COUNT, workers=1))
    generation.generate(load(config), tmp_path / "out", Request(COUNT, workers=1))
    assert asked == [(n, min(n + 4, COUNT)) for n in (0, 4, 8, 12, 12, 16, 20, 24)]
    assert files(tmp_path / "out") == expected


def test_a_folder_grows_to_what_a_larger_one_would_have_been(config, expected, tmp_path):
    for count in (9, 11, COUNT):
        generation.generate(load(config), tmp_path / "out", Request(count, workers=1))
    assert files(tmp_path / "out") == expected


def write_all(folder, content):
    for name, data in content.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


@pytest.mark.parametrize("harm", ["truncated", "corrupt", "missing"])
def test_damaged_shards_are_named_and_made_again_on_request(harm, config, expected, tmp_path, refused, said):
    write_all(tmp_path, expected)
    path = made(tmp_path)[2]
    content = path.read_bytes()
    path.write_bytes(content[:-1] if harm == "truncated" else content[:-1] + bytes([content[-1] ^ 1]))
    if harm == "missing":
        path.unlink()
    arguments = ["generate", config, "--out", tmp_path, "--count", COUNT]
    refused([*arguments, "--verify"], path, "a damaged shard", "--repair")
    if harm != "corrupt":  # its size tells
        refused(arguments, path, "a damaged shard", "--repair")
    assert files(tmp_path) != expected
    assert said(*arguments, "--repair", "--workers", 1)[0] == 0
    assert files(tmp_path) == expected
    assert said(*arguments, "--verify") == (0, ["7 shards are whole", "generate pairs"])


def test_a_repair_that_gives_other_bits_is_no_repair(config, expected, tmp_path, monkeypatch, said):
    write_all(tmp_path, expected)
    path = made(tmp_path)[1]
    path.unlink()
    make = dataset.make_shard
    monkeypatch.setattr(dataset, "make_shard", lambda config, raw, first, stop: make(config, raw, first + 1, stop + 1))
    code, lines = said("generate", config, "--out", tmp_path, "--count", COUNT, "--repair", "--workers", 1)
    assert code == 1 and path.name in lines[-1] and "differs" in lines[-1] and not path.exists()
    assert_only_whole_shards_are_listed(tmp_path)


def test_bad_counts_are_refused_before_anything_is_written(config, tmp_path, refused):
    out = tmp_path / "out"
    for count in (0, -1):
        refused(["generate", config, "--out", out, "--count", count], "--count", f"at least 1, got {count}")
    refused(["generate", config, "--out", out, "--count", COUNT, "--workers", 0], "--workers", "got 0")
    for count in (10**12, 10**24):
        refused(["generate", config, "--out", out, "--count", count, "--workers", 1], "--count", count, "GB free")
    assert not list(tmp_path.iterdir())


def test_the_space_that_is_asked_for_is_what_a_pair_takes(config, expected, tmp_path, monkeypatch, refused):
    size = sum(len(data) for name, data in expected.items() if name.startswith("shards/")) / COUNT

    def with_free(share):
        usage = type("Usage", (), {"free": int(COUNT * size * share)})
        monkeypatch.setattr(generation.shutil, "disk_usage", lambda path: usage)

    results, asked = local_engine.results, []

    def noted(function, tasks, workers):
        asked.append(tasks)
        return results(function, tasks, workers)

    with_free(0.6)
    with monkeypatch.context() as patch:
        patch.setattr(local_engine, "results", noted)  # this process makes no pairs but as the engine's
        refused(["generate", config, "--out", tmp_path / "out", "--count", COUNT, "--workers", 1], "--count", "GB free")
    assert asked == [[(0, SIZE)]] and generation.SAMPLE > SIZE
    with_free(1.6)
    assert cli.main(["generate", str(config), "--out", str(tmp_path / "out"), "--count", "26", "--workers", "1"]) == 0
    with_free(0.1)  # and what is there needs no more room
    assert cli.main(["generate", str(config), "--out", str(tmp_path / "out"), "--count", "26", "--workers", "1"]) == 0


def test_a_folder_of_something_else_is_refused_and_left_alone(config, expected, tmp_path, refused):
    arguments = ["generate", config, "--out"]
    (tmp_path / "photo.jpg").write_text("x")
    refused([*arguments, tmp_path, "--count", 8], tmp_path, "photo.jpg")
    refused([*arguments, tmp_path / "photo.jpg", "--count", 8], "photo.jpg", "found a file")
    refused([*arguments, tmp_path / "photo.jpg" / "x", "--count", 8], "photo.jpg")
    run = tmp_path / "run"
    with run_folder.open_run(run, load(config)):
        (run / "models.safetensors").touch()
    refused([*arguments, run, "--count", 8], run, "models.safetensors")
    folder = tmp_path / "shards"
    write_all(folder, expected)
    refused([*arguments, folder, "--count", 8], folder, "holds 26 pairs, got --count 8")
    refused([*arguments, folder, "--count", COUNT, "--raw"], folder, "without raw scans")
    other = tmp_path / "other.toml"
    other.write_text("seed = 9\n" + SETTINGS)
    refused(["generate", other, "--out", folder, "--count", COUNT], folder, "other settings")
    with run_folder.open_run(folder, load(config)):  # another process is at it
        refused([*arguments, folder, "--count", COUNT], folder, "another process")
    assert files(folder) == expected
    versions = json.loads(expected["versions.json"])
    (folder / "versions.json").write_text(json.dumps(versions | {"code": "another"}))
    refused([*arguments, folder, "--count", COUNT], folder, "other code")


def test_a_machine_with_more_cores_goes_on_with_the_same_folder(config, expected, tmp_path, monkeypatch, refused, said):
    write_all(tmp_path, expected)
    made(tmp_path)[-1].unlink()
    monkeypatch.setattr("jaxmm.versions.core_count", lambda: 96)
    arguments = ["generate", config, "--out", tmp_path, "--count", COUNT, "--workers", 1]
    assert said(*arguments, "--repair")[0] == 0 and files(tmp_path) == expected
    versions = json.loads(expected["versions.json"])
    other = versions | {"packages": versions["packages"] | {"safetensors": "0.0.1"}}
    (tmp_path / "versions.json").write_text(json.dumps(other))
    refused(["generate", config, "--out", tmp_path, "--count", COUNT], tmp_path, "other packages")


def test_a_full_disk_is_one_line_and_the_next_run_goes_on(config, expected, tmp_path, monkeypatch, said):
    replace, left = os.replace, [3]

    def full(source, target):
        left[0] -= "shard-" in str(target)
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(source, target)

    arguments = ["generate", config, "--out", tmp_path / "out", "--count", COUNT, "--workers", 1]
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        code, lines = said(*arguments)
    assert code == 2 and "No space left on device" in lines[-1] and "shard-000003" in lines[-1]
    assert lines[:-1] == ["generate pairs"] and len(made(tmp_path / "out")) == 3
    assert not list(tmp_path.rglob("*.tmp"))
    assert_only_whole_shards_are_listed(tmp_path / "out")
    assert said(*arguments)[0] == 0 and files(tmp_path / "out") == expected


def test_a_file_that_the_system_refuses_to_grow_leaves_nothing_half_written(config, tmp_path):
    process = start(config, tmp_path / "out", "--workers", 1, file_limit=10_000)
    _, err = process.communicate(timeout=60)
    lines = err.splitlines()
    assert process.returncode == 2 and lines[0] == "generate pairs" and len(lines) == 2, err
    assert "shard-000000" in lines[1] and "File too large" in lines[1]
    assert not made(tmp_path / "out") and not list(tmp_path.rglob("*.tmp"))


def test_ctrl_c_is_one_line(config, tmp_path):
    process = start(config, tmp_path / "out", "--workers", 2)
    wait_for(lambda: (tmp_path / "out" / MANIFEST).exists(), process)
    time.sleep(0.3)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1, err
    assert err.splitlines() == ["generate pairs", "jaxmm generate: interrupted; the same command again goes on"]
    assert_only_whole_shards_are_listed(tmp_path / "out")


def test_large_raw_scans_make_small_shards():
    sizes = [generation._pairs_per_shard(Config(), False), generation._pairs_per_shard(Config(), True)]
    wide = Config(scan=Table.of({"width": 8192, "height": 8192}))
    assert sizes == [SIZE, SIZE] and generation._pairs_per_shard(wide, True) == 1
