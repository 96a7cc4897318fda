"""What several test files share: the folder of real data, and one whole run of the main job at its smallest,
and detections that say what is true.

And how files are shared out to two processes, so that both are done at about the same time.
"""

import functools
import gc
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import jaxmm  # noqa: F401 - says where kernels and programs are kept, which stay there below

# Before JAX is imported, here and in every process that tests start: compiling takes longer than what is compiled.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
if "PYTEST_XDIST_WORKER" in os.environ:  # two processes on two cores: threads of one would wait for those of the other
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
else:
    # Tests start hundreds of programs: where Python was told to keep no bytecode, each would compile this package anew.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    # Models are kept for these tests alone: what the reader makes of a file is tested, not what it once made. Most are
    # rooms of the same bytes, and a process that reads one takes a second.
    kept = tempfile.TemporaryDirectory(prefix="jaxmm-models-")
    os.environ["JAXMM_CACHE"] = kept.name

gc.set_threshold(100_000, 50, 50)  # walking through the many objects of loaded libraries took a sixteenth of the time

TINY_RUN = """
[data]
train_rooms = 1
validation_rooms = 1
test_rooms = 2
unchanged_rooms = 1

[scan]
width = 96
height = 60

[network]
encoder = [4, 8]
head = [4]

[train]
step_count = 6
batch_size = 2
points_per_cloud = 64
learning_rate = 3e-3
validate_every = 2
patience = 0

[evaluate]
resamples = 100
"""


# These take one whole run of the main job, which is then made once: they go to one process.
ONE_RUN = ("runs/test_reproduce.py", "commands/test_cli.py", "commands/test_cli_thesis.py", "thesis/test_rows.py")
# These take longest, and come first: whoever is done early takes the short ones. Beside the one run begin those that
# need no Warp, so that its kernels are compiled by one process, and once.
FIRST = (
    *ONE_RUN, "learning/test_train_step.py", "learning/test_joint_training.py", "learning/test_fused_layers.py",
    "learning/test_fit.py", "paper/test_notebooks.py", "data/test_engines.py", "data/test_generation.py",
    "benchmarks/test_smoke.py", "commands/test_cli_detect.py", "commands/test_detect_files.py",
    "rays/test_viewpoint.py", "paper/test_data_figures.py", "test_docs.py", "data/test_labelled_buildings.py",
    "test_fuzz.py", "reports/test_page_browser.py", "warp_scanner/test_buildings.py", "runs/test_run_folder.py",
    "learning/test_device_mesh.py", "verdicts/test_detection.py", "reports/test_figures.py",
    "warp_scanner/test_changes.py", "commands/test_project.py", "verdicts/test_changed_house.py",
    "commands/test_scan_frames.py", "verdicts/test_behind_removed.py", "verdicts/test_pose_search.py",
    "warp_scanner/test_room_ifc.py", "warp_scanner/test_room_presets.py", "warp_scanner/test_guarded.py",
    "warp_scanner/test_scenarios.py",
)  # fmt: skip
TESTS = Path(__file__).resolve().parent


def pytest_collection_modifyitems(items):
    """The tests of files in FIRST before all others; within a file they keep their order."""
    names = {item: item.path.relative_to(TESTS).as_posix() for item in items}
    items.sort(key=lambda item: FIRST.index(names[item]) if names[item] in FIRST else len(FIRST))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """What `--dist loadfile` does, but files in ONE_RUN count as one, and the order is that of FIRST."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class ByFile(LoadFileScheduling):
        def _split_scope(self, nodeid):
            path = super()._split_scope(nodeid)
            return "one run" if path.removeprefix("tests/") in ONE_RUN else path

    config.option.loadscopereorder = False  # by the number of tests, which says little of how long they take
    return ByFile(config, log)


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Folder of real scans and weights (JAXMM_DATA, default ../shared/data); skips where there is none."""
    root = Path(os.environ.get("JAXMM_DATA") or Path(__file__).resolve().parents[1] / "../shared/data").resolve()
    if not root.is_dir():
        pytest.skip(f"needs real data: JAXMM_DATA names no folder ({root})")
    return root


@pytest.fixture(scope="session")
def judges():
    """The models that are shipped."""
    from jaxmm.learning.prediction import read_judges
    from jaxmm.weights import DEFAULT

    return read_judges(DEFAULT)


@pytest.fixture(scope="session")
def real_building(data_root):
    """real_building(name) -> the building in that file of ifc/, read once for all tests; skips without ifcopenshell."""
    pytest.importorskip("ifcopenshell")
    from warp_scanner.buildings.files import read_building

    return functools.cache(lambda name: read_building(data_root / "ifc" / f"{name}.ifc"))


@pytest.fixture(scope="session")
def tiny_config(tmp_path_factory) -> Path:
    """Settings of the main job at its smallest; its scores mean nothing."""
    path = tmp_path_factory.mktemp("config") / "tiny.toml"
    path.write_text(TINY_RUN)
    return path


@pytest.fixture(scope="session")
def finished_run(tiny_config, tmp_path_factory) -> Path:
    """Run folder that an undisturbed `jaxmm reproduce` of the tiny settings wrote; read it, do not write to it."""
    folder = tmp_path_factory.mktemp("runs") / "tiny"
    command = [sys.executable, "-m", "jaxmm", "reproduce", tiny_config, "--out", folder]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (folder.parent / "stdout").write_text(done.stdout)
    (folder.parent / "stderr").write_text(done.stderr)
    return folder


@pytest.fixture
def said(capsys):
    """said(*arguments) -> exit code and the lines on standard error of one command, run in this process."""
    from jaxmm.commands import cli

    def run(*arguments):
        try:
            code = cli.main([str(argument) for argument in arguments])
        except SystemExit as end:
            code = end.code
        return code, capsys.readouterr().err.splitlines()

    return run


@pytest.fixture
def refused(said):
    """refused(arguments, *words): the command ends with one line of error that holds all the words."""

    def check(arguments, *words, code=2):
        found, lines = said(*arguments)
        assert found == code and len(lines) == 1, lines
        assert lines[0].startswith(f"jaxmm {arguments[0]}: ")
        for word in words:
            assert str(word) in lines[0], lines[0]

    return check


@pytest.fixture(scope="session")
def removed(tmp_path_factory):
    """A pillar and a wall are gone: what is true of a room, as a detection."""
    from tests.cases.detections import true_case

    return true_case(tmp_path_factory.mktemp("removed")).detection


@pytest.fixture(scope="session")
def added(tmp_path_factory):
    """A pillar is new."""
    from tests.cases.detections import true_case

    return true_case(tmp_path_factory.mktemp("added"), "pillar_added").detection
