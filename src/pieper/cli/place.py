"""``pieper place``: where to put the base of an arm for a task, or which of several arms to take."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.arguments import Json, load
from pieper.cli.outputs import keep_apart
from pieper.cli.progress import progress_bar
from pieper.cli.show import console, print_json, print_table, written
from pieper.cli.workspace import Tool, ToolRpy, with_tool
from pieper.errors import ArrayError

if TYPE_CHECKING:
    from pieper.spatial._checks import FloatArray
    from pieper.workspace.place import Placement

_LISTED = 5

Span = tuple[float, float]


def place(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="ARM... POSES.csv",
            help="One arm or several, and the poses of the task.",
            autocompletion=completion.robots,
        ),
    ],
    x: Annotated[
        Span | None, typer.Option("--x", metavar="FROM TO", help="Of the base [m]; around the poses by default.")
    ] = None,
    y: Annotated[Span | None, typer.Option("--y", metavar="FROM TO", help="The same.")] = None,
    z: Annotated[Span, typer.Option("--z", metavar="FROM TO", help="The same; 0 by default.")] = (0.0, 0.0),
    step: Annotated[float, typer.Option("--step", metavar="M", help="Between base positions [m].")] = 0.1,
    yaws: Annotated[
        int, typer.Option("--yaws", metavar="N", help="Turns of the base tried at each, evenly spread.")
    ] = 8,
    tool: Tool = None,
    tool_rpy: ToolRpy = None,
    position_only: Annotated[
        bool, typer.Option("--position-only", help="Leave the orientation of the poses aside.")
    ] = False,
    workers: Annotated[int, typer.Option("--workers", metavar="N", help="Processes at work; 1 by default.")] = 1,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Write the result; every base pose with its scores, .csv."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", metavar="FILE", help="Draw a .png, .pdf or .svg; the best of each place.")
    ] = None,
    json: Json = False,
) -> int:
    """Find the base pose from which an arm reaches most poses of a task, farthest from its limits; or the best arm.

    For example:
      pieper place ur3e ur5e task.csv --step 0.25
    """
    from pieper.workspace import place as placing

    if len(words) < 2:
        raise ArrayError(
            f"name one arm or several, and then a file of poses, as in: pieper place ur5e task.csv; got {words[0]!r} alone"
        )
    *names, file = words
    if not file.lower().endswith(".csv"):
        raise ArrayError(f"the last word is the file of poses and ends in .csv, got {file!r}")
    keep_apart([file], {"--out": out, "--figure": figure})
    if out is not None and out.suffix.lower() != ".csv":
        raise ArrayError(f"--out writes a table and ends in .csv, got {str(out)!r}")
    if figure is not None:
        from pieper.viewer import plot

        plot.checked_file(figure)
    targets, alone = placing.read_poses(file)
    tried = []
    for name in names:
        robot = with_tool(load(name), tool, tool_rpy)
        bases = placing.grid_of_bases(*_box(robot.chain, targets, x, y, step), z, step=step, yaws=yaws)
        tried.append(_with_progress(robot.name, robot, targets, bases, alone or position_only, workers))
    best = max(range(len(tried)), key=lambda i: (*tried[i].score, -i))
    if json:
        print_json({"best": best, "arms": [_record(each) for each in tried]})
    else:
        _print(tried, best)
    if out is not None:
        written(placing.write_scores(tried, out), json=json)
    if figure is not None:
        from pieper.viewer import map_figure, plot

        written(plot.save(map_figure.placement(tried[best], targets), figure), json=json)
    return 0 if tried[best].score[0] == len(targets) else 1


def _box(chain: Any, targets: FloatArray, x: Span | None, y: Span | None, step: float) -> tuple[Span, Span]:
    """Where to try the base: as given, or as far around the poses as the arm reaches, in whole steps."""
    import math

    from pieper.kinematics.reach import reach

    far = reach(chain).from_base if x is None or y is None else 0.0
    if far == float("inf"):
        raise ArrayError(f"{chain.name!r} has a slide without limits: say where to try its base with --x and --y")
    low, high = targets[:, :2, 3].min(axis=0) - far, targets[:, :2, 3].max(axis=0) + far
    if not 0.0 < step < math.inf:
        raise ArrayError(f"--step must be a positive length [m], got {step!r}")
    spans = [(math.floor(a / step) * step, math.ceil(b / step) * step) for a, b in zip(low, high, strict=True)]
    return x or spans[0], y or spans[1]


def _with_progress(
    name: str, robot: Any, targets: FloatArray, bases: FloatArray, position_only: bool, workers: int
) -> Placement:
    from pieper.workspace.place import place as try_bases

    with progress_bar(f"{name}, base poses") as advance:
        return try_bases(robot, targets, bases, position_only=position_only, workers=workers, progress=advance)


def _print(tried: list[Placement], best: int) -> None:
    import numpy as np

    out = console()
    for each in tried:
        out.print(f"{each.arm}  {len(each.bases)} base poses for {each.poses} poses", style="bold", markup=False)
        rows = []
        for k in each.order[:_LISTED]:
            a, b, c, yaw = each.bases[k]
            rows.append(
                [
                    *(f"{value:.3f}" for value in (a, b, c)),
                    f"{np.degrees(yaw):.0f}",
                    f"{each.reached[k]}/{each.poses}",
                    _worth(each.margin[k]),
                    _worth(each.manipulability[k]),
                ]
            )
        print_table(
            out, [">x [m]", ">y [m]", ">z [m]", ">yaw [deg]", ">reached", ">margin [rad]", ">manipulability"], rows
        )
        out.print()
    each = tried[best]
    a, b, c, yaw = each.bases[each.best]
    words = f"{each.arm} at {a:.3f} {b:.3f} {c:.3f} m, turned by {np.degrees(yaw):.0f} deg"
    if each.score[0] == each.poses:
        out.print(f"best  {words}, reaches all {each.poses} poses", style="green", markup=False, soft_wrap=True)
    else:
        out.print(
            f"best  {words}, reaches {each.score[0]} of {each.poses} poses: none tried reaches all",
            style="red",
            markup=False,
            soft_wrap=True,
        )


def _worth(value: float) -> str:
    return "-" if value != value else f"{value:.3g}"


def _record(each: Placement) -> dict[str, Any]:
    return {
        "arm": each.arm,
        "tried": len(each.bases),
        "poses": each.poses,
        "base": each.bases[each.best],
        "T_world_base": each.T_world_base,
        "reached": int(each.reached[each.best]),
        "margin": float(each.margin[each.best]),
        "manipulability": float(each.manipulability[each.best]),
    }
