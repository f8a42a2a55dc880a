"""``pieper info``: what is known about an arm."""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING, Any

from pieper.cli.arguments import ArmName, Base, Json, Nominal, Tip, about, load, turning
from pieper.cli.show import console, matrix, number, print_json, print_table

if TYPE_CHECKING:
    from rich.console import Console

    from pieper.arm import Arm
    from pieper.model.dh import DhTable


def info(
    arm: ArmName,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
    as_json: Json = False,
) -> int:
    """Print the joints of an arm, their limits, Denavit-Hartenberg rows, screws, reach and structure.

    For example:
      pieper info ur5e
    """
    from dataclasses import asdict

    from pieper.ik.family import find_family
    from pieper.kinematics.reach import reach
    from pieper.model import dh

    robot = load(arm, base=base, tip=tip, nominal=nominal)
    chain = robot.chain
    rows = dh.as_dh(chain)
    far = reach(chain)
    family = find_family(chain)
    if as_json:
        print_json(
            {
                **about(robot),
                "joints": joint_records(robot),
                "frames": [frame.name for frame in chain.frames],
                "dh": dh.as_record(rows),
                "screws": chain.screws,
                "home": chain.home,
                "reach": {"from_base": far.from_base, "from_first_axis": far.from_first_axis},
                "structure": {"has_closed_form": family.has_closed_form, "reason": family.reason},
                "inverse_kinematics": asdict(robot.ik_info),
            }
        )
        return 0
    out = console()
    out.print(f"{robot.name}  {chain.base} -> {chain.tip}, {chain.dof} joints", style="bold", markup=False)
    out.print(
        f"reach      {number(far.from_base, 3)} m from the origin of {chain.base}, "
        f"{number(far.from_first_axis, 3)} m from the first axis",
        markup=False,
    )
    solved = str(robot.ik_info).removeprefix("solved ").replace(f": {family.reason}", "")
    said = {"structure": family.reason, "solved": solved}
    for name, words in said.items():
        for k, line in enumerate(wrap(words, max(20, out.width - 11))):
            out.print(f"{'' if k else name:9s}  {line}", markup=False)
    out.print()
    _print_joints(out, robot)
    _print_dh(out, rows)
    _print_screws(out, robot)
    return 0


def joint_records(robot: Arm) -> list[dict[str, Any]]:
    """Name, type and limits of each joint [rad or m], for JSON."""
    chain = robot.chain
    turns = turning(robot)
    return [
        {
            "name": chain.joint_names[i],
            "type": "revolute" if turns[i] else "prismatic",
            "lower": chain.limits[i, 0],
            "upper": chain.limits[i, 1],
            "max_velocity": chain.max_velocity[i],
            "max_effort": chain.max_effort[i],
        }
        for i in range(chain.dof)
    ]


def _print_joints(out: Console, robot: Arm) -> None:
    import numpy as np

    rows = []
    for joint in joint_records(robot):
        turns = joint["type"] == "revolute"
        scale = float(np.degrees(1.0)) if turns else 1.0
        digits = 2 if turns else 4
        endless = turns and not np.isfinite([joint["lower"], joint["upper"]]).any()
        row = [joint["name"], "continuous" if endless else joint["type"]]
        row += [number(joint[key] * scale, digits) for key in ("lower", "upper")]
        row += ["deg" if turns else "m", number(joint["max_velocity"] * scale, digits - 1)]
        rows.append([*row, number(joint["max_effort"], 1)])
    headings = ("joint", "type", ">lower", ">upper", "unit", ">speed [/s]", ">effort")
    print_table(out, headings, rows, title="Joints; effort in N or N m")


def _print_dh(out: Console, table: DhTable) -> None:
    import numpy as np

    rows, axis = [], 0
    for row in table.rows:
        name, d, theta = "fixed", number(row.d), number(float(np.degrees(row.theta)), 4)
        if row.type != "fixed":
            name = " + ".join(n for n, f in zip(table.joint_names, table.coupling[axis], strict=True) if f != 0.0)
            axis += 1
            term = f" {'-' if row.sign < 0 else '+'} q"
            d, theta = (d, theta + term) if row.type == "revolute" else (d + term, theta)
        rows.append((name, number(row.a), number(float(np.degrees(row.alpha)), 4), d, theta))
    out.print()
    headings = ("joint", ">a [m]", ">alpha [deg]", ">d [m]", ">theta [deg]")
    print_table(out, headings, rows, title="Standard Denavit-Hartenberg rows")
    for key, meaning in (("T_base", "before the first row"), ("T_tool", "after the last row")):
        T = getattr(table, key)
        if np.array_equal(T, np.eye(4)):
            continue
        out.print(f"{key}, {meaning}\n{matrix(T)}", markup=False)


def _print_screws(out: Console, robot: Arm) -> None:
    chain = robot.chain
    rows = [(str(axis), *(number(float(x)) for x in screw)) for axis, screw in enumerate(chain.screws, start=1)]
    headings = ("axis", *(f">{part}{i}" for part in "vw" for i in "xyz"))
    out.print()
    print_table(out, headings, rows, title="Screws at home, linear part first [m, -]")
    out.print(f"\npose of {chain.tip} at home\n{matrix(chain.home)}", markup=False)
