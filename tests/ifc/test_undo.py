"""Edits of an IFC file's text leave the rest as it was, and every one of them can be taken back to the last byte."""

import errno
import json
import os

import numpy as np
import pytest

from jaxmm.ifc.text_edits import Edit, edit_text, take_back
from jaxmm.ifc.undo import UNDO, UPDATED, revert, sha256, write_with_undo
from jaxmm.inputs import InputError

HOSTILE = (
    b"'a;b'", b"'it''s #7= X(); '", b"/* #5= WALL(); it's */ $", b"'/* no comment'", b'"0FF;"', b"'caf\xe9 \xff'",
    b"#3", b"IFCTEXT('ENDSEC;')", b"1./3", b"(#1,#2)",
)  # fmt: skip
HEAD = b"ISO-10303-21;\nHEADER;\nFILE_NAME('DATA;','#9= A();');\nENDSEC;\nDATA;\n"
TAIL = b"ENDSEC;\nEND-ISO-10303-21;\n"


def entities(rng, count: int, newline: bytes) -> list[tuple[int, bytes, bytes]]:
    """Numbers, texts, and what follows each: awkward but valid."""
    between = [newline, b" ", b"", newline + b"/* #1= A(); don't; */" + newline]
    made = []
    for number in (rng.permutation(3 * count)[:count] + 1).tolist():
        values = b",".join(HOSTILE[row] for row in rng.integers(len(HOSTILE), size=rng.integers(1, 4)))
        text = b"#%d%s= %s(%s);" % (number, b" " * rng.integers(2), [b"IFCWALL", b"X"][rng.integers(2)], values)
        made.append((number, text, between[rng.integers(4)]))
    return made


def file_of(own: list[tuple[int, bytes, bytes]], newline: bytes) -> bytes:
    body = b"".join(text + after for _, text, after in own)
    return HEAD.replace(b"\n", newline) + body + TAIL.replace(b"\n", newline)


def test_edits_change_what_they_name_and_can_be_taken_back():
    rng = np.random.default_rng(5)
    for newline in [b"\n", b"\r\n"] * 200:
        own = entities(rng, int(rng.integers(1, 30)), newline)
        chosen = [number for number, _, _ in own if rng.random() < 0.4]
        replaced = {number: None if rng.random() < 0.5 else b"#%d=NEW('%d;');" % (number, number) for number in chosen}
        added = [b"#%d=ADDED();" % (1000 + row) for row in range(rng.integers(4))]
        expected = []
        for number, text, after in own:
            text = replaced.get(number, text)
            # What is removed takes the end of its line along.
            expected.append((number, text or b"", after if text is not None else after.removeprefix(newline)))
        expected += [(0, text, newline) for text in added]
        text = file_of(own, newline)
        edited, edits = edit_text(text, replaced, added, "x.ifc")
        assert edited == file_of(expected, newline)
        assert take_back(edited, edits) == text


def test_without_edits_nothing_changes():
    text = file_of(entities(np.random.default_rng(0), 20, b"\n"), b"\n")
    assert edit_text(text, {}, [], "x.ifc") == (text, [])


@pytest.mark.parametrize(
    ("text", "replaced", "word"),
    [
        (HEAD + b"#1=A();\n" + TAIL, {2: None}, "#2"),
        (HEAD + b"#1=A();\n#1=B();\n" + TAIL, {1: None}, "#1 twice"),
        (HEAD + b"#1=A();\n", {1: None}, "section of data"),
        (b"ISO-10303-21;\n", {}, "section of data"),
        (HEAD + b"/* #1=A(); */\n#2=A('#1=B();');\n" + TAIL, {1: None}, "#1"),
    ],
)
def test_text_that_cannot_be_edited_is_refused(text, replaced, word):
    with pytest.raises(InputError, match=word) as error:
        edit_text(text, replaced, [b"#9=A();"], "x.ifc")
    assert "x.ifc" in str(error.value)


@pytest.fixture
def pair(tmp_path):
    """A folder with an updated file and its undo, and the original text."""
    own = entities(np.random.default_rng(3), 12, b"\r\n")
    original, replaced = file_of(own, b"\r\n"), {number: None for number, _, _ in own[::3]}
    updated, edits = edit_text(original, replaced, [b"#999=NEW();"], "x.ifc")
    write_with_undo(tmp_path / "out", original, updated, edits)
    return tmp_path / "out", original


def test_the_original_comes_back(pair, tmp_path):
    folder, original = pair
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    revert(folder / UPDATED, tmp_path / "back.ifc")
    assert (tmp_path / "back.ifc").read_bytes() == original
    assert before == {path.name: path.read_bytes() for path in folder.iterdir()} and set(before) == {UPDATED, UNDO}


def refusal(updated, out) -> str:
    """The one line in which undoing ends; nothing is written."""
    before = out.read_bytes() if out.is_file() else None
    with pytest.raises(InputError) as error:
        revert(updated, out)
    assert "\n" not in str(error.value)
    assert before == (out.read_bytes() if out.is_file() else None)
    return str(error.value)


def test_what_does_not_belong_together_is_refused(pair, tmp_path):
    folder, _ = pair
    updated, undo, out = folder / UPDATED, folder / UNDO, tmp_path / "back.ifc"
    assert "a new file" in refusal(updated, updated) and "a new file" in refusal(updated, undo)
    own = tmp_path / "own.ifc"
    own.write_text("edited since")
    assert "a new file" in refusal(updated, own)
    assert "nothing there" in refusal(folder, out)
    said = refusal(tmp_path / "none.ifc", out)
    assert UNDO in said and "nothing there" in said
    text = updated.read_bytes()
    updated.write_bytes(text.replace(b"#999", b"#998"))
    said = refusal(updated, out)
    assert UPDATED in said and "another or an edited one" in said
    updated.unlink()
    said = refusal(updated, out)
    assert UPDATED in said and "nothing there" in said
    updated.write_bytes(text)
    undo.unlink()
    said = refusal(updated, out)
    assert UNDO in said and "nothing there" in said
    undo.mkdir()
    said = refusal(updated, out)
    assert UNDO in said and "a folder" in said


def test_an_undo_cut_off_at_any_byte_is_refused(pair, tmp_path):
    folder, _ = pair
    whole = (folder / UNDO).read_bytes().rstrip()
    for length in range(0, len(whole), 3):
        (folder / UNDO).write_bytes(whole[:length])
        assert UNDO in refusal(folder / UPDATED, tmp_path / "back.ifc")


@pytest.mark.parametrize(
    "content",
    [b"[]", b"null", b"[" * 100_000, b"\xff\xfe", b'{"format": "jaxmm undo 2"}', b'{"format": "jaxmm undo 1"}'],
)
def test_another_json_is_refused(pair, tmp_path, content):
    folder, _ = pair
    (folder / UNDO).write_bytes(content)
    assert UNDO in refusal(folder / UPDATED, tmp_path / "back.ifc")


@pytest.mark.parametrize(
    ("name", "value"),
    [("start", -1), ("start", 1.5), ("start", True), ("start", None), ("start", 10**30), ("length", "3"),
     ("length", 10**9), ("before", 5), ("before", "\u20ac"), ("before", "other"), (None, [])],
)  # fmt: skip
def test_a_damaged_edit_is_refused(pair, tmp_path, name, value):
    folder, _ = pair
    content = json.loads((folder / UNDO).read_text())
    content["edits"][1] = value if name is None else content["edits"][1] | {name: value}
    (folder / UNDO).write_text(json.dumps(content))
    said = refusal(folder / UPDATED, tmp_path / "back.ifc")
    assert UNDO in said and "damaged" in said
    (folder / UNDO).write_text(json.dumps(content | {"edits": value}))
    said = refusal(folder / UPDATED, tmp_path / "back.ifc")
    assert UNDO in said and "damaged" in said


def test_a_flipped_bit_never_gives_another_file(pair, tmp_path):
    folder, original = pair
    whole, rng = (folder / UNDO).read_bytes(), np.random.default_rng(8)
    for place in rng.integers(len(whole), size=300):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        (folder / UNDO).write_bytes(damaged)
        try:
            revert(folder / UPDATED, tmp_path / "back.ifc")
        except InputError:
            assert not (tmp_path / "back.ifc").exists()
        else:
            assert (tmp_path / "back.ifc").read_bytes() == original
            (tmp_path / "back.ifc").unlink()


def test_both_files_are_written_or_neither(tmp_path, monkeypatch):
    updated, edits = edit_text(HEAD + TAIL, {}, [b"#1=A();"], "x.ifc")
    replace = os.replace

    def full(source, target):
        if str(target).endswith(UPDATED):
            raise OSError(errno.ENOSPC, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        write_with_undo(tmp_path, HEAD + TAIL, updated, edits)
    assert list(tmp_path.iterdir()) == []


def test_a_model_without_its_undo_is_told_which_one_it_needs(tmp_path):
    (tmp_path / "alone.ifc").write_bytes(b"ISO-10303-21;")
    with pytest.raises(
        InputError, match=r"undo\.json: .*beside alone\.ifc, found nothing there; .*as_built\.undo\.json"
    ):
        revert(tmp_path / "alone.ifc", tmp_path / "back.ifc")
    assert not (tmp_path / "back.ifc").exists()


def test_a_folder_in_the_way_is_refused_and_an_older_undo_stays(tmp_path):
    (tmp_path / UPDATED).mkdir()
    (tmp_path / UNDO).write_text("older")
    updated, edits = edit_text(HEAD + TAIL, {}, [b"#1=A();"], "x.ifc")
    with pytest.raises(InputError, match="found a folder"):
        write_with_undo(tmp_path, HEAD + TAIL, updated, edits)
    assert (tmp_path / UNDO).read_text() == "older"


def test_the_hash_is_the_usual_one():
    assert sha256(b"") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"


def test_edits_outside_the_text_or_out_of_order_are_refused():
    for edits in ([Edit(5, 1, b"")], [Edit(0, 6, b"")], [Edit(2, 1, b""), Edit(1, 1, b"")]):
        with pytest.raises(ValueError, match="does not fit"):
            take_back(b"12345", edits)
