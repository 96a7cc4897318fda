"""Models with a detection's changes in them, of a prior that is in one IFC file or in several.

Of one there is `updated.ifc`; of several a folder `updated/` with each that changes, by its name; likewise as built.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.ifc.as_built import NOT_WRITTEN, model_as_built, write_as_built
from jaxmm.ifc.shares import files_of_added, in_own_frame, share_of
from jaxmm.ifc.text_edits import Edit
from jaxmm.ifc.undo import AS_BUILT_FILES, UPDATED_FILES, write_one_of_several
from jaxmm.ifc.update import edited_model, write_update
from jaxmm.verdicts.results import Detection
from warp_scanner.buildings.ifc_zips import IFC, ZIPPED, is_ifc
from warp_scanner.buildings.model_files import Model, ModelFile
from warp_scanner.scenes.building import Source

# Text before, after, and the way back; notes; and GlobalIds of new elements, by their place among the mismatches.
Edited = tuple[tuple[bytes, bytes, list[Edit]], tuple[str, ...], dict[int, str]]


class Updates(NamedTuple):
    """What was written."""

    notes: tuple[str, ...]  # what could not be done, or must be known, a sentence each
    new: dict[int, tuple[str, str]]  # by place among the mismatches: GlobalId of what was added, and the file it is in


def write_updates(model: Model, detection: Detection, out: Path, *, apply: bool = False) -> Updates:
    """Write what a detection changes into a folder: `updated.ifc`, or of several files `updated/`, and the way back.

    Args:
        model: the files that the detection was run on.
        detection: what was found.
        out: the folder.
        apply: delete removed elements instead of marking them, as `write_update` does.

    Raises:
        InputError: a file cannot be read or edited.
        OSError: one cannot be written.
    """
    if len(model.files) == 1:
        told = write_update(model.files[0].path, detection, out, apply=apply)
        return Updates(told.notes, {number: (guid, told.path.name) for number, guid in told.of_mismatch.items()})
    sources = _sources(model, detection)
    added = files_of_added(detection, [source.file for _, source in sources])

    def edited(file: ModelFile, source: Source) -> Edited:
        share = in_own_frame(share_of(detection, source, added), source.to_world)
        texts, (*_, new, notes) = edited_model(file.path, share, apply=apply)
        return texts, notes, new

    return _write(out / UPDATED_FILES, sources, edited)


def write_models_as_built(model: Model, detection: Detection, out: Path) -> tuple[str, ...]:
    """Write the model with displaced elements where they were measured: `as_built.ifc`, or of several `as_built/`.

    Nothing is written while a scan is in doubt. Arguments and errors are those of `write_updates`.
    """
    if len(model.files) == 1:
        return write_as_built(model.files[0].path, detection, out)
    if detection.doubts:
        return (NOT_WRITTEN,)

    def edited(file: ModelFile, source: Source) -> Edited:
        return *model_as_built(file.path, share_of(detection, source, {}), np.asarray(source.to_world)), {}

    return _write(out / AS_BUILT_FILES, _sources(model, detection), edited).notes


def _sources(model: Model, detection: Detection) -> list[tuple[ModelFile, Source]]:
    """The IFC files of the model, and where each lies."""
    known = {source.file: source for source in detection.prior.sources} if detection.prior else {}
    return [(file, known[file.name]) for file in model.files if file.name in known and is_ifc(file.path)]


def _write(
    folder: Path, sources: list[tuple[ModelFile, Source]], edited: Callable[[ModelFile, Source], Edited]
) -> Updates:
    """Write every file that changes; the notes name which, and what could not be done in each."""
    names, notes, written, new = _names([file for file, _ in sources]), [], [], {}
    for file, source in sources:
        (original, updated, edits), told, added = edited(file, source)
        new |= {number: (guid, f"{folder.name}/{names[file.name]}") for number, guid in added.items()}
        notes += [f"{file.name}: {note}" for note in told]
        if updated != original:
            write_one_of_several(folder / names[file.name], file.name, original, updated, edits)
            written.append(names[file.name])
    said = f"{folder.name}: {', '.join(written)}" if written else f"{folder.name}: no file of the model changes"
    return Updates((*notes, said), new)


def _names(files: list[ModelFile]) -> dict[str, str]:
    """What each file is written as: by its name, unpacked; with the old ending before it where that is taken."""
    plain = {file.name for file in files if not file.name.lower().endswith(ZIPPED)}
    names = {}
    for file in files:
        bare = file.name[: -len(ZIPPED)] + IFC if file.name.lower().endswith(ZIPPED) else file.name
        names[file.name] = f"{file.name}{IFC}" if bare != file.name and bare in plain else bare
    return names
