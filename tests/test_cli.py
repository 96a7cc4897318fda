"""The command line: whatever is wrong ends as one line that says what and where, code 2 for input and 1 for failure."""

import errno
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
import zipfile

import numpy as np
import pytest

from jaxmm import cli, reproduce, runs

COMMANDS = ("reproduce", "train", "evaluate", "thesis")


def said(capsys, *arguments):
    """Exit code and the lines on standard error of one command, run in this process."""
    try:
        code = cli.main([str(argument) for argument in arguments])
    except SystemExit as end:
        code = end.code
    return code, capsys.readouterr().err.splitlines()


def refused(capsys, arguments, *words, code=2):
    found, lines = said(capsys, *arguments)
    assert found == code and len(lines) == 1, lines
    assert lines[0].startswith(f"jaxmm {arguments[0]}: ")
    for word in words:
        assert str(word) in lines[0], lines[0]


def test_the_package_loads_nothing_heavy():
    heavy = "{'jax', 'numpy', 'warp', 'matplotlib', 'orbax'}"
    code = f"import sys, jaxmm, jaxmm.cli; print(sorted({heavy} & set(sys.modules) - {{'numpy'}}))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example_that_parses(command, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main([command, "--help"])
    text = " ".join(capsys.readouterr().out.split())
    example = text.partition(f"example: jaxmm {command} ")[2]
    assert end.value.code == 0 and example
    options = cli._parser().parse_args([command, *example.split()])
    assert options.command == command and not options.debug


def test_help_lists_every_command(capsys):
    assert said(capsys, "--help") == (0, [])
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    out = capsys.readouterr().out
    assert all(command in out and cli.ABOUT[command].split(",")[0] in " ".join(out.split()) for command in COMMANDS)


@pytest.mark.parametrize(
    "arguments, word",
    [
        pytest.param([], "COMMAND", id="no command"),
        pytest.param(["detekt"], "detekt", id="unknown command"),
        pytest.param(["reproduce"], "CONFIG", id="no config"),
        pytest.param(["reproduce", "a.toml", "--outt", "b"], "--outt", id="unknown option"),
        pytest.param(["evaluate", "run", "--rooms", "many"], "--rooms", id="text for a number"),
        pytest.param(["thesis", ".", "--method", "magic", "--out", "x"], "--method", id="unknown method"),
        pytest.param(["thesis", "."], "--method", id="missing options"),
    ],
)
def test_wrong_options_are_one_line(arguments, word, capsys):
    code, lines = said(capsys, *arguments)
    assert code == 2 and len(lines) == 1 and lines[0].startswith("jaxmm") and word in lines[0]


@pytest.mark.parametrize("command", ["reproduce", "train"])
def test_bad_settings_are_refused_before_anything_is_written(command, tmp_path, capsys):
    path, out = tmp_path / "bad.toml", tmp_path / "out"
    cases = {
        "[train]\nstep_count = 0": "train: step_count",
        "[train]\nx = 0": "train: unknown x",
        "[room]\nx = 1": "room: unknown x",
        "[room]\nsize = [nan, 1.0, 1.0]": "room: size",
        "[room]\npillar_width = [2.0, 1.0]": "pillar_width",
        "seed = ": "not valid TOML",
    }
    for text, word in cases.items():
        path.write_text(text)
        refused(capsys, [command, path, "--out", out], path, word)
    refused(capsys, [command, tmp_path / "none.toml", "--out", out], tmp_path / "none.toml", "No such file")
    refused(capsys, [command, tmp_path, "--out", out], tmp_path, "directory")
    assert not out.exists()


def test_an_output_that_is_no_run_folder_is_refused_and_left_alone(tiny_config, tmp_path, capsys):
    (tmp_path / "photo.jpg").write_text("x")
    for command in ("reproduce", "train"):
        refused(capsys, [command, tiny_config, "--out", tmp_path], tmp_path, "photo.jpg")
        refused(capsys, [command, tiny_config, "--out", tmp_path / "photo.jpg"], "photo.jpg", "found a file")
        refused(capsys, [command, tiny_config, "--out", tmp_path / "photo.jpg" / "x"], "Not a directory")
    assert [path.name for path in tmp_path.iterdir()] == ["photo.jpg"]


def test_other_settings_and_an_unwanted_resume_are_refused(finished_run, tiny_config, tmp_path, capsys):
    other = tmp_path / "other.toml"
    other.write_text(f"seed = 9\n{tiny_config.read_text()}")
    refused(capsys, ["reproduce", other, "--out", finished_run], finished_run, "other settings")
    refused(capsys, ["train", tiny_config, "--out", finished_run], finished_run, "--resume")
    assert said(capsys, "train", tiny_config, "--out", finished_run, "--resume") == (0, [])


@pytest.fixture
def a_run(finished_run, tmp_path):
    """A copy of the finished run that a test may write to."""
    folder = tmp_path / "run"
    shutil.copytree(finished_run, folder)
    return folder


def test_evaluate_makes_rows_of_a_finished_run(a_run, capsys):
    before = (a_run / "table_1.json").read_bytes()
    assert cli.main(["evaluate", str(a_run), "--rows", "wall_added:clean", "--rooms", "1"]) == 0
    out = capsys.readouterr().out
    rows = json.loads((a_run / "evaluations" / "1_rooms" / "table_1.json").read_text())["rows"]
    assert len(rows) == 6 and {row["test_case"] for row in rows} == {"Wall Added"} and "wall added" in out
    assert (a_run / "table_1.json").read_bytes() == before
    assert cli.main(["evaluate", str(a_run)]) == 0
    assert (a_run / "table_1.json").read_bytes() == before
    capsys.readouterr()


def test_evaluate_refuses_what_is_no_finished_run(a_run, tmp_path, capsys):
    empty = tmp_path / "empty"
    empty.mkdir()
    refused(capsys, ["evaluate", empty], empty, "expected a run folder", "config.toml")
    refused(capsys, ["evaluate", tmp_path / "none"], tmp_path / "none", "no folder")
    refused(capsys, ["evaluate", a_run / "config.toml"], "config.toml", "expected a run folder")
    refused(capsys, ["evaluate", a_run, "--rows", "wall_added"], "--rows", "wall_added:clean"[:10], "'wall_added'")
    refused(capsys, ["evaluate", a_run, "--rows", "wall_added:dark"], "--rows", "occluded", "'wall_added:dark'")
    refused(capsys, ["evaluate", a_run, "--rooms", "0"], "--rooms", "at least 1, got 0")
    models = a_run / runs.MODELS
    models.write_bytes(models.read_bytes()[:1000])
    refused(capsys, ["evaluate", a_run], models, "not a whole safetensors file")
    models.unlink()
    refused(capsys, ["evaluate", a_run], a_run, models.name, "found none")
    (a_run / "config.toml").write_text("x = 1")
    refused(capsys, ["evaluate", a_run], a_run / "config.toml", "unknown x")
    assert not (a_run / "evaluations").exists() and not list(a_run.rglob(".*.tmp"))


def test_a_failure_is_one_line_with_code_1_and_debug_shows_where(tiny_config, tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise RuntimeError("the room is on fire\nsecond line")

    monkeypatch.setattr(reproduce, "train_stage", fail)
    arguments = ["reproduce", tiny_config, "--out", tmp_path / "run"]
    refused(capsys, arguments, "RuntimeError: the room is on fire", code=1)
    code, lines = said(capsys, *arguments, "--debug")
    assert code == 1 and "Traceback" in lines[0] and any("in fail" in line for line in lines)
    assert lines[-1] == "jaxmm reproduce: RuntimeError: the room is on fire"


def test_a_full_disk_is_one_line_and_the_next_run_goes_on(a_run, tiny_config, capsys, monkeypatch):
    table = a_run / "table_1.json"
    table.unlink()
    replace = os.replace

    def full(source, target):
        if str(target).endswith("table_1.json"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        refused(capsys, ["evaluate", a_run], "No space left on device", table, code=1)
    assert not table.exists() and not list(a_run.rglob(".*.tmp"))
    assert cli.main(["evaluate", str(a_run)]) == 0 and table.exists()
    capsys.readouterr()


def command(*arguments, file_limit=None, **options):
    """Start a command, whose files may grow to at most so many bytes."""
    line = [sys.executable, "-m", "jaxmm.cli", *map(str, arguments)]
    if file_limit is not None:
        limit = "import os, resource, sys; n = int(sys.argv[1]); resource.setrlimit(resource.RLIMIT_FSIZE, (n, n))"
        line = [sys.executable, "-c", f"{limit}; os.execv(sys.argv[2], sys.argv[2:])", str(file_limit), *line]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


@pytest.mark.parametrize("stage, limit", [("data", 20_000), ("checkpoints/nn", 3_000), ("checkpoints/nn", 9_000)])
def test_a_full_disk_in_any_stage_is_one_line_and_leaves_nothing_half_written(
    a_run, tiny_config, stage, limit, tmp_path
):
    """The system refuses to let files grow past a limit, which that stage is the first to need."""
    shutil.rmtree(a_run / "checkpoints")
    for name in (runs.MODELS, runs.METRICS):
        (a_run / name).unlink()
    if stage == "data":
        shutil.rmtree(a_run / "data")
    caches = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "cache")}  # JAX does not write its files whole or not at all
    process = command("train", "--resume", tiny_config, "--out", a_run, file_limit=limit, env=os.environ | caches)
    _, err = process.communicate(timeout=120)
    lines = err.splitlines()
    assert process.returncode == 1 and lines[-1].startswith("jaxmm train: OSError: "), err
    assert "File too large" in lines[-1] and str(a_run / stage) in lines[-1]
    assert all(line.startswith(("scan ", "train ")) for line in lines[:-1]), err
    assert not list(a_run.rglob(".*.tmp")) and not (a_run / runs.MODELS).exists()


def test_ctrl_c_is_one_line(tiny_config, tmp_path):
    process = command("reproduce", tiny_config, "--out", tmp_path / "run", start_new_session=True)
    end = time.monotonic() + 60
    while not list(tmp_path.glob("run/data/*")) and process.poll() is None and time.monotonic() < end:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    lines = [line for line in err.splitlines() if not line.startswith(("scan ", "train "))]
    assert process.returncode == 1, err
    assert lines == ["jaxmm reproduce: interrupted; the same command again goes on"]


@pytest.fixture
def repository(tmp_path):
    """The thesis's layout with one pair: 40 points, of which the last 10 are gone from the robot scan."""
    points = np.random.default_rng(0).uniform(-1, 1, (40, 3)).astype(np.float32)
    points[30:] += 3
    folder = tmp_path / "thesis" / "datasets" / "dataset_pillar_removed"
    scans, labels = (folder / "clean_and_occluded" / name for name in ("npy_files_x", "labels_x"))
    tables = folder / "clean" / "preprocessed_csv_files"
    for place in (scans, labels, tables):
        place.mkdir(parents=True)
    name = "room_test_1_clean_dt_scan_x"
    np.save(scans / f"{name}.npy", points)
    np.save(scans / "room_test_1_clean_robot_scan_x.npy", points[:30])
    np.save(labels / f"{name}_labels.npy", (np.arange(40) >= 30).astype(np.float32))
    rows = [f"{x};{y};{z};{int(i >= 30)}" for i, (x, y, z) in enumerate(points)]
    (tables / f"{name}.csv").write_text("\n".join(["X;Y;Z;categoryID", *rows]))
    return tmp_path / "thesis"


def scan_file(repository, pattern="*dt_scan_x.npy"):
    (path,) = repository.rglob(pattern)
    return path


def thesis(repository, method="nn-raw", *more):
    return ["thesis", repository, "--method", method, "--out", repository.parent / "out.json", *more]


def test_thesis_scores_a_whole_repository(repository, capsys):
    assert cli.main(list(map(str, thesis(repository)))) == 0
    out, err = capsys.readouterr()
    (row,) = json.loads((repository.parent / "out.json").read_text())["rows"]
    assert row["roc_auc"] == 1 and row["positives"] == 10 and row["by_element"]["roc_auc"] == 1
    assert err == "" and "pillar_removed room_test_1 clean: AUC 1.0000" in out


def truncated(path):
    path.write_bytes(path.read_bytes()[:-5])


def with_array(array):
    return lambda path: np.save(path, array, allow_pickle=True)


POINTS = np.ones((40, 3), np.float32)


@pytest.mark.parametrize(
    "pattern, damage, words",
    [
        pytest.param("*dt_scan_x.npy", truncated, [".npy"], id="truncated scan"),
        pytest.param("*dt_scan_x.npy", lambda path: path.write_bytes(b""), [".npy"], id="scan of no bytes"),
        pytest.param("*dt_scan_x.npy", with_array(POINTS.astype(object)), ["bject"], id="scan of objects"),
        pytest.param("*dt_scan_x.npy", with_array(POINTS[:, :2]), ["(N, 3)", "(40, 2)"], id="flat scan"),
        pytest.param("*dt_scan_x.npy", with_array(POINTS[:0]), ["at least one point"], id="empty scan"),
        pytest.param("*dt_scan_x.npy", with_array(POINTS * np.nan), ["finite", "NaN"], id="scan of NaN"),
        pytest.param("*robot_scan_x.npy", with_array(POINTS * np.inf), ["finite"], id="partner of infinities"),
        pytest.param("*robot_scan_x.npy", os.unlink, ["expected its partner"], id="no partner"),
        pytest.param("*_labels.npy", os.unlink, ["labels"], id="no labels"),
        pytest.param("*_labels.npy", truncated, [".npy"], id="truncated labels"),
        pytest.param("*_labels.npy", with_array(np.ones(39)), ["40 labels", "(39,)"], id="too few labels"),
        pytest.param("*_labels.npy", with_array(np.full(40, 2)), ["0 and 1"], id="labels of 2"),
        pytest.param("*_labels.npy", with_array(np.full(40, np.nan)), ["0 and 1"], id="labels of NaN"),
        pytest.param("*.csv", lambda path: path.write_text("X;Y;Z\n1;2;3"), ["categoryID"], id="csv without ids"),
        pytest.param("*.csv", truncated, [], id="truncated csv"),
        pytest.param("*.csv", lambda path: path.write_text(""), ["columns"], id="empty csv"),
        pytest.param("*.csv", lambda path: path.write_text("X;Y;Z;categoryID\n0;nan;0;1"), ["finite"], id="csv of NaN"),
    ],
)
def test_damaged_scans_are_refused_and_nothing_is_written(repository, capsys, pattern, damage, words):
    path = scan_file(repository, pattern)
    damage(path)
    refused(capsys, thesis(repository), path.stem.split("_scan_")[0], *words)
    assert not (repository.parent / "out.json").exists()


def released(repository, content):
    """Write a .pth of our own making: torch's archive around any pickle."""
    path = repository / "trained_models" / "pillar_removed" / "net.pth"
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, bytes):
        path.write_bytes(content)
        return path
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("net/data.pkl", pickle.dumps(content, protocol=2))
        archive.writestr("net/byteorder", "little")
    return path


class Command:
    def __reduce__(self):
        return os.mkdir, ("/tmp/jaxmm-was-tricked",)


@pytest.mark.parametrize(
    "content, word",
    [
        pytest.param({"conv1.weight": Command()}, "mkdir", id="a command to run"),
        pytest.param({"conv1.weight": [1, 2]}, "tensors", id="a list"),
        pytest.param(Command(), "mkdir", id="no dict"),
        pytest.param({"epoch": 3}, "tensors", id="a number"),
        pytest.param(b"not a zip at all", "torch.save", id="no archive"),
        pytest.param(b"", "torch.save", id="no bytes"),
    ],
)
def test_weights_that_hold_anything_but_tensors_are_refused(repository, capsys, content, word):
    path = released(repository, content)
    refused(capsys, thesis(repository, "released"), path, word)
    assert not (repository.parent / "out.json").exists() and not os.path.exists("/tmp/jaxmm-was-tricked")


def test_truncated_released_weights_are_refused(repository, data_root, capsys):
    (original,) = (data_root / "thesis" / "trained_models" / "pillar_removed").glob("*.pth")
    whole = original.read_bytes()
    for length in (len(whole) // 2, len(whole) - 1):
        path = released(repository, whole[:length])
        refused(capsys, thesis(repository, "released"), path, "torch.save")


def test_options_of_thesis_that_do_not_fit_are_refused(repository, finished_run, tmp_path, capsys):
    refused(capsys, thesis(repository, "nn"), "--model", "expected a run folder")
    refused(capsys, thesis(repository, "nn-raw", "--model", finished_run), "--model", "nn-raw")
    refused(capsys, thesis(repository, "nn", "--weights", tmp_path), "--weights", "released")
    refused(capsys, thesis(repository, "released", "--model", finished_run), "--model")
    refused(capsys, thesis(repository, "nn", "--model", tmp_path), tmp_path, "run folder")
    refused(capsys, thesis(repository, "nn", "--model", tmp_path / "x.safetensors"), "x.safetensors", "no file")
    refused(capsys, thesis(repository, "released"), "trained_models", "found none")
    refused(capsys, thesis(tmp_path / "none"), "datasets", "found none")
    missing = ["thesis", repository, "--method", "nn-raw", "--out"]
    refused(capsys, [*missing, tmp_path / "none" / "out.json"], "--out", tmp_path / "none" / "out.json")
    refused(capsys, [*missing, tmp_path], "--out", tmp_path)
    assert not (tmp_path / "none").exists()
