"""``pieper move``: a motion to joint values or to a pose, within the limits of joints and tip, into a file."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pieper.cli.arguments import ArmName, Axis, Base, Degrees, Json, Nominal, Quaternion, Rpy, Start, Tip, about, load
from pieper.cli.show import console, print_json
from pieper.cli.target import start_values, wanted
from pieper.errors import PieperError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pieper.arm import Arm
    from pieper.motion.path_ik import JointPath
    from pieper.motion.timing import TcpLimits, Usage
    from pieper.motion.trajectory import Trajectory

Kept = Literal["pose", "axis", "position"]

To = Annotated[
    str | None,
    typer.Option("--to", metavar="Q1,Q2,...", help="Joint values to go to [rad or m; with --deg, deg or m]."),
]
Target = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--target", metavar="X Y Z", help="Position of the tip in the base frame [m]; instead of --to."),
]
Straight = Annotated[
    bool,
    typer.Option("--straight/--joint", help="The tip goes on a straight line, or the joints go their shortest way."),
]
Velocity = Annotated[float | None, typer.Option("--velocity", metavar="V", help="Limit of every joint [rad/s or m/s].")]
Acceleration = Annotated[
    float | None, typer.Option("--acceleration", metavar="A", help="Limit of every joint [rad/s^2 or m/s^2].")
]
Jerk = Annotated[float | None, typer.Option("--jerk", metavar="J", help="Limit of every joint [rad/s^3 or m/s^3].")]
TipVelocity = Annotated[float | None, typer.Option("--tip-velocity", metavar="V", help="Limit of the tip [m/s].")]
TipAcceleration = Annotated[
    float | None, typer.Option("--tip-acceleration", metavar="A", help="Limit of the tip [m/s^2].")
]
Rate = Annotated[
    float | None,
    typer.Option("--rate", metavar="HZ", help="How many a second; points in the file, as few as needed by default."),
]
Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="FILE", help="Write the result; the motion as .csv, .json or .npz."),
]
Figure = Annotated[
    Path | None,
    typer.Option("--figure", metavar="FILE", help="Draw a .png, .pdf or .svg; joint values and velocities."),
]

_ANSWER = ("reached", "reason", "break", "duration", "branch", "limits_used", "trajectory")
"""What ``--json`` says of a motion; null where there is nothing to say."""


def move(
    arm: ArmName,
    to: To = None,
    target: Target = None,
    rpy: Rpy = None,
    quaternion: Quaternion = None,
    axis: Axis = None,
    start: Start = None,
    straight: Straight = False,
    velocity: Velocity = None,
    acceleration: Acceleration = None,
    jerk: Jerk = None,
    tip_velocity: TipVelocity = None,
    tip_acceleration: TipAcceleration = None,
    rate: Rate = None,
    out: Out = None,
    figure: Figure = None,
    degrees: Degrees = False,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
    as_json: Json = False,
) -> int:
    """A motion from rest to rest to joint values (--to) or to a pose (--target), within limits of velocity, acceleration and jerk.

    For example:
      pieper move ur5e --from 0,-1,1,0,0,0 --to 1,-1,1,-1,-1,0 --out move.csv
      pieper move ur5e --from 0,-1,1,-1,-1,0 --target 0.5 0.2 0.4 --straight
    """
    import numpy as np

    from pieper.motion import files
    from pieper.motion.limits import JointLimits
    from pieper.motion.timing import TcpLimits, time_path, time_waypoints, usage

    _check(to, target, (rpy, quaternion, axis), out, figure)
    robot = load(arm, base=base, tip=tip, nominal=nominal)
    q_start = start_values(robot, start, degrees=degrees)
    limits = {"max_velocity": velocity, "max_acceleration": acceleration, "max_jerk": jerk}
    tcp = TcpLimits(
        np.inf if tip_velocity is None else tip_velocity, np.inf if tip_acceleration is None else tip_acceleration
    )
    T_goal, q_goal = _goal(robot, q_start, to, target, rpy, quaternion, axis, degrees=degrees)
    whole = target is None or rpy is not None or quaternion is not None
    counts = _what_counts(robot, whole=whole, axis=axis)
    way: JointPath | None = None
    if straight:
        way = _straight(robot, q_start, T_goal, counts)
        if way.broken is not None:
            return _not_reached(robot, way, as_json)
        made = time_path(way, tcp=tcp, **limits)
    else:
        found = q_goal if target is None else _answer(robot, q_start, T_goal, counts, target, axis)
        if found is None or isinstance(found, str):
            return _not_reached(robot, str(found), as_json)
        made = time_waypoints(robot.chain, [q_start, found], tcp=tcp, **limits)
    used = usage(made, JointLimits.of(robot.chain, **limits), tcp)
    written = made if rate is None else made.at_rate(rate)
    if out is not None:
        files.write(written, out)
    if figure is not None:
        _draw(robot, made, figure, degrees=degrees)
    if as_json:
        print_json(_record(robot, written, way, used))
    else:
        _print(robot, written, way, used, tcp, out, figure)
    return 0


def _check(
    to: str | None, target: object, orientation: tuple[object, ...], out: Path | None, figure: Path | None
) -> None:
    """What can be said before any work."""
    from pieper.motion import files

    if (to is None) == (target is None):
        raise PieperError("give one of --to Q1,Q2,... and --target X Y Z")
    if to is not None and any(way is not None for way in orientation):
        raise PieperError("--rpy, --quat and --axis belong to --target; joint values have an orientation already")
    if figure is not None:
        from pieper.viewer.plot import checked_file

        checked_file(figure)
    if out is not None and out.suffix.lower() not in files.FORMATS:
        raise PieperError(f"--out must end in {', '.join(files.FORMATS)}, got {str(out)!r}")


def _what_counts(robot: Arm, *, whole: bool, axis: object) -> list[Kept]:
    """What of the pose counts, most first: an arm with fewer than six joints can seldom keep what was not asked for."""
    if whole or robot.dof >= 6:
        return ["pose"]
    return ["pose", "position" if axis is None else "axis"]


def _goal(
    robot: Arm,
    q_start: NDArray[np.float64],
    to: str | None,
    target: tuple[float, float, float] | None,
    rpy: Any,
    quaternion: Any,
    axis: Any,
    *,
    degrees: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """The pose to go to, and the joint values where they were typed; a position alone keeps the orientation of the start."""
    if target is None:
        q = start_values(robot, to, degrees=degrees, option="--to")
        return robot.fk(q), q
    goal = wanted(*target, rpy=rpy, quaternion=quaternion, axis=axis, degrees=degrees)
    goal.target()  # refuses what does not go together
    return goal.pose_from(robot.fk(q_start)[:3, :3]), None


def _straight(robot: Arm, q_start: NDArray[np.float64], T_goal: NDArray[np.float64], counts: list[Kept]) -> JointPath:
    """The tip on a straight line: the first way that is complete, or the last one that was tried."""
    from pieper.motion.path import line
    from pieper.motion.path_ik import follow_path

    poses = line(robot.fk(q_start), T_goal)
    for kept in counts:
        way = follow_path(robot.chain, poses, q_start=q_start, target=kept)
        if way.complete:
            break
    return way


def _answer(
    robot: Arm,
    q_start: NDArray[np.float64],
    T_goal: NDArray[np.float64],
    counts: list[Kept],
    target: tuple[float, float, float],
    axis: Any,
) -> NDArray[np.float64] | str:
    """Joint values (n,) at the goal, those nearest to the start; or why there are none."""
    import numpy as np

    for kept in counts:
        if kept == "pose":
            answers = robot.ik(T_goal, seed=q_start)
        else:
            goal = wanted(*target, rpy=None, quaternion=None, axis=axis, degrees=False)
            answers = robot.ik(goal.target(), seed=q_start)
        if answers.reached and kept == "pose":
            return robot.nearest_ik(T_goal, q_start)
        if answers.reached:
            near = answers.q[answers.within_limits]
            return np.asarray(near[int(np.argmin(np.linalg.norm(near - q_start, axis=1)))])
    return str(answers.reason)


def _not_reached(robot: Arm, why: JointPath | str, as_json: bool) -> int:
    broken = None if isinstance(why, str) else why.broken
    reason = why if isinstance(why, str) else str(broken)
    if as_json:
        record: dict[str, Any] = {**about(robot), **dict.fromkeys(_ANSWER)}
        record |= {"reached": False, "reason": reason}
        if broken is not None:
            record["break"] = {key: getattr(broken, key) for key in ("s", "reason", "precision", "start")}
        print_json(record)
    else:
        console().print(f"not reached  {reason}", style="red", markup=False)
    return 1


def _record(robot: Arm, made: Trajectory, way: JointPath | None, used: Usage) -> dict[str, Any]:
    return {
        **about(robot),
        **dict.fromkeys(_ANSWER),
        "reached": True,
        "duration": made.duration,
        "branch": None if way is None or not way.branch else way.branch[0],
        "limits_used": used._asdict(),
        "trajectory": made.as_message(),
    }


def _print(
    robot: Arm,
    made: Trajectory,
    way: JointPath | None,
    used: Usage,
    tcp: TcpLimits,
    out: Path | None,
    figure: Path | None,
) -> None:
    page = console()
    page.print(f"{robot.name}  {robot.base} -> {robot.tip}\n", style="bold", markup=False)
    if way is None:
        page.print("way          straight in joint space", markup=False)
    else:
        branch = f", {way.branch[0]}" if way.branch and way.branch[0] else ""
        page.print(f"way          straight line of the tip, {len(way.q)} poses{branch}", markup=False)
    page.print(f"duration     {made.duration:.4g} s, {len(made.t)} points", markup=False)
    said = ["velocity", "acceleration", "jerk"]
    said += [f"tcp_{name}" for name in ("velocity", "acceleration") if isfinite(getattr(tcp, name))]
    words = [f"{name.replace('tcp_', 'tip ')} {100.0 * getattr(used, name):.0f} %" for name in said]
    shares = ", ".join(words)
    page.print(f"limits used  {shares}", markup=False)
    for file in (out, figure):
        if file is not None:
            typer.echo(f"wrote {file}", err=True)


def _draw(robot: Arm, made: Trajectory, file: Path, *, degrees: bool) -> None:
    from pieper.viewer import plot

    plot.save(plot.joints(robot, made, degrees=degrees), file)
