"""The run folder: files are whole or absent, one process writes, and models come back as they went."""

import dataclasses
import errno
import json
import os
import resource
import stat
import subprocess
import sys

import jax
import numpy as np
import pytest
import safetensors.numpy
import tomli_w

from jaxmm import files, run_folder
from jaxmm.config import Config, NetworkConfig, Table, load
from jaxmm.inputs import InputError
from jaxmm.learning import model_files
from jaxmm.learning.train_step import init_all
from jaxmm.versions import versions
from warp_scanner.cores import core_count

CONFIG = Config(network=NetworkConfig((4, 8), (4,)), room=Table.of({"size": [9.0, 9.0, 3.0]}))


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def refused(call, *words):
    with pytest.raises(InputError) as caught:
        call()
    assert "\n" not in str(caught.value)
    for word in words:
        assert str(word) in str(caught.value)


def half_then(error):
    def write(temporary):
        temporary.write_text("ha")
        raise error

    return write


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt(), ValueError()])
@pytest.mark.parametrize("old", ["the old content", None])
def test_a_writer_that_fails_midway_leaves_the_old_file_and_no_other(tmp_path, error, old):
    path = tmp_path / "sub" / "file.txt"
    if old is not None:
        files.write_text(path, old)
    with pytest.raises(type(error)) as caught:
        files.write_atomically(path, half_then(error))
    assert names(path.parent) == ([path.name] if old else []) and (old is None or path.read_text() == old)
    if isinstance(error, OSError):
        assert str(path) in str(caught.value) and caught.value.errno == errno.ENOSPC


def test_a_link_is_followed_and_a_device_or_folder_is_refused(tmp_path):
    real, link, pipe = tmp_path / "real.json", tmp_path / "link.json", tmp_path / "pipe"
    real.write_text("old")
    link.symlink_to(real)
    files.write_text(link, "new")
    assert link.is_symlink() and real.read_text() == "new"
    os.mkfifo(pipe)
    for path in (pipe, tmp_path):
        with pytest.raises(InputError, match="expected a file to write to"):
            files.write_text(path, "new")
        with pytest.raises(InputError, match="--out: expected a file"):
            files.check_writable(path, "--out")
    assert stat.S_ISFIFO(pipe.stat().st_mode) and names(tmp_path) == ["link.json", "pipe", "real.json"]


@pytest.mark.parametrize("content", [None, '{"step": 1', "[1,2"])
def test_damaged_records_are_named_with_what_to_do(tmp_path, content):
    if content is not None:
        (tmp_path / run_folder.METRICS).write_text(content)
    with pytest.raises(InputError, match=rf"{run_folder.METRICS}: .*delete {run_folder.MODELS}"):
        run_folder.read_records(tmp_path)


def test_json_refuses_nan_and_keeps_the_old_file(tmp_path):
    path = tmp_path / "a.json"
    files.write_json(path, {"x": 1.5, "gap": None})
    with pytest.raises(ValueError):
        files.write_json(path, {"x": float("nan")})
    assert json.loads(path.read_text()) == {"x": 1.5, "gap": None} and names(tmp_path) == ["a.json"]


FULL_DISK = """
import pathlib, resource, sys
import numpy as np
from jaxmm import files
folder = pathlib.Path(sys.argv[1])
files.write_text(folder / "text", "old")
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
for write in (
    lambda: files.write_text(folder / "text", "new" * 1000),
    lambda: files.write_arrays(folder / "arrays.npz", {"a": np.arange(1000)}),
    lambda: files.write_json(folder / "rows.json", list(range(1000))),
):
    try:
        write()
    except OSError as error:
        print(error)
"""


def test_a_file_that_the_system_refuses_to_grow_leaves_nothing_behind(tmp_path):
    done = subprocess.run([sys.executable, "-c", FULL_DISK, tmp_path], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert [line.rpartition("/")[2] for line in lines] == ["text'", "arrays.npz'", "rows.json'"], done
    assert names(tmp_path) == ["text"] and (tmp_path / "text").read_text() == "old"


def test_a_new_run_folder_holds_settings_and_versions(tmp_path):
    folder = tmp_path / "a" / "b"
    with run_folder.open_run(folder, CONFIG):
        assert names(folder) == [".lock", "config.toml", "versions.json"]
    assert run_folder.read_config(folder) == CONFIG
    told = json.loads((folder / "versions.json").read_text())
    assert told == versions()
    assert told["packages"]["jax"] == jax.__version__ and told["packages"]["numpy"] == np.__version__
    assert told["threads"] == core_count() and told["python"] == ".".join(map(str, sys.version_info[:3]))
    with run_folder.open_run(folder, CONFIG):  # and it opens again
        pass


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "photo.jpg").touch()
    refused(lambda: run_folder.open_run(tmp_path, CONFIG).__enter__(), tmp_path, "photo.jpg", "config.toml")
    refused(lambda: run_folder.open_run(tmp_path / "photo.jpg", CONFIG).__enter__(), "photo.jpg", "found a file")
    refused(
        lambda: run_folder.open_run(tmp_path / "photo.jpg" / "x", CONFIG).__enter__(), "photo.jpg/x", "Not a directory"
    )
    assert names(tmp_path) == ["photo.jpg"]


def test_other_settings_are_refused(tmp_path):
    with run_folder.open_run(tmp_path, CONFIG):
        pass
    other = dataclasses.replace(CONFIG, seed=1)
    refused(lambda: run_folder.open_run(tmp_path, other).__enter__(), tmp_path, "other settings")
    assert run_folder.read_config(tmp_path) == CONFIG


def test_another_number_of_cores_is_refused_where_it_matters(tmp_path, monkeypatch):
    with run_folder.open_run(tmp_path, CONFIG):
        pass
    monkeypatch.setattr("jaxmm.versions.core_count", lambda: 96)
    refused(lambda: run_folder.open_run(tmp_path, CONFIG).__enter__(), tmp_path, "other threads")
    with run_folder.open_run(tmp_path, CONFIG, threads_matter=False):
        assert run_folder.read_config(tmp_path) == CONFIG


def test_a_mistake_that_is_put_right_is_not_another_run(tmp_path):
    """Settings that led to no work do not bind the folder; those that did, do."""
    other = dataclasses.replace(CONFIG, seed=1)
    with pytest.raises(InputError, match="no shards"), run_folder.open_run(tmp_path, CONFIG):
        raise InputError("no shards")
    with pytest.raises(InputError, match="again"), run_folder.open_run(tmp_path, other):
        (tmp_path / "data").mkdir()
        raise InputError("again")
    assert run_folder.read_config(tmp_path) == other
    refused(lambda: run_folder.open_run(tmp_path, CONFIG).__enter__(), tmp_path, "other settings")


def test_a_folder_that_was_killed_while_it_was_made_opens(tmp_path):
    for name in (".lock", "versions.json", ".versions.json.tmp", ".config.toml.tmp"):
        (tmp_path / name).write_text("{")
    (tmp_path / "config.toml").mkdir()
    refused(lambda: run_folder.read_config(tmp_path), tmp_path, "config.toml")
    (tmp_path / "config.toml").rmdir()
    with run_folder.open_run(tmp_path, CONFIG):
        (tmp_path / "figures").mkdir()
        (tmp_path / "figures" / ".loss.png.17.tmp").touch()
    with run_folder.open_run(tmp_path, CONFIG):  # what a killed process left half-written goes
        assert not list(tmp_path.rglob("*.tmp")) and json.loads((tmp_path / "versions.json").read_text())


def test_a_second_process_is_refused_while_the_first_one_writes(tmp_path):
    config = tmp_path / "config.toml"
    code = (
        "import pathlib, sys\nfrom jaxmm import run_folder\nfolder = pathlib.Path(sys.argv[1])\n"
        "try:\n    with run_folder.open_run(folder, run_folder.read_config(folder)): print('open')\n"
        "except Exception as error: print(type(error).__name__, error)\n"
    )
    second = [sys.executable, "-c", code, tmp_path]
    with run_folder.open_run(tmp_path, CONFIG):
        said = subprocess.run(second, capture_output=True, text=True, check=True).stdout
        assert said.startswith(f"InputError {tmp_path}: another process")
    assert subprocess.run(second, capture_output=True, text=True, check=True).stdout == "open\n"
    assert load(config) == CONFIG


def test_what_is_no_run_folder_is_refused(tmp_path):
    refused(lambda: run_folder.read_config(tmp_path), tmp_path, "config.toml", "found none")
    refused(lambda: run_folder.read_config(tmp_path / "x"), tmp_path / "x", "found no folder")
    (tmp_path / "config.toml").write_bytes(b"\xff\xfe")
    refused(lambda: run_folder.read_config(tmp_path), tmp_path / "config.toml", "not UTF-8")
    (tmp_path / "config.toml").write_text("[tool]\nx = 1\n")
    refused(lambda: run_folder.read_config(tmp_path), tmp_path / "config.toml", "unknown tool")
    assert names(tmp_path) == ["config.toml"]


@pytest.fixture(scope="module")
def models():
    key = jax.random.key(1)
    return {name: init_all(key, size, CONFIG).model for name, size in (("nn", 1), ("xyz_nn", 4))}


def test_models_come_back_bit_for_bit_with_their_settings(tmp_path, models):
    path = tmp_path / "models.safetensors"
    model_files.save_models(path, models, CONFIG)
    loaded, config = model_files.load_models(path)
    assert config == CONFIG and list(loaded) == ["nn", "xyz_nn"]
    for name, model in models.items():
        assert jax.tree.structure(model) == jax.tree.structure(loaded[name])
        jax.tree.map(np.testing.assert_array_equal, model, loaded[name])
    whole = path.read_bytes()
    model_files.save_models(path, models, CONFIG)
    assert path.read_bytes() == whole and path.stat().st_mode & 0o044 == 0o044 & ~_umask()


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_damaged_and_foreign_model_files_are_refused(tmp_path, models):
    path = tmp_path / "models.safetensors"
    refused(lambda: model_files.load_models(path), path, "found no file")
    refused(lambda: model_files.load_models(tmp_path), tmp_path, "expected a run folder")
    model_files.save_models(path, models, CONFIG)
    whole = path.read_bytes()
    for length in (0, 4, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        refused(lambda: model_files.load_models(path), path, "not a whole safetensors file")
    tensors = safetensors.numpy.load(whole)

    def with_tensors(**changes):
        changed = {name: value for name, value in (tensors | changes).items() if value is not None}
        config = tomli_w.dumps(run_folder.as_table(CONFIG))
        path.write_bytes(safetensors.numpy.save(changed, {"config": config}))

    path.write_bytes(safetensors.numpy.save(tensors))
    refused(lambda: model_files.load_models(path), path, "under `config`")
    path.write_bytes(safetensors.numpy.save(tensors, {"config": "seed = -1"}))
    refused(lambda: model_files.load_models(path), path, "config: seed")
    name = "nn/params/conv1/kernel"
    for wrong in (None, tensors[name][:3], tensors[name].astype(np.float64)):
        with_tensors(**{name: wrong})
        refused(lambda: model_files.load_models(path), path, "expected the tensors of nn, xyz_nn")
    for extra in ("nn", "nn/params", "other/params/x", "x"):
        with_tensors(**{extra: np.zeros(1, np.float32)})
        refused(lambda: model_files.load_models(path), path, "expected the tensors of nn, xyz_nn")
    with_tensors(**{name: np.full_like(tensors[name], np.nan)})
    refused(lambda: model_files.load_models(path), path, "NaN")


def test_a_full_disk_keeps_the_old_models(tmp_path, models):
    path = tmp_path / "models.safetensors"
    model_files.save_models(path, models, CONFIG)
    whole = path.read_bytes()
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limit[1]))
    try:
        with pytest.raises(OSError, match=r"models\.safetensors"):
            model_files.save_models(path, models, CONFIG)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert path.read_bytes() == whole and names(tmp_path) == [path.name]


@pytest.mark.parametrize("name", ["code", "python", "packages", "threads"])
def test_a_run_that_other_code_began_is_refused(tmp_path, name):
    with run_folder.open_run(tmp_path / "run", Config()):
        pass
    path = tmp_path / "run" / run_folder.VERSIONS
    stored = json.loads(path.read_text())
    path.write_text(json.dumps(stored | dict.fromkeys(("git_commit", "processor", "instructions"), "another")))
    with run_folder.open_run(tmp_path / "run", Config()):  # prose and processor may change
        pass
    path.write_text(json.dumps(stored | {name: "another"}))
    with pytest.raises(InputError, match=rf"other {name} \("), run_folder.open_run(tmp_path / "run", Config()):
        pass


@pytest.mark.parametrize("content", [None, b"", b'[{"room": 0', b"PK\x03\x04"])
@pytest.mark.parametrize("load_file, name", [(files.load_json, "a.json"), (files.load_arrays, "a.npz")])
def test_damaged_files_of_a_run_are_named_with_what_to_do(tmp_path, load_file, name, content):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"{name}: .*delete it") as caught:
        load_file(tmp_path / name)
    assert "\n" not in str(caught.value)
