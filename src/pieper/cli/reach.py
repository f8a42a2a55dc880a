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
    Seed,
    Tip,
    X,
    Y,
    Z,
    load,
    turning,
)
from pieper.cli.ik import outcome
from pieper.cli.show import console, gauge, number, numbers, print_json, small, table_lines
from pieper.cli.target import seed_values, wanted

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.console import Console

    from pieper.arm import Arm
    from pieper.cli.target import Wanted
    from pieper.ik.solutions import IKSolutions
    from pieper.ik.target import Target

_STEPS = 40  # of one starting point, as the solver has it
_FRAME_SECONDS = 0.06


def reach(
    arm: ArmName,
    x: X,
    y: Y,
    z: Z,
    rpy: Rpy = None,
    quaternion: Quaternion = None,
    axis: Axis = None,
    degrees: Degrees = False,
    seed: Seed = None,
    animate: Annotated[
        bool | None, typer.Option("--animate/--no-animate", help="Show each step; by default on a terminal only.")
    ] = None,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
    as_json: Json = False,
) -> int:
    """Bring the tip to a target, starting from zero: joint table, errors, or how far the nearest pose is."""
    from pieper.ik.solve import solve

    robot = load(arm, base=base, tip=tip, nominal=nominal)
    goal = wanted(x, y, z, rpy=rpy, quaternion=quaternion, axis=axis, degrees=degrees)
    start = seed_values(robot, seed, degrees=degrees)
    target = goal.target()
    answers = solve(robot.chain, target, seed=start)
    reached = bool(answers.reached)
    q = answers.q[0] if reached else answers.nearest.q
    if as_json:
        print_json(_record(robot, goal, answers, q))
        return 0 if reached else 1

    out = console()
    out.print(f"{robot.name}  {robot.base} -> {robot.tip}\n", style="bold", markup=False)
    if animate if animate is not None else out.is_terminal:
        _animate(out, robot, target, start)
    for line in _arm_lines(robot, q, out.width):
        out.print(line, markup=False, no_wrap=True, overflow="ignore", crop=False)
    out.print()
    _print_pose(out, robot, goal, q, degrees=degrees)
    position_error, rotation_error = _errors(answers)
    out.print(f"errors       position {small(position_error, 'm')}, orientation {_turn(goal, rotation_error)}")
    if reached:
        out.print(f"reached      {_how(robot, target, start)}", style="green", markup=False)
    else:
        out.print(f"not reached  {answers.reason}", style="red", markup=False)
    return 0 if reached else 1


def _record(robot: Arm, goal: Wanted, answers: IKSolutions, q: NDArray[np.float64]) -> dict[str, Any]:
    from pieper.spatial import rotation

    T = robot.fk(q)
    position_error, rotation_error = _errors(answers)
    return {
        "arm": robot.name,
        "base": robot.base,
        "tip": robot.tip,
        "joint_names": robot.joint_names,
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


def _first_start(robot: Arm, target: Target, start: NDArray[np.float64], steps: int) -> IKSolutions:
    """What the solver has after so many steps from the first starting point alone."""
    from pieper.ik.numeric import solve_numeric

    return solve_numeric(robot.chain, target, seed=start, restarts=1, iterations=steps)


def _how(robot: Arm, target: Target, start: NDArray[np.float64]) -> str:
    for steps in range(1, _STEPS + 1):
        if _first_start(robot, target, start, steps).reached:
            return f"in {steps} step{'s' * (steps > 1)} from the start"
    return "from another starting point; the first one got stuck"


def _animate(out: Console, robot: Arm, target: Target, start: NDArray[np.float64]) -> None:
    """Show the arm after each step from the first starting point; where lines cannot be drawn again, its errors only."""
    from rich.live import Live
    from rich.text import Text

    with Live(console=out, auto_refresh=False, transient=True) as live:
        for steps in range(_STEPS + 1):
            q, errors, reached = start, "", False
            if steps:
                answers = _first_start(robot, target, start, steps)
                reached = bool(answers.reached)
                q = answers.q[0] if reached else answers.nearest.q
                errors = "position {:.1e} m, orientation {:.1e} rad".format(*_errors(answers))
            line = f"step {steps:2d}  {errors}".rstrip()
            if out.is_terminal:
                live.update(Text("\n".join([*_arm_lines(robot, q, out.width), "", line])), refresh=True)
                time.sleep(_FRAME_SECONDS)
            else:
                out.print(line, markup=False)
            if reached:
                break
