"""Keeps what took long to compute in files: found again by a key, checked, and dropped when there are too many.

A file holds a digest of its content and the content. What is damaged counts as not there, and a folder that cannot be
written keeps nothing: a cache may cost time, and nothing else.
"""

import contextlib
import hashlib
import os
import tempfile
from pathlib import Path

SUFFIX = ".kept"
_DIGEST = hashlib.sha256().digest_size


class Store:
    """A folder of at most `most` bytes; those that were not used for longest are dropped first."""

    def __init__(self, folder: Path, most: int):
        self.folder, self.most = folder, most

    def get(self, key: str) -> bytes | None:
        """What was put under a key; None where nothing was, or where it is damaged."""
        path = self._path(key)
        try:
            content = path.read_bytes()
            os.utime(path)  # it was used now
        except OSError:
            return None
        digest, content = content[:_DIGEST], content[_DIGEST:]
        return content if digest == hashlib.sha256(content).digest() else None

    def put(self, key: str, content: bytes) -> None:
        """Keep content under a key, which names a file; nothing where it is larger than all may be together."""
        if len(content) + _DIGEST > self.most:
            return
        with contextlib.suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self.folder)
            temporary = Path(name)
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(hashlib.sha256(content).digest() + content)
                os.replace(temporary, self._path(key))
            finally:
                temporary.unlink(missing_ok=True)
            self._bound()

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}{SUFFIX}"

    def _bound(self) -> None:
        found = sorted(((one.stat(), one) for one in self.folder.glob(f"*{SUFFIX}")), key=lambda it: -it[0].st_mtime_ns)
        total = 0
        for stat, path in found:
            total += stat.st_size
            if total > self.most:
                path.unlink(missing_ok=True)
