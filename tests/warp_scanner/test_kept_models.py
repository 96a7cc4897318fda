"""What was read is not read again while nothing changed, is not trusted when damaged, and stays within bounds."""

import contextlib
import os
import time

import numpy as np
import pytest

from tests.cases.valid_ifc import ifc_text
from tests.warp_scanner.test_building_arrays import assert_same
from warp_scanner.buildings import kept_models
from warp_scanner.buildings.ifc_files import read_ifc, reading_ahead
from warp_scanner.caches import cache_folder
from warp_scanner.kept import SUFFIX, Store
from warp_scanner.scenes.building import ReadOptions


@pytest.fixture
def path(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXMM_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("JAXMM_KEEP_MODELS", raising=False)
    path = tmp_path / "house.ifc"
    path.write_bytes(ifc_text("IFC4"))
    return path


@pytest.fixture
def begun(monkeypatch):
    """Every process that a reader starts."""
    begin, found = kept_models.begin, []

    def counted(*words):
        found.append(begin(*words))
        return found[-1]

    monkeypatch.setattr(kept_models, "begin", counted)
    return found


def files_kept():
    return sorted(cache_folder("models").glob(f"*{SUFFIX}"))


def test_a_building_that_was_kept_is_the_one_that_was_read(path, begun):
    first = read_ifc(path)
    (path.parent / "elsewhere").mkdir()
    again = read_ifc(path.rename(path.parent / "elsewhere" / path.name))
    assert len(begun) == len(files_kept()) == 1
    assert_same(again, first)


def test_other_content_options_code_or_library_is_read_again(path, begun, monkeypatch):
    read_ifc(path)
    read_ifc(path, ReadOptions(doors="open"))
    assert len(begun) == 2
    path.write_text(path.read_text() + "\n")
    read_ifc(path)
    assert len(begun) == 3
    monkeypatch.setattr(kept_models.metadata, "version", lambda _: "0.0.1")
    read_ifc(path)
    assert len(begun) == 4
    monkeypatch.setattr(kept_models, "_reader", lambda: "other code")
    read_ifc(path)
    assert len(begun) == 5 == len(files_kept())


def test_a_damaged_file_is_read_again_and_mended(path, begun):
    first = read_ifc(path)
    (kept,) = files_kept()
    whole = kept.read_bytes()
    for damaged in (b"", whole[:40], whole[:-1], whole[:200] + bytes([whole[200] ^ 1]) + whole[201:]):
        kept.write_bytes(damaged)
        assert_same(read_ifc(path), first)
        assert kept.read_bytes()[:32] == whole[:32]
    assert len(begun) == 5


def test_nothing_is_kept_where_that_is_asked_for(path, begun, monkeypatch):
    monkeypatch.setenv("JAXMM_KEEP_MODELS", "0")
    read_ifc(path)
    read_ifc(path)
    assert len(begun) == 2 and not files_kept()


@pytest.mark.parametrize("asked", ["-1", "many", "", "1.5", "²"])
def test_a_bound_that_is_no_number_is_one_line(path, monkeypatch, asked):
    monkeypatch.setenv("JAXMM_KEEP_MODELS", asked)
    with pytest.raises(ValueError, match=r"^JAXMM_KEEP_MODELS: expected a number of megabytes, .*, got '.*'$"):
        read_ifc(path)


def test_what_is_read_ahead_is_waited_for_and_else_ended(path, begun):
    with reading_ahead(path), reading_ahead(path):
        building = read_ifc(path)
    assert len(begun) == 1 and len(building.elements.guid)
    path.write_text(path.read_text() + "\n")
    with contextlib.suppress(KeyboardInterrupt), reading_ahead(path):
        raise KeyboardInterrupt
    assert len(begun) == 2 and begun[1].poll() is not None
    assert not kept_models._begun


def test_reading_ahead_leaves_what_is_wrong_to_the_reader(tmp_path, begun):
    path = tmp_path / "no.ifc"
    path.write_text("no IFC")
    for one in (path, tmp_path / "missing.ifc", tmp_path):
        with reading_ahead(one):
            pass
    assert not begun


def test_a_store_gives_back_what_it_was_given_and_drops_what_was_not_used_for_longest(tmp_path):
    store, rng = Store(tmp_path / "new" / "folder", 1000), np.random.default_rng(0)
    contents = {f"{number}": rng.bytes(200) for number in range(4)}
    assert store.get("0") is None
    for age, (key, content) in enumerate(contents.items()):
        store.put(key, content)
        os.utime(store.folder / f"{key}{SUFFIX}", (age, age))
    assert {key: store.get(key) for key in contents} == contents
    os.utime(store.folder / f"1{SUFFIX}", (0, 0))
    store.put("4", b"x" * 200)
    assert store.get("1") is None and store.get("4") == b"x" * 200 and store.get("0") == contents["0"]
    store.put("large", b"x" * 1000)
    assert store.get("large") is None and store.get("4") is not None
    assert sum(one.stat().st_size for one in store.folder.iterdir()) <= 1000


def test_a_store_that_cannot_be_written_keeps_nothing_and_says_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    store = Store(tmp_path / "file" / "folder", 1000)
    store.put("key", b"content")
    assert store.get("key") is None


def test_looking_something_up_counts_as_use(tmp_path):
    store = Store(tmp_path, 1000)
    store.put("key", b"content")
    os.utime(tmp_path / f"key{SUFFIX}", (0, 0))
    store.get("key")
    assert time.time() - (tmp_path / f"key{SUFFIX}").stat().st_mtime < 60.0
