"""Edits of an IFC file's own text (STEP), entity by entity, that can be taken back to the last byte.

What is not edited stays as its author wrote it, with comments, spaces and order. Text is bytes here: nothing of it is
decoded, so files in whatever encoding survive.
"""

import re
from typing import NamedTuple

from jaxmm.inputs import InputError

# Possessive: an unclosed string ends the search at once, not after trying all of its beginnings.
_STATEMENT = re.compile(rb"(?:\s++|/\*.*?\*/)*+((?:[^;'\"/]++|'[^']*+'|\"[^\"]*+\"|/\*.*?\*/|/)*+;)", re.DOTALL)
_NUMBER = re.compile(rb"#\s*(\d+)\s*=")


class Edit(NamedTuple):
    """One stretch of an edited text, and what stood there before."""

    start: int  # bytes of the edited text before it
    length: int  # bytes
    before: bytes


def edit_text(
    text: bytes, replaced: dict[int, bytes | None], added: list[bytes], name: object
) -> tuple[bytes, list[Edit]]:
    """Replace, remove and append entities.

    Args:
        text: of a STEP file.
        replaced: by number of an entity of the file: its new text, from `#` to `;`, or None to remove it.
        added: texts of new entities, for the end of the data.
        name: of the file, for errors.

    Returns:
        The edited text, and what `take_back` needs, in the order of the text.

    Raises:
        InputError: an entity to replace stands in the text twice or not at all, or the text has no data.
    """
    found, end = _places(text, replaced.keys(), name)
    newline = b"\r\n" if b"\r\n" in text[:4096] else b"\n"
    changes = [(*found[number], new) for number, new in replaced.items()]
    changes = [
        (start, _line_end(text, stop), b"") if new is None else (start, stop, new) for start, stop, new in changes
    ]
    if added:
        changes.append((end, end, newline.join(added) + newline))
    pieces, edits, read, written = [], [], 0, 0
    for start, stop, new in sorted(changes):
        pieces += [text[read:start], new]
        written += start - read
        edits.append(Edit(written, len(new), text[start:stop]))
        read, written = stop, written + len(new)
    return b"".join([*pieces, text[read:]]), edits


def take_back(text: bytes, edits: list[Edit]) -> bytes:
    """The text before the edits.

    Raises:
        ValueError: an edit lies outside the text, or they are out of order.
    """
    pieces, read = [], 0
    for edit in edits:
        if not read <= edit.start <= edit.start + edit.length <= len(text):
            raise ValueError(f"an edit at byte {edit.start} does not fit a text of {len(text)} bytes")
        pieces += [text[read : edit.start], edit.before]
        read = edit.start + edit.length
    return b"".join([*pieces, text[read:]])


def _places(text: bytes, wanted: object, name: object) -> tuple[dict[int, tuple[int, int]], int]:
    """Where the wanted entities stand, first byte to the one behind `;`, and where the data end."""
    found: dict[int, tuple[int, int]] = {}
    inside = False
    for statement in _STATEMENT.finditer(text):
        body = statement[1]
        if number := _NUMBER.match(body):
            key = int(number[1])
            if key in wanted:
                if key in found:
                    raise InputError(f"{name}: expected each entity once, found #{key} twice")
                found[key] = statement.span(1)
        elif body[:4].upper() == b"DATA":
            inside = True
        elif inside and body.upper().startswith(b"ENDSEC"):
            break
    else:
        raise InputError(f"{name}: expected a section of data (DATA; to ENDSEC;), found none")
    if missing := sorted(wanted - found.keys()):
        raise InputError(
            f"{name}: expected the entity #{missing[0]} to begin a statement of the data, found it nowhere"
        )
    return found, statement.start(1)


def _line_end(text: bytes, stop: int) -> int:
    """A removed entity takes its line with it, where it was the last thing on that line."""
    for newline in (b"\r\n", b"\n"):
        if text.startswith(newline, stop):
            return stop + len(newline)
    return stop
