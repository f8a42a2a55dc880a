"""Arguments and options that several verbs share, and the arm that they name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion, record
from pieper.errors import DescriptionError, UnknownNameError, unknown_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from pieper.arm import Arm
    from pieper.model.dh import DhTable

ArmName = Annotated[
    str,
    typer.Argument(
        metavar="ARM", help="A built-in robot, or a URDF, xacro or JSON file.", autocompletion=completion.robots
    ),
]
Base = Annotated[str | None, typer.Option("--base", metavar="LINK", help="Link where the arm begins.")]
Tip = Annotated[str | None, typer.Option("--tip", metavar="LINK", help="Link where the arm ends.")]
Nominal = Annotated[
    bool, typer.Option("--nominal", help="Built-in robots: exact multiples of 45 deg instead of the printed angles.")
]
Degrees = Annotated[bool, typer.Option("--deg", help="Angles are given in degrees, not in radians.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object for scripts, in SI units.")]
X = Annotated[float, typer.Argument(metavar="X", help="Target in the base frame [m].")]
Y = Annotated[float, typer.Argument(metavar="Y", help="")]
Z = Annotated[float, typer.Argument(metavar="Z", help="")]
Rpy = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        "--rpy",
        metavar="ROLL PITCH YAW",
        help="Orientation Rz(yaw) Ry(pitch) Rx(roll) of the tip [rad; with --deg, deg].",
    ),
]
Quaternion = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option("--quat", metavar="X Y Z W", help="Orientation of the tip as a quaternion, scalar last."),
]
Axis = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--axis", metavar="X Y Z", help="Direction for the z axis of the tip, in base axes; free to spin."),
]
Start = Annotated[
    str | None,
    typer.Option(
        "--from",
        metavar="Q1,Q2,...",
        help="Joint values to start from, zero by default [rad or m; with --deg, deg or m].",
    ),
]


def load(name: str, *, base: str | None = None, tip: str | None = None, nominal: bool = False) -> Arm:
    """The arm that the command line names: a robot, a file, or a DH table on record, as in ``kr210:report``."""
    import pieper

    if Path(name).is_dir():
        raise DescriptionError(name, "file", "is a folder; name the URDF, xacro or JSON file in it")
    if name.lower().endswith(".json"):
        return pieper.load(record.from_file(name), base=base, tip=tip, nominal=nominal)
    table = _table_on_record(name)
    return pieper.load(name if table is None else table, base=base, tip=tip, nominal=nominal)


def _table_on_record(name: str) -> DhTable | None:
    """The table that ``ROBOT:TABLE`` means; None for other words."""
    robot, colon, label = name.partition(":")
    if not colon or Path(name).exists():
        return None
    from pieper.model import catalog

    try:
        tables = catalog.dh_tables(robot)
    except UnknownNameError:
        return None  # C:\..., or what the loader tells better
    if label not in tables:
        raise unknown_name("DH table", label, sorted(tables), f"the records of {robot!r}")
    return tables[label]


def about(arm: Arm) -> dict[str, Any]:
    """What every ``--json`` begins with: the arm, its ends, and the order of its joint values."""
    return {"arm": arm.name, "base": arm.base, "tip": arm.tip, "joint_names": list(arm.joint_names)}


def joint_values(arm: Arm, values: Sequence[float], *, degrees: bool) -> NDArray[np.float64]:
    """(n,) joint values [rad or m]; with `degrees` those of turning joints were typed in degrees."""
    import numpy as np

    from pieper.errors import ArrayError

    if len(values) != arm.dof:
        names = ", ".join(arm.joint_names)
        raise ArrayError(f"{arm.name} has {arm.dof} joints ({names}) and needs as many values, got {len(values)}")
    q = np.array(values, dtype=np.float64)
    return np.where(turning(arm), np.radians(q), q) if degrees else q


def turning(arm: Arm) -> NDArray[np.bool_]:
    """(n,) mask of the joints whose values are angles."""
    import numpy as np

    chain = arm.chain
    moved = chain.coupling != 0.0  # (axes, joints)
    return np.array([bool(chain.is_revolute[axes].all()) for axes in moved.T], dtype=np.bool_)
