"""The command line: parses, calls, prints. Errors are one line; 2 says the input is wrong, 1 that the work failed."""

import argparse
import sys
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from jaxmm.config import CONDITIONS, SCENARIOS
from jaxmm.inputs import InputError

ENGINES = ("local", "ray")
THESIS_METHODS = ("released", "nn-raw", "nn", "xyz_nn")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    options = _parser().parse_args(arguments)
    hook = sys.unraisablehook
    if not options.debug:
        # Threads that write checkpoints go on to complain for themselves about an error that is told below, some of
        # them as the process ends; and a compilation cache that cannot be used costs time only.
        sys.unraisablehook = lambda _: None
        warnings.filterwarnings("ignore", "coroutine .* was never awaited", RuntimeWarning)
        warnings.filterwarnings("ignore", "Error .* persistent compilation cache", UserWarning)
    try:
        return _run(options)
    finally:
        sys.unraisablehook = hook


def _run(options: argparse.Namespace) -> int:
    try:
        options.run(options)
    except KeyboardInterrupt:
        again = "the same command with --resume" if options.command == "train" else "the same command again"
        return _failed(options, f"interrupted; {again} goes on", 1)
    except InputError as error:
        return _failed(options, str(error), 2)
    except Exception as error:
        lines = str(error).strip().splitlines() or [""]
        return _failed(options, f"{type(error).__name__}: {lines[0]}", 1)
    return 0


def _failed(options: argparse.Namespace, message: str, code: int) -> int:
    if options.debug:
        traceback.print_exc()
    print(f"jaxmm {options.command}: {message}", file=sys.stderr)
    return code


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, without the usage before it."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="jaxmm", description="What was added, removed or hidden, from one scan.")
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
    command.add_argument("--model", type=Path, metavar="RUN|FILE", help="our models, for nn and xyz_nn")
    command.add_argument("--out", type=Path, required=True, metavar="FILE.json")
    return parser


ABOUT = {
    "generate": "write shards of labelled clouds with their truth, resumable, on all cores or on a Ray cluster",
    "reproduce": "generate rooms, train the four models, evaluate them, write tables and figures (the main job)",
    "train": "generate the training rooms and train the four models",
    "evaluate": "score held-out rooms with the models of a run",
    "thesis": "score the test pairs of the thesis's public repository",
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
    from jaxmm import pipeline, reproduce

    reproduce.reproduce(pipeline.load_config(options.config), _run_folder(options))


def _generate(options: argparse.Namespace) -> None:
    from jaxmm import generate, pipeline

    asked = (getattr(options, name) for name in generate.Request._fields)
    manifest = generate.generate(pipeline.load_config(options.config), options.out, generate.Request(*asked))
    points = sum(entry.points for entry in manifest.shards.values())
    print(f"shards: {options.out} ({manifest.count} pairs, {points} points in {len(manifest.shards)} files)")


def _train(options: argparse.Namespace) -> None:
    from jaxmm import pipeline, reproduce, runs

    settings, folder = pipeline.load_config(options.config), _run_folder(options)
    if (folder / runs.CONFIG).exists() and not options.resume:
        raise InputError(f"{folder}: already holds a run; --resume goes on with it, --out chooses another folder")
    with runs.open_run(folder, settings):
        reproduce.train_stage(settings, folder)
    print(f"models: {folder / runs.MODELS}")


def _evaluate(options: argparse.Namespace) -> None:
    from jaxmm import reproduce, runs, tables

    settings = runs.read_config(options.run_folder)
    if not (options.run_folder / runs.MODELS).exists():
        raise InputError(f"{options.run_folder}: expected trained models in {runs.MODELS}, found none")
    rows = [_row_name(name) for name in options.rows] or reproduce.EVERY_ROW
    rooms = settings.data.test_rooms if options.rooms is None else options.rooms
    if rooms < 1:
        raise InputError(f"--rooms: expected at least 1, got {rooms}")
    own = rooms == settings.data.test_rooms
    with runs.open_run(options.run_folder, settings):
        models = reproduce.train_stage(settings, options.run_folder)
        folder = options.run_folder if own else options.run_folder / "evaluations" / f"{rooms}_rooms"
        scored = reproduce.evaluate_stage(settings, folder, models, rooms, rows)
        reproduce.write_results(settings, options.run_folder, folder, scored)
    print(tables.as_terminal(tables.read_rows(folder)))
    print(f"table: {folder / 'table_1.json'}")


def _row_name(text: str) -> tuple[str, str]:
    scenario, _, condition = text.partition(":")
    if scenario not in SCENARIOS or condition not in CONDITIONS:
        names = f"{', '.join(SCENARIOS)} with :{' or :'.join(CONDITIONS)}"
        raise InputError(f"--rows: expected {names}, got {text!r}")
    return scenario, condition


def _thesis(options: argparse.Namespace) -> None:
    from jaxmm import thesis_rows

    thesis_rows.score_repository(options.root, options.method, options.weights, options.model, options.out)


def _run_folder(options: argparse.Namespace) -> Path:
    return options.out or Path("runs") / options.config.stem


if __name__ == "__main__":
    sys.exit(main())
