"""A BCF file to test: two removed objects of a room and one of them found again elsewhere; written, and read back."""

import importlib
import zipfile
from datetime import UTC, datetime

import numpy as np
import pytest

from jaxmm.reports.bcf import write_bcf
from jaxmm.reports.bcf_topics import OVERVIEW, NewElement
from tests.cases.detections import true_case

NEW = "2O2Fr$t4X7Zf8NOew3FNr2"  # of an element that the updated model has anew
WHEN = datetime(2024, 2, 29, 12, 30, 15, tzinfo=UTC)


@pytest.fixture(scope="module")
def moved(tmp_path_factory):
    """A detection of a removed wall, a removed pillar, and that pillar added elsewhere."""
    detection = true_case(tmp_path_factory.mktemp("case")).detection
    wall, pillar = sorted(detection.mismatches, key=lambda one: one.object_type != "wall")
    again = pillar._replace(
        mismatch_type="added", center=pillar.center + np.array([1.5, -2.0, 0.0]), rotation=30.0, element=None,
        moved_from=1, probability=0.75, observable_fraction=None,
    )  # fmt: skip
    return detection._replace(mismatches=(wall, pillar, again))


@pytest.fixture(scope="module")
def written(moved, tmp_path_factory):
    """The file of that detection."""
    path = tmp_path_factory.mktemp("bcf") / "mismatches.bcf"
    write_bcf(path, moved, "Tower & annex", WHEN)
    return path


@pytest.fixture(scope="module")
def older(moved, tmp_path_factory):
    """The same in BCF 2.1, with the GlobalId that the updated model has for the added one."""
    path = tmp_path_factory.mktemp("bcf") / "mismatches.bcf"
    write_bcf(path, moved, "Tower & annex", WHEN, version="2.1", new={2: NewElement(NEW, "updated.ifc")})
    return path


@pytest.fixture
def opened():
    """Reads a file with bcf-client, and closes it after the test."""
    pytest.importorskip("bcf")
    held = []

    def read(path, module="bcf.v3.bcfxml"):
        held.append(importlib.import_module(module).BcfXml.load(path))
        return held[-1]

    yield read
    for one in held:
        one.close()


def content_of(path):
    """The files of an archive by name."""
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name) for name in archive.namelist()}


def by_index(read):
    """Topics in the order of the mismatches, without that of all of them."""
    topics = sorted(read.topics.values(), key=lambda topic: topic.topic.index)
    return [topic for topic in topics if topic.topic.topic_type != OVERVIEW]


def only(items):
    (item,) = items
    return item
