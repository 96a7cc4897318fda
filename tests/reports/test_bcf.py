"""BCF files: valid by the schemas, read back by another reader as they were meant, and topics that say it in words."""

import os
import re
import subprocess
import sys
import zipfile
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from jaxmm.reports.bcf import write_bcf
from jaxmm.reports.bcf_layouts import AUTHOR
from jaxmm.reports.bcf_topics import topics_of
from jaxmm.verdicts.results import PriorFile
from tests.cases.bcf_case import WHEN, by_index, content_of, only
from tests.cases.bcf_schema import check_schema

HOSTILE = "a\x00\x0b<b & \"c\" 'd' ]]> \ud800\uffff ü 柱 \U0001f9f1\r\n\te " + "x" * 5000
pytest_plugins = ["tests.cases.bcf_case"]  # its fixtures: moved, written, opened


def test_file_is_valid(written):
    check_schema(content_of(written))


@pytest.mark.parametrize(
    "file, old, new",
    [
        ("bcf.version", b'VersionId="3.0"', b""),
        ("project.bcfp", b"ProjectId=", b"ProjektId="),
        ("extensions.xml", b"<User>jaxmm</User>", b"<User> </User>"),
        ("markup.bcf", b"TopicStatus=", b"Status="),
        ("markup.bcf", b'IfcProject="', b'IfcProject="-'),
        ("markup.bcf", b"<Filename>room.ifc", b"<Filename> "),
        ("markup.bcf", b"<Title>", b"<Index>0</Index><Title>"),
        ("markup.bcf", b"15Z</CreationDate>", b"15 o'clock</CreationDate>"),
        ("markup.bcf", b"<Label>", b"words <Label>"),
        ("viewpoint.bcfv", b'IfcGuid="', b'IfcGuid="x'),
        ("viewpoint.bcfv", b"<FieldOfView>60.0", b"<FieldOfView>180.0"),
        ("viewpoint.bcfv", b"<AspectRatio>1.3", b"<AspectRatio>-1.3"),
        ("viewpoint.bcfv", b"<X>", b"<X>nan"),
        ("viewpoint.bcfv", b"PerspectiveCamera>", b"OrthogonalCamera>"),
    ],
)
def test_check_of_the_schema_finds_what_is_wrong(written, file, old, new):
    content = content_of(written)
    name = next(name for name in content if name.endswith(file))
    assert old in content[name]
    content[name] = content[name].replace(old, new)
    with pytest.raises((AssertionError, ValueError)):
        check_schema(content)


def test_file_without_mismatches_is_valid_and_has_no_topics(moved, opened, tmp_path):
    write_bcf(tmp_path / "none.bcf", moved._replace(mismatches=(), scans=()))
    check_schema(content_of(tmp_path / "none.bcf"))
    assert not opened(tmp_path / "none.bcf").topics


def test_another_reader_reads_back_what_was_written(moved, written, opened):
    read = opened(written)
    assert (read.version.version_id, read.project.name) == ("3.0", "Tower & annex")
    assert len(read.topics) == len(moved.mismatches) + 1
    for one, sentence, topic in zip(moved.mismatches, moved.sentences, by_index(read), strict=True):
        told = topic.topic
        x, y = one.center[:2]
        assert told.title.startswith(f"{one.mismatch_type.capitalize()} {one.object_type}")
        assert told.title.endswith(f"at x {x:.2f}, y {y:.2f} m") and "[" not in told.title
        assert sentence in told.description
        assert told.labels.label[:2] == [one.object_type, one.mismatch_type]
        assert told.creation_date.to_datetime() == WHEN


def test_header_names_the_file_that_was_compared_with(moved, written, opened, tmp_path):
    assert len(moved.prior.project) == 22
    for topic in by_index(opened(written)):
        file = only(topic.header.files.file)
        assert (file.filename, file.ifc_project, file.is_external) == ("room.ifc", moved.prior.project, True)
    for prior, name in (
        (PriorFile("a\x00 & <b>.obj", "mesh", 1.0), "a\ufffd & <b>.obj"),
        (PriorFile("\udcff.ifc", "ifc", 0.001, "no GlobalId"), "\ufffd.ifc"),
    ):
        write_bcf(tmp_path / "named.bcf", moved._replace(prior=prior))
        check_schema(content_of(tmp_path / "named.bcf"))
        for topic in by_index(opened(tmp_path / "named.bcf")):
            file = only(topic.header.files.file)
            assert (file.filename, file.ifc_project) == (name, None)
    write_bcf(tmp_path / "arrays.bcf", moved._replace(prior=None))
    check_schema(content_of(tmp_path / "arrays.bcf"))
    assert all(topic.header is None for topic in by_index(opened(tmp_path / "arrays.bcf")))


def test_every_word_of_a_topic_is_declared(written, opened):
    read = opened(written)
    words = read.extensions
    for topic in (topic.topic for topic in read.topics.values()):
        assert topic.topic_type in words.topic_types.topic_type
        assert topic.topic_status in words.topic_statuses.topic_status
        assert topic.priority in words.priorities.priority
        assert set(topic.labels.label) <= set(words.topic_labels.topic_label)
        assert topic.creation_author in words.users.user == [AUTHOR]


@pytest.mark.parametrize(
    "probability, words",
    [(1.0, "1.000"), (0.99951, "more than 0.999"), (0.9994, "0.999"), (0.0004, "less than 0.001"), (0.0, "0.000")],
)
def test_what_is_nearly_sure_is_not_called_sure(moved, probability, words):
    sure = moved._replace(
        mismatches=tuple(one._replace(probability=probability) for one in moved.mismatches),
        elements=tuple(one._replace(probability=probability) for one in moved.elements),
    )
    topics = topics_of(sure, "")
    assert len(topics) == 3 and all(f"that this is real is {words}." in topic.description for topic in topics)
    assert sum(f"that it was removed is {words}." in topic.description for topic in topics) == 2


def test_description_says_how_sure_and_why(moved):
    wall, pillar, again = topics_of(moved, "")
    told = next(one for one in moved.elements if one.guid == moved.mismatches[1].element)
    assert "The probability that this is real is 0.970." in pillar.description
    assert f"{moved.mismatches[1].observable_fraction:.0%} could be observed" in pillar.description
    for part in (
        told.name,
        told.guid,
        told.storey,
        f"{told.points} points",
        "90 through, 2 support, 8 blocked, 0 unseen",
    ):
        assert part in pillar.description
    assert "robot.ply" in wall.description
    turned = moved._replace(mismatches=(moved.mismatches[0]._replace(rotation=78.24), *moved.mismatches[1:]))
    straight = moved._replace(mismatches=(moved.mismatches[0]._replace(rotation=0.2), *moved.mismatches[1:]))
    assert "turned by 78.2° counter-clockwise" in topics_of(turned, "")[0].description
    assert "turned by" not in topics_of(straight, "")[0].description
    square = straight.mismatches[0]._replace(rotation=-89.8, dimensions=np.array([0.4, 0.4, 3.0]))
    assert "turned by" not in topics_of(straight._replace(mismatches=(square,)), "")[0].description
    oblong = square._replace(dimensions=np.array([0.4, 0.5, 3.0]))
    assert "turned by 89.8° clockwise" in topics_of(straight._replace(mismatches=(oblong,)), "")[0].description
    assert "observed" not in again.description and "Element of the model" not in again.description
    assert [topic.priority for topic in (wall, pillar, again)] == ["High", "High", "Normal"]


def test_moved_pairs_are_related_both_ways_and_nothing_else_is(moved, written, opened):
    wall, pillar, again = by_index(opened(written))
    assert wall.topic.related_topics is None
    assert only(pillar.topic.related_topics.related_topic).guid == again.guid
    assert only(again.topic.related_topics.related_topic).guid == pillar.guid
    assert moved.sentences[2] in pillar.topic.description and moved.sentences[1] in again.topic.description
    assert ["moved" in topic.topic.labels.label for topic in (wall, pillar, again)] == [False, True, True]


def test_same_input_gives_the_same_bytes_and_later_only_another_date(moved, written, tmp_path):
    write_bcf(tmp_path / "zone.bcf", moved, "Tower & annex", WHEN.astimezone(timezone(timedelta(hours=-7))))
    write_bcf(tmp_path / "naive.bcf", moved, "Tower & annex", WHEN.replace(tzinfo=None))
    assert (tmp_path / "zone.bcf").read_bytes() == (tmp_path / "naive.bcf").read_bytes() == written.read_bytes()
    write_bcf(tmp_path / "now.bcf", moved, "Tower & annex")
    old, new = content_of(written), content_of(tmp_path / "now.bcf")
    assert list(old) == list(new)
    date = re.compile(rb"<CreationDate>(.*)Z</CreationDate>")
    for name in old:
        assert date.sub(b"", old[name]) == date.sub(b"", new[name])
    name = next(name for name in new if name.endswith("markup.bcf"))
    stamp = datetime.fromisoformat(date.search(new[name])[1].decode()).replace(tzinfo=UTC)
    assert timedelta(0) <= datetime.now(UTC) - stamp < timedelta(minutes=5)


def test_guids_name_the_project_and_the_place_and_never_clash(moved):
    def guids(detection, project="a"):
        return [topic.guid for topic in topics_of(detection, project)]

    first = moved.mismatches[0]
    surer = moved._replace(mismatches=(first._replace(probability=0.5), *moved.mismatches[1:]))
    assert guids(surer) == guids(moved)
    assert not set(guids(moved)) & set(guids(moved, "b"))
    elsewhere = first._replace(center=first.center + np.array([0.0, 0.0, 0.1]))
    twice = moved._replace(mismatches=(first, elsewhere, first._replace(rotation=5.0), first, first))
    assert len(set(guids(twice))) == 5 and guids(twice)[0] == guids(moved)[0]
    pair = (first, first._replace(rotation=5.0))
    assert guids(moved._replace(mismatches=pair)) == guids(moved._replace(mismatches=pair[::-1]))[::-1]


def test_names_of_any_kind_stay_valid_and_short(moved, opened, tmp_path):
    wall, pillar, again = moved.mismatches
    hostile = tuple(
        one._replace(guid=HOSTILE if one.guid == wall.element else one.guid, name=HOSTILE, storey=HOSTILE, ifc_class="")
        for one in moved.elements
    )
    scan = moved.scans[0]._replace(file=HOSTILE)
    told = moved._replace(
        mismatches=(wall._replace(element=HOSTILE), pillar, again._replace(element="nobody's")),
        elements=hostile, scans=(scan,),
    )  # fmt: skip
    path = tmp_path / "hostile.bcf"
    write_bcf(path, told, HOSTILE, WHEN)
    check_schema(content_of(path))
    read = opened(path)
    assert read.project.name.startswith("a\ufffd\ufffd<b & \"c\" 'd' ]]> \ufffd\ufffd ü 柱 \U0001f9f1 e xxx")
    assert len(read.project.name) == 200
    for topic in by_index(read):
        assert len(topic.topic.description) < 1500
    assert "柱 \U0001f9f1 e x" in by_index(read)[0].topic.description
    first = only(by_index(read)[0].viewpoints.values()).visualization_info
    assert first.components.selection is None and len(first.lines.line) == 12
    write_bcf(path, moved, "\n ", WHEN)
    check_schema(content_of(path))
    assert opened(path).project.name is None


def test_archive_is_as_readers_expect(written):
    with zipfile.ZipFile(written) as archive:
        entries = archive.infolist()
    names = [entry.filename for entry in entries]
    assert len(set(names)) == len(names) == 3 + 4 * (3 + 1)
    assert all(entry.date_time == (1980, 1, 1, 0, 0, 0) for entry in entries)
    for name in names:  # every folder is listed, before what is in it
        folder, slash, _ = name.rpartition("/")
        assert not slash or names.index(f"{folder}/") <= names.index(name)
    assert "\\" not in "".join(names)


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(moved, tmp_path, monkeypatch):
    path = tmp_path / "mismatches.bcf"
    path.write_text("old")
    count, write = iter(range(100)), zipfile.ZipFile.writestr

    def full(archive, entry, data):
        if next(count) == 6:
            raise OSError(28, "No space left on device")
        write(archive, entry, data)

    monkeypatch.setattr(zipfile.ZipFile, "writestr", full)
    with pytest.raises(OSError, match=r"mismatches\.bcf"):
        write_bcf(path, moved)
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["mismatches.bcf"]
    monkeypatch.undo()
    write_bcf(path, moved)
    assert zipfile.is_zipfile(path) and os.listdir(tmp_path) == ["mismatches.bcf"]


def test_mismatches_without_a_scan_are_refused_and_nothing_is_written(moved, tmp_path):
    with pytest.raises(ValueError, match="at least one scan"):
        write_bcf(tmp_path / "mismatches.bcf", moved._replace(scans=()))
    assert not os.listdir(tmp_path)


def test_writing_needs_no_reader():
    """bcf-client is only the witness here: its licence is not ours."""
    code = "import sys, jaxmm.reports.bcf; sys.exit(bool({'bcf', 'xsdata', 'ifcopenshell'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
