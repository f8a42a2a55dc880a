"""Making a map: chunks against an executor, here or on a cluster, with progress, resuming and workers that may die.

Every chunk is a pure function of the question and its number, and is written by the process that asked. So a map is the same bit for bit
on any number of workers, in any order, and after any interruption.

Any `concurrent.futures.Executor` will do. `Here` works in this process, `Processes` starts processes, `Cluster` talks to Dask.
"""

from __future__ import annotations

import concurrent.futures as futures
import pickle
import threading
import time
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

from pieper._native import kernels
from pieper._version import __version__
from pieper.errors import MapError, MissingExtraError
from pieper.workspace._quiet_process import QuietContext, leave_ctrl_c_alone
from pieper.workspace.grid import whole
from pieper.workspace.measure import Measurer
from pieper.workspace.store import Memory

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from pieper.workspace.map import WorkspaceMap
    from pieper.workspace.store import Store
    from pieper.workspace.survey import Survey

ATTEMPTS = 3
"""Workers that a chunk may take down before it is given up, by name."""

_WAIT = 0.2  # [s] how often a wish to stop is looked at


@dataclass(frozen=True)
class Progress:
    """How far the work is.

    Attributes
    ----------
    chunks, of : int
        Chunks that are finished, of all.
    poses : int
        Poses solved in this run.
    seconds : float
        Since it began.
    retried : int
        Chunks that were given out again, since a worker died.
    """

    chunks: int
    of: int
    poses: int
    seconds: float
    retried: int

    @property
    def rate(self) -> float:
        """Poses per second."""
        return self.poses / self.seconds if self.seconds > 0.0 else 0.0


class Workers(Protocol):
    """Where the work is done."""

    @property
    def window(self) -> int:
        """Chunks to have under way."""
        ...

    def agree(self, survey: Survey) -> Survey:
        """The question in a form that all workers can answer alike; raises MapError where they cannot."""
        ...

    def open(self) -> futures.Executor:
        """An executor; called again when the last one broke."""
        ...

    def close(self) -> None:
        """No more work comes."""
        ...


class Here:
    """In this process, one chunk after the other."""

    window = 1

    def agree(self, survey: Survey) -> Survey:
        """As it is."""
        return survey

    def open(self) -> futures.Executor:
        """An executor that works while it is handed the work."""
        return _AtOnce()

    def close(self) -> None:
        """Nothing."""


class Processes:
    """Processes on this machine.

    Parameters
    ----------
    count : int
        How many.
    """

    def __init__(self, count: int) -> None:
        self.count = whole(count, "workers")
        self._pool: futures.ProcessPoolExecutor | None = None

    @property
    def window(self) -> int:
        """One chunk in work and one waiting for each."""
        return 2 * self.count

    def agree(self, survey: Survey) -> Survey:
        """As it is: all are of one machine."""
        return survey

    def open(self) -> futures.Executor:
        """Fresh processes, which leave Ctrl-C to this one."""
        self.close()
        self._pool = futures.ProcessPoolExecutor(self.count, mp_context=QuietContext(), initializer=leave_ctrl_c_alone)
        return self._pool

    def close(self) -> None:
        """Ends them."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


class Cluster:
    """Workers of a Dask scheduler that runs already.

    Parameters
    ----------
    address : str
        Of the scheduler, as in ``tcp://10.0.0.1:8786``.
    timeout : float
        How long to look for it [s].

    Raises
    ------
    MissingExtraError
        Dask is not installed.
    MapError
        There is no scheduler at that address.
    """

    def __init__(self, address: str, *, timeout: float = 10.0) -> None:
        connect: Any
        try:
            from distributed import Client as connect
        except ImportError as cause:
            raise MissingExtraError("distributed", "cluster", "working on a Dask cluster") from cause
        try:
            self._client: Any = connect(address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise MapError(
                f"no Dask scheduler at {address}: {str(error).splitlines()[0] if str(error) else error!r}"
            ) from error
        self.address = address
        self._cores = 1

    @property
    def window(self) -> int:
        """Two chunks for each thread of all workers, and some on their way."""
        return 2 * self._cores + 2

    def agree(self, survey: Survey) -> Survey:
        """With vector instructions that all processors have; every worker needs this version of pieper.

        Raises
        ------
        MapError
            A worker has another version, cannot be asked, or no instruction set is common to all.
        """
        self._client.wait_for_workers(1, timeout=60)
        self._cores = sum(self._client.nthreads().values())
        there = self._client.run(_who, on_error="return")
        common = list(kernels.instruction_sets())
        for worker, told in there.items():
            if isinstance(told, BaseException):
                raise MapError(f"the worker {worker} cannot work on a map: {told}")
            version, sets = told
            if version != __version__:
                raise MapError(
                    f"the worker {worker} has pieper {version}, this is {__version__}; install the same there"
                )
            common = [name for name in common if name in sets]
        if survey.instructions in common:
            return survey
        if not common:
            raise MapError(
                f"the workers and this machine have no vector instructions in common: here are {', '.join(kernels.instruction_sets())}; take workers of one kind"
            )
        return replace(survey, instructions=common[-1])

    def open(self) -> futures.Executor:
        """The executor of the client; Dask gives the work of a worker that died to another."""
        executor: futures.Executor = self._client.get_executor(pure=False)
        return executor

    def close(self) -> None:
        """Leaves the scheduler as it is."""
        self._client.close()


def run(
    survey: Survey,
    store: Store | None = None,
    *,
    workers: Workers | None = None,
    progress: Callable[[Progress], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> WorkspaceMap:
    """Compute the chunks that a store does not have yet.

    Parameters
    ----------
    survey : Survey
    store : Store, optional
        In memory when not given.
    workers : Workers, optional
        `Here` when not given.
    progress : callable, optional
        Told a `Progress` after every chunk.
    stop : callable, optional
        Asked a few times a second; once it says True no chunk is begun, those under way are finished, and what there is
        comes back with `WorkspaceMap.missing`.

    Returns
    -------
    WorkspaceMap
        What there is now; ``missing`` holds the numbers of the chunks that are not.

    Raises
    ------
    MapError
        A chunk took down `ATTEMPTS` workers, or a worker cannot do it; what is finished is kept.
    OSError
        The store cannot be written to; what is finished is kept.

    Examples
    --------
    >>> import pieper
    >>> from pieper.workspace.survey import survey
    >>> found = run(survey(pieper.load("ur5e"), voxel=0.2, orientations=20))
    >>> found.array("dexterity").shape, found.summary().most_solutions
    ((11, 11, 11), 8)
    """
    kept: Store = Memory(survey) if store is None else store
    work = _Work(survey, kept, Here() if workers is None else workers, progress, stop)
    try:
        work.all()
    finally:
        work.workers.close()
    return kept.map()


class _Work:
    """The chunks of one run: which are open, under way, or suspected of taking workers down."""

    def __init__(
        self,
        survey: Survey,
        store: Store,
        workers: Workers,
        progress: Callable[[Progress], None] | None,
        stop: Callable[[], bool] | None,
    ) -> None:
        self.survey, self.store, self.workers = survey, store, workers
        self._progress, self._stop = progress, stop
        done = store.finished()
        self._finished = len(done)
        self._open = deque(k for k in range(survey.grid.chunks) if k not in done)
        self._suspects: deque[int] = deque()
        self._deaths: dict[int, int] = {}
        self._poses = self._retried = 0
        self._packed = pickle.dumps(survey)
        self._began = time.perf_counter()

    def all(self) -> None:
        """Do what is open."""
        self._tell()
        executor = self.workers.open() if self._open else None
        while executor is not None and (self._open or self._suspects) and not self._asked_to_stop():
            try:
                # a broken pool fails every chunk under way: those are then done one at a time, to see which it was
                if self._suspects:
                    self._do(executor, self._suspects, window=1)
                else:
                    self._do(executor, self._open, window=self.workers.window)
            except futures.BrokenExecutor:  # noqa: PERF203  that is what it is about
                executor = self.workers.open()

    def _do(self, executor: futures.Executor, chunks: deque[int], *, window: int) -> None:
        """Hand out chunks, a few ahead of the workers, and keep what comes back."""
        under_way: dict[futures.Future[Any], int] = {}
        try:
            while under_way or (chunks and not self._asked_to_stop()):
                while chunks and len(under_way) < window and not self._asked_to_stop():
                    chunk = chunks.popleft()
                    try:
                        under_way[executor.submit(_work, self._packed, chunk)] = chunk
                    except BaseException:
                        chunks.appendleft(chunk)
                        raise
                done, _ = futures.wait(under_way, timeout=_WAIT, return_when=futures.FIRST_COMPLETED)
                for future in done:
                    self._keep(under_way[future], future)
                    del under_way[future]
                if self._asked_to_stop():
                    self._take_back(under_way, chunks)
        except futures.BrokenExecutor:
            self._suspect(under_way.values())
            raise
        except BaseException:
            for future in under_way:
                future.cancel()
            raise

    def _keep(self, chunk: int, future: futures.Future[Any]) -> None:
        try:
            arrays: dict[str, NDArray[Any]] = future.result()
        except futures.BrokenExecutor:
            raise
        except Exception as error:
            if type(error).__name__ == "KilledWorker":  # of Dask, after it has tried several
                raise MapError(f"{self._named(chunk)} took down every worker that tried it: {error}") from error
            raise MapError(f"{self._named(chunk)} failed: {type(error).__name__}: {error}") from error
        try:
            self.store.write(chunk, arrays)
        except OSError as error:
            why = f"{error.strerror or error}; {self._finished} of {self.survey.grid.chunks} chunks are finished and kept, go on with --resume"
            raise OSError(error.errno, why, str(getattr(self.store, "path", "the map"))) from error
        self._finished += 1
        voxels = self.survey.grid.chunk_voxels(chunk)
        self._poses += voxels[0] * voxels[1] * voxels[2] * self.survey.samples
        self._tell()

    def _suspect(self, chunks: Iterable[int]) -> None:
        """One of these took a worker down; where it was the only one, it is counted."""
        found = list(chunks)
        self._retried += len(found)
        if len(found) == 1:
            (chunk,) = found
            self._deaths[chunk] = self._deaths.get(chunk, 0) + 1
            if self._deaths[chunk] >= ATTEMPTS:
                raise MapError(
                    f"{self._named(chunk)} took down {ATTEMPTS} workers, one after the other; the finished chunks are kept. "
                    "Is there enough memory?"
                )
        self._suspects.extend(found)
        self._tell()

    def _take_back(self, under_way: dict[futures.Future[Any], int], chunks: deque[int]) -> None:
        """Those that no worker has begun."""
        for future in list(under_way):
            if future.cancel():
                chunks.append(under_way.pop(future))

    def _named(self, chunk: int) -> str:
        centres = self.survey.grid.centres(chunk)
        low, high = centres.min(axis=0), centres.max(axis=0)
        span = ", ".join(f"{name} {a:.3f} to {b:.3f}" for name, a, b in zip("xyz", low, high, strict=True))
        return f"chunk {chunk} ({span} m)"

    def _asked_to_stop(self) -> bool:
        return self._stop is not None and self._stop()

    def _tell(self) -> None:
        if self._progress is not None:
            spent = time.perf_counter() - self._began
            self._progress(Progress(self._finished, self.survey.grid.chunks, self._poses, spent, self._retried))


class _AtOnce(futures.Executor):
    """Does the work when it is handed over."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        future: futures.Future[Any] = futures.Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001  it belongs to whoever asks for the result
            future.set_exception(error)
        return future


def _work(packed: bytes, chunk: int) -> dict[str, NDArray[Any]]:
    """One chunk, in whatever process this is."""
    return _measurer(packed).chunk(chunk)


class _Prepared(threading.local):
    """What a thread has prepared for the question it works on: a measurer writes into arrays of its own."""

    packed: bytes | None = None
    measurer: Measurer | None = None


_prepared = _Prepared()


def _measurer(packed: bytes) -> Measurer:
    if _prepared.measurer is None or _prepared.packed != packed:
        _prepared.measurer = Measurer(pickle.loads(packed))
        _prepared.packed = packed
    return _prepared.measurer


def _who() -> tuple[str, list[str]]:
    """What a worker is."""
    return __version__, list(kernels.instruction_sets())
