"""`jaxmm detect` and `jaxmm revert` on the command line: their options, and what is printed."""

import argparse
import contextlib
import re
import threading
from collections.abc import Iterator
from pathlib import Path

from jaxmm.inputs import InputError

MANY_ALIKE = 3  # notes of further scans that say the same but for the numbers, from which one line tells of them
EXAMPLE = "jaxmm detect house.ifc scan.e57 --pose 4,-3,1.5,90 --sensor oak-d-pro --out found"
PRIORS = "building model: .ifc, .ifczip, a mesh, a folder of such files that describe one building, or a point cloud"
ALSO = "another IFC or mesh file of the same building, in its own unit; may be given several times"
POSES = (
    "for every scan one, in order, or a file of them: JSON (angles, a quaternion or a 4x4 matrix) or a TUM trajectory; "
    "own (in JSON null), the default of all: what the scan file says, else it is estimated; search, also once for all "
    "scans: a scanner's that looks around, where its points, in its own frame, fit one place in the building only"
)
SENSORS = (
    "oak-d-pro, oak-d-pro-small, velodyne-16, ouster-64, tls, also with -real behind the name, or a TOML file: says "
    "what was in view without a return; default: the view that the points span"
)
FRAMES = (
    "of the scans' points: the prior's, the sensor's (x forward, y left, z up), or an optical one (x right, y down, z "
    "forward: ROS, Kinect, PCL); in the last two they are moved to --pose, or else to the pose in their file; default: "
    "the prior's, or of PCD with a VIEWPOINT the sensor's where that fits"
)
PRIOR_FRAME = (
    "of the points of a cloud as prior: the world's, the sensor's, moved by the pose in its file, or an optical one "
    "(see --frame), moved by that pose or else turned to z up about its zero; default: told by how scans fit"
)
UNIT = "of the scans, 0.001 of millimetres; default: told by how they fit"
CLASSES = (
    "that get a verdict, and no others: all, or of wall,column,door,window,slab; or any of IFC with its kinds, as "
    "IfcBeam, IfcFlowSegment or IfcElement; default: wall,column"
)
# What every detection in a building launches, in the order of first use.
KERNELS = ("triangles", "voxels", "planes", "neighbours", "sightlines", "surface")
AS_BUILT = "also write as_built.ifc: the model with displaced elements where they were measured"
DATE = (
    "when the scans were taken, as 2026-03-02 or 2026-03-02T14:30 (UTC), for jaxmm progress; default: what the scan "
    "files say (E57, LAS), or else when they were last changed"
)
BCF = "version of mismatches.bcf; 2.1 for tools that do not read 3.0, the default"
ENGINE = "of several stations: local, the cores of this machine; ray, the cluster that RAY_ADDRESS names"
WORKERS = "processes for several stations; default: one a core; how many changes nothing but the time"
KEEP_GOING = "leave out scans that cannot be used, and say so; default: the first one ends the command"
SETTINGS = (
    'any field of jaxmm/verdicts/settings.py, as TOML: classes = ["wall"], or of a table in it: objects.threshold = 0.4'
)


def add_detect(command: argparse.ArgumentParser, pose: str) -> None:
    """The options of `jaxmm detect`; `pose` says how a pose reads."""
    command.add_argument("prior", type=Path, metavar="PRIOR", help=PRIORS)
    command.add_argument("--also", type=Path, action="append", default=[], metavar="FILE", help=ALSO)
    command.add_argument(
        "scans", type=Path, nargs="+", metavar="SCAN",
        help=".ply, .pcd, .e57, .ptx, .pts, .las, .laz, .vtk, .csv, .npy, .npz, .xyz, .txt or .asc; E57, PTX and PTS "
        "may hold several; bags: .bag, .mcap, .db3 or a folder; or a folder of depth images",
    )  # fmt: skip
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="new folder of the reports")
    command.add_argument(
        "--pose",
        action="append",
        default=[],
        metavar="X,Y,Z,YAW[,PITCH[,ROLL]]|own|search|FILE",
        help=f"{pose}; {POSES}",
    )
    command.add_argument("--sensor", metavar="NAME|FILE", help=SENSORS)
    command.add_argument("--preset", choices=("default", "thesis"), help="how points become boxes")
    command.add_argument("--model", type=Path, metavar="RUN|FILE", help="default: the models that come with jaxmm")
    command.add_argument("--settings", type=Path, metavar="FILE.toml", help=SETTINGS)
    command.add_argument("--classes", action="append", default=[], metavar="CLASS,...", help=CLASSES)
    command.add_argument("--date", metavar="DATE", help=DATE)
    command.add_argument("--apply", action="store_true", help="delete removed elements in updated.ifc, not mark them")
    command.add_argument("--as-built", action="store_true", help=AS_BUILT)
    command.add_argument("--bcf", choices=("3.0", "2.1"), default="3.0", help=BCF)
    command.add_argument("--no-refine", action="store_true", help="believe poses as they are given")
    command.add_argument("--frame", choices=("world", "sensor", "optical"), help=FRAMES)
    command.add_argument("--topic", metavar="NAME", help="of the clouds in bags; default: the only one that there is")
    command.add_argument("--unit", type=float, metavar="METRES", help=UNIT)
    command.add_argument(
        "--prior-unit", type=float, metavar="METRES", help="of a mesh or cloud as prior; default: told by how it fits"
    )
    command.add_argument(
        "--up", choices=("y", "z"), help="axis of a mesh or cloud as prior; default: told by how it fits"
    )
    command.add_argument("--prior-frame", choices=("world", "sensor", "optical"), help=PRIOR_FRAME)
    command.add_argument("--open-doors", action="store_true", help="leave the prior's doors out")
    command.add_argument("--engine", choices=("local", "ray"), default="local", help=ENGINE)
    command.add_argument("--workers", type=int, metavar="N", help=WORKERS)
    command.add_argument("--keep-going", action="store_true", help=KEEP_GOING)
    command.add_argument("--clear-glass", action="store_true", help="let rays pass the glass of the prior's windows")


# The imports below wait until they are needed: --help should not load JAX.


def detect(options: argparse.Namespace) -> None:
    """Read, compare, write, and print what was found."""
    from jaxmm.files import check_empty, check_folder
    from jaxmm.formats.dates import parse_date
    from warp_scanner.buildings.ifc_files import reading_ahead

    check_folder(options.out, "--out")
    check_empty(options.out, "--out")
    if options.workers is not None and options.workers < 1:
        raise InputError(f"--workers: expected at least 1, got {options.workers}")
    if not options.prior.exists():
        raise InputError(f"{options.prior}: expected a file or a folder of models, found nothing there")
    for scan in () if options.keep_going else options.scans:
        if not scan.exists():
            raise InputError(f"{scan}: expected a scan file, or a folder of depth images, found nothing there")
    if options.date is not None:
        try:
            parse_date(options.date)
        except InputError as error:
            raise InputError(f"--date: {error}") from error
    with reading_ahead(options.prior, read_options(options, _prior_unit(options))):
        _detect(options)


def _classes(words: list[str]) -> list[str]:
    """The classes that the values of --classes name."""
    from jaxmm.verdicts.settings import DetectSettings

    names = [name.strip() for word in words for name in word.split(",")]
    try:
        DetectSettings(classes=tuple(names))
    except ValueError as error:  # its words begin with the name of the setting, which is that of the option
        raise InputError(f"--{error}") from error
    return names


def _detect(options: argparse.Namespace) -> None:
    from jaxmm.formats.poses import read_poses  # SciPy, and the sensor's Warp, load while the model is read

    poses, sensor = read_poses(options.pose) or None, _sensor(options.sensor)

    from jaxmm.commands import detect_files  # takes seconds: what is wrong with the words above is said before
    from jaxmm.reports.drawing_process import drawing_beside
    from jaxmm.reports.plain_files import doubts_in_short, sentences_of
    from jaxmm.verdicts.settings import load_settings
    from jaxmm.weights import DEFAULT

    given = {"preset": options.preset} if options.preset else {}
    if options.no_refine:
        given["refine"] = False
    if options.classes:
        given["classes"] = _classes(options.classes)
    settings, reading, work = load_settings(options.settings, **given), _reading(options, sensor), _work(options)
    with drawing_beside():
        # Not before: a process with threads is not split.
        threading.Thread(target=_load_ahead, args=(options.prior,), name="loading").start()
        detection = detect_files.detect(
            options.prior, options.scans, poses, also=options.also, reading=reading, settings=settings,
            model=options.model or DEFAULT, date=options.date, work=work,
        )  # fmt: skip
        for note in (*detection.notes, *notes_in_short([(scan.file, scan.notes) for scan in detection.scans])):
            print(note)
        said = detect_files.write_all(
            detection, options.prior, options.out, also=options.also, apply=options.apply, as_built=options.as_built,
            bcf=options.bcf,
        )  # fmt: skip
    work.clear()
    for line in (*said, *sentences_of(detection), detection.summary()):
        print(line)
    if doubt := doubts_in_short(detection.doubts):  # told above, perhaps many lines ago
        print(f"in doubt: {doubt}")
    print(f"reports: {options.out}")


def _load_ahead(prior: Path) -> None:
    """What is needed later, in a thread of its own: compilers, and rays that are cast, leave the interpreter to it."""
    from warp_scanner.buildings.ifc_model import import_ifcopenshell
    from warp_scanner.launches import load_all

    with contextlib.suppress(Exception):  # whoever needs it tells
        load_all(KERNELS)
        if prior.suffix.lower() == ".ifc":
            import_ifcopenshell()
        import openpyxl  # noqa: F401


def _work(options: argparse.Namespace):
    """How to go about several stations: what is done of them stays beside --out until that is written."""
    from jaxmm.stations.work_folder import Work

    out = options.out.resolve()
    folder = out.with_name(f".{out.name}.stations")
    return Work(options.engine, options.workers, folder, options.keep_going, leaves=True)


def _sensor(asked: str | None):
    if asked is None:
        return None
    from warp_scanner.sensors.sensors import sensor_named

    try:
        return sensor_named(asked)
    except ValueError as error:
        raise InputError(f"--sensor: {error}") from error


def _reading(options: argparse.Namespace, sensor):
    from jaxmm.commands.detect_files import Reading

    _check_kind(options)
    prior = read_options(options, _prior_unit(options), options.prior_frame)
    return Reading(prior, options.unit, options.frame, sensor, options.topic)


def notes_in_short(told: list[tuple[str, tuple[str, ...]]]) -> Iterator[str]:
    """Lines of the notes of scans, by the names of their files; of many that differ in numbers only, the first.

    A robot's drive is a scan for each message. The report holds all of them.
    """
    alike: dict[str, list[str]] = {}
    for file, notes in told:
        for note in notes:
            alike.setdefault(re.sub(r"\d+(?:\.\d+)?", "0", note), []).append(f"{file}: {note}")
    for first, *others in alike.values():
        if len(others) < MANY_ALIKE:
            yield from (first, *others)
        else:
            yield f"{first} (and {len(others)} scans more, but for the numbers; report.md has all)"


def _prior_unit(options: argparse.Namespace) -> float:
    return 1.0 if options.prior_unit is None else options.prior_unit


def read_options(options: argparse.Namespace, unit: float, frame: str | None = None):
    """How a command line has a model read; `unit` [m] is that of a mesh or cloud, `frame` that of a cloud.

    Raises:
        InputError: no such unit.
    """
    from warp_scanner.scenes.building import ReadOptions

    try:
        return ReadOptions(
            glass="transparent" if options.clear_glass else "solid",
            doors="open" if options.open_doors else "closed",
            y_up=None if options.up is None else options.up == "y",
            unit=unit,
            frame=frame,
        )
    except ValueError as error:
        raise InputError(str(error)) from error


def _check_kind(options: argparse.Namespace) -> None:
    """Refuse options that say nothing about a prior of this kind."""
    from jaxmm.commands.detect_files import prior_files
    from jaxmm.verdicts.priors import kind_of

    model = prior_files(options.prior, options.also)
    kind = "ifc" if model.has_ifc else kind_of(model.files[0].path)
    if options.prior_frame is not None and kind != "cloud":
        raise InputError(f"--prior-frame: only for a point cloud; {options.prior} is a {kind}")
    if options.prior_frame == "optical" and options.up is not None:
        raise InputError("--up: not with --prior-frame optical, which says what is up")
    if kind == "ifc":
        if options.prior_unit is not None or options.up is not None:
            raise InputError(f"--prior-unit, --up: not for IFC; {options.prior} says its unit and axes itself")
        return
    if options.apply:
        raise InputError(f"--apply: only for IFC, whose elements it deletes; {options.prior} is a {kind}")
    if options.as_built:
        raise InputError(f"--as-built: only for IFC, whose elements it moves; {options.prior} is a {kind}")
    if kind == "cloud" and (options.open_doors or options.clear_glass):
        raise InputError(f"--open-doors, --clear-glass: not for a point cloud, as {options.prior} is")


def revert(options: argparse.Namespace) -> None:
    """Undo an update."""
    from jaxmm.files import check_writable
    from jaxmm.ifc import undo

    check_writable(options.out, "--out")
    undo.revert(options.updated, options.out)
    print(f"model: {options.out}")
