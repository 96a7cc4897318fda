"""The command line: parses, calls, prints. Errors are one line.

2 says that the input is wrong, or that a command of WRITERS has nowhere to write; 1 that the work failed.
"""

import argparse
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NoReturn

from jaxmm.commands import benchmark_options, detect_options, progress_options
from jaxmm.commands.interruptions import heed, interruption
from jaxmm.config import CONDITIONS, SCENARIOS
from jaxmm.devices import check_devices
from jaxmm.inputs import InputError

ENGINES = ("local", "ray")
THESIS_METHODS = ("released", "nn-raw", "rule", "nn", "xyz_nn", "evidence")
WRITERS = (
    "scan",
    "generate",
    "detect",
    "progress",
    "benchmark",
    "revert",
)  # commands for which a file that cannot be written is the user's to put right
WITHOUT_JAX = ("scan", "revert")
_AGAIN = "the same command again goes on"
GOES_ON = {  # what to say of an interrupted command that keeps what it has done; others write all at their end
    "reproduce": _AGAIN, "generate": _AGAIN, "evaluate": _AGAIN, "benchmark": _AGAIN,
    "train": "the same command with --resume goes on",
}  # fmt: skip
FEW_RETURNS = 0.05  # share of rays below which a scan is hardly one
SCAN_SENSORS = (
    "oak-d-pro (default), oak-d-pro-small, velodyne-16, ouster-64 or tls, ideal within its range; with -real behind "
    "the name it errs as such devices do; or a TOML file"
)
POSE = (
    "metres in the frame of the building, z absolute; degrees, YAW counter-clockwise from +x, PITCH upwards, ROLL with "
    "the right side down"
)
SCENES = "building: .ifc, .ifczip, .obj, .ply, .glb, .gltf or .stl, or a folder of such files that describe one"
SCAN_FILES = (
    ".ply, .pcd, .e57 (fields jaxmm:element, jaxmm:semantic), .las, .laz or .csv: the returns with the element of "
    "each; .npz: every ray, returned or not, and a table of the elements"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Without arguments it is the command of this process, which is taken to end with it: what threads complain about
    later stays unheard.
    """
    options = _parser().parse_args(_glued(sys.argv[1:] if arguments is None else arguments))
    if arguments is None:
        os.environ["JAX_ENABLE_X64"] = "0"  # our models are of single precision, and JAX is not yet there
        heed(shown=options.debug)
    if arguments is None and not options.debug:
        # A compilation cache that cannot be used costs time only.
        warnings.filterwarnings("ignore", "coroutine .* was never awaited", RuntimeWarning)
        warnings.filterwarnings("ignore", "Error .* persistent compilation cache", UserWarning)
    return _run(options)


def _glued(arguments: Sequence[str]) -> list[str]:
    """A pose may begin with a minus, which argparse would take for an option."""
    glued: list[str] = []
    for argument in arguments:
        if glued and glued[-1] == "--pose" and argument[:2].strip("-.0123456789") == "":
            glued[-1] = f"--pose={argument}"
        else:
            glued.append(argument)
    return glued


def _run(options: argparse.Namespace) -> int:
    try:
        if options.command not in WITHOUT_JAX:
            check_devices()
        options.run(options)
    except (KeyboardInterrupt, Exception) as error:
        return _told(options, error)
    return 0


def _told(options: argparse.Namespace, error: BaseException) -> int:
    stop = interruption(error)
    if stop is not None:
        told = str(stop) or GOES_ON.get(options.command, "nothing was written")
        return _failed(options, f"interrupted; {told}", 1)
    if isinstance(error, InputError):
        return _failed(options, str(error), 2)
    if isinstance(error, OSError) and options.command in WRITERS and error.filename is not None:
        return _failed(options, f"{error.filename}: {error.strerror}", 2)  # others are not about a file
    return _failed(options, _described(error), 1)


def _described(error: BaseException) -> str:
    lines = str(error).strip().splitlines() or [""]
    return f"{type(error).__name__}: {lines[0]}"


def _failed(options: argparse.Namespace, message: str, code: int) -> int:
    if options.debug:
        traceback.print_exc()
    print(f"jaxmm {options.command}: {message}", file=sys.stderr)
    return code


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, without the usage before it."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


class _Version(argparse.Action):
    """Looks the version up when it is asked for: a folder on the path has none."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(f"jaxmm {version('jaxmm')}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="jaxmm", description="What was added, removed or hidden, from one scan.")
    parser.add_argument("--version", action=_Version, nargs=0, help="print it")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    command = _command(commands, "reproduce", _reproduce, "jaxmm reproduce configs/demo.toml")
    command.add_argument("config", type=Path, metavar="CONFIG", help="settings, a TOML file")
    _add_out(command)

    command = _command(commands, "generate", _generate, "jaxmm generate configs/generate.toml --out shards --count 100")
    command.add_argument("config", type=Path, metavar="CONFIG", help="settings, a TOML file")
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the shards")
    command.add_argument("--count", type=int, required=True, metavar="N", help="pairs to make")
    command.add_argument("--engine", choices=ENGINES, default="local", help="this machine's cores, or a Ray cluster")
    command.add_argument("--workers", type=int, metavar="N", help="processes, default one a core")
    command.add_argument("--raw", action="store_true", help="also store both raw scans of every pair")
    command.add_argument("--verify", action="store_true", help="check the sha256 of every shard that is there")
    command.add_argument("--repair", action="store_true", help="check them likewise, and make damaged shards again")

    command = _command(commands, "train", _train, "jaxmm train configs/demo.toml --out runs/mine")
    command.add_argument("config", type=Path, metavar="CONFIG", help="settings, a TOML file")
    command.add_argument("--resume", action="store_true", help="go on with the training that the run folder holds")
    _add_out(command)

    command = _command(commands, "evaluate", _evaluate, "jaxmm evaluate runs/demo --rows pillar_removed:occluded")
    command.add_argument("run_folder", type=Path, metavar="RUN", help="run folder with trained models")
    command.add_argument("--rows", nargs="+", metavar="SCENARIO:CONDITION", default=[], help="default: all eight")
    command.add_argument("--rooms", type=int, metavar="N", help="test rooms per row, default as configured")

    command = _command(commands, "thesis", _thesis, "jaxmm thesis path/to/thesis --method released --out released.json")
    command.add_argument("root", type=Path, metavar="ROOT", help="the thesis's public repository")
    command.add_argument("--method", required=True, choices=THESIS_METHODS)
    command.add_argument("--weights", type=Path, metavar="DIR", help="released .pth files, default below ROOT")
    command.add_argument(
        "--model",
        type=Path,
        metavar="RUN|FILE",
        help="our models, for nn, xyz_nn and evidence (default there: those that come with jaxmm)",
    )
    command.add_argument("--out", type=Path, required=True, metavar="FILE.json")

    command = _command(commands, "scan", _scan, "jaxmm scan house.ifc --pose 4,-3,1.5,90 --out scan.ply")
    command.add_argument("scene", type=Path, metavar="SCENE", help=SCENES)
    command.add_argument("--also", type=Path, action="append", default=[], metavar="FILE", help=detect_options.ALSO)
    command.add_argument("--pose", required=True, metavar="X,Y,Z,YAW[,PITCH[,ROLL]]", help=POSE)
    command.add_argument("--sensor", default="oak-d-pro", metavar="NAME|FILE", help=SCAN_SENSORS)
    command.add_argument("--seed", type=int, default=0, metavar="N", help="of the errors of a sensor that errs")
    command.add_argument("--out", type=Path, required=True, metavar="FILE", help=f"{SCAN_FILES}; replaces a file")
    command.add_argument("--open-doors", action="store_true", help="leave doors out")
    command.add_argument("--clear-glass", action="store_true", help="let rays pass through the glass of windows")
    command.add_argument("--up", choices=("y", "z"), help="axis of the mesh file; default: y in glTF, z in all others")
    command.add_argument("--unit", type=float, default=1.0, metavar="METRES", help="length of the mesh file's unit")

    detect_options.add_detect(_command(commands, "detect", detect_options.detect, detect_options.EXAMPLE), POSE)
    progress_options.add_progress(_command(commands, "progress", progress_options.progress, progress_options.EXAMPLE))
    benchmark = _command(commands, "benchmark", benchmark_options.benchmark, benchmark_options.EXAMPLE)
    benchmark_options.add_benchmark(benchmark)
    command = _command(commands, "revert", detect_options.revert, "jaxmm revert found/updated.ifc --out before.ifc")
    command.add_argument("updated", type=Path, metavar="UPDATED.ifc", help="of detect; its undo.json lies beside it")
    command.add_argument("--out", type=Path, required=True, metavar="FILE.ifc", help="the model as it was before")
    return parser


ABOUT = {
    "generate": "write shards of labelled clouds with their truth, resumable, on all cores or on a Ray cluster",
    "reproduce": "generate rooms, train the four models, evaluate them, write tables and figures (the main job)",
    "train": "generate the training rooms and train the four models",
    "evaluate": "score held-out rooms with the models of a run",
    "thesis": "score the test pairs of the thesis's public repository",
    "scan": "scan a building from one place and write the scan",
    "detect": "compare robot scans with a building model: what was added, what removed, what could not be seen",
    "progress": "follow every element over the reports of several weeks: when it was built, displaced or removed",
    "benchmark": "write scenes that any method can be run on, and score what it says",
    "revert": "undo what detect changed in an IFC file",
}


def _command(commands, name: str, run, example: str) -> argparse.ArgumentParser:
    command = commands.add_parser(name, help=ABOUT[name], description=ABOUT[name], epilog=f"example: {example}")
    command.add_argument("--debug", action="store_true", help="print the traceback of an error")
    command.set_defaults(run=run)
    return command


def _add_out(command: argparse.ArgumentParser) -> None:
    command.add_argument("--out", type=Path, metavar="RUN", help="run folder, default runs/<name of the config>")


# The imports below wait until a command needs them: --help should not load JAX.


def _reproduce(options: argparse.Namespace) -> None:
    from jaxmm.data import simulator_settings
    from jaxmm.runs import main_job

    main_job.reproduce(simulator_settings.load_config(options.config), _run_folder(options))


def _generate(options: argparse.Namespace) -> None:
    from jaxmm.data import generation, simulator_settings

    asked = (getattr(options, name) for name in generation.Request._fields)
    manifest = generation.generate(
        simulator_settings.load_config(options.config), options.out, generation.Request(*asked)
    )
    points = sum(entry.points for entry in manifest.shards.values())
    print(f"shards: {options.out} ({manifest.count} pairs, {points} points in {len(manifest.shards)} files)")


def _train(options: argparse.Namespace) -> None:
    from jaxmm.data import simulator_settings
    from jaxmm.runs.training_stage import train

    print(f"models: {train(simulator_settings.load_config(options.config), _run_folder(options), options.resume)}")


def _evaluate(options: argparse.Namespace) -> None:
    from jaxmm import run_folder
    from jaxmm.learning import result_tables
    from jaxmm.runs import main_job

    run_folder.read_config(options.run_folder)  # what is wrong with it is said before what is wrong with the rows
    rows = [_row_name(name) for name in options.rows] or main_job.EVERY_ROW
    shown, table = main_job.evaluate(options.run_folder, rows, options.rooms)
    print(result_tables.as_terminal(shown))
    print(f"table of all rows scored so far: {table}")


def _row_name(text: str) -> tuple[str, str]:
    scenario, _, condition = text.partition(":")
    if scenario not in SCENARIOS or condition not in CONDITIONS:
        names = f"{', '.join(SCENARIOS)} with :{' or :'.join(CONDITIONS)}"
        raise InputError(f"--rows: expected {names}, got {text!r}")
    return scenario, condition


def _thesis(options: argparse.Namespace) -> None:
    from jaxmm.thesis import rows as thesis_rows

    thesis_rows.score_repository(options.root, options.method, options.weights, options.model, options.out)


def _scan(options: argparse.Namespace) -> None:
    import numpy as np

    from jaxmm.commands.detect_options import read_options
    from jaxmm.commands.scanning import check_returns, opened, scan_of
    from jaxmm.files import check_writable
    from jaxmm.formats import writers
    from jaxmm.formats.poses import parse_pose
    from warp_scanner.scenes.remarks import remarks
    from warp_scanner.sensors.sensors import sensor_named

    writers.check_format(options.out)
    check_writable(options.out, "--out")
    pose = parse_pose(options.pose)
    try:
        sensor = sensor_named(options.sensor)
    except ValueError as error:
        raise InputError(str(error)) from error
    building = opened(options.scene, read_options(options, options.unit), options.also)
    scan = scan_of(building, pose, sensor, options.seed)
    check_returns(scan, options.pose, options.scene)
    _, *moved = writers.write_scan(options.out, scan)
    hits, rays = int(np.isfinite(scan.distance).sum()), len(scan.distance)
    for remark in remarks(building):
        print(remark)
    if hits < FEW_RETURNS * rays:
        print(f"note: only {hits / rays:.1%} of the rays return; is the sensor inside of something, or far away?")
    for beside in moved:
        print(f"in single precision, moved by the kilometres in its name: {beside}")
    print(f"{hits} returns of {rays} rays, {len(set(scan.element[scan.element >= 0]))} elements: {options.out}")


def _run_folder(options: argparse.Namespace) -> Path:
    return options.out or Path("runs") / options.config.stem
