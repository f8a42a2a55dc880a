"""``pieper workspace``: where an arm can reach, and how well."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.arguments import ArmName, Base, Json, Nominal, Tip, load
from pieper.cli.outputs import keep_apart
from pieper.cli.progress import progress_bar
from pieper.cli.show import console, print_json, written
from pieper.cli.signals import stopped_once
from pieper.errors import ArrayError

if TYPE_CHECKING:
    from pieper.arm import Arm
    from pieper.motion.world import World
    from pieper.workspace.map import Summary, WorkspaceMap
    from pieper.workspace.run import Progress, Workers
    from pieper.workspace.store import Store
    from pieper.workspace.survey import Survey

_INTERRUPTED = 130
_FEW = 1_000_000  # poses for which processes are not worth their start

Tool = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--tool", metavar="X Y Z", help="A tool: where its tip is, in the frame of the tip of the arm [m]."),
]
ToolRpy = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--tool-rpy", metavar="ROLL PITCH YAW", help="A tool: how it is turned there [rad]."),
]


def workspace(
    arm: ArmName,
    voxel: Annotated[float, typer.Option("--voxel", metavar="M", help="Side of a voxel [m].")] = 0.05,
    orientations: Annotated[
        int, typer.Option("--orientations", metavar="N", help="Asked in each voxel, evenly spread.")
    ] = 200,
    box: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option("--box", metavar="X0 X1 Y0 Y1 Z0 Z1", help="Where to look [m]; all that is reached by default."),
    ] = None,
    layer: Annotated[
        str | None, typer.Option("--slice", metavar="AXIS=M", help="One layer alone, as in y=0 or z=0.4.")
    ] = None,
    tool: Tool = None,
    tool_rpy: ToolRpy = None,
    seed: Annotated[
        int,
        typer.Option(
            "--seed",
            metavar="N",
            help="Of random numbers, the same again for the same; for a turn of all orientations, 0 for none.",
        ),
    ] = 0,
    redundancy: Annotated[
        int,
        typer.Option("--redundancy-samples", metavar="N", help="Seven joints: values tried of the one that is held."),
    ] = 16,
    collision: Annotated[
        bool, typer.Option("--collision", help="Count only answers in which the arm does not touch itself. Slow.")
    ] = False,
    world: Annotated[
        Path | None,
        typer.Option(
            "--world",
            metavar="FILE",
            help="YAML file of obstacles in the base frame; answers touch none of them. Slow.",
        ),
    ] = None,
    margin: Annotated[
        float, typer.Option("--margin", metavar="M", help="Distance that is kept [m]; with --collision and --world.")
    ] = 0.0,
    counts_only: Annotated[
        bool, typer.Option("--counts-only", help="Poses and solutions alone, without measures of how good they are.")
    ] = False,
    chunk: Annotated[
        int, typer.Option("--chunk", metavar="N", help="Voxels along a chunk: what is stored, or lost, at once.")
    ] = 12,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FOLDER", help="Write the result; the map, as it is made, into a .zarr folder."
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what --out holds.")] = False,
    workers: Annotated[
        int | None, typer.Option("--workers", metavar="N", help="Processes at work; as many as cores by default.")
    ] = None,
    dask: Annotated[
        str | None, typer.Option("--dask", metavar="ADDRESS", help="Of a Dask scheduler, as tcp://10.0.0.1:8786.")
    ] = None,
    show: Annotated[
        str,
        typer.Option(
            "--show",
            metavar="QUANTITY",
            help="What the colours show: dexterity, manipulability, ...",
            autocompletion=completion.quantities,
        ),
    ] = "dexterity",
    figure: Annotated[
        Path | None, typer.Option("--figure", metavar="FILE", help="Draw a .png, .pdf or .svg; the map.")
    ] = None,
    exports: Annotated[
        list[Path] | None,
        typer.Option(
            "--export",
            metavar="FILE",
            help="Write it for other programs; .csv, .h5, .vtk, or its surface as .ply. May be repeated.",
        ),
    ] = None,
    level: Annotated[
        float | None,
        typer.Option("--level", metavar="SHARE", help="Dexterity on that surface; the edge of reach by default."),
    ] = None,
    json: Json = False,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
) -> int:
    """Map where an arm can reach, with how many of all orientations, solutions, and how far from limits and singularities.

    For example:
      pieper workspace ur5e --voxel 0.2 --orientations 20 --out ur5e.zarr
    """
    from pieper.workspace.survey import survey

    files = exports or []
    _check(out, resume, workers, dask, figure, files, show, world)
    robot = with_tool(load(arm, base=base, tip=tip, nominal=nominal), tool, tool_rpy)
    asked = survey(
        robot,
        voxel=voxel,
        orientations=orientations,
        box=None if box is None else [box[0::2], box[1::2]],
        layer=None if layer is None else _layer(layer),
        seed=seed,
        redundancy=redundancy,
        collision=collision,
        world=None if world is None else _world(world),
        margin=margin,
        measures=not counts_only,
        chunk=chunk,
    )
    hands = _workers(asked, workers, dask)
    found, last = _make(asked, hands, out, resume=resume)
    if found.missing:
        done = found.grid.chunks - len(found.missing)
        how = "go on with --resume" if out is not None else "nothing is kept without --out"
        typer.echo(f"{done} of {found.grid.chunks} chunks are finished; {how}", err=True)
        return _INTERRUPTED
    summary = found.summary()
    if json:
        print_json(_record(found, summary, last))
    else:
        _print(robot, asked, found, summary, last)
    for file in files:
        from pieper.workspace.export import export

        written(export(found, file, level=level), json=json)
    if figure is not None:
        from pieper.viewer import plot
        from pieper.viewer.map_figure import workspace as drawn

        written(plot.save(drawn(found, quantity=show, chain=robot.chain, title=robot.name), figure), json=json)
    if out is not None:
        written(out, json=json)
    return 0 if summary.reachable > 0.0 else 1


def _world(file: Path) -> World:
    from pieper.motion.world import read_world

    return read_world(file)


def with_tool(robot: Arm, tool: tuple[float, float, float] | None, rpy: tuple[float, float, float] | None) -> Arm:
    """The arm with the tool that was asked for."""
    if tool is None and rpy is None:
        return robot
    import numpy as np

    from pieper.spatial.rotation import from_rpy

    T = np.eye(4)
    T[:3, 3] = tool or (0.0, 0.0, 0.0)
    if rpy is not None:
        T[:3, :3] = from_rpy(np.array(rpy))
    return robot.with_tool(T)


def _check(
    out: Path | None,
    resume: bool,
    workers: int | None,
    dask: str | None,
    figure: Path | None,
    files: list[Path],
    show: str,
    world: Path | None,
) -> None:
    """What can be said before any work."""
    from pieper.errors import unknown_name
    from pieper.workspace.export import checked_file
    from pieper.workspace.map import UNITS

    if resume and out is None:
        raise ArrayError("--resume goes on with a map that is kept: name it with --out")
    if workers is not None and dask is not None:
        raise ArrayError("either --workers, on this machine, or --dask")
    for file in files:
        checked_file(file)
    if figure is not None:
        from pieper.viewer import plot

        plot.checked_file(figure)
    if show not in UNITS:
        raise unknown_name("quantity", show, sorted(UNITS), "a workspace map")
    keep_apart([world], {"--out": out, "--figure": figure, **{f"--export {file}": file for file in files}})


def _layer(text: str) -> tuple[str, float]:
    axis, equals, value = text.partition("=")
    try:
        if axis.strip() not in ("x", "y", "z") or not equals:
            raise ValueError
        return axis.strip(), float(value)
    except ValueError:
        raise ArrayError(f"--slice takes an axis and a coordinate, as in y=0 or z=0.4, got {text!r}") from None


def _workers(asked: Survey, workers: int | None, dask: str | None) -> Workers:
    from pieper.workspace.run import Cluster, Here, Processes

    if dask is not None:
        return Cluster(dask)
    if workers is None:
        workers = os.cpu_count() or 1
        if asked.poses * asked.redundancy < _FEW and not asked.collision:
            workers = 1
        workers = min(workers, asked.grid.chunks)
    return Here() if workers == 1 else Processes(workers)


def _make(asked: Survey, hands: Workers, out: Path | None, *, resume: bool) -> tuple[WorkspaceMap, Progress | None]:
    from pieper.workspace import store as stores
    from pieper.workspace.run import run

    told: list[Progress] = []
    try:
        begun = resume and out is not None and out.exists()
        if begun and out is not None:
            asked = stores.like(out, asked)
        asked = hands.agree(asked)
        kept: Store | None = None
        if out is not None:
            kept = stores.resume(out, asked) if begun else stores.create(out, asked)
        with stopped_once(_say_stopping) as came, progress_bar("chunks", asked.grid.chunks) as advance:

            def tell(step: Progress) -> None:
                told[:] = [step]
                advance(step.chunks, words=_beside(step))

            return run(asked, kept, workers=hands, progress=tell, stop=lambda: bool(came)), told[0]
    finally:
        hands.close()


def _say_stopping() -> None:
    typer.echo("\nfinishing the chunks under way; once more to leave at once", err=True)


def _beside(step: Progress) -> str:
    """What is said beside the bar."""
    again = f", {step.retried} again" if step.retried else ""
    return f"{step.rate / 1e6:.2f} million poses/s{again}" if step.poses else ""


def _record(found: WorkspaceMap, summary: Summary, last: Progress | None) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        **found.record,
        **asdict(summary),
        "poses": found.grid.voxels * found.samples,
        "seconds": None if last is None else last.seconds,
        "poses_per_second": None if last is None or not last.poses else last.rate,
    }


def _print(robot: Arm, asked: Survey, found: WorkspaceMap, summary: Summary, last: Progress | None) -> None:
    say = console().print
    grid = found.grid
    flat = sum(n == 1 for n in grid.shape)
    unit = {0: "m^3", 1: "m^2", 2: "m", 3: ""}[flat]
    say(f"{robot.name}  {robot.base} -> {robot.tip}\n", style="bold", markup=False)
    sides = " x ".join(str(n) for n in grid.shape)
    lines = [
        ("asked", f"{sides} voxels of {1e3 * grid.voxel:g} mm, {asked.words}"),
        (
            "reachable",
            f"{summary.reachable:.4g} {unit}, with {100 * summary.mean_dexterity:.3g} % of the poses on average",
        ),
        ("dexterous", f"{summary.dexterous:.4g} {unit}, where every pose is reached"),
    ]
    if summary.reachable > 0.0:
        low, high = summary.box
        spans = ", ".join(f"{name} {a:.3f} to {b:.3f}" for name, a, b in zip("xyz", low, high, strict=True))
        lines.append(("within", f"{spans} m"))
        lines.append(("solutions", f"up to {summary.most_solutions} of a pose"))
        if asked.measures:
            lines.append(("best", f"manipulability {summary.manipulability:.4g}"))
    if last is not None and last.poses:
        lines.append(("took", f"{last.seconds:.2f} s, {last.rate / 1e6:.3g} million poses a second"))
    for name, words in lines:
        say(f"{name:10s} {words}", markup=False, soft_wrap=True)
