"""The same map from any number of workers, after any interruption, and with workers that die."""

from __future__ import annotations

import concurrent.futures as futures
import errno
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from pieper.errors import ArrayError, MapError
from pieper.workspace import run as running
from pieper.workspace import store as stores
from pieper.workspace.map import WorkspaceMap
from pieper.workspace.measure import QUANTITIES
from pieper.workspace.run import Here, Processes, Progress, run
from pieper.workspace.store import Memory
from pieper.workspace.survey import Survey, survey
from tests.robots import chain

pytest.importorskip("zarr", reason="zarr is not installed: the extra 'maps'")

BOX = [[-0.9, -0.9, 0.0], [0.9, 0.9, 0.8]]


def asked(name: str = "ur5e", **options: Any) -> Survey:
    return survey(chain(name), **{"voxel": 0.1, "orientations": 20, "box": BOX, "chunk": 5, **options})


def bits(found: WorkspaceMap) -> dict[str, bytes]:
    assert not found.missing
    return {name: found.array(name).tobytes() for name in QUANTITIES}


@pytest.mark.parametrize("name", ["ur5e", "kuka_youbot"])
def test_processes_and_threads_make_the_same_bits_as_one(name: str, tmp_path: Path) -> None:
    question = asked(name, box=None, voxel=0.15)
    expected = bits(run(question))
    kept = stores.create(tmp_path / "map.zarr", question)
    assert bits(run(question, kept, workers=Processes(2))) == expected
    assert bits(run(question, workers=Threads())) == expected


class Threads(Here):
    """Any executor will do."""

    window = 4

    def open(self) -> futures.Executor:
        self._pool = futures.ThreadPoolExecutor(3)
        return self._pool

    def close(self) -> None:
        self._pool.shutdown()


def test_what_was_stopped_goes_on_and_makes_the_same_bits(tmp_path: Path) -> None:
    question = asked()
    told: list[Progress] = []
    kept = stores.create(tmp_path / "map.zarr", question)
    found = run(question, kept, progress=told.append, stop=lambda: told[-1].chunks >= 3)
    assert len(found.missing) == question.grid.chunks - 3
    assert found.summary().finished < question.grid.voxels
    again: list[Progress] = []
    whole = run(question, stores.resume(tmp_path / "map.zarr", question), progress=again.append)
    assert again[0].chunks == 3
    assert again[-1].poses < question.poses
    assert bits(whole) == bits(run(question))


def test_a_worker_that_dies_is_replaced(tmp_path: Path) -> None:
    question = asked(orientations=300)
    workers = Processes(2)
    told: list[Progress] = []

    def kill_one(step: Progress) -> None:
        told.append(step)
        if step.chunks == 3 and step.retried == 0:
            os.kill(next(iter(workers._pool._processes)), signal.SIGKILL)  # type: ignore[union-attr]

    found = run(question, stores.create(tmp_path / "map.zarr", question), workers=workers, progress=kill_one)
    assert told[-1].retried > 0
    assert bits(found) == bits(run(question))


class Deadly(Here):
    """A pool that breaks whenever it gets a certain chunk, with everything that is under way."""

    window = 4

    def __init__(self, chunk: int, times: int) -> None:
        self.chunk, self.times = chunk, times
        self.opened = 0

    def open(self) -> futures.Executor:
        self.opened += 1
        return DeadlyPool(self)


class DeadlyPool(futures.Executor):
    def __init__(self, workers: Deadly) -> None:
        self.workers, self.broken = workers, False
        self.given: list[futures.Future[Any]] = []

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        if self.broken:
            raise futures.BrokenExecutor("broken")
        future: futures.Future[Any] = futures.Future()
        if args[1] == self.workers.chunk and self.workers.times > 0:
            self.workers.times -= 1
            self.broken = True
            future.set_exception(futures.BrokenExecutor("broken"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


def test_a_chunk_that_takes_down_two_workers_is_tried_once_more() -> None:
    question = asked()
    workers = Deadly(7, times=2)  # the first time it may be one of several under way, which are then tried one by one
    assert bits(run(question, workers=workers)) == bits(run(question))
    assert workers.opened == 3


def test_a_chunk_that_takes_down_every_worker_is_named_and_the_rest_is_kept(tmp_path: Path) -> None:
    question = asked()
    kept = stores.create(tmp_path / "map.zarr", question)
    with pytest.raises(MapError, match=r"chunk 7 \(x .* m\) took down 3 workers, one after the other"):
        run(question, kept, workers=Deadly(7, times=99))
    assert {0, 1, 2, 3} <= kept.finished()
    assert 7 not in kept.finished()


def test_a_chunk_that_fails_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(packed: bytes, chunk: int) -> None:
        raise ZeroDivisionError(f"in {chunk}")

    monkeypatch.setattr(running, "_work", fail)
    with pytest.raises(MapError, match=r"chunk 0 \(x -0.900 to -0.500, .*\) failed: ZeroDivisionError: in 0"):
        run(asked())


def test_a_full_disk_ends_the_run_with_what_is_finished_kept(tmp_path: Path) -> None:
    """The limit on the size of files stands for the end of the disk: the write itself fails."""
    question = asked()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    kept = stores.create(tmp_path / "map.zarr", question)

    def fill(step: Progress) -> None:
        if step.chunks == 3:
            resource.setrlimit(resource.RLIMIT_FSIZE, (60, before[1]))

    try:
        with pytest.raises(OSError, match="3 of 32 chunks are finished and kept, go on with --resume") as caught:
            run(question, kept, progress=fill)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert caught.value.errno == errno.EFBIG
    assert caught.value.filename == str(tmp_path / "map.zarr")
    assert len(kept.finished()) == 3
    assert not list((tmp_path / "map.zarr").rglob("*.partial"))
    assert bits(run(question, stores.resume(tmp_path / "map.zarr", question))) == bits(run(question))


def test_a_disk_that_is_full_from_the_start_is_left_empty(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            stores.create(tmp_path / "map.zarr", asked())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


COMMAND = [
    *(sys.executable, "-m", "pieper", "workspace", "ur5e", "--voxel", "0.1", "--orientations", "400"),
    *("--box", "-0.9", "0.9", "-0.9", "0.9", "0", "0.8", "--chunk", "4", "--workers", "2"),
]


def begin(place: Path) -> subprocess.Popen[str]:
    """The command, as soon as it has finished some chunks; in a group of processes of its own, as of a terminal."""
    process = subprocess.Popen(
        [*COMMAND, "--out", str(place)],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    end = time.monotonic() + 60.0
    while len(list((place / "reached").glob("c/*/*/*"))) < 5:
        assert process.poll() is None, process.stderr and process.stderr.read()
        assert time.monotonic() < end
        time.sleep(0.005)
    return process


def question_of_command() -> Survey:
    return asked(orientations=400, chunk=4)


def finish(place: Path) -> None:
    """Go on here, and compare with a map that was never interrupted."""
    question = question_of_command()
    kept = stores.resume(place, question)
    assert 5 <= len(kept.finished()) < question.grid.chunks
    assert bits(run(question, kept)) == bits(run(question))


def test_a_run_that_was_killed_goes_on_and_makes_the_same_bits(tmp_path: Path) -> None:
    place = tmp_path / "map.zarr"
    process = begin(place)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    finish(place)


def test_ctrl_c_finishes_what_is_under_way_and_says_how_to_go_on(tmp_path: Path) -> None:
    place = tmp_path / "map.zarr"
    process = begin(place)
    os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to every process of the group
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "chunks are finished; go on with --resume" in said
    assert "Traceback" not in said
    finish(place)


def test_a_map_that_is_not_kept_has_a_bound() -> None:
    question = asked(voxel=0.004, box=BOX)
    with pytest.raises(MapError, match=r"\d+ voxels are too many for memory .*: give a store with --out MAP.zarr"):
        Memory(question)


@pytest.mark.parametrize("count", [0, -1, True, 1.5])
def test_the_number_of_workers_is_a_whole_number(count: Any) -> None:
    with pytest.raises(ArrayError, match="workers must be a whole number of at least 1"):
        Processes(count)
