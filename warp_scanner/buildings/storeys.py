"""Storeys of several files brought together: which rows of their tables are one level of the building.

Elevations and heights in metres above one zero.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from warp_scanner.scenes.building import Storeys

LEVEL = 0.5  # [m] between elevations that are one level: finished floor, raw slab, top of the slab below
NAMED = 1.5  # [m] between elevations of one name, up to which they are one level
STANDS = 1.0  # [m] from a storey's elevation to the feet of the lowest of its elements, if it says where it is
SPREAD = 4.5  # [m] between the feet of its elements, beyond which a storey is no level: a name for none
MOST = 0.7  # share of a storey's elements whose feet must be on one level for all to be on it


class FileStoreys(NamedTuple):
    """The storeys of one file, and what is on them."""

    file: str
    storeys: Storeys  # elevations above the common zero
    row: np.ndarray  # (E,) of each element; -1
    foot: np.ndarray  # (E,) [m] its lowest point
    middle: np.ndarray  # (E,) [m] halfway up


class _Level(NamedTuple):
    file: int
    row: int
    name: str
    elevation: float


def merged_storeys(files: list[FileStoreys]) -> tuple[Storeys, list[np.ndarray], tuple[str, ...]]:
    """One table for all files, the row in it of every element of each, and what was told, a sentence each.

    A row that says where it is, by the feet of its elements, is one level with those of other files at its height, or
    of its name near it; it takes the name of the file that has the most storeys. One that does not, as of a file that
    puts all at zero, is the level that most of its elements stand on; one whose elements stand on several is none, and
    each has the level at its feet.
    """
    sound = [[_says_where(one, row) for row in range(len(one.storeys.name))] for one in files]
    levels, at = _levels(files, sound)
    if not levels:
        lowest = min(float(one.foot.min()) for one in files)
        return Storeys(("",), ("",), np.array([lowest])), [np.zeros(len(one.row), np.int32) for one in files], ()
    order = np.argsort([one.elevation for one in levels], kind="stable")
    place = np.argsort(order)
    levels = [levels[number] for number in order]
    elevation = np.array([one.elevation for one in levels])
    rows, same, notes = [], {}, []
    for number, one in enumerate(files):
        at_feet = _level_at(elevation, one.foot + LEVEL)  # slabs are cast below the level that they carry
        new = np.where(one.row < 0, -1, _level_at(elevation, one.middle))
        for row in np.unique(one.row[one.row >= 0]):
            own, name = one.row == row, one.storeys.name[row]
            usual = np.bincount(at_feet[own]).argmax()
            most = np.mean(at_feet[own] == usual) >= MOST
            if (number, row) in at and (most or sum(sound[number]) > 1):
                new[own] = place[at[number, row]]
            elif most:
                new[own] = usual
            elif name or len(one.storeys.name) > 1:
                notes.append(f"{one.file}: what is on {name!r} stands on several storeys, and is told by its height")
                continue
            else:
                continue
            same.setdefault(int(new[own][0]), []).append((name, one.file))
        rows.append(new.astype(np.int32))
    told = [_said(levels[level].name, files[levels[level].file].file, same[level]) for level in sorted(same)]
    guid = tuple(files[one.file].storeys.guid[one.row] for one in levels)
    table = Storeys(guid, tuple(one.name for one in levels), elevation)
    return table, rows, (*filter(None, told), *notes)


def _says_where(one: FileStoreys, row: int) -> bool:
    """Whether a storey's elevation is that of its elements; of one without any, whether it may be."""
    foot = one.foot[one.row == row]
    if not one.storeys.guid[row]:
        return False  # it stands for those that the file does not have
    if len(foot):
        low = float(np.quantile(foot, 0.1))
        return abs(low - one.storeys.elevation[row]) <= STANDS and float(np.ptp(foot)) <= SPREAD
    used = np.unique(one.row[one.row >= 0])
    return len(used) > 0 and all(_says_where(one, other) for other in used)


def _levels(files: list[FileStoreys], sound: list[list[bool]]) -> tuple[list[_Level], dict[tuple[int, int], int]]:
    """The levels, and which of them each sound row of each file is; two of one file are never one."""
    order = sorted(range(len(files)), key=lambda one: (-sum(sound[one]), -len(files[one].row), files[one].file))
    levels: list[_Level] = []
    at: dict[tuple[int, int], int] = {}
    for number in order:
        one, taken = files[number], set()
        for row in np.flatnonzero(sound[number]):
            name, elevation = one.storeys.name[row], float(one.storeys.elevation[row])
            away = {
                level: abs(known.elevation - elevation)
                for level, known in enumerate(levels)
                if level not in taken
                and abs(known.elevation - elevation) <= (NAMED if _alike(known.name, name) else LEVEL)
            }
            level = min(away, key=away.__getitem__) if away else len(levels)
            if not away:
                levels.append(_Level(number, int(row), name, elevation))
            taken.add(level)
            at[number, int(row)] = level
    return levels, at


def _alike(one: str, other: str) -> bool:
    return bool(one.strip()) and one.strip().casefold() == other.strip().casefold()


def _level_at(elevation: np.ndarray, height: np.ndarray) -> np.ndarray:
    """The highest level at or below a height, or the lowest."""
    return np.maximum(np.searchsorted(elevation, height, side="right") - 1, 0)


def _said(name: str, file: str, same: Iterable[tuple[str, str]]) -> str:
    """Which storeys of other files are a level; nothing where all have its name."""
    others: dict[str, list[str]] = {}
    for other, where in same:
        if where != file and other != name:
            others.setdefault(other, []).append(where)
    if not others:
        return ""
    words = "; ".join(f"{other!r} of {', '.join(sorted(where))}" for other, where in sorted(others.items()))
    return f"storey {name!r} of {file} is also {words}"
