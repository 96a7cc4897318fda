"""What a benchmark told of each view, in a file with a line each: a long run may be ended, and gone on with."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

Key = tuple[str | int, ...]  # of a view


class KeptViews:
    """By key what was told of views; those of a file are there from the start, and new ones come into it at once.

    Args:
        path: the file, of JSON lines; None keeps nothing.

    Raises:
        OSError: it cannot be read.
    """

    def __init__(self, path: Path | None = None):
        self._path: Path | None = path
        self._told: dict[Key, dict[str, Any] | None] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    key, told = json.loads(line)
                except ValueError:  # of a run that was ended while it wrote
                    continue
                self._told[tuple(key)] = told

    def has(self, key: Key) -> bool:
        """Whether a view was told."""
        return key in self._told

    def add(self, key: Key, told: dict[str, Any] | None) -> None:
        """Keep what was told of a view; None where there is no such view."""
        self._told[key] = told
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                # The end of a line comes before the next one: what a run was ended in is a line by itself.
                file.write("\n" + json.dumps([key, told]))

    def items(self) -> Iterator[tuple[Key, dict[str, Any] | None]]:
        """Every view that was told, the first first."""
        return iter(self._told.items())
