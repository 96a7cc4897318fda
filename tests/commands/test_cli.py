"""The command line: whatever is wrong ends as one line that says what and where, code 2 for input and 1 for failure."""

import argparse
import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import warnings

import pytest

from jaxmm import run_folder
from jaxmm.commands import cli
from jaxmm.runs import main_job

COMMANDS = ("reproduce", "generate", "train", "evaluate", "thesis", "scan", "benchmark")


def test_the_package_loads_nothing_heavy():
    heavy = "{'jax', 'numpy', 'warp', 'matplotlib', 'orbax'}"
    code = f"import sys, jaxmm, jaxmm.commands.cli; print(sorted({heavy} & set(sys.modules) - {{'numpy'}}))"
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


def test_help_waits_for_no_library():
    heavy = "{'numpy', 'jax', 'warp', 'scipy', '_hashlib'}"
    told = f"import sys, jaxmm.commands.cli; print(sorted({heavy} & {{*sys.modules}}))"
    assert subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_help_lists_every_command(capsys, said):
    assert said("--help") == (0, [])
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
def test_wrong_options_are_one_line(arguments, word, said):
    code, lines = said(*arguments)
    assert code == 2 and len(lines) == 1 and lines[0].startswith("jaxmm") and word in lines[0]


@pytest.mark.parametrize("command", ["reproduce", "train"])
def test_bad_settings_are_refused_before_anything_is_written(command, tmp_path, refused):
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
        refused([command, path, "--out", out], path, word)
    refused([command, tmp_path / "none.toml", "--out", out], tmp_path / "none.toml", "No such file")
    refused([command, tmp_path, "--out", out], tmp_path, "directory")
    assert not out.exists()


def test_an_output_that_is_no_run_folder_is_refused_and_left_alone(tiny_config, tmp_path, refused):
    (tmp_path / "photo.jpg").write_text("x")
    for command in ("reproduce", "train"):
        refused([command, tiny_config, "--out", tmp_path], tmp_path, "photo.jpg")
        refused([command, tiny_config, "--out", tmp_path / "photo.jpg"], "photo.jpg", "found a file")
        refused([command, tiny_config, "--out", tmp_path / "photo.jpg" / "x"], "Not a directory")
    assert [path.name for path in tmp_path.iterdir()] == ["photo.jpg"]


def test_other_settings_and_an_unwanted_resume_are_refused(finished_run, tiny_config, tmp_path, refused, said):
    other = tmp_path / "other.toml"
    other.write_text(f"seed = 9\n{tiny_config.read_text()}")
    refused(["reproduce", other, "--out", finished_run], finished_run, "other settings")
    refused(["train", tiny_config, "--out", finished_run], finished_run, "--resume")
    assert said("train", tiny_config, "--out", finished_run, "--resume") == (0, [])


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


def test_evaluate_refuses_what_is_no_finished_run(a_run, tmp_path, refused):
    empty = tmp_path / "empty"
    empty.mkdir()
    refused(["evaluate", empty], empty, "expected a run folder", "config.toml")
    refused(["evaluate", tmp_path / "none"], tmp_path / "none", "no folder")
    refused(["evaluate", a_run / "config.toml"], "config.toml", "expected a run folder")
    refused(["evaluate", a_run, "--rows", "wall_added"], "--rows", "wall_added:clean"[:10], "'wall_added'")
    refused(["evaluate", a_run, "--rows", "wall_added:dark"], "--rows", "occluded", "'wall_added:dark'")
    refused(["evaluate", a_run, "--rooms", "0"], "--rooms", "at least 1", "got 0")
    models = a_run / run_folder.MODELS
    models.write_bytes(models.read_bytes()[:1000])
    refused(["evaluate", a_run], models, "not a whole safetensors file")
    models.unlink()
    refused(["evaluate", a_run], a_run, models.name, "found none")
    (a_run / "config.toml").write_text("x = 1")
    refused(["evaluate", a_run], a_run / "config.toml", "unknown x")
    assert not (a_run / "evaluations").exists() and not list(a_run.rglob(".*.tmp"))


def test_a_failure_is_one_line_with_code_1_and_debug_shows_where(tiny_config, tmp_path, monkeypatch, refused, said):
    def fail(*_):
        raise RuntimeError("the room is on fire\nsecond line")

    monkeypatch.setattr(main_job, "train_stage", fail)
    arguments = ["reproduce", tiny_config, "--out", tmp_path / "run"]
    refused(arguments, "RuntimeError: the room is on fire", code=1)
    code, lines = said(*arguments, "--debug")
    assert code == 1 and "Traceback" in lines[0] and any("in fail" in line for line in lines)
    assert lines[-1] == "jaxmm reproduce: RuntimeError: the room is on fire"


def test_a_full_disk_is_one_line_and_the_next_run_goes_on(a_run, tiny_config, capsys, monkeypatch, refused):
    table = a_run / "table_1.json"
    table.unlink()
    replace = os.replace

    def full(source, target):
        if str(target).endswith("table_1.json"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        refused(["evaluate", a_run], "No space left on device", table, code=1)
    assert not table.exists() and not list(a_run.rglob(".*.tmp"))
    assert cli.main(["evaluate", str(a_run)]) == 0 and table.exists()
    capsys.readouterr()


def command(*arguments, file_limit=None, **options):
    """Start a command, whose files may grow to at most so many bytes."""
    line = [sys.executable, "-m", "jaxmm", *map(str, arguments)]
    # A process in the background ignores Ctrl-C, and its children with it, unless they are told otherwise.
    first = "import os, resource, signal, sys; signal.signal(signal.SIGINT, signal.SIG_DFL)"
    if file_limit is not None:
        first += f"; resource.setrlimit(resource.RLIMIT_FSIZE, ({file_limit}, {file_limit}))"
    line = [sys.executable, "-c", f"{first}; os.execv(sys.argv[1], sys.argv[1:])", *line]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


@pytest.mark.long
@pytest.mark.parametrize("stage, limit", [("data", 20_000), ("checkpoints/nn", 3_000), ("checkpoints/nn", 9_000)])
def test_a_full_disk_is_one_line_and_leaves_nothing_half_written(a_run, tiny_config, stage, limit, tmp_path):
    """The system refuses to let files grow past a limit, which that stage is the first to need."""
    shutil.rmtree(a_run / "checkpoints")
    for name in (run_folder.MODELS, run_folder.METRICS):
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
    assert not list(a_run.rglob(".*.tmp")) and not (a_run / run_folder.MODELS).exists()


def test_threads_that_complain_after_the_line_are_not_heard(tmp_path, capsys, monkeypatch):
    """Writers of a checkpoint that failed may come back when the command has said so and is about to end."""

    class Late:
        def __del__(self):
            raise RuntimeError("Event loop is closed")

    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)  # pytest has its own; puts it back, too
    monkeypatch.setattr(sys, "argv", ["jaxmm", "evaluate", str(tmp_path / "none")])
    alarm = signal.getsignal(signal.SIGALRM)
    with warnings.catch_warnings():
        assert cli.main() == 2
        Late()
    signal.signal(signal.SIGALRM, alarm)
    assert len(capsys.readouterr().err.splitlines()) == 1
    monkeypatch.undo()
    before = sys.unraisablehook
    cli.main(["evaluate", str(tmp_path / "none")])
    assert sys.unraisablehook is before  # a process that only calls it keeps its own


def test_what_an_interrupted_command_keeps_is_told(capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    for name, words in (("detect", "nothing was written"), ("train", "the same command with --resume goes on")):
        options = argparse.Namespace(command=name, run=interrupted, debug=False)
        assert cli._run(options) == 1
        assert capsys.readouterr().err == f"jaxmm {name}: interrupted; {words}\n"


def test_the_version_is_told(capsys):
    with pytest.raises(SystemExit) as done:
        cli.main(["--version"])
    assert done.value.code == 0 and re.fullmatch(r"jaxmm \d+\.\d+\.\d+\n", capsys.readouterr().out)


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
