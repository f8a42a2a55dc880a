"""``pieper reach``: bring the tip to a target and show the arm that does it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli.arguments import (
    ArmName,
    Axis,
    Base,
    Degrees,
    Json,
    Nominal,
    Quaternion,
    Rpy,
    Start,
    Tip,
    X,
    Y,
    Z,
    about,
    load,
    turning,
)
from pieper.cli.ik import outcome
from pieper.cli.show import console, gauge, number, numbers, print_json, small, table_lines
from pieper.cli.target import start_values, wanted

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.console import Console

    from pieper.arm import Arm
    from pieper.cli.target import Wanted
    from pieper.ik.iteration import Step
    from pieper.ik.solutions import IKSolutions

# The way that is shown. The solver goes on from its end, so that what is shown and what is answered belong together.
_GAIN = 0.4
_DAMPING = 0.05  # keeps steps short near singular poses, where most arms stand at zero
_CLOSE = 1e-4  # [m, rad]
_SAME_ANSWER = 0.05  # [rad, m] more than _CLOSE moves a joint, less than two answers differ
_MOST_STEPS = 80
_PATIENCE = 15  # steps without getting closer
_FRAME_SECONDS = 0.04


def reach(
    arm: ArmName,
    x: X,
    y: Y,
    z: Z,
    rpy: Rpy = None,
    quaternion: Quaternion = None,
    axis: Axis = None,
    degrees: Degrees = False,
    start: Start = None,
    animate: Annotated[
        bool | None, typer.Option("--animate/--no-animate", help="Show each step; by default on a terminal only.")
    ] = None,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
    as_json: Json = False,
) -> int:
    """Bring the tip to a target, starting from zero: joint table, errors, or how far the nearest pose is.

    For example:
      pieper reach mh12 0.3 0.3 0.3
    """
    from pieper.ik.solve import solve

    robot = load(arm, base=base, tip=tip, nominal=nominal)
    goal = wanted(x, y, z, rpy=rpy, quaternion=quaternion, axis=axis, degrees=degrees)
    q_start = start_values(robot, start, degrees=degrees)
    target = goal.target()
    steps = _walk(robot, goal, q_start)
    answers = solve(robot.chain, target, seed=_first_seed(robot, steps))
    reached = bool(answers.reached)
    q = answers.q[0] if reached else answers.nearest.q
    if as_json:
        print_json(_record(robot, goal, answers, q))
        return 0 if reached else 1

    out = console()
    out.print(f"{robot.name}  {robot.base} -> {robot.tip}\n", style="bold", markup=False)
    if animate if animate is not None else out.is_terminal:
        _animate(out, robot, steps)
    for line in _arm_lines(robot, q, out.width):
        out.print(line, markup=False, no_wrap=True, overflow="ignore", crop=False)
    out.print()
    _print_pose(out, robot, goal, q, degrees=degrees)
    position_error, rotation_error = _errors(answers)
    out.print(f"errors       position {small(position_error, 'm')}, orientation {_turn(goal, rotation_error)}")
    if reached:
        out.print(f"reached      {_how(steps, q)}", style="green", markup=False)
    else:
        out.print(f"not reached  {answers.reason}", style="red", markup=False)
    return 0 if reached else 1


def _record(robot: Arm, goal: Wanted, answers: IKSolutions, q: NDArray[np.float64]) -> dict[str, Any]:
    from pieper.spatial import rotation

    T = robot.fk(q)
    position_error, rotation_error = _errors(answers)
    return {
        **about(robot),
        "target": goal.record(),
        **outcome(answers),
        "q": q,
        "margin": _margins(robot, q),
        "position": T[:3, 3],
        "quaternion_xyzw": rotation.as_quaternion(T[:3, :3]),
        "position_error": position_error,
        "rotation_error": rotation_error,
    }


def _errors(answers: IKSolutions) -> tuple[float, float]:
    if answers.reached:
        return float(answers.position_error[0]), float(answers.rotation_error[0])
    return float(answers.nearest.position_error), float(answers.nearest.rotation_error)


def _turn(goal: Wanted, error: float) -> str:
    return "not asked for" if goal.is_position_only else small(error, "rad")


def _margins(robot: Arm, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) distance of each joint to its nearer limit [rad or m]; infinite without limits, negative outside."""
    import numpy as np

    return np.asarray(np.minimum(q - robot.limits[:, 0], robot.limits[:, 1] - q))


def _arm_lines(robot: Arm, q: NDArray[np.float64], width: int) -> list[str]:
    """The joint table: values, limits, margin to the nearer one, and a picture of it where there is room."""
    import numpy as np

    rows = []
    for i, turns in enumerate(turning(robot)):
        scale, digits = (float(np.degrees(1.0)), 2) if turns else (1.0, 4)
        value, (lower, upper) = float(q[i]), robot.limits[i]
        rows.append(
            [
                robot.joint_names[i],
                number(value * scale, 4) if turns else "",
                number(value, 6) + ("" if turns else " m"),
                *(number(limit * scale, digits) for limit in (lower, upper)),
                number(float(_margins(robot, q)[i]) * scale, digits),
                gauge(value, lower, upper, 11),
            ]
        )
    headings = ["joint", ">deg", ">rad", ">lower", ">upper", ">margin", "limits"]
    lines = table_lines(headings, rows, width)
    if max(map(len, lines)) > width:
        lines = table_lines(headings[:-1], [row[:-1] for row in rows], width)
    return lines


def _print_pose(out: Console, robot: Arm, goal: Wanted, q: NDArray[np.float64], *, degrees: bool) -> None:
    import numpy as np

    from pieper.spatial import rotation

    T = robot.fk(q)
    rpy = np.degrees(rotation.as_rpy(T[:3, :3]))
    out.print(f"target       {numbers(goal.position, 6, 11)} m", markup=False)
    out.print(f"             {goal.words(degrees=degrees)}", markup=False)
    out.print(f"tip          {numbers(T[:3, 3], 6, 11)} m", markup=False)
    out.print(f"             {numbers(rpy, 4, 11)} deg  roll pitch yaw", markup=False)


def _walk(robot: Arm, goal: Wanted, start: NDArray[np.float64]) -> list[Step]:
    """The way from the start towards the target: damped steps, until the tip is close or comes no closer."""
    from pieper.ik.iteration import iterate

    pose = goal.pose_from(robot.fk(start)[:3, :3])
    steps: list[Step] = []
    best = -1
    for step in iterate(
        robot.chain,
        pose,
        start,
        orientation="ignore" if goal.is_position_only else "reach",
        alpha=_GAIN,
        damping=_DAMPING,
        iterations=_MOST_STEPS,
        position_stop=_CLOSE,
        rotation_stop=None if goal.is_position_only else _CLOSE,
    ):
        steps.append(step)
        best = step.iteration if best < 0 or step.norm < steps[best].norm else best
        if step.iteration - best > _PATIENCE:
            break
    return steps


def _first_seed(robot: Arm, steps: list[Step]) -> NDArray[np.float64]:
    """Where the solver goes on: the end of the way if it came close, else its beginning; no joint turned needlessly far."""
    import numpy as np

    start, end = steps[0].q, steps[-1].q
    if not _came_close(steps):
        return start
    turns = np.where(turning(robot), np.round((end - start) / (2.0 * np.pi)), 0.0)
    return np.asarray(end - 2.0 * np.pi * turns)


def _how(steps: list[Step], q: NDArray[np.float64]) -> str:
    """Whether the answer is where the way that is shown ends; it may end outside the joint limits."""
    import numpy as np

    from pieper.kinematics.joints import without_turns

    turned = np.abs(without_turns(True, q - steps[-1].q))
    if _came_close(steps) and float(turned.max()) < _SAME_ANSWER:
        return f"in {len(steps) - 1} steps from the start to 0.2 mm, then solved to the last digit"
    return "from another starting point"


def _came_close(steps: list[Step]) -> bool:
    return steps[-1].norm < 2.0 * _CLOSE


def _animate(out: Console, robot: Arm, steps: list[Step]) -> None:
    """Show the arm after each step; where lines cannot be drawn again, its errors only."""
    import numpy as np
    from rich.live import Live
    from rich.text import Text

    with Live(console=out, auto_refresh=False, transient=True) as live:
        for step in steps:
            parts = np.linalg.norm(step.error.reshape(-1, 3), axis=-1)
            left = ", ".join(f"{part:.1e} {unit}" for part, unit in zip(parts, ("m", "rad"), strict=False))
            line = f"step {step.iteration:2d}  {left} to go"
            if out.is_terminal:
                live.update(Text("\n".join([*_arm_lines(robot, step.q, out.width), "", line])), refresh=True)
                time.sleep(_FRAME_SECONDS)
            else:
                out.print(line, markup=False)
    if not out.is_terminal:
        out.print()
