"""A map from a real scheduler and two workers, each a process of its own on the loopback interface, one of which is killed on the way."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from pieper.cli.main import main
from pieper.errors import MapError
from pieper.workspace import store as stores
from pieper.workspace.measure import QUANTITIES
from pieper.workspace.run import Cluster, Progress, run
from pieper.workspace.survey import survey
from tests.robots import chain

pytest.importorskip("distributed", reason="Dask is not installed: the extra 'cluster'")

START = 60.0  # [s] in which they have to be up
MOST = 120.0  # [s] after which a worker that was never told to end ends by itself


class Grid:
    """A scheduler and its workers."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: list[subprocess.Popen[bytes]] = []
        file = folder / "scheduler.json"
        options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--dashboard-address", "127.0.0.1:0")
        self.start("dask_scheduler", *options, "--scheduler-file", str(file))
        end = time.monotonic() + START
        while not file.exists():
            assert time.monotonic() < end, "no scheduler"
            time.sleep(0.02)
        while True:  # the file is there before its content
            try:
                self.address = str(json.loads(file.read_text())["address"])
                break
            except ValueError:
                time.sleep(0.02)

    def start(self, kind: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{kind}", *options]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(sys.path),
            "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "5s",
        }
        with (self.folder / f"{kind}.{len(self.processes)}.log").open("wb") as log:
            process = subprocess.Popen(command, stdout=log, stderr=log, cwd=self.folder, env=environment)
        self.processes.append(process)
        return process

    def worker(self) -> subprocess.Popen[bytes]:
        options = (
            "--no-nanny",
            "--nthreads",
            "1",
            "--no-dashboard",
            "--host",
            "127.0.0.1",
            "--lifetime",
            f"{MOST:.0f}s",
        )
        return self.start("dask_worker", self.address, *options)

    def close(self) -> None:
        for process in self.processes:
            process.terminate()
        for process in self.processes:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Grid]:
    made = Grid(tmp_path_factory.mktemp("dask"))
    try:
        made.worker()
        yield made
    finally:
        made.close()


BOX = [[-0.9, -0.9, 0.0], [0.9, 0.9, 0.8]]


def test_a_cluster_makes_the_same_bits_though_a_worker_is_killed(grid: Grid, tmp_path: Path) -> None:
    question = survey(chain("ur5e"), voxel=0.1, orientations=300, box=BOX, chunk=4)
    doomed = grid.worker()
    workers = Cluster(grid.address, timeout=START)
    workers._client.wait_for_workers(2, timeout=START)
    agreed = workers.agree(question)
    assert workers.window == 6
    told: list[Progress] = []

    def kill(step: Progress) -> None:
        told.append(step)
        if step.chunks == 10:
            doomed.send_signal(signal.SIGKILL)

    found = run(agreed, stores.create(tmp_path / "map.zarr", agreed), workers=workers, progress=kill)
    assert doomed.wait(10) == -signal.SIGKILL
    assert told[-1].chunks == question.grid.chunks
    assert agreed.instructions == question.instructions
    expected = run(question)
    for name in QUANTITIES:
        assert found.array(name).tobytes() == expected.array(name).tobytes()


def test_the_command_works_on_a_cluster(grid: Grid, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["ur5e", "--voxel", "0.3", "--orientations", "8"]
    assert main(["workspace", *options, "--dask", grid.address, "--export", str(tmp_path / "cluster.csv")]) == 0
    assert main(["workspace", *options, "--workers", "1", "--export", str(tmp_path / "here.csv")]) == 0
    assert "reachable" in capsys.readouterr().out
    assert (tmp_path / "cluster.csv").read_bytes() == (tmp_path / "here.csv").read_bytes()


def test_a_scheduler_that_is_not_there_is_named() -> None:
    with pytest.raises(MapError, match=r"no Dask scheduler at tcp://127\.0\.0\.1:1: "):
        Cluster("tcp://127.0.0.1:1", timeout=0.5)
    with pytest.raises(MapError, match="no Dask scheduler at carrier-pigeon://loft"):
        Cluster("carrier-pigeon://loft", timeout=0.5)
