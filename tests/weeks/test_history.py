"""What becomes of elements: the four weeks of the case, and what is always true."""

import random

import pytest

from jaxmm.verdicts.verdicts import VERDICTS
from jaxmm.weeks.history import STANDING, STATES, UNKNOWN, follow
from jaxmm.weeks.reports import read_weeks
from jaxmm.weeks.shares import shares_of
from tests.cases.four_weeks import DATES, SEEN, changed, element, report, write_reports
from tests.cases.four_weeks import STATES as EXPECTED


@pytest.fixture(scope="module")
def four(tmp_path_factory):
    return follow(read_weeks(write_reports(tmp_path_factory.mktemp("four"))))


def by_name(progress):
    return {one.latest.name: one for one in progress.elements}


def test_states_week_by_week(four):
    assert {name: tuple(moment.state for moment in one.moments) for name, one in by_name(four).items()} == EXPECTED


@pytest.mark.parametrize(
    "name, first, not_before, last, removed, displaced, since",
    [
        ("A1", 0, None, 2, None, None, 2),
        ("A2", 0, None, 0, None, None, 0),
        ("A3", 1, 0, 2, 3, None, 3),
        ("A4", 2, 1, 3, None, None, 3),
        ("B1", 2, 1, 3, None, None, 3),
        ("B2", 2, 1, 3, None, 2, 3),
        ("B3", None, None, None, None, None, 2),
        ("B4", None, None, None, None, None, None),
    ],
)
def test_when(four, name, first, not_before, last, removed, displaced, since):
    one = by_name(four)[name]
    found = one.first_seen, one.not_before, one.last_seen, one.removed, one.displaced, one.moments[-1].since
    assert found == (first, not_before, last, removed, displaced, since)


def test_built_is_told_only_where_a_week_before_saw_that_it_was_not_there(four):
    told = {name: one.told_changes for name, one in by_name(four).items()}
    assert told["A1"] == told["A2"] == [(0, "not seen", "first seen to stand")]
    assert told["B1"] == [(1, "not seen", "not built"), (2, "not built", "built")]
    assert told["B2"][1:] == [(2, "not built", "displaced")]
    for name, one in by_name(four).items():
        new = [becomes for _, _, becomes in told[name] if becomes == "built"]
        assert bool(new) == (one.first_seen is not None and one.not_before is not None and name != "B2"), name


def test_what_is_first_seen_off_its_place_is_told_so(tmp_path):
    seen = {"A1": "uudd", "A2": "uuup"}
    one, two = follow(read_weeks(write_reports(tmp_path, [report(week, seen) for week in range(4)]))).elements
    assert one.told_changes == [(2, "not seen", "first seen to stand, displaced")]
    assert two.told_changes == [(3, "not seen", "first seen to stand")]


def test_only_what_moved_beyond_both_intervals_moved(four):
    assert by_name(four)["B2"].moved == (pytest.approx(0.029), 2, 3)
    assert by_name(four)["A1"].moved is None  # 1 mm within 4
    assert [moment.offset is None for moment in by_name(four)["A1"].moments] == [False, False, True, True]


def test_shares_count_every_element_once(four):
    shares = shares_of(four)
    for week in range(4):
        by_kind = {}
        for one in shares:
            if one.week == week:
                by_kind.setdefault(one.kind, []).append(one)
        (whole,) = by_kind["all"]
        assert whole.elements == len(SEEN)
        for kind in ("class", "storey"):
            assert sum(one.elements for one in by_kind[kind]) == whole.elements
            assert sum(one.done for one in by_kind[kind]) == whole.done
        assert whole.done == sum(states[week] in STANDING for states in EXPECTED.values())
        assert whole.at_most == (whole.done + sum(states[week] == UNKNOWN for states in EXPECTED.values())) / 9
    assert [one.name for one in shares if one.kind == "storey" and one.week == 0] == ["Ground floor", "Upper floor"]


def random_reports(rng: random.Random, weeks: int):
    """Any verdicts on any elements; each has one place, and may be left out now and then."""
    names = [f"{kind}{number}" for kind in "AB" for number in (1, 2, 3, 4)]
    contents = []
    for week in range(weeks):
        content = report(week)
        listed = [name for name in names if rng.random() < 0.9] or names[:1]
        content["elements"] = [element(name, rng.choice(VERDICTS), rng.choice([None, rng.random()])) for name in listed]
        contents.append(content)
    return contents


@pytest.mark.parametrize("seed", range(25))
def test_what_is_always_true(tmp_path, seed):
    rng = random.Random(seed)
    contents = random_reports(rng, 4)
    paths = write_reports(tmp_path, contents)
    progress = follow(read_weeks(paths))
    shuffled = rng.sample(paths, len(paths))
    assert follow(read_weeks(shuffled)) == progress  # the order in which they are given says nothing
    listed = {one["guid"] for content in contents for one in content["elements"]}
    assert {one.latest.guid for one in progress.elements} == listed and len(progress.elements) == len(listed)
    for one in progress.elements:
        state, since = UNKNOWN, None
        for week, moment in enumerate(one.moments):
            told = moment.verdict in ("present", "displaced", "removed")
            assert moment.told == told and moment.state in STATES
            if told:
                since = week
                assert (moment.state in STANDING) == (moment.verdict != "removed")
            else:
                assert moment.state == state  # it keeps what it was
            assert moment.since == since
            state = moment.state
        assert (one.first_seen is None) == (one.last_seen is None) == all(m.state not in STANDING for m in one.moments)
        assert (one.removed is not None) == (one.state == "removed")
        assert (one.displaced is not None) == (one.state == "displaced")
        if one.removed is not None:
            assert one.last_seen < one.removed
    for share in shares_of(progress):
        assert sum(share.counts.values()) == share.elements >= share.done
        assert share.elements == 0 or 0.0 <= share.at_least <= share.at_most <= 1.0


@pytest.mark.parametrize("seed", range(10))
def test_a_week_that_sees_nothing_changes_nothing(tmp_path, seed):
    rng = random.Random(seed)
    contents = random_reports(rng, 3)
    blind = {one["guid"]: one for content in contents for one in content["elements"]}
    blind = [changed(one, ("verdict",), rng.choice(("occluded", "unscanned"))) for one in blind.values()]
    for one in blind:
        one["deviation"] = None
    place = rng.randrange(4)
    date = ("2026-03-01", "2026-03-05", "2026-03-12", "2026-03-20")[place]
    content = report(0) | {"date": date, "elements": blind, "mismatches": []}
    before = follow(read_weeks(write_reports(tmp_path / "a", contents)))
    after = follow(read_weeks(write_reports(tmp_path / "b", [*contents, content])))
    old = {one.key: one for one in before.elements}
    assert {one.key for one in after.elements} == old.keys()
    for one in after.elements:
        assert one.state == old[one.key].state
        shift = [week if week < place else week + 1 for week in range(3)]
        for name in ("first_seen", "not_before", "last_seen", "removed", "displaced"):
            value = getattr(old[one.key], name)
            if name in ("removed", "displaced") and value is not None:
                assert getattr(one, name) in (shift[value], place)  # a run may begin in it only by going on
            else:
                assert getattr(one, name) == (None if value is None else shift[value])


def test_an_element_that_left_the_model_does_not_count(tmp_path):
    gone = report(2)
    gone["elements"] = [one for one in gone["elements"] if one["name"] != "B3"]
    gone["prior"] = gone["prior"] | {"sha256": "cd" * 32, "file": "house-2.ifc"}
    progress = follow(read_weeks(write_reports(tmp_path, [report(0), report(1), gone])))
    assert [moment.in_model for moment in by_name(progress)["B3"].moments] == [True, True, False]
    totals = [one.elements for one in shares_of(progress) if one.kind == "all"]
    assert totals == [9, 9, 8]
    assert any("0 elements are new, 1 are no longer in it, 8 are in both" in note for note in progress.notes)


def test_a_class_that_nobody_asked_for_stays_in_the_model(tmp_path):
    walls = report(1)
    walls["elements"] = [one for one in walls["elements"] if one["name"] != "C"]
    progress = follow(read_weeks(write_reports(tmp_path, [report(0), walls, report(2)])))
    assert all(moment.in_model for moment in by_name(progress)["C"].moments)
    assert not progress.notes


def test_what_comes_back_and_what_is_in_doubt_is_said(tmp_path):
    contents = [report(week, {"A1": "prpp", "A2": "pppp"}) for week in range(3)]
    contents[1]["scans"][0]["doubts"] = ["it does not fit\n\x1b[31m"]
    progress = follow(read_weeks(write_reports(tmp_path, contents)))
    assert any("seen again in a later one: 'A1'" in note for note in progress.notes)
    assert any(note.startswith(DATES[1]) and "in doubt" in note for note in progress.notes)
    assert all(note.isprintable() for note in progress.notes)
