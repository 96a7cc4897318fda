"""The engines: every task once, few under way at once, nothing outlives its parent, and one line for what is wrong."""

import os
import platform
import signal
import socket
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from jaxmm.config import load
from jaxmm.data import dataset, generation, local_engine, ray_engine
from jaxmm.data.generation import Request
from jaxmm.inputs import InputError
from tests.cases import engine_tasks
from tests.cases.engine_tasks import burden, die, fail, square

SETTINGS = "[data]\ntrain_rooms = 2\nunchanged_rooms = 1\n[scan]\nwidth = 64\nheight = 40\n"
COUNT, SIZE = 26, 4  # pairs, and pairs a shard in these tests: seven shards, the last one short


@pytest.fixture
def config(tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "small.toml"
    path.write_text(SETTINGS)
    return path


def test_the_local_engine_takes_no_more_tasks_than_it_has_workers():
    taken = []

    def tasks():
        for number in range(40):
            taken.append(number)
            yield (number,)

    results = {}
    for (number,), result in local_engine.results(square, tasks(), 2):
        results[number] = result
        assert len(taken) <= len(results) + 2  # however many there are
    assert results == {number: number * number for number in range(40)}
    assert list(local_engine.results(square, iter(()), 2)) == []


def test_a_pool_keeps_its_processes_from_one_function_to_the_next():
    with local_engine.Pool(2) as pool:
        first, second = ({pid for _, pid in pool.results(os.getpid, [()] * 8)} for _ in range(2))
        assert first == second and len(first) <= 2 and os.getpid() not in first
        assert dict(pool.results(square, [(3,)])) == {(3,): 9}
        with pytest.raises(InputError, match="room 0 is on fire"):
            list(pool.results(fail, [(0,)]))
        assert dict(pool.results(square, [(4,)])) == {(4,): 16}  # by new ones
    assert not any(Path(f"/proc/{pid}").exists() for pid in first)


def test_a_lost_worker_and_an_error_of_its_own_end_the_work():
    with pytest.raises(RuntimeError, match=r"ended early.*-9"):
        list(local_engine.results(die, ((number,) for number in range(9)), 2))
    with pytest.raises(InputError, match="room 0 is on fire"):
        list(local_engine.results(fail, [(0,)], 2))


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="tunes the heap of glibc")
def test_a_worker_keeps_nothing_of_the_tasks_before():
    found = [result for _, result in local_engine.results(burden, [(50,)] * 6, 2)]
    sizes = [size for size, _, _ in found]
    assert max(sizes) < min(sizes) + 15, sizes
    # A heap of its own reserves 64 MB of addresses for each thread; of a thread that ended, its stack of 8 MB may stay.
    assert all(growth < 8 * 64 / 2 for _, growth, _ in found)


ORPHANS = """
from jaxmm.data import local_engine
from tests.cases import engine_tasks
if __name__ == "__main__":
    for _, worker in local_engine.results(engine_tasks.whoami, ((n,) for n in range(1000)), 2):
        print(worker, flush=True)
"""


def test_workers_end_when_their_parent_is_killed():
    environment = os.environ | {"PYTHONPATH": f"{Path(__file__).parents[2]}"}
    process = subprocess.Popen([sys.executable, "-c", ORPHANS], stdout=subprocess.PIPE, text=True, env=environment)
    workers = {int(process.stdout.readline()) for _ in range(4)}
    process.kill()
    process.communicate()
    end = time.monotonic() + 20
    while any(Path(f"/proc/{worker}").exists() for worker in workers) and time.monotonic() < end:
        time.sleep(0.05)
    assert workers and not any(Path(f"/proc/{worker}").exists() for worker in workers)


def test_without_ray_the_ray_engine_is_refused_and_the_local_one_works(config, tmp_path, monkeypatch, refused, said):
    monkeypatch.setitem(sys.modules, "ray", None)
    arguments = ["generate", config, "--out", tmp_path / "out", "--count", 3, "--workers", 1]
    refused([*arguments, "--engine", "ray"], "--engine", "needs the package ray")
    assert not list(tmp_path.iterdir())
    assert said(*arguments) == (0, ["generate pairs"])


@pytest.mark.long
@pytest.mark.parametrize("address", ["127.0.0.1:1", "ray://127.0.0.1:1", "127.0.0.1:99999"])
def test_a_cluster_that_nobody_answers_for_is_refused(address, config, tmp_path, monkeypatch, refused):
    pytest.importorskip("ray", reason="needs the package ray")
    monkeypatch.setenv("RAY_ADDRESS", address)
    arguments = ["generate", config, "--out", tmp_path / "out", "--count", 3, "--engine", "ray"]
    refused(arguments, "--engine", "no Ray cluster", address)
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_an_address_of_something_else_than_ray_is_refused_soon(config, tmp_path, monkeypatch, refused):
    pytest.importorskip("ray", reason="needs the package ray")
    monkeypatch.setattr(ray_engine, "DEADLINE", 6.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        monkeypatch.setenv("RAY_ADDRESS", address)
        arguments = ["generate", config, "--out", tmp_path / "out", "--count", 3, "--engine", "ray"]
        begin = time.monotonic()
        refused(arguments, "--engine", "no Ray cluster", address, "within 6 s")
    assert time.monotonic() - begin < 30 and not list(tmp_path.iterdir())


@pytest.mark.long
def test_a_cluster_of_this_machine_starts_without_a_word():
    pytest.importorskip("ray", reason="needs the package ray")
    hidden = ("RAY_ADDRESS", "RAY_BACKEND_LOG_LEVEL")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    code = "from jaxmm.data import ray_engine; ray_engine.connect(1)"
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=root)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def deadly(marks, config, raw, first, stop):
    """Makes a shard, but the first to come to the third one kills the process that it runs in."""
    if first == 2 * SIZE and not (mark := Path(marks) / "killed").exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return dataset.make_shard(config, raw, first, stop)


@pytest.fixture(scope="module")
def cluster():
    ray = pytest.importorskip("ray", reason="needs the package ray")
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("RAY_ADDRESS", raising=False)
        ray_engine.connect(2)
    for module in (sys.modules[__name__], engine_tasks):
        ray.cloudpickle.register_pickle_by_value(module)  # its workers cannot import tests
    yield ray
    ray.shutdown()


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.long
def test_a_ray_cluster_gives_the_same_bits_though_a_worker_is_killed(cluster, config, tmp_path, monkeypatch):
    monkeypatch.setattr(generation, "PAIRS_PER_SHARD", SIZE)
    generation.generate(load(config), tmp_path / "expected", Request(COUNT, workers=1))
    connected = partial(ray_engine.results, partial(deadly, str(tmp_path), load(config), False))
    monkeypatch.setattr(ray_engine, "results", lambda function, tasks, workers: connected(tasks, workers))
    generation.generate(load(config), tmp_path / "out", Request(COUNT, engine="ray", workers=2))
    assert (tmp_path / "killed").exists() and contents(tmp_path / "out") == contents(tmp_path / "expected")


@pytest.mark.long
def test_errors_of_a_ray_task_come_back_as_they_are(cluster, monkeypatch):
    with pytest.raises(InputError, match="room 0 is on fire"):
        list(ray_engine.results(fail, [(0,)]))
    results = dict(ray_engine.results(square, ((number,) for number in range(20))))
    assert results == {(number,): number * number for number in range(20)}
    monkeypatch.setattr(ray_engine, "ground", lambda: {"code": "another"})
    with pytest.raises(InputError, match=r"machine .* has other code"):
        list(ray_engine.results(square, [(0,)]))


def test_ctrl_c_waits_until_a_worker_is_started():
    """Though another thread, to which it is not blocked, takes it from the system."""
    handler, over, done = signal.getsignal(signal.SIGINT), threading.Event(), []
    other = threading.Thread(target=over.wait)
    other.start()
    try:
        with pytest.raises(KeyboardInterrupt), local_engine._undisturbed():
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.1)
            done.append("started")
    finally:
        over.set()
        other.join()
    assert done == ["started"] and signal.getsignal(signal.SIGINT) is handler
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
