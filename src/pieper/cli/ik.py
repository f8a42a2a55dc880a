"""``pieper ik``: the joint values that reach a target, several where there are several."""

from __future__ import annotations

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
from pieper.cli.show import console, number, print_json, print_table
from pieper.cli.target import seed_values, wanted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pieper.arm import Arm
    from pieper.ik.solutions import IKSolutions


def ik(
    arm: ArmName,
    x: X,
    y: Y,
    z: Z,
    rpy: Rpy = None,
    quaternion: Quaternion = None,
    axis: Axis = None,
    degrees: Degrees = False,
    seed: Seed = None,
    count: Annotated[int, typer.Option("--count", metavar="K", min=1, max=64, help="Answers to look for.")] = 8,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
    as_json: Json = False,
) -> int:
    """Print joint values that bring the tip to a target, one answer a column."""
    from pieper.ik.solve import solve

    robot = load(arm, base=base, tip=tip, nominal=nominal)
    goal = wanted(x, y, z, rpy=rpy, quaternion=quaternion, axis=axis, degrees=degrees)
    start = None if seed is None else seed_values(robot, seed, degrees=degrees)
    answers = solve(robot.chain, goal.target(), seed=start, count=count)
    reached = bool(answers.reached)
    if as_json:
        print_json(
            {
                "arm": robot.name,
                "base": robot.base,
                "tip": robot.tip,
                "joint_names": robot.joint_names,
                "target": goal.record(),
                **outcome(answers),
                "complete": answers.complete,
                "answers": _records(answers),
            }
        )
        return 0 if reached else 1
    out = console()
    out.print(f"{robot.name}  {robot.base} -> {robot.tip}", style="bold", markup=False)
    out.print(f"target  {x:.6g} {y:.6g} {z:.6g} m, {goal.words(degrees=degrees)}\n", markup=False)
    if reached:
        for headings, rows in _blocks(robot, _records(answers), out.width, degrees=degrees):
            print_table(out, headings, rows)
            out.print()
        out.print(f"joints that turn in {'degrees' if degrees else 'radians'}; others in metres", markup=False)
    else:
        out.print(f"not reached: {answers.reason}", style="red", markup=False)
    return 0 if reached else 1


def outcome(answers: IKSolutions) -> dict[str, Any]:
    """How a target ended, for JSON: the nearest pose is null where the target was reached."""
    from pieper.ik.solutions import Status

    near = answers.nearest
    return {
        "reached": bool(answers.reached),
        "status": Status(int(answers.status)).name,
        "reason": answers.reason,
        "nearest": None
        if answers.reached
        else {
            "q": near.q,
            "position_error": near.position_error,
            "rotation_error": near.rotation_error,
            "out_of_reach": near.out_of_reach,
        },
    }


def _records(answers: IKSolutions) -> list[dict[str, Any]]:
    return [
        {
            "q": answers.q[k].tolist(),
            "position_error": float(answers.position_error[k]),
            "rotation_error": float(answers.rotation_error[k]),
            "within_limits": bool(answers.within_limits[k]),
        }
        for k in range(len(answers.valid))
        if answers.valid[k]
    ]


def _blocks(
    robot: Arm, records: list[dict[str, Any]], width: int, *, degrees: bool
) -> Iterator[tuple[list[str], list[list[str]]]]:
    """The answers side by side, one row for each joint, in as many tables as the width of the screen asks for."""
    import numpy as np

    scale = np.where(turning(robot), np.degrees(1.0), 1.0) if degrees else np.ones(robot.dof)
    labels = [*robot.joint_names, "position error [m]", "rotation error [rad]", "joint limits"]
    columns = [
        [
            str(index),
            *(number(value, 4 if degrees else 6) for value in (np.array(record["q"]) * scale).tolist()),
            f"{record['position_error']:.1e}",
            f"{record['rotation_error']:.1e}",
            "inside" if record["within_limits"] else "outside",
        ]
        for index, record in enumerate(records, start=1)
    ]
    broadest = max(len(cell) for column in columns for cell in column) + 2
    across = max(1, (width - max(map(len, labels))) // broadest)
    for first in range(0, len(columns), across):
        block = columns[first : first + across]
        rows = [[label, *(column[k] for column in block)] for k, label in enumerate(labels, start=1)]
        yield ["answer", *(">" + column[0] for column in block)], rows
