"""`jaxmm benchmark` on the command line: scenes for others to run on, and scores of what they say."""

import argparse
from pathlib import Path

EXAMPLE = "jaxmm benchmark export scenes --count 100"
SPLITS = ("train", "validation", "test")
TRUTH = "with the truth of the test split; default: DIR-test-truth.npz, beside DIR"


def add_benchmark(command: argparse.ArgumentParser) -> None:
    """The two commands of `jaxmm benchmark`."""
    steps = command.add_subparsers(dest="step", required=True, metavar="export|score")
    about = "write scenes: model, scans, poses, sensors and truth as plain files with a data sheet; resumable"
    step = steps.add_parser("export", help=about, description=about, epilog=f"example: {EXAMPLE}")
    step.add_argument(
        "folder", type=Path, metavar="DIR", help="folder of the scenes, with a README.md that explains it"
    )
    step.add_argument("--count", type=int, default=1000, metavar="N", help="scenes, default 1000")
    step.add_argument("--ifc", type=Path, metavar="FOLDER", help="every second scene is in one of these IFC files")
    step.add_argument("--settings", type=Path, metavar="FILE.toml", help="fields of ExportSettings, jaxmm/exchange")
    step.add_argument("--truth", type=Path, metavar="FILE.npz", help=f"file to write, {TRUTH}")
    step.add_argument("--workers", type=int, metavar="N", help="processes, default one a core")
    about = "score a method's predictions: points, elements and objects, by difficulty, with intervals"
    example = "jaxmm benchmark score scenes predictions --split validation"
    step = steps.add_parser("score", help=about, description=about, epilog=f"example: {example}")
    step.add_argument("folder", type=Path, metavar="DIR", help="of jaxmm benchmark export")
    step.add_argument("predictions", type=Path, metavar="PREDICTIONS", help="folder of one .npz or .csv a scene")
    step.add_argument("--split", choices=SPLITS, default="test", help="default test")
    step.add_argument("--truth", type=Path, metavar="FILE.npz", help=f"file {TRUTH}")
    step.add_argument("--out", type=Path, metavar="FILE.json", help="also write all scores to this file")


# The imports below wait until they are needed: --help should not load JAX.


def benchmark(options: argparse.Namespace) -> None:
    """Export or score, and print what there is then."""
    {"export": _export, "score": _score}[options.step](options)


def _export(options: argparse.Namespace) -> None:
    from jaxmm.exchange.export import Request, export, truth_path
    from jaxmm.exchange.tasks import load_export_settings

    settings = load_export_settings(options.settings)
    truth = options.truth or truth_path(options.folder)
    counts = export(settings, options.folder, Request(options.count, options.ifc, truth, options.workers))
    print(f"scenes: {options.folder} ({', '.join(f'{count} {split}' for split, count in counts.items())})")
    if counts["test"]:
        print(f"truth of the test split: {truth}")


def _score(options: argparse.Namespace) -> None:
    from jaxmm.exchange.export import truth_path
    from jaxmm.exchange.score_table import markdown
    from jaxmm.exchange.scores import score
    from jaxmm.files import check_writable, write_json

    if options.out is not None:
        check_writable(options.out, "--out")
    truth = options.truth or truth_path(options.folder)
    told = score(options.folder, options.predictions, options.split, truth)
    if options.out is not None:
        write_json(options.out, told)
    print(markdown(told))
