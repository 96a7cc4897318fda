"""Many stations: the same bits wherever and in whatever order they are done, and nothing is done twice."""

import contextlib
import errno
import json
import os
import sys
from typing import NamedTuple

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from jaxmm.commands import detect_files
from jaxmm.commands.detect_files import detect
from jaxmm.formats.poses import GivenPose
from jaxmm.inputs import InputError, Misfit
from jaxmm.learning.prediction import read_judges
from jaxmm.reports.report_json import to_json
from jaxmm.stations import work_folder
from jaxmm.stations.records import SUFFIX, write_record
from jaxmm.stations.work_folder import Work
from jaxmm.verdicts import station_steps
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.priors import read_prior
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from tests.cases.box_building import scan_of, shell_of, table_of
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.sensors import Spinning

SENSOR = Spinning(channels=30, azimuth_steps=120, elevation_range=(-50.0, 50.0))
SHELL = shell_of(4.0, 3.0, 2.8)
GONE, NEW = ((1.5, 0.0, 1.4), (0.1, 1.5, 1.4), WALL), ((-1.5, 1.0, 1.4), (0.2, 0.2, 1.4), PILLAR)
PLACES = np.array([[-3.0, -2.0, 1.5], [3.0, 2.0, 1.4], [0.0, -2.0, 1.6]])
SETTINGS = DetectSettings(refine=False)


class Site(NamedTuple):
    """A model, scans of what stands there, and where they were taken from."""

    model: object
    scans: list
    poses: list


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    write_room(folder / "model.ifc", table_of((*SHELL, GONE)), 0)
    scans = []
    for number, place in enumerate(PLACES):
        scans.append(folder / f"{number}.npy")
        np.save(scans[-1], scan_of((*SHELL, NEW), place, SENSOR).scan.points)
    return Site(folder / "model.ifc", scans, [GivenPose(place, 0.0, 0.0) for place in PLACES])


@pytest.fixture(scope="module")
def one_by_one(site):
    """What is found in this process."""
    return detect(site.model, site.scans, site.poses, settings=SETTINGS)


def bits(detection):
    """All that is told, but for the time it took."""
    told = to_json(detection)
    del told["timing"]
    drawn = [one.tobytes() for one in detection.drawing if isinstance(one, np.ndarray)]
    return json.dumps(told), drawn, repr(detection.mismatches)


def by_hand(monkeypatch, order=lambda tasks: tasks, until=None):
    """Does tasks in this process, in an order, and counts them; a kill comes before one of them."""
    done = []

    def results(function, tasks):
        for task in order(list(tasks)):
            if len(done) == until:
                raise KeyboardInterrupt
            done.append(task)
            yield task, function(*task)

    @contextlib.contextmanager
    def engine(work, stations):
        yield results

    monkeypatch.setattr(detect_files, "engine_of", engine)
    return done


def test_stations_find_what_is_new_and_gone_as_scans_in_memory_do(site, one_by_one):
    assert {(one.mismatch_type, one.object_type) for one in one_by_one.mismatches} == {
        ("removed", "wall"), ("added", "pillar"),
    }  # fmt: skip
    prior, judges = read_prior(site.model), read_judges(DEFAULT)
    named = []
    for number, place in enumerate(PLACES):
        scan = scan_of((*SHELL, NEW), place, SENSOR)
        named.append(scan._replace(scan=scan.scan._replace(sensor=None), file=f"{number}.npy"))
    with threadpool_limits(limits=1, user_api="blas"):
        held = detect_scans(prior, named, judges, SETTINGS)
    dated = tuple(one._replace(taken=by.taken) for one, by in zip(held.scans, one_by_one.scans, strict=True))
    assert bits(held._replace(prior=one_by_one.prior, scans=dated, date=one_by_one.date)) == bits(one_by_one)


def test_the_order_of_finishing_and_the_number_of_workers_change_no_bit(site, one_by_one, monkeypatch):
    with monkeypatch.context() as patched:
        by_hand(patched, order=lambda tasks: tasks[::-1])
        assert bits(detect(site.model, site.scans, site.poses, settings=SETTINGS)) == bits(one_by_one)
    two = detect(site.model, site.scans, site.poses, settings=SETTINGS, work=Work(workers=2))
    assert bits(two) == bits(one_by_one)


@pytest.mark.long
def test_what_was_killed_goes_on_and_leaves_nothing_behind(site, one_by_one, monkeypatch, tmp_path):
    work = Work(folder=tmp_path / "work")

    def run(until=None, scans=site.scans):
        with monkeypatch.context() as patched:
            done = by_hand(patched, until=until)
            try:
                return done, detect(site.model, scans, site.poses, settings=SETTINGS, work=work)
            except KeyboardInterrupt:
                return done, None

    every, whole = run()
    assert bits(whole) == bits(one_by_one) and not work.folder.exists()
    for first in (1, len(every) * 2 // 3):
        done, nothing = run(first)
        assert nothing is None and len(done) == first and work.folder.exists()
        rest, found = run()
        assert len(rest) == len(every) - first and bits(found) == bits(one_by_one)
        assert not list(tmp_path.iterdir())


def test_what_is_done_stays_until_the_reports_are_written(site, monkeypatch, tmp_path):
    work = Work(folder=tmp_path / "work", leaves=True)
    with monkeypatch.context() as patched:
        by_hand(patched)
        found = detect(site.model, site.scans, site.poses, settings=SETTINGS, work=work)
        again = by_hand(patched)  # as after a kill in between
        assert bits(detect(site.model, site.scans, site.poses, settings=SETTINGS, work=work)) == bits(found)
        assert again == []
    work.clear()
    assert not list(tmp_path.iterdir())


def test_other_settings_begin_anew(site, monkeypatch, tmp_path):
    work = Work(folder=tmp_path / "work")
    with monkeypatch.context() as patched:
        by_hand(patched, until=2)
        with pytest.raises(KeyboardInterrupt):
            detect(site.model, site.scans, site.poses, settings=SETTINGS, work=work)
        done = by_hand(patched)
        other = DetectSettings(refine=False, least_probability=0.4)
        detect(site.model, site.scans, site.poses, settings=other, work=work)
    assert len({number for number, *_ in done[:3]}) == 3  # all stations from their first step


def test_a_bad_file_is_named_and_left_out_only_if_asked(site, tmp_path, monkeypatch):
    by_hand(monkeypatch)
    bad = tmp_path / "bad.npy"
    bad.write_bytes(b"nothing")
    scans = [site.scans[0], bad, *site.scans[2:]]
    with pytest.raises(InputError, match=r"^[^\n]*bad\.npy: [^\n]*$"):
        detect(site.model, scans, site.poses, settings=SETTINGS)
    found = detect(site.model, scans, site.poses, settings=SETTINGS, work=Work(keep_going=True))
    assert [one.file for one in found.scans] == ["0.npy", "2.npy"]
    (note,) = [one for one in found.notes if one.startswith("left out: ")]
    assert str(bad) in note
    without = detect(site.model, [scans[0], *scans[2:]], [site.poses[0], *site.poses[2:]], settings=SETTINGS)
    assert bits(found._replace(notes=without.notes)) == bits(without)
    with pytest.raises(InputError, match=r"bad\.npy"):
        detect(site.model, [bad, tmp_path / "none.npy"], site.poses[:2], settings=SETTINGS, work=Work(keep_going=True))
    far = site.poses[0]._replace(position=np.array([300.0, 0.0, 1.5]))
    with pytest.raises(InputError, match=r"0\.npy: the prior has nothing in view"):  # what ended it
        detect(site.model, [site.scans[0], bad], [far, far], work=Work(keep_going=True))


def test_what_fails_once_all_are_counted_ends_it_in_one_line(site, monkeypatch):
    """Though bad scans may be left out: what it showed of faces and poses is part of all results by then."""
    by_hand(monkeypatch)
    looks, look_at = [], station_steps.look_at

    def failing(*words):
        looks.append(words)
        if len(looks) == 2:
            raise ValueError("nothing to look at")
        return look_at(*words)

    monkeypatch.setattr(station_steps, "look_at", failing)
    with pytest.raises(InputError, match=r"^1\.npy: nothing to look at$"):
        detect(site.model, site.scans, site.poses, settings=SETTINGS, work=Work(keep_going=True))


def test_equal_stations_and_no_workers_are_refused_in_one_line(site, tmp_path):
    again = tmp_path / "copy.npy"
    again.write_bytes(site.scans[0].read_bytes())
    for scans in ([site.scans[0]] * 2, [site.scans[0], again]):
        with pytest.raises(InputError, match=r"^[^\n]*two equal ones from one pose[^\n]*$"):
            detect(site.model, scans, [site.poses[0]] * 2, settings=SETTINGS)
    for work, words in (
        (Work(workers=0), "--workers: expected at least 1, got 0"),
        (Work("slurm"), "--engine: expect"),
    ):
        with pytest.raises(InputError, match=words):
            detect(site.model, site.scans, site.poses, settings=SETTINGS, work=work)


def test_without_ray_its_engine_is_refused_before_anything_is_read(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match=r"^--engine: ray needs the package ray[^\n]*$"):
        detect(tmp_path / "none.ifc", [tmp_path / "none.ply"], work=Work("ray"))


@pytest.mark.parametrize("kind", [InputError, Misfit, RuntimeError, KeyboardInterrupt, OSError])
def test_what_ends_it_names_the_folder_that_is_kept(kind, tmp_path):
    folder = tmp_path / "work"
    for done in (False, True):
        with pytest.raises(kind) as told, work_folder._held(folder, "one"):
            write_record(folder / f"prior-{'0' * 32}{SUFFIX}", 1)
            if done:
                write_record(folder / f"00000-{'0' * 32}{SUFFIX}", 1)
            raise kind("it ends")
        assert type(told.value) is kind and folder.exists() == done
        assert (
            str(told.value)
            == "it ends" + f"; what is done is kept in {folder}, from where the same command goes on" * done
        )


def test_a_full_disk_names_the_folder_that_is_kept(monkeypatch, site, tmp_path):
    """Whoever of the processes it is that cannot write; with some room, the same goes on."""
    folder, write = tmp_path / "work", work_folder.write_record

    def full(path, value):
        if path.name.startswith("00002-") and path.name.endswith(f"-looked{SUFFIX}"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        write(path, value)

    work = Work(workers=1, folder=folder)
    with monkeypatch.context() as here:
        here.setattr(work_folder, "write_record", full)
        with pytest.raises(OSError, match=rf"No space left on device; what is done is kept in {folder}, from") as told:
            detect(site.model, site.scans, site.poses, settings=SETTINGS, work=work)
    assert told.value.errno == errno.ENOSPC and str(folder) in told.value.filename and folder.exists()
    assert len(detect(site.model, site.scans, site.poses, settings=SETTINGS, work=work).scans) == len(site.scans)


def test_what_another_process_is_at_is_left_to_it(tmp_path):
    """Though that one has other settings."""
    folder, kept = tmp_path / "work", "00000-step.record"
    with work_folder._held(folder, "one"):
        (folder / kept).touch()
        with pytest.raises(InputError, match="another process is at work here"), work_folder._held(folder, "other"):
            pass
        assert (folder / kept).exists()
    assert not folder.exists()
