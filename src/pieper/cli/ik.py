"""``pieper ik``: the joint values that reach a target, every branch where the arm allows it."""

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
    Start,
    Tip,
    X,
    Y,
    Z,
    about,
    load,
    turning,
)
from pieper.cli.show import console, number, print_columns, print_json
from pieper.cli.target import start_values, wanted
from pieper.errors import ArrayError

if TYPE_CHECKING:
    from pieper.arm import Arm
    from pieper.ik.solutions import IKSolutions


_SEARCHED = 8
"""Answers that are looked for, or shown, where there is no end of them."""

_BRANCH_ROWS = ("shoulder", "elbow", "wrist")


def ik(
    arm: ArmName,
    x: X,
    y: Y,
    z: Z,
    rpy: Rpy = None,
    quaternion: Quaternion = None,
    axis: Axis = None,
    degrees: Degrees = False,
    start: Start = None,
    show_all: Annotated[bool, typer.Option("--all", help="Every branch, also those outside the joint limits.")] = False,
    redundancy: Annotated[
        str | None,
        typer.Option(
            "--redundancy",
            metavar="VALUE",
            help="Seven joints: value of the joint that is given (see pieper info), JOINT=VALUE for another one, or "
            "swivel=ANGLE [rad or m; with --deg, deg or m].",
        ),
    ] = None,
    count: Annotated[
        int | None, typer.Option("--count", metavar="N", min=1, max=64, help="How many; answers to print at most.")
    ] = None,
    base: Base = None,
    tip: Tip = None,
    nominal: Nominal = False,
    as_json: Json = False,
) -> int:
    """Print joint values that bring the tip to a target, one answer a column.

    For example:
      pieper ik ur5e 0.4 0.2 0.3 --rpy 180 0 0 --deg
    """
    robot = load(arm, base=base, tip=tip, nominal=nominal)
    goal = wanted(x, y, z, rpy=rpy, quaternion=quaternion, axis=axis, degrees=degrees)
    q_start = None if start is None else start_values(robot, start, degrees=degrees)
    searches = robot.ik_info.method == "numeric" or (robot.dof > 6 and not goal.is_whole)
    options: dict[str, Any] = {} if redundancy is None else {"redundancy": _redundancy(redundancy, degrees=degrees)}
    answers = robot.ik(goal.target(), q_start, count=(count or _SEARCHED) if searches else None, **options)
    if count is None and answers.free and not show_all:
        count = _SEARCHED
    reached = bool(answers.reached)
    records = _records(answers, outside=show_all or as_json)[:count]
    if as_json:
        print_json(
            {
                **about(robot),
                "target": goal.record(),
                **outcome(answers),
                "complete": bool(answers.complete),
                "answers": records,
            }
        )
        return 0 if reached else 1
    out = console()
    out.print(f"{robot.name}  {robot.base} -> {robot.tip}", style="bold", markup=False)
    out.print(f"target  {x:.6g} {y:.6g} {z:.6g} m, {goal.words(degrees=degrees)}\n", markup=False)
    if records:
        print_columns(out, "answer", *_columns(robot, records, degrees=degrees))
        out.print(f"joints that turn in {'degrees' if degrees else 'radians'}; others in metres", markup=False)
        out.print(_how_many(answers, len(records)), markup=False)
    if not reached:
        out.print(f"not reached: {answers.reason}", style="red", markup=False)
        if answers.count and not show_all:
            out.print("--all shows the answers outside the limits", markup=False)
    return 0 if reached else 1


def _redundancy(text: str, *, degrees: bool) -> float | dict[str, float]:
    """A value, or a name and its value, of what seven joints leave free."""
    from math import isfinite, radians

    name, _, number_text = text.rpartition("=")
    try:
        value = float(number_text)
    except ValueError:
        raise ArrayError(
            f"--redundancy must be a number, or a name and a number as in swivel=0.3; got {text!r}"
        ) from None
    if not isfinite(value):
        raise ArrayError(f"--redundancy must be a finite number, got {text!r}")
    value = radians(value) if degrees else value
    return {name: value} if name else value


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


def _how_many(answers: IKSolutions, shown: int) -> str:
    """How many answers there are, and whether they are all."""
    found, inside = int(answers.count), int(answers.within_limits.sum())
    if answers.free and bool(answers.complete):
        return f"{found} in all, each with a joint that is free" + (f", {shown} shown" if found > shown else "")
    if answers.free:
        ways = {1: "a curve", 2: "a surface", 3: "a continuum"}.get(answers.free, "a continuum")
        sampled = "" if shown == found else f", {shown} of {found} shown"
        return f"the answers form {ways}, these are samples{sampled}"
    if not bool(answers.complete):
        return f"{found} found; there may be others"
    others = f", {found - inside} outside the joint limits" if found > inside else ""
    hidden = f", {shown} shown" if found > shown else ""
    return f"{found} in all{others}{hidden}" + (" (--all shows them)" if inside < found > shown else "")


def _records(answers: IKSolutions, *, outside: bool) -> list[dict[str, Any]]:
    labels, margin = answers.labels, answers.limit_margin
    return [
        {
            "q": answers.q[k].tolist(),
            "branch": str(labels[k]),
            "position_error": float(answers.position_error[k]),
            "rotation_error": float(answers.rotation_error[k]),
            "within_limits": bool(answers.within_limits[k]),
            "limit_margin": float(margin[k]),
        }
        for k in range(len(answers.valid))
        if answers.valid[k] and (outside or answers.within_limits[k])
    ]


def _columns(robot: Arm, records: list[dict[str, Any]], *, degrees: bool) -> tuple[list[str], list[list[str]]]:
    """What the rows are, a joint each and what else is known; and the answers, a column each."""
    import numpy as np

    scale = np.where(turning(robot), np.degrees(1.0), 1.0) if degrees else np.ones(robot.dof)
    unit = "deg" if degrees else "rad"
    named = any(record["branch"] for record in records)
    labels = [
        *robot.joint_names,
        "position error [m]",
        "rotation error [rad]",
        "joint limits",
        f"margin to limits [{unit}]",
        *(_BRANCH_ROWS if named else ()),
    ]
    columns = [
        [
            str(index),
            *(number(value, 4 if degrees else 6) for value in (np.array(record["q"]) * scale).tolist()),
            f"{record['position_error']:.1e}",
            f"{record['rotation_error']:.1e}",
            "inside" if record["within_limits"] else "outside",
            _margin(robot, record, degrees=degrees),
            *(_branch_cells(record["branch"]) if named else ()),
        ]
        for index, record in enumerate(records, start=1)
    ]
    return labels, columns


def _margin(robot: Arm, record: dict[str, Any], *, degrees: bool) -> str:
    """The distance to the nearest limit, named with its unit when it is that of a slide; ``-`` without limits."""
    import numpy as np

    gaps = np.minimum(np.array(record["q"]) - robot.limits[:, 0], robot.limits[:, 1] - np.array(record["q"]))
    joint = int(np.argmin(gaps))
    if not np.isfinite(gaps[joint]):
        return "-"
    if not turning(robot)[joint]:
        return f"{number(float(gaps[joint]), 4)} m"
    return number(float(np.degrees(gaps[joint]) if degrees else gaps[joint]), 2 if degrees else 4)


def _branch_cells(branch: str) -> list[str]:
    """A label by its parts, one for each row of `_BRANCH_ROWS`."""
    parts = branch.split(", ")
    elbow = [part.removeprefix("elbow ") for part in parts if part.startswith("elbow ")]
    wrist = [part for part in parts if part in ("flip", "no flip")]
    rest = [part for part in parts if not part.startswith("elbow ") and part not in ("flip", "no flip")]
    return [part[0] if part else "" for part in (rest, elbow, wrist)]
