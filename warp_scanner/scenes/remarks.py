"""What a user must know of how the file of a building was read, a line each."""

from warp_scanner.scenes.building import MOST_NAMED, Building, Failure

Alike = tuple[str, str, str]  # class, name and reason


def remarks(building: Building) -> list[str]:
    """What is missing, flawed, left out or assumed; last what several files lack alike, as what marks their zero."""
    lines, everywhere = [], []
    for word, elements in (("without a shape", building.failures), ("not a solid", building.flaws)):
        several = _in_several_files(elements)
        own = tuple(one for one in elements if _words(one) not in several)
        told = [line for alike in _alike(own) for line in _told(word, alike)]
        both = told, _of_several(word, several)
        for some in both if elements is building.flaws else ():  # of a mesh without a solid they would hide all else
            if len(some) > MOST_NAMED:
                some[MOST_NAMED:] = [f"{word}: {len(some) - MOST_NAMED} more elements, for such reasons"]
        lines += both[0]
        everywhere += both[1]
    if building.zero_area:
        lines.append(f"note: {building.zero_area} triangles without area were left out")
    return [*lines, *(f"note: {note}" for note in building.notes), *everywhere]


def _words(one: Failure) -> Alike:
    return one.ifc_class, one.name, one.reason


def _in_several_files(elements: tuple[Failure, ...]) -> dict[Alike, set[str]]:
    """The files of what is told alike of several."""
    files: dict[Alike, set[str]] = {}
    for one in elements:
        files.setdefault(_words(one), set()).add(one.file)
    return {words: found for words, found in files.items() if len(found) > 1}


def _of_several(word: str, several: dict[Alike, set[str]]) -> list[str]:
    """A line for each; of many that differ in their names alone, one for all."""
    groups: dict[tuple, list[str]] = {}
    for (kind, name, reason), files in several.items():
        groups.setdefault((kind or "element", reason, len(files)), []).append(name)
    lines = []
    for (kind, reason, count), names in groups.items():
        told = (
            [f"{len(names)} of the class {kind}"] if len(names) > MOST_NAMED else [f"{kind} {one!r}" for one in names]
        )
        lines += [f"{word}: {one} of {count} files: {reason}" for one in told]
    return lines


def _alike(elements: tuple[Failure, ...]) -> list[list[Failure]]:
    """Failures of one class and reason in one of several files together; each of an only file by itself."""
    groups: dict[tuple, list[Failure]] = {}
    for number, one in enumerate(elements):
        groups.setdefault((one.file, one.ifc_class, one.reason) if one.file else (number,), []).append(one)
    return list(groups.values())


def _told(word: str, alike: list[Failure]) -> list[str]:
    first = alike[0]
    kind, where = first.ifc_class or "element", f"{first.file}: " if first.file else ""
    if len(alike) > MOST_NAMED:
        return [f"{where}{word}: {len(alike)} of the class {kind}: {first.reason}"]
    return [f"{where}{word}: {kind} {one.name!r} ({one.guid}): {one.reason}" for one in alike]
