"""``pieper fk``: where the tip is."""

from __future__ import annotations

from typing import Annotated

import typer

from pieper.cli.arguments import ArmName, Base, Degrees, Json, Nominal, Tip, about, joint_values, load
from pieper.cli.show import console, matrix, numbers, print_json


def fk(
    arm: ArmName,
    q: Annotated[list[float] | None, typer.Argument(metavar="Q1 Q2 ...", help="Joint values [rad or m].")] = None,
    degrees: Degrees = False,
    up_to: Annotated[
        str | None, typer.Option("--up-to", metavar="LINK", help="Pose of this link instead of the tip.")
    ] = None,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
    as_json: Json = False,
) -> int:
    """Print the pose of the tip in the base frame for the given joint values.

    For example:
      pieper fk mh12 --deg -10 20 30 0 45 0
    """
    import numpy as np

    from pieper.spatial import rotation

    robot = load(arm, base=base, tip=tip, nominal=nominal)
    values = joint_values(robot, q or [], degrees=degrees)
    end = up_to or robot.tip
    T = robot.fk(values, up_to=up_to)
    position, R = T[:3, 3], T[:3, :3]
    quaternion, rpy = rotation.as_quaternion(R), rotation.as_rpy(R)
    if as_json:
        print_json(
            {
                **about(robot),
                "tip": end,
                "q": values,
                "position": position,
                "quaternion_xyzw": quaternion,
                "rpy": rpy,
                "matrix": T,
            }
        )
        return 0
    out = console()
    out.print(f"{robot.name}  {robot.base} -> {end}\n", style="bold", markup=False)
    out.print(f"position    x y z             {numbers(position, 6, 10)}  m")
    out.print(f"quaternion  x y z w           {numbers(quaternion, 6, 10)}")
    out.print(f"angles      roll pitch yaw    {numbers(np.degrees(rpy), 4, 10)}  deg")
    out.print("matrix")
    out.print(matrix(T))
    return 0
