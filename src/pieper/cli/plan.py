"""``pieper plan``: a motion around obstacles, or what is in the way."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli.arguments import (
    ArmName,
    Base,
    Degrees,
    Json,
    Nominal,
    Quaternion,
    Rpy,
    Start,
    Tip,
    about,
    load,
    turning,
)
from pieper.cli.move import Acceleration, Jerk, Out, To, Velocity
from pieper.cli.show import console, number, print_columns, print_json
from pieper.cli.target import start_values, wanted
from pieper.errors import ArrayError, PieperError

if TYPE_CHECKING:
    from pieper.arm import Arm
    from pieper.motion.planning import Plan
    from pieper.motion.trajectory import Trajectory
    from pieper.motion.world import World


def plan(
    arm: ArmName,
    world: Annotated[
        Path | None,
        typer.Option("--world", metavar="FILE", help="YAML file of obstacles in the base frame; none by default."),
    ] = None,
    start: Start = None,
    to: To = None,
    target: Annotated[
        tuple[float, float, float] | None,
        typer.Option("--target", metavar="X Y Z", help="Position of the tip in the base frame [m]; instead of --to."),
    ] = None,
    rpy: Rpy = None,
    quaternion: Quaternion = None,
    degrees: Degrees = False,
    margin: Annotated[float, typer.Option("--margin", metavar="M", help="Distance that is kept [m].")] = 0.01,
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", help="Of random numbers, the same again for the same; for the search.")
    ] = 0,
    timeout: Annotated[
        float, typer.Option("--timeout", metavar="SECONDS", help="How long at most; for the search.")
    ] = 5.0,
    velocity: Velocity = None,
    acceleration: Acceleration = None,
    jerk: Jerk = None,
    rest: Annotated[
        bool, typer.Option("--rest", help="Rest at each point; corners are rounded where that is free if not given.")
    ] = False,
    out: Out = None,
    picture: Annotated[
        Path | None,
        typer.Option("--picture", metavar="FILE", help="Draw a picture; of the arm among the obstacles, .png."),
    ] = None,
    json: Json = False,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
) -> int:
    r"""Find a motion from joint values to joint values or a pose that touches nothing.

    For example:
      pieper plan ur5e --world world.yaml --from 1.2,-1.2,1.2,-1.6,-1.6,0 \
          --to -1.2,-1.2,1.2,-1.6,-1.6,0 --out plan.csv
    """
    from pieper.motion import files, planning
    from pieper.motion.collision import CollisionModel
    from pieper.motion.world import World, read_world

    if (to is None) == (target is None):
        raise ArrayError("say where to go: either --to Q1,Q2,... or --target X Y Z")
    if target is None and (rpy, quaternion) != (None, None):
        raise ArrayError("--rpy and --quat speak of the orientation at a target; give --target X Y Z too")
    if out is not None and out.suffix.lower() not in files.FORMATS:
        raise PieperError(f"--out must end in {', '.join(files.FORMATS)}, got {str(out)!r}")
    if picture is not None and picture.suffix.lower() != ".png":
        raise ArrayError(f"--picture must end in .png, got {str(picture)!r}")
    robot = load(arm, base=base, tip=tip, nominal=nominal)
    around = World() if world is None else read_world(world)
    q_start = start_values(robot, start, degrees=degrees)
    goal: Any
    if target is None:
        goal = start_values(robot, to, degrees=degrees, option="--to")
    else:
        goal = wanted(*target, rpy=rpy, quaternion=quaternion, axis=None, degrees=degrees).target()
    model = CollisionModel(robot, around, margin=margin)
    found = _with_progress(lambda told: planning.plan(model, q_start, goal, seed=seed, timeout=timeout, progress=told))
    motion = None
    if found.found:
        motion = found.trajectory(
            robot.chain if rest else model, max_velocity=velocity, max_acceleration=acceleration, max_jerk=jerk
        )
    if out is not None and motion is not None:
        files.write(motion, out)
    if picture is not None:
        _draw(robot, around, found, picture)
    if json:
        print_json(_record(robot, found, motion))
    else:
        _print(robot, found, motion)
        for path in (out if found.found else None, picture):
            if path is not None:
                console().print(f"wrote {path}", markup=False, soft_wrap=True)
    return 0 if found.found else 1


def _with_progress(work: Any) -> Plan:
    """Do the work, with a line about it on a terminal."""
    from rich.console import Console

    screen = Console(stderr=True)
    if not screen.is_terminal:
        return work(None)  # type: ignore[no-any-return]
    with screen.status("planning") as status:

        def told(seconds: float, edges: int) -> None:
            status.update(f"planning  {seconds:.1f} s, {edges} edges looked at")

        return work(told)  # type: ignore[no-any-return]


def _print(robot: Arm, found: Plan, motion: Trajectory | None) -> None:
    import numpy as np

    out = console()
    out.print(f"{robot.name}  {robot.base} -> {robot.tip}\n", markup=False)
    shown = np.where(turning(robot), np.degrees(found.q), found.q)
    columns = [[str(k), *(number(value, 2) for value in row)] for k, row in enumerate(shown.tolist())]
    print_columns(out, "point", list(robot.joint_names), columns, title="deg or m")
    if found.found:
        out.print(f"found  {found}", style="green", markup=False, soft_wrap=True)
        out.print(
            f"       {found.edges} edge{'' if found.edges == 1 else 's'} and {found.states} states looked at; at least {1e3 * found.kept:.3g} mm kept all along",
            markup=False,
            soft_wrap=True,
        )
        if motion is not None:
            out.print(f"       {motion.duration:.3g} s from rest to rest, jerk-limited", markup=False, soft_wrap=True)
    else:
        out.print(f"{found.status}  {found.reason}", style="red", markup=False, soft_wrap=True)


def _record(robot: Arm, found: Plan, motion: Trajectory | None) -> dict[str, Any]:
    pair = found.blocking
    return {
        **about(robot),
        "found": found.found,
        "status": found.status,
        "reason": found.reason,
        "q": found.q,
        "duration": None if motion is None else motion.duration,
        "blocking": None if pair is None else {"first": pair.first, "second": pair.second, "distance": pair.distance},
        "margin": found.margin,
        "kept": found.kept,
        "seconds": found.seconds,
        "edges": found.edges,
        "states": found.states,
    }


def _draw(robot: Arm, around: World, found: Plan, file: Path) -> None:
    """The arm at both ends, as ghosts between, among the obstacles."""
    from pieper.sim.picture import Picture

    picture = Picture()
    draw_plan(picture, robot, around, found)
    picture.save(file)


def draw_plan(picture: Any, robot: Arm, around: World, found: Plan) -> None:
    """Put a plan into a picture."""
    from pieper.kinematics.fk import fk

    picture.add_solids([(item.solid, item.pose) for item in around], opacity=1.0)
    color = "#f28c28"
    picture.add_arm(robot, found.q[-1], color=color)
    for q in found.q[:-1]:
        picture.add_arm(robot, q, color=color, opacity=0.25)
    if len(found.q) > 1:
        import numpy as np

        way = np.vstack(
            [a + np.linspace(0.0, 1.0, 40)[:, None] * (b - a) for a, b in zip(found.q[:-1], found.q[1:], strict=True)]
        )
        picture.add_line(fk(robot.chain, way)[:, :3, 3])
