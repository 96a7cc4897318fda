"""An IFC model that is being edited, and the book that is kept of every entity touched."""

import itertools
import re
import uuid
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jaxmm.ifc.text_edits import Edit, edit_text
from jaxmm.ifc.undo import sha256
from jaxmm.inputs import InputError, one_line
from warp_scanner.buildings.ifc_model import import_ifcopenshell
from warp_scanner.buildings.ifc_schemas import Lost, parse
from warp_scanner.buildings.ifc_zips import ifc_text, plain_file

SOFTWARE = "jaxmm"
_FAMILY = uuid.UUID("0d8a1f3e-9d1c-5d0b-8f0e-3c5a6a1d7b42")  # GlobalIds are names in this family
_NUMBER = re.compile(rb"#\s*(\d{1,9})\s*=")


class Draft:
    """Edits go through here; what is not touched keeps its text.

    The model is one that ifcopenshell has opened and nobody has edited yet.
    """

    def __init__(self, ifcopenshell: Any, model: Any, seed: str, when: datetime):
        """Begin.

        Args:
            ifcopenshell: the library.
            model: the parsed file.
            seed: with the word for each new thing it fixes the GlobalId of that thing.
            when: of the edit; UTC where it names no zone.
        """
        self.model, self.when = model, when if when.tzinfo else when.replace(tzinfo=UTC)
        self._compress, self._seed = ifcopenshell.guid.compress, seed
        self._new: dict[int, Any] = {}
        self._changed: dict[int, Any] = {}
        self._removed: set[int] = set()
        self._history: Any = None
        self._version = version(SOFTWARE)  # asked once: it reads a file

    @property
    def software(self) -> str:
        """Name and version of what edits."""
        return f"{SOFTWARE} {self._version}"

    def create(self, kind: str, *values: Any, **named: Any) -> Any:
        """A new entity, or a value of a type when `kind` is none of an entity."""
        made = self.model.create_entity(kind, *values, **named)
        if made.id():
            self._new[made.id()] = made
        return made

    def root(self, kind: str, word: str, **named: Any) -> Any:
        """A new entity with a GlobalId that `word`, used once, decides, and where IFC2X3 wants it an owner."""
        guid = self._compress(uuid.uuid5(_FAMILY, f"{self._seed}/{word}").hex)
        if self.model.schema == "IFC2X3":
            named["OwnerHistory"] = self._owner_history()
        return self.create(kind, GlobalId=guid, **named)

    def put(self, entity: Any, attribute: str | int, value: Any) -> None:
        """Change one attribute."""
        if isinstance(attribute, int):
            entity[attribute] = value
        else:
            setattr(entity, attribute, value)
        self._changed[entity.id()] = entity

    def remove(self, entity: Any) -> None:
        """Remove an entity that nothing refers to any more."""
        if self.model.get_total_inverses(entity):
            raise AssertionError(f"{entity} is still referred to")
        number = entity.id()
        self._changed.pop(number, None)
        if self._new.pop(number, None) is None:
            self._removed.add(number)
        self.model.remove(entity)

    def has(self, number: int) -> bool:
        """Whether the entity of that number is still there."""
        return number not in self._removed

    def text(self, original: bytes, name: object) -> tuple[bytes, list[Edit]]:
        """The edited file and the way back, from the text that the model was parsed from.

        Raises:
            InputError: the text holds an edited entity twice.
        """
        changed = {number: one for number, one in self._changed.items() if number not in self._new}
        replaced: dict[int, bytes | None] = {number: _line(one) for number, one in changed.items()}
        replaced.update(dict.fromkeys(self._removed))
        return edit_text(original, replaced, [_line(one) for _, one in sorted(self._new.items())], name)

    def _owner_history(self) -> Any:
        """Who made the new things: this program, on behalf of nobody else."""
        if self._history is None:
            organization = self.create("IfcOrganization", Name=SOFTWARE)
            person = self.create("IfcPerson", FamilyName=SOFTWARE)
            known = [one for one in self.model.by_type("IfcApplication") if one.ApplicationIdentifier == SOFTWARE]
            # The schema wants this identifier once in a file, which may be an update of an update.
            application = known[0] if known else self.create(
                "IfcApplication", organization, self._version, SOFTWARE, SOFTWARE
            )  # fmt: skip
            self._history = self.create(
                "IfcOwnerHistory",
                OwningUser=self.create("IfcPersonAndOrganization", person, organization),
                OwningApplication=application, ChangeAction="ADDED", CreationDate=int(self.when.timestamp()),
            )  # fmt: skip
        return self._history


def open_draft(prior: Path, when: datetime | None, date: str | None) -> tuple[bytes, Draft]:
    """The text of an IFC file, unpacked, and its model to edit; of the time `when`, else `date` (ISO 8601), else now.

    Raises:
        InputError: it cannot be read.
        ImportError: ifcopenshell is not installed.
    """
    ifcopenshell = import_ifcopenshell()
    try:
        original = ifc_text(prior)
        with plain_file(prior) as plain:
            model, _, lost = parse(ifcopenshell, plain)
        _number_behind(model, original, lost)
    except OSError as error:
        raise InputError(f"{prior}: cannot be read: {error.strerror}") from error
    except Exception as error:  # the parser raises classes of its own, and plain ones on unknown schemas
        raise InputError(f"{prior}: not a readable IFC file: {one_line(error)}") from error
    when = when or (datetime.fromisoformat(date) if date else datetime.now(UTC))
    return original, Draft(ifcopenshell, model, sha256(original), when)


def _number_behind(model: Any, text: bytes, lost: list[Lost]) -> None:
    """Let new entities be numbered behind all that a file has or refers to, also what the library left out of it."""
    numbers = (int(found[1]) for found in _NUMBER.finditer(text))
    last = max(itertools.chain(numbers, (one.number for one in lost)), default=0)
    try:
        model.by_id(last)
    except RuntimeError:  # it is not in the model
        model.remove(model.create_entity("IfcCartesianPoint", (0.0, 0.0), id=last))


def _line(entity: Any) -> bytes:
    return entity.to_string().encode("utf-8") + b";"
