"""`undo.json`: what is needed to make the file that a detection was run on from one that it edited.

It holds the text of the entities that were changed or removed, and where it stood; not the file, and nothing to run.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

from jaxmm.files import write_atomically, write_json
from jaxmm.ifc.text_edits import Edit, take_back
from jaxmm.inputs import InputError

UPDATED, UNDO = "updated.ifc", "undo.json"
AS_BUILT, AS_BUILT_UNDO = "as_built.ifc", "as_built.undo.json"
UPDATED_FILES, AS_BUILT_FILES = "updated", "as_built"  # folders of a model that is in several files
_FORMAT, _OF_SEVERAL = "jaxmm undo 1", "jaxmm undo 2"


def sha256(data: bytes) -> str:
    """The hash that tells files apart."""
    return hashlib.sha256(data).hexdigest()


def write_with_undo(
    folder: Path, original: bytes, updated: bytes, edits: list[Edit], name: str = UPDATED, undo_name: str = UNDO
) -> None:
    """Write an edited file and its undo to a folder, by these names, both whole or neither.

    Raises:
        InputError: a folder or a device stands where one of them would be.
        OSError: one of them cannot be written.
    """
    undo = {"format": _FORMAT} | _way_back(original, updated, edits)
    written = []

    def write(temporary: Path) -> None:
        temporary.write_bytes(updated)
        write_json(folder / undo_name, undo)  # last, as only moving the other one is left to go wrong
        written.append(undo_name)

    try:
        write_atomically(folder / name, write)
    except BaseException:
        if written:
            (folder / undo_name).unlink(missing_ok=True)
        raise


def write_one_of_several(path: Path, source: str, original: bytes, updated: bytes, edits: list[Edit]) -> None:
    """Write one edited file of a model that is in several, and add its way back to the UNDO beside it.

    Args:
        path: of the edited file; the folder is one that nobody reads yet.
        source: what the file that was read is called.
        original: its text.
        updated: the edited text.
        edits: from this back to that.

    Raises:
        OSError: it cannot be written.
    """
    undo = path.with_name(UNDO)
    path.parent.mkdir(parents=True, exist_ok=True)
    known = json.loads(undo.read_text(encoding="utf-8"))["files"] if undo.exists() else {}
    way_back = {"source": source} | _way_back(original, updated, edits)
    path.write_bytes(updated)
    write_json(undo, {"format": _OF_SEVERAL, "files": known | {path.name: way_back}})


def _way_back(original: bytes, updated: bytes, edits: list[Edit]) -> dict[str, Any]:
    if take_back(updated, edits) != original:
        raise AssertionError("the edits must lead back to the original")
    return {
        "updated_sha256": sha256(updated),
        "original_sha256": sha256(original),
        # Latin-1 has one character for every byte, so any encoding of the file survives in JSON.
        "edits": [
            {"start": edit.start, "length": edit.length, "before": edit.before.decode("latin-1")} for edit in edits
        ],
    }


def revert(updated: Path | str, out: Path | str) -> None:
    """Give back the very file that an update was made from, byte for byte.

    Args:
        updated: a file that `write_update` or `write_as_built` wrote, or one of several, with its undo beside it. What
            was read packed comes back as the plain text.
        out: the new file to write, whole or not at all.

    Raises:
        InputError: `updated` or its UNDO is missing, they do not belong together, UNDO is damaged, or `out` is there
            already: it may be the original, with edits of its own by now.
        OSError: `out` cannot be written.
    """
    updated, out = Path(updated), Path(out)
    if out.exists():
        raise InputError(f"{out}: expected the name of a new file, found one that is there")
    undo = updated.with_name(AS_BUILT_UNDO if updated.name == AS_BUILT else UNDO)
    if not undo.exists():
        raise InputError(
            f"{undo}: expected what `jaxmm detect` wrote beside {updated.name}, found nothing there; "
            f"that of {AS_BUILT} is {AS_BUILT_UNDO}, and counts where the model bears that name"
        )
    content = _load(undo, updated.name)
    text = _read(updated)
    if sha256(text) != content["updated_sha256"]:
        raise InputError(f"{updated}: expected the file that {undo} was written with, found another or an edited one")
    try:
        edits = [Edit(_count(one["start"]), _count(one["length"]), one["before"].encode("latin-1"))
                 for one in content["edits"]]  # fmt: skip
        original = take_back(text, edits)
    except (TypeError, KeyError, AttributeError, ValueError) as error:
        raise InputError(f"{undo}: expected edits that fit {updated}, found it damaged") from error
    if sha256(original) != content["original_sha256"]:
        raise InputError(f"{undo}: expected edits that lead back to the original file, found it damaged")
    write_atomically(out, lambda temporary: temporary.write_bytes(original))


def _load(undo: Path, name: str) -> dict[str, Any]:
    """The way back of the file of that name."""
    try:
        content = json.loads(_read(undo))
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{undo}: expected what `jaxmm detect` wrote beside its models, found it damaged") from error
    form = content.get("format") if isinstance(content, dict) else None
    if form == _OF_SEVERAL and isinstance(content.get("files"), dict):
        files = content["files"]
        if name not in files:
            raise InputError(f"{undo}: expected to hold the way back of {name}, found those of {', '.join(files)}")
        content = files[name]
    wanted = ("updated_sha256", "original_sha256", "edits")
    if form not in (_FORMAT, _OF_SEVERAL) or not isinstance(content, dict) or any(key not in content for key in wanted):
        raise InputError(f"{undo}: expected JSON of the format {_FORMAT!r}, found something else")
    return content


def _read(path: Path) -> bytes:
    if not path.is_file():
        raise InputError(f"{path}: expected a file, found {'a folder' if path.is_dir() else 'nothing there'}")
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _count(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ValueError(f"expected a whole number of bytes, got {value!r}")
    return value
