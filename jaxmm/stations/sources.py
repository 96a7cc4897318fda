"""Where the scans of a detection come from: which file, which of its scans, and what it is called.

Most formats hold one scan a file, and E57 says in its header how many: of those nothing is read before a station's
turn. Of the others the scans are read to count them.
"""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.formats.bags import is_bag
from jaxmm.formats.e57 import scans_with_points
from jaxmm.formats.poses import AskedPose
from jaxmm.formats.readers import PointScan, read_scans
from jaxmm.inputs import InputError

SEVERAL = (".ptx", ".pts")  # that may hold several scans, which only reading tells; and bags, and folders
BLOCK = 2**22  # bytes


class ScanSource(NamedTuple):
    """One scan of a file."""

    file: str
    number: int  # of the scans with points in its file
    name: str = ""  # what it is called in reports
    pose: AskedPose = None
    topic: str | None = None  # of a bag
    at: int | None = None  # of all scans in an E57 file; None: of the scans that are read
    remark: str = ""  # on the file, told with its first scan
    error: str = ""  # why its file cannot be read


Found = tuple[ScanSource, PointScan | None]  # with the scan, where it is read already


def sources_of(files: list[Path], topic: str | None) -> Iterator[Found]:
    """The scans of some files, with those that had to be read to count them.

    A file that cannot be read counts as one source, with the error.
    """
    for file in files:
        try:
            yield from _scans_of(file, topic if is_bag(file) else None)
        except InputError as error:
            yield ScanSource(str(file), 0, error=str(error)), None


def _scans_of(file: Path, topic: str | None) -> Iterator[Found]:
    kind = file.suffix.lower()
    if kind == ".e57":
        chosen, count = scans_with_points(file)
        if len(chosen) > 1:
            left = f"{count - len(chosen)} of {count} scans hold no points and are left out"
            for number, at in enumerate(chosen):
                yield (
                    ScanSource(str(file), number, at=at, remark=left if len(chosen) < count and not number else ""),
                    None,
                )
            return
    elif not file.is_dir() and not is_bag(file) and kind not in SEVERAL:
        yield ScanSource(str(file), 0, topic=topic), None
        return
    for number, scan in enumerate(read_scans(file, topic)):
        yield ScanSource(str(file), number, topic=topic), scan


def scan_of(source: ScanSource) -> PointScan:
    """The points of one scan.

    Raises:
        InputError: its file cannot be read.
    """
    if source.error:
        raise InputError(source.error)
    scans = read_scans(source.file, source.topic, only=source.at)
    scan = scans[0 if source.at is not None else source.number]
    return scan._replace(remarks=(source.remark, *scan.remarks)) if source.remark else scan


def content_of(file: Path) -> str:
    """sha256 of a file, or of all that is in a folder; empty where nothing can be read."""
    digest = hashlib.sha256()
    try:
        for one in sorted(file.rglob("*")) if file.is_dir() else [file]:
            if one.is_file():
                with open(one, "rb") as opened:
                    while block := opened.read(BLOCK):
                        digest.update(block)
    except OSError:
        return ""
    return digest.hexdigest()


def check_different(sources: list[ScanSource], contents: dict[str, str]) -> None:
    """Refuse two equal stations: what one of them says would count twice.

    Raises:
        InputError: the same scan from the same pose, twice.
    """
    seen: dict[tuple, ScanSource] = {}
    for one in sources:
        pose = one.pose if one.pose is None or isinstance(one.pose, str) else (
            *np.asarray(one.pose.position, float).tolist(), *(float(value) for value in one.pose[1:4]), one.pose[4],
        )  # fmt: skip
        key = contents[one.file] or one.file, one.number, one.at, pose
        if not one.error and key in seen:
            other = seen[key]
            which = one.name if one.name == other.name else f"{other.name} and {one.name}"
            raise InputError(f"{one.file}: expected each scan once, got two equal ones from one pose: {which}")
        seen[key] = one


def names_of(files: list[Path]) -> list[str]:
    """What to call the scans of these files, one of each: by name, with as many folders as tell them apart.

    Several of one file are numbered as they stand there.
    """
    parts = {file: file.absolute().parts for file in files}

    def name(file: Path) -> str:
        depth = next(
            depth
            for depth in range(1, len(parts[file]) + 1)
            if sum(other[-depth:] == parts[file][-depth:] for other in set(parts.values())) == 1
        )
        return Path(*parts[file][-depth:]).as_posix()

    return [
        name(file) if files.count(file) == 1 else f"{name(file)}#{files[:number].count(file)}"
        for number, file in enumerate(files)
    ]
