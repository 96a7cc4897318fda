"""report.json: whatever was found, it is valid against the schema that ships; it and tables say the same numbers."""

import copy
import csv
import io
import json
import math
from pathlib import Path

import numpy as np
import pytest

import jaxmm
from jaxmm.classes.unexplained import Unexplained
from jaxmm.deviations.deviation import Deviation
from jaxmm.formats.dates import Taken
from jaxmm.learning.element_boxes import UprightBox
from jaxmm.rays.evidence import FRACTIONS
from jaxmm.reports.markdown import as_markdown
from jaxmm.reports.plain_files import elements_csv, mismatches_csv
from jaxmm.reports.report_json import to_json
from jaxmm.verdicts.results import (
    Detection,
    Drawing,
    ElementVerdict,
    Mismatch,
    PriorFile,
    ScanRecord,
    counted,
    notes_on,
)
from jaxmm.verdicts.verdicts import VERDICTS
from tests.cases.detections import true_case

jsonschema = pytest.importorskip("jsonschema")
SCHEMA = json.loads((Path(jaxmm.__file__).parent / "report_schema.json").read_text(encoding="utf-8"))
NAMES = (
    "",
    "Wand 3",
    "Stütze\n\u2028Ost",
    '"=1+1"',
    "柱",
    "a|b`<i>",
    "\udcff\udc00",
    "\U0001f3e0",
    "x" * 3000,
    "a\x00b",
)


NEARLY = np.nextafter(np.float32(1.0), np.float32(0.0))
SURE_AND_TOLD = (
    (1.0 - 3e-7, 0.999999),
    (NEARLY, 0.999999),
    (3e-7, 1e-6),
    (1.0, 1.0),
    (0.0, 0.0),
    (0.1234567, 0.123457),
)


def random_detection(seed: int) -> Detection:
    """Anything that its types allow: numbers that are none, places at the end of the world, names of all kinds."""
    rng = np.random.default_rng(seed)
    odd = (math.nan, math.inf, -math.inf, -0.0, 1e-300, 7.5e9, -7.5e9, 0.1 + 0.2)

    def real() -> float:
        return float(odd[rng.integers(len(odd))] if rng.random() < 0.3 else rng.normal(0, 1e5))

    def share() -> float:
        return math.nan if rng.random() < 0.1 else float(np.float32(rng.random()))

    def name() -> str:
        return NAMES[rng.integers(len(NAMES))]

    def maybe(value):
        return value if rng.random() < 0.5 else None

    def pose():
        return tuple(real() for _ in range(5))

    def count() -> np.int64:
        return rng.integers(0, 2**40)

    def triple():
        return tuple(real() for _ in range(3))

    def deviation():
        interval = tuple(maybe((real(), real())) for _ in range(3))
        classes = {"loa": "LOA30", "din18202": ("within", "beyond", "open")[rng.integers(3)]}
        found = Deviation(
            triple(), interval, real(), triple(), maybe(real()), maybe(real()), real(), real(), 7, classes
        )
        return found._replace(half=real(), scans=(0, 1))

    mismatches = tuple(
        Mismatch(
            ("pillar", "wall")[rng.integers(2)], ("added", "removed")[rng.integers(2)],
            np.array([real() for _ in range(3)]), np.abs([real() for _ in range(3)]), real(), share(), maybe(name()),
            maybe(int(rng.integers(5))), maybe(share()), ("rectangular", "round")[rng.integers(2)],
            type_probability=maybe(share()),
        )
        for _ in range(rng.integers(4))
    )  # fmt: skip
    elements = tuple(
        ElementVerdict(
            name(), name(), name(), name(), VERDICTS[rng.integers(5)], share(), count(),
            tuple(count() for _ in range(4)),
            maybe(pose()), maybe(deviation()),
            maybe(UprightBox(triple(), tuple(abs(real()) for _ in range(3)), real())),
        )
        for _ in range(rng.integers(5))
    )  # fmt: skip
    scans = tuple(
        ScanRecord(
            name(), count(), pose(), ("given", "file", "estimated", "searched")[rng.integers(4)], maybe(pose()),
            {"shift": real(), "residual": np.float32(real())}, dict(zip(VERDICTS, rng.integers(0, 9, 5), strict=True)),
            (name(),), taken=maybe(Taken("2026-03-02T14:30:00Z", "header")),
        )
        for _ in range(1 + rng.integers(3))
    )  # fmt: skip
    settings = {name(): [real(), {"deep": np.array([real()])}], "on": np.bool_(True), "none": None}
    none = np.zeros((0, 3), np.float32)
    drawing = Drawing(
        np.zeros(3), none, none[:, 0], none[:, 0].astype(np.uint8), none[:, 0].astype(np.int32), none, none[:, 0],
        none[:, 0].astype(np.uint8), none[:, 0].astype(np.int32), (), None, None, None, (none,) * len(scans),
    )  # fmt: skip
    timing = {"total": abs(real()), "none": math.nan}
    prior = maybe(
        PriorFile(name(), ("ifc", "mesh", "cloud")[rng.integers(3)], 10.0 ** rng.uniform(-6, 3), maybe(name()))
    )
    return Detection(
        mismatches,
        elements,
        scans,
        {"residual": real()},
        settings,
        timing,
        (name(),),
        drawing,
        prior,
        maybe("2026-03-02"),
    )


@pytest.fixture(scope="module")
def true_report(tmp_path_factory):
    return to_json(true_case(tmp_path_factory.mktemp("case")).detection)


def is_same(told, value: float) -> bool:
    return told is None if not math.isfinite(value) else abs(told - value) <= 1e-6 * max(1.0, abs(value))


def test_the_schema_is_one_and_takes_a_true_report(true_report):
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    jsonschema.validate(true_report, SCHEMA)
    assert true_report["mismatches"] and true_report["elements"] and true_report["scans"]


def test_every_detection_gives_a_valid_report():
    validator = jsonschema.Draft202012Validator(SCHEMA)
    for seed in range(300):
        report = json.loads(json.dumps(to_json(random_detection(seed)), allow_nan=False))
        assert [error.message for error in validator.iter_errors(report)] == []


def test_what_is_nearly_sure_is_not_told_as_sure():
    for sure, told in SURE_AND_TOLD:
        detection = random_detection(2)
        detection = detection._replace(
            mismatches=tuple(one._replace(probability=sure, moved_from=None) for one in detection.mismatches),
            elements=tuple(one._replace(probability=sure) for one in detection.elements),
        )
        assert detection.mismatches and detection.elements
        report = to_json(detection)
        assert {one["probability"] for one in report["mismatches"] + report["elements"]} == {told}
        tables = {"probability": mismatches_csv(detection.mismatches)}
        tables["probability_removed"] = elements_csv(detection.elements)
        for column, table in tables.items():
            assert {float(row[column]) for row in csv.DictReader(io.StringIO(table))} == {told}


def test_the_report_says_the_numbers_of_the_detection():
    for seed in range(100):
        detection = random_detection(seed)
        report = json.loads(json.dumps(to_json(detection)))
        for told, one in zip(report["mismatches"], detection.mismatches, strict=True):
            pairs = [
                *zip(told["center"], one.center, strict=True),
                *zip(told["dimensions"], one.dimensions, strict=True),
            ]
            pairs += [(told["rotation"], one.rotation), (told["probability"], one.probability)]
            assert all(is_same(a, b) for a, b in pairs)
            assert (told["element"], told["moved_from"]) == (one.element, one.moved_from)
        for told, one in zip(report["elements"], detection.elements, strict=True):
            assert (told["guid"], told["name"], told["verdict"]) == (one.guid, one.name, one.verdict)
            assert told["evidence"] == {"points": one.points, **dict(zip(FRACTIONS, one.rays, strict=True))}
            assert (told["next_view"] is None) == (one.next_view is None)
        for told, one in zip(report["scans"], detection.scans, strict=True):
            assert all(is_same(a, b) for a, b in zip(told["pose"], one.pose, strict=True))
            assert told["told"] == one.told and told["file"] == one.file
        assert (report["prior"] is None) == (detection.prior is None)
        if detection.prior:
            assert report["prior"].pop("files") == []
            assert PriorFile(**report["prior"]) == detection.prior
        assert report["sentences"] == list(detection.sentences) and len(report["sentences"]) == len(
            detection.mismatches
        )


@pytest.mark.parametrize(
    "place, value",
    [
        pytest.param(("mismatches", 0, "probability"), 1.5, id="probability above 1"),
        pytest.param(("mismatches", 0, "center"), [0.0, 0.0], id="a place of two numbers"),
        pytest.param(("mismatches", 0, "object_type"), "door", id="a type that boxes do not have"),
        pytest.param(("mismatches", 0, "moved_from"), -1, id="index below 0"),
        pytest.param(("mismatches", 0, "extra"), 0, id="unknown key"),
        pytest.param(("elements", 0, "verdict"), "gone", id="unknown verdict"),
        pytest.param(("elements", 0, "evidence"), {"points": 1}, id="evidence without rays"),
        pytest.param(("elements", 0, "next_view"), [0.0] * 4, id="pose of four numbers"),
        pytest.param(("scans", 0, "told"), {"moved": 1}, id="told of no verdict"),
        pytest.param(("date",), "last week", id="a date that is none"),
        pytest.param(("format",), 3, id="a format to come"),
        pytest.param(("prior", "kind"), "dwg", id="unknown kind of prior"),
        pytest.param(("prior", "unit"), 0.0, id="a unit without length"),
        pytest.param(("prior", "folder"), "/home", id="more of the prior than its name"),
        pytest.param(("sentences",), [1], id="a sentence that is a number"),
        pytest.param(("guesses",), [], id="unknown block"),
    ],
)
def test_the_schema_refuses_what_is_wrong(true_report, place, value):
    report = copy.deepcopy(true_report)
    *above, last = place
    inner = report
    for step in above:
        inner = inner[step]
    inner[last] = value
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(report, SCHEMA)


def test_the_schema_misses_every_key_that_is_left_out(true_report):
    blocks = [
        true_report,
        true_report["prior"],
        *(true_report[name][0] for name in ("mismatches", "elements", "scans")),
    ]
    for block in blocks:
        for name in list(block):
            value = block.pop(name)
            assert not jsonschema.Draft202012Validator(SCHEMA).is_valid(true_report), name
            block[name] = value


def test_what_several_files_hold_counts_once():
    def element(file, guid, verdict="present", **more):
        return ElementVerdict(guid, "", "", "", verdict, 0.0, 0, (0, 0, 0, 0))._replace(file=file, **more)

    elements = (
        element("a.ifc", "wall", same_as=(("b.ifc", "wall"),)),
        element("b.ifc", "wall", same_as=(("a.ifc", "wall"),)),
        element("a.ifc", "whole", "removed", parts=(("b.ifc", "left"), ("b.ifc", "right"))),
        element("b.ifc", "left", "removed"),
        element("b.ifc", "right", "removed"),
        element("a.ifc", "stair", parts=(("a.ifc", "flight"),)),  # whose flight is of its own file, and of no verdict
    )
    found = random_detection(0)._replace(mismatches=(), elements=elements, unexplained=())
    assert [one.guid for one in counted(elements)] == ["wall", "left", "right", "stair"]
    assert found.count("present") == 2 and found.count("removed") == 2
    told = "of 4 elements, 2 more being the same in other files: 2 present, 2 removed, 0 occluded, 0 unscanned"
    assert found.summary() == f"no mismatch; {told}"
    assert "2 of them are others of these again, in another file." in as_markdown(found)
    assert "of these again" not in as_markdown(found._replace(elements=elements[3:]))
    # A whole may be off its place as one body where none of its pieces surely is.
    moved = (elements[2]._replace(verdict="displaced"), *(one._replace(verdict="present") for one in elements[3:]))
    assert [one.guid for one in counted(moved)] == ["whole", "stair"]
    assert found._replace(elements=moved).count("displaced") == 1


def test_the_summary_counts():
    wall = Mismatch("wall", "added", np.zeros(3), np.ones(3), 0.0, 0.9)
    elements = tuple(ElementVerdict("", "", "", "", name, 0.0, 0, (0, 0, 0, 0)) for name in ("present", "removed") * 2)
    detection = random_detection(0)._replace(
        mismatches=(wall, wall, wall._replace(object_type="pillar")), elements=elements, unexplained=()
    )
    assert (
        detection.summary()
        == "1 pillar added, 2 walls added; of 4 elements 2 present, 2 removed, 0 occluded, 0 unscanned"
    )
    nothing = detection._replace(mismatches=(), elements=(), unexplained=())
    assert nothing.summary() == "no mismatch"
    thing = Unexplained(np.zeros(3), np.ones(3), 0.0, 9)
    for count, told in ((1, "1 other thing is not in the model"), (2, "2 other things are not in the model")):
        assert nothing._replace(unexplained=(thing,) * count).summary() == f"no mismatch; {told}"
    assert detection.sentences[0] == "A wall has been added at [0. 0. 0.] with dimensions [1. 1. 1.]."


def test_notes_tell_of_which_removed_elements_a_part_may_stand():
    def gone(name, standing):
        return Mismatch("wall", "removed", np.zeros(3), np.ones(3), 0.0, 0.7, name, standing=standing)

    there = ElementVerdict("there", "IfcWall", "north", "", "present", 0.01, 50, (0, 90, 9, 9))
    half = ElementVerdict("half", "IfcWall", "a\n\x1b[31mb", "", "removed", 0.7, 50, (60, 40, 9, 9))
    assert notes_on((gone("whole", 0.19),), (there,)) == ()
    (line,) = notes_on((gone("whole", 0.0), gone("half", 0.4)), (there, half))
    assert line.startswith("IfcWall 'a\\n") and line.isprintable() and "(half)" in line and "40%" in line
    assert len(notes_on((gone("half", 0.4),), (half,))) == 2  # and nothing is present
    many = notes_on(tuple(gone(str(number), 0.5) for number in range(80)), (there,))
    assert len(many) == 6 and "75 more" in many[-1]


def test_notes_tell_of_which_present_elements_a_part_may_be_gone():
    def there(through, support, name="wall"):
        return ElementVerdict(name, "IfcWall", "north", "", "present", 0.1, 50, (through, support, 9, 9))

    (line,) = notes_on((), (there(100, 400),))
    assert line == (
        "IfcWall 'north' (wall) is told to be present, but 20% of the rays that tell of it pass through its place: "
        "a part of it may be gone"
    )
    assert notes_on((), (there(99, 101), there(100, 401))) == ()
    hidden = there(300, 300)._replace(verdict="occluded")
    assert notes_on((), (hidden, there(0, 50))) == ()
    many = notes_on((), tuple(there(300, 400, str(number)) for number in range(8)))
    assert len(many) == 6 and many[-1] == "of 3 more present elements a part may be gone, too"


def test_its_text_is_one_line_without_arrays():
    detection = random_detection(3)
    assert repr(detection) == str(detection) == f"<Detection: {detection.summary()}>"
