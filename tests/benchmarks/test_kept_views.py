"""What was told of views stays: a run that was ended goes on where it was, whatever it was writing."""

import pytest

from benchmarks.views.kept_views import KeptViews


def test_a_run_that_was_ended_while_it_wrote_goes_on(tmp_path):
    path = tmp_path / "kept.jsonl"
    first = KeptViews(path)
    for number in range(2):
        first.add(("rooms", "tls", number), {"elements": [{"off": 0.25, "number": number}]})
    path.write_text(path.read_text()[:-9])
    again = KeptViews(path)
    assert again.has(("rooms", "tls", 0)) and not again.has(("rooms", "tls", 1))
    again.add(("rooms", "tls", 1), {"elements": []})
    assert dict(KeptViews(path).items()) == {
        ("rooms", "tls", 0): {"elements": [{"off": 0.25, "number": 0}]},
        ("rooms", "tls", 1): {"elements": []},
    }


def test_without_a_file_nothing_is_kept_for_another_run():
    one = KeptViews()
    one.add(("rooms", 1), {})
    assert one.has(("rooms", 1)) and not KeptViews().has(("rooms", 1))


def test_each_place_is_met_in_a_way_that_is_drawn_and_each_way_as_often_as_asked():
    deviations = pytest.importorskip("benchmarks.deviations")
    for sensor in ("tls-real", "velodyne-16-real"):
        kinds = [deviations.drawn(7, sensor, number) for number in range(18)]
        assert sorted(kinds[:9]) == sorted(kinds[9:]) == sorted(deviations.TURNS) and kinds[:9] != kinds[9:]
    assert kinds != [deviations.drawn(7, "tls-real", number) for number in range(18)]
