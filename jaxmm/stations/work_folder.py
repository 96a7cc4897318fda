"""Stations whose shelves stand in a work folder: each step is done wherever there is a core, and what is done stays.

A step of one station is one task. Its digest is that of all that it depends on: version, settings, models, prior, scan
file, pose, and the steps before. It leaves one record under that name, whole or not at all, which says what it gave and
what stands on the station's shelf from then on. So neither order nor place of the work can change a bit, and the same
command after a kill takes up what is there.
"""

import contextlib
import functools
import hashlib
import shutil
import tempfile
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from threadpoolctl import threadpool_limits

from jaxmm.data import local_engine, ray_engine
from jaxmm.files import LOCK, held, load_json, write_json
from jaxmm.inputs import InputError, Misfit
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.progress import bar_of
from jaxmm.stations.named_files import Reading
from jaxmm.stations.records import SUFFIX, digest_of, read_record, write_record
from jaxmm.stations.sources import Found, check_different, content_of
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.station_steps import Context, Shelf
from warp_scanner.cores import core_count
from warp_scanner.sensors.triangles import prepare

ENGINES = ("local", "ray")
FEW = 4  # stations, below which starting processes takes longer than they save
STEPS = 4  # of every station, at least, which the bar counts: read, laid, its faces, looked at
KEY = "stations.json"
Results = Callable[..., Iterator[tuple]]  # as local_engine.results


class Work(NamedTuple):
    """How to go about several stations."""

    engine: str = "local"  # or "ray"
    workers: int | None = None  # processes; None: one a core, or this one alone for a few stations
    folder: Path | None = None  # of what is done, where a killed detection goes on; None: a temporary one
    keep_going: bool = False  # leaves out stations that cannot be used
    leaves: bool = False  # the folder when all is done, for whoever has yet to write what was found; `clear` removes it

    def check(self) -> "Work":
        """Itself, if it can be done so; of a cluster, connected to it.

        Raises:
            InputError: less than one worker, another engine, or no Ray.
        """
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers: expected at least 1, got {self.workers}")
        if self.engine not in ENGINES:
            raise InputError(f"--engine: expected {' or '.join(ENGINES)}, got {self.engine!r}")
        if self.engine == "ray":
            ray_engine.connect(self.workers)
        return self

    def clear(self) -> None:
        """Remove the folder with all that is in it."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


class Shared(NamedTuple):
    """What all stations share, but for the prior."""

    model: Path
    settings: DetectSettings


@contextlib.contextmanager
def engine_of(work: Work, stations: int) -> Iterator[Results]:
    """The engine's `results`, whose processes stay while this is open; on this machine they load what they need now."""
    if work.engine == "ray":
        yield functools.partial(ray_engine.results, workers=work.workers)
        return
    workers = work.workers or (core_count() if stations >= FEW else 1)
    with local_engine.Pool(min(workers, stations), keep_to_cores=True, module=__name__) as pool:
        yield pool.results


@contextlib.contextmanager
def kept_stations(
    found: list[Found], shared: Shared, work: Work, reading: Reading, results: Results
) -> Iterator["KeptStations"]:
    """Stations of some sources, with the scans that are read already, while their work folder is held.

    Steps are done by the `results` of `engine_of`. The folder is removed when all is done, unless `work.leaves` it, and
    where an error comes before any step is done; a killed process leaves it, and an error that comes later names it.

    Raises:
        InputError: two equal stations; the folder is another's, or another process is at work in it.
    """
    contents = {one.file: content_of(Path(one.file)) for one, _ in found}
    check_different([one for one, _ in found], contents)
    with _held(work.folder, _key(shared, reading), work.leaves) as folder:
        label = f"detect from {len(found)} stations{', going on with what is kept' if _has_steps(folder) else ''}"
        rows = []
        for number, (one, scan) in enumerate(found):
            shelf = WorkShelf(folder, number, digest_of(one, contents[one.file], reading.unit), {})
            shelf["source"] = one
            if scan is not None:
                shelf["read"] = scan
            rows.append(_Row(number, shelf.digest, shelf.files))
        found.clear()
        with bar_of(label, STEPS * len(rows), "step", is_long=len(rows) >= FEW) as bar:
            yield KeptStations(folder, rows, (results, shared, work.keep_going, bar))


class _Row(NamedTuple):
    """How far one station is."""

    number: int
    digest: str  # of the step that was done last, and of all before
    files: dict[str, str]  # what stands on its shelf, and in which file of the work folder


class WorkShelf(MutableMapping[str, Any]):
    """The shelf of one station in the work folder, during one step."""

    def __init__(self, folder: Path, number: int, digest: str, files: dict[str, str]):
        self.folder, self.number, self.digest, self.files = folder, number, digest, dict(files)
        self._had = dict(files)

    def __getitem__(self, name: str) -> Any:
        return read_record(self.folder / self.files[name])

    def __setitem__(self, name: str, value: Any) -> None:
        file = f"{self.number:05d}-{self.digest}-{name}{SUFFIX}"
        if not (self.folder / file).exists():  # whose name tells all that it holds
            write_record(self.folder / file, value)
        self.files[name] = file

    def __delitem__(self, name: str) -> None:
        del self.files[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.files)

    def __len__(self) -> int:
        return len(self.files)

    def clear_away(self) -> None:
        """Remove the files of what has been taken from the shelf."""
        for file in set(self._had.values()) - set(self.files.values()):
            (self.folder / file).unlink(missing_ok=True)


class KeptStations:
    """Stations in a work folder, as verdicts.station_steps.Stations."""

    def __init__(self, folder: Path, rows: list[_Row], how: tuple[Any, Shared, bool, Any]):
        self._folder, self._rows = folder, rows
        self._results, self._shared, self._keep_going, self._bar = how
        self.left_out: list[str] = []

    def each(
        self,
        step: Callable[..., Any],
        prior: Prior,
        *arguments: Any,
        own: Sequence[Any] | None = None,
        may_leave_out: bool = False,
    ) -> list[Any]:
        """What a step gives of each station, in their order; those that cannot be used may be left out from then on.

        Raises:
            InputError: of the first station that cannot be used; all of them, if they may be left out.
        """
        keep_going = self._keep_going and may_leave_out
        stored = self._stored(prior)
        key = digest_of(step.__name__, stored, arguments)
        last = {row.number: () if own is None else (own[place],) for place, row in enumerate(self._rows)}
        rows = [row._replace(digest=digest_of(row.digest, key, *last[row.number])) for row in self._rows]
        missing = [row for row in rows if not self._record(row).exists()]
        function = functools.partial(_done, (self._folder, stored, self._shared), step, arguments)
        errors: dict[int, InputError] = {}
        self._bar.total = max(self._bar.total, self._bar.n + len(rows))
        self._bar.update(len(rows) - len(missing))
        tasks = (
            (row.number, row.digest, tuple(row.files.items()), *last[row.number])
            for row in missing
            if not errors or keep_going
        )
        for (number, *_), error in self._results(function, tasks):
            self._bar.update()
            if error is not None:
                errors[number] = {"Misfit": Misfit}.get(error[0], InputError)(error[1])
        if errors and (not keep_going or len(errors) == len(rows)):
            raise errors[min(errors)]
        self.left_out += [f"left out: {errors[number]}" for number in sorted(errors)]
        given, self._rows = [], []
        for row in rows:
            if row.number not in errors:
                result, files = read_record(self._record(row))
                given.append(result)
                self._rows.append(row._replace(files=files))
        return given

    def kept(self, load: Callable[[Shelf], Any]) -> Sequence[Any]:
        """Of each station something from its shelf, which is loaded when it is asked for."""
        return _Loaded([WorkShelf(self._folder, *row) for row in self._rows], load)

    def _record(self, row: _Row) -> Path:
        return _record(self._folder, row.number, row.digest)

    def _stored(self, prior: Prior) -> str:
        """The file of a prior in the work folder."""
        # A tree for rays is made anew of the triangles, wherever it is needed.
        plain = prior._replace(scene=None), None if prior.scene is None else prior.scene.triangles
        file = f"prior-{digest_of(plain)}{SUFFIX}"
        if not (self._folder / file).exists():
            write_record(self._folder / file, plain)
        return file


class _Loaded(Sequence[Any]):
    """Something of each shelf, loaded when it is looked at; the last few are kept."""

    def __init__(self, shelves: list[WorkShelf], load: Callable[[Shelf], Any]):
        self._shelves = shelves
        self._loaded = functools.lru_cache(maxsize=FEW)(lambda number: load(shelves[number]))

    def __getitem__(self, number: int) -> Any:
        return self._loaded(number)

    def __len__(self) -> int:
        return len(self._shelves)


@threadpool_limits.wrap(limits=1, user_api="blas")  # sums of products come out otherwise on more threads
def _done(
    where: tuple[Path, str, Shared], step: Callable[..., Any], arguments: tuple[Any, ...],
    number: int, digest: str, files: tuple[tuple[str, str], ...], *own: Any,
) -> tuple[str, str] | None:  # fmt: skip
    """Do a step of one station and leave its record; kind and words of an error of the user's."""
    folder, prior, shared = where
    shelf = WorkShelf(folder, number, digest, dict(files))
    try:
        given = step(Context(_prior(folder / prior), _judges(shared.model), shared.settings), shelf, *arguments, *own)
    except InputError as error:
        return type(error).__name__, str(error)
    write_record(_record(folder, number, digest), (given, shelf.files))
    shelf.clear_away()
    return None


def _record(folder: Path, number: int, digest: str) -> Path:
    return folder / f"{number:05d}-{digest}{SUFFIX}"


@functools.lru_cache(maxsize=1)
def _prior(path: Path) -> Prior:
    prior, triangles = read_record(path)
    return prior if triangles is None else prior._replace(scene=prepare(triangles))


@functools.lru_cache(maxsize=1)
def _judges(model: Path) -> Judges:
    return read_judges(model)


def _key(shared: Shared, reading: Reading) -> str:
    """What all that is in a work folder depends on."""
    words = f"{sorted(ray_engine.ground().items())}{shared.settings}{reading}{content_of(shared.model)}"
    return hashlib.sha256(words.encode()).hexdigest()


@contextlib.contextmanager
def _held(folder: Path | None, key: str, leaves: bool = False) -> Iterator[Path]:
    """The work folder, for this process alone; emptied where it is of another version, other settings or models."""
    if folder is None:
        with tempfile.TemporaryDirectory(prefix="jaxmm-stations-") as temporary:
            yield Path(temporary)
        return
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(held(folder, "at work here; wait for it or choose another --out"))
            if (folder / KEY).exists() and load_json(folder / KEY) != {"key": key}:
                _empty(folder)
            write_json(folder / KEY, {"key": key})
        except OSError as error:
            raise InputError(f"--out: cannot write {folder}: {error.strerror}") from error
        try:
            yield folder
        except (InputError, RuntimeError, KeyboardInterrupt, OSError) as error:
            if _has_steps(folder):
                kept = f"what is done is kept in {folder}, from where the same command goes on"
                if isinstance(error, OSError) and error.errno is not None:  # as where the disk is full
                    raise OSError(error.errno, f"{error.strerror}; {kept}", error.filename) from error
                kind = next(
                    one
                    for one in (Misfit, InputError, RuntimeError, KeyboardInterrupt, OSError)
                    if isinstance(error, one)
                )
                raise kind(f"{error}; {kept}" if str(error) else kept) from error
            shutil.rmtree(folder, ignore_errors=True)
            raise
        if not leaves:
            shutil.rmtree(folder, ignore_errors=True)


def _has_steps(folder: Path) -> bool:
    """Whether a step of a station is done in it; the prior's name is as long."""
    return any(folder.glob(f"[0-9]????-{'?' * 32}{SUFFIX}"))


def _empty(folder: Path) -> None:
    """Remove what was kept, but for the lock: only who holds that may."""
    for path in folder.iterdir():
        if path.name != LOCK:
            path.unlink()
