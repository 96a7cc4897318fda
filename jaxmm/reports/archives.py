"""Zip files of which the same content gives the same bytes, on every machine and at any time."""

import zipfile
from pathlib import Path

_FIRST_DAY = (1980, 1, 1, 0, 0, 0)  # the earliest that zip knows


def write_zip(path: Path, files: dict[str, bytes]) -> None:
    """Write an archive of files by name, in their order; names that end in / are folders."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, _FIRST_DAY)
            entry.create_system = 3  # the same bytes from every system
            folder = name.endswith("/")
            entry.external_attr = (0o40755 << 16) | 0x10 if folder else 0o100644 << 16
            entry.compress_type = zipfile.ZIP_STORED if folder else zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
