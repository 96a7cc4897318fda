"""IFC files that are packed: an .ifczip is a zip archive that holds one model as STEP text."""

import contextlib
import lzma
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path

from warp_scanner.scenes.building import WithoutSurfacesError

IFC, ZIPPED = ".ifc", ".ifczip"
SUFFIXES = (IFC, ZIPPED)
# STEP text packs to a tenth or so; what unpacks to more than this, and is large, is made to fill memory or disk.
MOST_PACKED = 100  # times its size in the archive
SMALL = 32 << 20  # [bytes] up to which that is not asked
_ENCRYPTED = 0x1  # flag of a member
# What zipfile raises of a damaged archive: names that are none, places before the file, and, as kinds of RuntimeError,
# passwords and packings that it does not know.
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, UnicodeDecodeError, EOFError, OSError, RuntimeError,
    OverflowError,
)  # fmt: skip


def is_ifc(path: Path) -> bool:
    """Whether a file is an IFC model by its ending, in any case."""
    return path.suffix.lower() in SUFFIXES


def ifc_text(path: Path) -> bytes:
    """The STEP text of an IFC file, unpacked where it is packed.

    Raises:
        ValueError: an archive that is damaged or locked, or holds no model, several, or one that is packed too well.
        OSError: the file cannot be read.
    """
    if path.suffix.lower() != ZIPPED:
        return path.read_bytes()
    with open(path, "rb") as file:  # what the system says of the file itself is none of the archive's faults
        try:
            with zipfile.ZipFile(file) as archive:
                member = _model_in(path, archive)
                return archive.read(member)  # no more than the archive says, or it raises
        except _DAMAGE as error:
            why = " ".join(str(error).split())[:100] or type(error).__name__
            raise ValueError(
                f"{path}: expected a zip archive that holds an IFC file, found it damaged ({why})"
            ) from error


@contextlib.contextmanager
def plain_file(path: Path) -> Iterator[Path]:
    """A file of that text to read: itself, or unpacked for as long as it is needed. Errors name the packed one.

    Raises:
        ValueError: as `ifc_text` does.
    """
    if path.suffix.lower() != ZIPPED or not path.is_file():
        yield path
        return
    text = ifc_text(path)
    with tempfile.TemporaryDirectory(prefix="ifczip-") as folder:
        plain = Path(folder) / "model.ifc"
        plain.write_bytes(text)
        try:
            yield plain
        except WithoutSurfacesError as error:
            raise WithoutSurfacesError(str(path), error.why) from error
        except ValueError as error:
            raise ValueError(str(error).replace(str(plain), str(path))) from error


def _model_in(path: Path, archive: zipfile.ZipFile) -> zipfile.ZipInfo:
    """The one member that is a model; what file managers leave beside it (names that begin with a dot) is none."""
    names = [one for one in archive.infolist() if Path(one.filename).suffix.lower() == IFC and not one.is_dir()]
    models = [one for one in names if not Path(one.filename).name.startswith(".")]
    if len(models) != 1:
        which = ", ".join(repr(one.filename[:60]) for one in models[:3]) + (", ..." if len(models) > 3 else "")
        found = f"{len(models)}: {which}" if models else "none"
        raise ValueError(f"{path}: expected one file ending in .ifc in the archive, found {found}")
    (model,) = models
    if model.flag_bits & _ENCRYPTED:
        raise ValueError(f"{path}: expected an archive without a password, found {model.filename[:60]!r} locked")
    times = model.file_size / max(model.compress_size, 1)
    if model.file_size > SMALL and times > MOST_PACKED:
        raise ValueError(
            f"{path}: expected an IFC file packed to no less than 1/{MOST_PACKED} of its size, found "
            f"{model.filename[:60]!r} of {model.file_size / 1e6:.0f} MB packed to 1/{times:.0f}"
        )
    return model
