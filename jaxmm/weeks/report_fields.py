"""What a report.json holds, taken out piece by piece; whatever is not as it should be is named by its place in it."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from jaxmm.inputs import InputError, clipped


class Field:
    """A value of a JSON file, and where it stands."""

    def __init__(self, value: Any, file: str, place: str = ""):
        self.value, self._file, self._place = value, file, place

    def __getitem__(self, name: str) -> "Field":
        """A member of an object, which must be there."""
        if not isinstance(self.value, dict):
            self.refuse("an object")
        if name not in self.value:
            raise InputError(f"{self._file}: expected {self._inside(name)}, found none")
        return Field(self.value[name], self._file, self._inside(name))

    def get(self, name: str) -> "Field | None":
        """A member of an object; None where it is not there, or null."""
        if not isinstance(self.value, dict):
            self.refuse("an object")
        return None if self.value.get(name) is None else self[name]

    def items(self) -> list["Field"]:
        """The members of a list."""
        if not isinstance(self.value, list):
            self.refuse("a list")
        return [Field(one, self._file, f"{self._place}[{row}]") for row, one in enumerate(self.value)]

    def text(self) -> str:
        """A text."""
        if not isinstance(self.value, str):
            self.refuse("a text")
        return self.value

    def one_of(self, names: Sequence[str]) -> str:
        """One of some words."""
        if self.value not in names:
            self.refuse(f"one of {', '.join(names)}")
        return self.value

    def number(self) -> float:
        """A finite number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float) or not math.isfinite(self.value):
            self.refuse("a number")
        return float(self.value)

    def number_or_none(self) -> float | None:
        """A finite number, or null."""
        return None if self.value is None else self.number()

    def whole(self) -> int:
        """A whole number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int):
            self.refuse("a whole number")
        return self.value

    def three(self, read: Callable[["Field"], Any]) -> tuple[Any, Any, Any]:
        """Three members of a list, each by `read`."""
        found = self.items()
        if len(found) != 3:
            self.refuse("a list of three")
        return tuple(read(one) for one in found)

    def read(self, parse: Callable[[str], Any]) -> Any:
        """What a function makes of a text; its error gets the place."""
        try:
            return parse(self.text())
        except InputError as error:
            raise InputError(f"{self._file}: {self._place}: {error}") from error

    def refuse(self, expected: str) -> NoReturn:
        """Say what was expected here."""
        got = clipped(repr(self.value)[:60])
        raise InputError(f"{self._file}: expected {expected} as {self._place or 'its content'}, got {got}")

    def _inside(self, name: str) -> str:
        return f"{self._place}.{name}" if self._place else name
