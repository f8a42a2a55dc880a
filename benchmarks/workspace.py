"""What does a map of the workspace cost, does it scale, and what do its chunks cost beside the bare solver?

UR5e, voxels of 5 cm, 200 orientations in each, all quantities, kept in a zarr store; on one process and on two in turn, the best of
some rounds; how it scales also with voxels of 3 cm, where the start of the processes weighs less. Beside it the same poses, made
beforehand, handed to the compiled solver in batches of 100 000: what is more than that is overhead, of which the cost of a chunk
(sending, storing) is given apart, also over Dask on the loopback interface. From the cost of a pose on one core and of a chunk in the
process that hands them out, runs of 1e9 and 1e12 poses are projected. The processor time of all processes is written beside the clock
on the wall, for machines that have other work.

    python benchmarks/workspace.py [--rounds 3]
"""

import argparse
import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace

import numpy as np
import results

import pieper
from pieper._native import kernels
from pieper.ik.solve import solver
from pieper.workspace import store as stores
from pieper.workspace.measure import Measurer
from pieper.workspace.run import Cluster, Here, Processes, run
from pieper.workspace.survey import Survey, survey

BATCH = 100_000
ARMS = {"ur5e": 0.05, "mh12": 0.1, "kr210": 0.2, "crx10ia": 0.5, "youbot": 0.2, "panda": 0.5}
NODE = 64  # cores of a node
BYTES = 22  # of a voxel in all arrays
LARGE = 32  # voxels along a chunk of a large map


def cpu() -> float:
    """Processor time of this process and of children that have ended [s]."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def timed(asked: Survey, workers: object) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        began, spent = time.perf_counter(), cpu()
        own = time.process_time()
        run(asked, stores.create(pathlib.Path(folder) / "map.zarr", asked), workers=workers)
        wall = time.perf_counter() - began
        return {"wall_s": wall, "cpu_s": cpu() - spent, "own_cpu_s": time.process_time() - own}


def least(rounds: list[dict[str, float]]) -> float:
    return min(row["wall_s"] for row in rounds)


def bare(asked: Survey) -> float:
    """Processor time of the compiled solver for all poses of a question, in microseconds a pose."""
    chain, form = asked.chain, solver(asked.chain)._form
    rotations = asked.rotations()
    spent, poses = 0.0, 0
    for chunk in range(asked.grid.chunks):
        centres = asked.grid.centres(chunk)
        T = np.tile(np.eye(4), (len(centres), len(rotations), 1, 1))
        T[..., :3, :3], T[..., :3, 3] = rotations, centres[:, None]
        flat = T.reshape(-1, 4, 4)
        for start in range(0, len(flat), BATCH):
            some = flat[start : start + BATCH]
            began = time.process_time()
            chain.native.answer_by_closed_form(form, some, None, 1e-9, 1e-9, 1)
            spent += time.process_time() - began
        poses += len(flat)
    return 1e6 * spent / poses


def per_pose(name: str, voxel: float) -> dict[str, float]:
    """Processor time of a pose in a map, over some chunks all over it."""
    asked = survey(pieper.load(name), voxel=voxel, chunk=4 if name in ("panda", "crx10ia", "youbot") else 12)
    measurer = Measurer(asked)
    chosen = range(0, asked.grid.chunks, max(1, asked.grid.chunks // 12))
    measurer.chunk(0)
    began = time.process_time()
    for chunk in chosen:
        measurer.chunk(chunk)
    spent = time.process_time() - began
    poses = sum(int(np.prod(asked.grid.chunk_voxels(chunk))) for chunk in chosen) * asked.samples
    return {"us_per_pose": 1e6 * spent / poses, "samples": asked.samples, "kind": asked.kind}


def handing_out(chunk: int, count: int) -> dict[str, float]:
    """Processor time that a chunk costs the process that hands it out and stores it, at no work: what it costs beside its poses."""
    voxel = 0.05
    side = chunk * voxel
    asked = survey(
        pieper.load("ur5e"), voxel=voxel, orientations=1, chunk=chunk,
        box=[[0.0, 0.0, 0.0], [side * count - voxel, side - voxel, side - voxel]],
    )  # fmt: skip
    made = Measurer(asked).chunk(0)
    with tempfile.TemporaryDirectory() as folder:
        kept = stores.create(pathlib.Path(folder) / "map.zarr", asked)
        kept.write(0, made)
        began = time.process_time()
        for k in range(asked.grid.chunks):
            kept.write(k, made)
        storing = (time.process_time() - began) / asked.grid.chunks
    workers = Processes(1)
    own: list[float] = []
    run(asked, workers=workers, progress=lambda step: own.append(time.process_time()))
    passing = (own[-1] - own[2]) / (len(own) - 3)
    return {"voxels": chunk**3, "storing_ms": 1e3 * storing, "passing_ms": 1e3 * passing, "chunks": asked.grid.chunks}


def over_dask(chunk: int, count: int) -> float:
    """The same over Dask, with a scheduler and a worker of their own [ms]."""
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "scheduler.json"
        local = ["--host", "127.0.0.1", "--no-dashboard"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", *local, "--port", "0"]
        held = [subprocess.Popen([*scheduler, "--scheduler-file", str(file)], **quiet)]
        try:
            address = ""
            while not address:
                time.sleep(0.1)
                if file.exists() and file.read_text().endswith("}"):
                    address = json.loads(file.read_text())["address"]
            worker = [
                sys.executable,
                "-m",
                "distributed.cli.dask_worker",
                address,
                *local,
                "--no-nanny",
                "--nthreads",
                "1",
            ]
            held.append(subprocess.Popen(worker, **quiet))
            workers = Cluster(address)
            side = chunk * 0.05
            box = [[0.0, 0.0, 0.0], [side * count - 0.05, side - 0.05, side - 0.05]]
            asked = survey(pieper.load("ur5e"), voxel=0.05, orientations=1, chunk=chunk, box=box)
            asked = workers.agree(asked)
            own: list[float] = []
            run(asked, workers=workers, progress=lambda step: own.append(time.process_time()))
            return 1e3 * (own[-1] - own[2]) / (len(own) - 3)
        finally:
            for process in held:
                process.terminate()
                process.wait()


BIG = """
import pathlib, resource, sys, tempfile, pieper
from pieper.workspace import store as stores
from pieper.workspace.export import export
from pieper.workspace.run import run
from pieper.workspace.survey import survey
asked = survey(pieper.load("ur5e"), voxel=0.008, orientations=2, chunk=32)
with tempfile.TemporaryDirectory() as folder:
    place = pathlib.Path(folder)
    found = run(asked, stores.create(place / "map.zarr", asked))
    found.summary()
    export(found, place / "map.h5")
    size = sum(file.stat().st_size for file in (place / "map.zarr").rglob("*") if file.is_file())
print(asked.grid.voxels, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, size)
"""


def large() -> dict[str, float]:
    """Peak memory of a map of many voxels, its summary and an export, and its size on disk."""
    told = subprocess.run([sys.executable, "-c", BIG], capture_output=True, text=True, check=True).stdout.split()
    return {"voxels": int(told[0]), "peak_MB": float(told[1]), "bytes_per_voxel": float(told[2]) / int(told[0])}


def projected(poses: float, us_per_pose: float, chunk: dict[str, float], dask_ms: float) -> dict[str, object]:
    """Hours on some nodes: the poses over all cores, or the chunks through the process that hands them out, whichever is longer."""
    chunks = poses / 200 / chunk["voxels"]
    through = 1e-3 * (chunk["storing_ms"] + dask_ms) * chunks
    rows = {}
    for nodes in (1, 4, 16, 64):
        work = 1e-6 * us_per_pose * poses / (nodes * NODE)
        rows[nodes] = {"work_s": work, "handing_out_s": through, "hours": max(work, through) / 3600.0}
    return {"poses": poses, "one_core_hours": 1e-6 * us_per_pose * poses / 3600.0, "chunks": chunks, "nodes": rows}


def write_page(data: dict) -> None:
    """The figures on the page of the guide."""
    figures = data["figures"]
    best, arms, large = figures["best"], figures["arms"], figures["large"]
    rows = [
        ("UR5e, 5 cm, 200 orientations", f"{figures['poses'] / 1e6:.1f} million poses, all quantities, stored", ""),
        (
            "on two processes",
            f"{best['2']['wall_s']:.1f} s on the wall, {best['2']['cpu_s']:.1f} s of processor time",
            "60 s",
        ),
        ("on one process", f"{best['1']['wall_s']:.1f} s, {best['1']['cpu_s']:.1f} s", ""),
        (
            "one to two processes, on the wall, with the start of the processes",
            f"{figures['scaling_wall']:.2f} times",
            "",
        ),
        (
            f"the same with voxels of 3 cm, {figures['fine_poses'] / 1e6:.0f} million poses",
            f"{figures['fine_scaling_wall']:.2f} times",
            "1.8 times",
        ),
        ("the same by processor time", f"{2.0 * best['1']['cpu_s'] / best['2']['cpu_s']:.2f} times", ""),
        ("the compiled solver alone", f"{figures['bare_us_per_pose']:.2f} us a pose", ""),
        ("more than that, counting", f"{100 * figures['overhead_counts_only']:.0f} %", "20 %"),
        ("more than that, all quantities", f"{100 * figures['overhead_all_quantities']:.0f} %", "20 %"),
        (f"memory at {large['voxels'] / 1e6:.0f} million voxels", f"{large['peak_MB']:.0f} MB", "500 MB"),
    ]
    lines = ["", "| | measured | asked |", "|---|---|---|", *(f"| {' | '.join(row)} |" for row in rows), ""]
    per = ", ".join(f"{name} {row['us_per_pose']:.2g}" for name, row in arms.items())
    lines += [f"Microseconds of one core for a pose: {per}.", ""]
    chunk, dask = figures["chunks"][str(LARGE)], figures["dask_passing_ms"][str(LARGE)]
    lines += [
        (
            f"A chunk of {LARGE} voxels along a side costs the process that hands it out {chunk['storing_ms']:.1f} ms to store and "
            f"{dask:.1f} ms to pass over Dask, however many poses are in it. Projected from that and from the cost of a pose, for nodes of {NODE} cores "
            "like this one, with 200 orientations: the longer of the poses over all cores and of the chunks through that process."
        ),
        "",
        "| poses | one core | "
        + " | ".join(f"{n} node{'s' if n != '1' else ''}" for n in figures["projection"][0]["nodes"])
        + " |",
        "|---|---|" + "---|" * len(figures["projection"][0]["nodes"]),
    ]
    for row in figures["projection"]:
        times = " | ".join(duration(3600.0 * each["hours"]) for each in row["nodes"].values())
        power = int(np.log10(row["poses"]))
        lines.append(f"| 10^{power} | {duration(3600.0 * row['one_core_hours'])} | {times} |")
    lines += [
        "",
        (
            f"These are projections, not measurements: nothing larger than this machine was there. At 10^12 poses the store has "
            f"{1e12 / 200 * BYTES / 1e9:.0f} GB before compression."
        ),
        "",
        (
            f"Measured on {data['date']} with pieper {data['versions']['pieper']}, commit {data['commit']}, on {data['machine']['processor']}, two cores, "
            f"load average {figures['load_average']:.1f}"
            + (
                ": the machine had other work, so that processor time tells more than the wall."
                if figures["load_average"] > 1.5
                else "."
            )
        ),
        "",
    ]
    page = results.HERE.parent / "docs" / "guides" / "workspace.md"
    begin, end = "<!-- figures: written by benchmarks/workspace.py -->", "<!-- end of figures -->"
    before, _, rest = page.read_text().partition(begin)
    page.write_text(before + begin + "\n" + "\n".join(lines) + end + rest.partition(end)[2])


def duration(seconds: float) -> str:
    """In words that fit a table."""
    if seconds < 120.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.0f} h"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--page", action="store_true", help="only write the page of what was measured")
    arguments = parser.parse_args()
    if arguments.page:
        write_page(results.load("workspace"))
        return
    rounds = arguments.rounds
    asked = survey(pieper.load("ur5e"), voxel=0.05, orientations=200)
    fine = survey(pieper.load("ur5e"), voxel=0.03, orientations=200)
    scaled: dict[str, list[dict[str, float]]] = {"here": [], "1": [], "2": []}
    finer: dict[str, list[dict[str, float]]] = {"1": [], "2": []}
    solved, counted = [], []
    for _ in range(rounds):
        solved.append(bare(asked))
        counted.append(timed(replace(asked, measures=False), Here())["cpu_s"])
        scaled["here"].append(timed(asked, Here()))
        for count in (1, 2):
            scaled[str(count)].append(timed(asked, Processes(count)))
            finer[str(count)].append(timed(fine, Processes(count)))
    best = {key: min(each, key=lambda row: row["wall_s"]) for key, each in scaled.items()}
    whole = 1e6 * min(row["cpu_s"] for row in scaled["here"]) / asked.poses
    chunks = {str(side): handing_out(side, 12) for side in (12, LARGE)}
    dask = {str(side): over_dask(side, 12) for side in (12, LARGE)}
    figures = {
        "poses": asked.poses,
        "grid": asked.grid.shape,
        "instructions": kernels.instruction_set(),
        "load_average": os.getloadavg()[0],
        "best": best,
        "scaling_wall": best["1"]["wall_s"] / best["2"]["wall_s"],
        "fine_poses": fine.poses,
        "fine_scaling_wall": least(finer["1"]) / least(finer["2"]),
        "us_per_pose": whole,
        "bare_us_per_pose": min(solved),
        "counts_only_us_per_pose": 1e6 * min(counted) / asked.poses,
        "overhead_counts_only": 1e6 * min(counted) / asked.poses / min(solved) - 1.0,
        "overhead_all_quantities": whole / min(solved) - 1.0,
        "chunks": chunks,
        "dask_passing_ms": dask,
        "arms": {name: per_pose(name, voxel) for name, voxel in ARMS.items()},
        "large": large(),
    }
    figures["projection"] = [projected(poses, whole, chunks[str(LARGE)], dask[str(LARGE)]) for poses in (1e9, 1e12)]
    print(json.dumps(results.rounded(figures), indent=1, default=float))
    results.save(
        "workspace",
        method=__doc__,
        packages=["zarr", "distributed"],
        rounds=results.rounded(scaled),
        figures=results.rounded(figures),
    )
    write_page(results.load("workspace"))


if __name__ == "__main__":
    main()
