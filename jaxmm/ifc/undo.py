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
_FORMAT = "jaxmm undo 1"


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
    if take_back(updated, edits) != original:
        raise AssertionError("the edits must lead back to the original")
    undo = {
        "format": _FORMAT,
        "updated_sha256": sha256(updated),
        "original_sha256": sha256(original),
        # Latin-1 has one character for every byte, so any encoding of the file survives in JSON.
        "edits": [
            {"start": edit.start, "length": edit.length, "before": edit.before.decode("latin-1")} for edit in edits
        ],
    }

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


def revert(updated: Path | str, out: Path | str) -> None:
    """Give back the very file that an update was made from, byte for byte.

    Args:
        updated: a file that `write_update` or `write_as_built` wrote, with its undo beside it.
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
    content = _load(undo)
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


def _load(undo: Path) -> dict[str, Any]:
    try:
        content = json.loads(_read(undo))
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{undo}: expected what `jaxmm detect` wrote beside its models, found it damaged") from error
    wanted = ("format", "updated_sha256", "original_sha256", "edits")
    if not isinstance(content, dict) or content.get("format") != _FORMAT or any(key not in content for key in wanted):
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
