"""Denavit-Hartenberg tables, in and out: standard, modified (Craig), and Hayati's for nearly parallel axes.

A table is a product of elementary moves along the arm, ``Z(theta, d) = Rz(theta) Tz(d)`` for a joint and
``X(a, alpha) = Tx(a) Rx(alpha)`` for the way to the next axis:

    standard   T_base_tip = T_base  [Z_1 X_1] [Z_2 X_2] ... [Z_n X_n]      T_tool     joint i turns about z of frame i-1
    modified   T_base_tip = T_base  [X_0 Z_1] [X_1 Z_2] ... [X_n-1 Z_n]    T_tool     joint i turns about z of frame i
    hayati     as standard, with ``X(a, alpha, beta) = Tx(a) Rx(alpha) Ry(beta)``; a row uses d or beta, not both

with ``theta = offset + sign * q`` where joint i turns and ``d = offset + sign * q`` where it slides. Whatever lies between
the arm's base or tool frame and the first or last row goes into the constant poses ``T_base`` and ``T_tool``.

*Where a table is ill-conditioned.* The rows follow the common normals of neighbouring axes. Between axes that are parallel
but for a small angle s the common normal runs away to a distance of about 1/s, so rounding, and every error of the data,
grows by 1/s. `as_dh` reports that factor for each row and takes the best row that four numbers allow: the common normal,
or the row of parallel axes with the tilt left out that it cannot hold. The second is better below s of about 4.5e-8, so
the factor never exceeds 2.3e7. Hayati's rows have no common normal and keep full accuracy there.

References
----------
Denavit, Hartenberg, A kinematic notation for lower-pair mechanisms based on matrices, J. Applied Mechanics 22 (1955).
Craig, Introduction to Robotics, section 3.4 (modified rows).
Hayati, Mirmirani, Improving the absolute positioning accuracy of robot manipulators, J. Robotic Systems 2 (1985) 397-413.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.model._dh_of_chain import as_dh
from pieper.model._dh_pose import hayati_dh, modified_dh, move_x, standard_dh
from pieper.model._dh_table import (
    CONVENTIONS,
    JOINT_TYPES,
    Convention,
    DhRow,
    DhTable,
    JointType,
    as_record,
    from_record,
    from_rows,
    row_pose,
)
from pieper.model.chain import Chain, Frame

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model._arrays import FloatArray

__all__ = [
    "CONVENTIONS", "JOINT_TYPES", "Convention", "DhRow", "DhTable", "JointType", "as_dh", "as_record", "forward_kinematics",
    "from_dh", "from_record", "from_rows", "hayati_dh", "modified_dh", "standard_dh",
]  # fmt: skip


def forward_kinematics(table: DhTable | Any, readings: ArrayLike, *, up_to_joint: int | None = None) -> FloatArray:
    """Pose that a table gives for joint readings, row by row.

    Parameters
    ----------
    table : DhTable or rows
        Rows alone are standard ones, see `from_rows`.
    readings : (..., n) array
        Joint values [rad or m].
    up_to_joint : int, optional
        None: base to tip, tool included. k from 1 to n: base to the frame of the k-th joint's row. 0: the identity.

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        Wrong number of readings, or ``up_to_joint`` outside 0..n.
    DhError
        Malformed rows.

    Notes
    -----
    Slow and plain, to follow a table by hand. ``pieper.load(table).fk(q)`` does the same in compiled code.

    Examples
    --------
    >>> from pieper.model.catalog import dh_tables
    >>> table = dh_tables("youbot")["simplified"]
    >>> forward_kinematics(table, [0.0, 0.0, 0.0, 0.0, 0.0])[:3, 3].round(6).tolist()  # straight up
    [0.0, 0.0, 0.478]
    >>> forward_kinematics(table, [0.0, 0.0, 0.0, 0.0, 0.0], up_to_joint=2)[:3, 3].round(6).tolist()
    [0.0, 0.0, 0.23]
    """
    table = table if isinstance(table, DhTable) else from_rows(table)
    try:
        q = np.asarray(readings, dtype=np.float64)
    except (TypeError, ValueError) as cause:
        raise ArrayError(f"readings must be numbers of shape (..., {table.dof}), got {readings!r}") from cause
    if q.ndim == 0 or q.shape[-1] != table.dof:
        raise ArrayError(f"readings must have shape (..., {table.dof}), got {q.shape}")
    if not np.isfinite(q).all():
        raise ArrayError("readings must be finite")
    moving = table.moving
    if up_to_joint is None:
        last = len(table.rows)
    else:
        if isinstance(up_to_joint, bool) or int(up_to_joint) != up_to_joint or not 0 <= up_to_joint <= len(moving):
            raise ArrayError(f"up_to_joint must be an integer from 0 to {len(moving)}, got {up_to_joint!r}")
        last = moving[int(up_to_joint) - 1] + 1 if up_to_joint else 0
    T = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4)).copy()
    if up_to_joint == 0:
        return T
    values = q @ table.coupling.T
    T = T @ table.T_base
    for i, row in enumerate(table.rows[:last]):
        value = values[..., moving.index(i)] if i in moving else np.zeros(q.shape[:-1])
        T = T @ row_pose(row, table.convention, value)
    return T @ table.T_tool if up_to_joint is None else T


def from_dh(table: DhTable | Any, *, convention: Convention | None = None, **described: Any) -> Chain:
    """The chain of a table: each row's z axis at joint value 0 is a screw, the product of all rows the home pose.

    Parameters
    ----------
    table : DhTable or rows
    convention : str, optional
        Of bare rows; ``"standard"`` unless given.
    **described
        Further keywords of `from_rows` for bare rows: name, joint_names, limits, T_base, T_tool.

    Returns
    -------
    Chain
        With one frame per row.

    Raises
    ------
    DhError
        Malformed rows.
    ArrayError
        Keywords for bare rows were given together with a `DhTable`.

    Examples
    --------
    >>> chain = from_dh([(0.3, 0.0, 0.0, 0.0), (0.2, 0.0, 0.0, 0.0)])
    >>> chain.screws.tolist()
    [[0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [0.0, -0.3, 0.0, 0.0, 0.0, 1.0]]
    """
    if not isinstance(table, DhTable):
        table = from_rows(table, convention=convention or "standard", **described)
    elif convention is not None or described:
        given = ", ".join(([] if convention is None else ["convention"]) + sorted(described))
        raise ArrayError(f"a DhTable says all of it already; use dataclasses.replace to change {given}")
    T = table.T_base
    screws: list[FloatArray] = []
    frames = [Frame(table.base, 0, np.eye(4))]
    taken = {table.base, table.tip}
    for i, row in enumerate(table.rows, start=1):
        axis = T @ move_x(row.a, row.alpha, row.beta) if table.convention == "modified" else T
        if row.type != "fixed":
            z = row.sign * axis[:3, 2]
            z = z / np.linalg.norm(z)
            if row.type == "revolute":
                v = np.cross(axis[:3, 3], z)
                screws.append(np.concatenate([v - z * (v @ z), z]))  # a far origin leaves rounding along z
            else:
                screws.append(np.concatenate([z, np.zeros(3)]))
        T = T @ row_pose(row, table.convention)
        label = f"row_{i}"
        while label in taken:
            label += "_"
        taken.add(label)
        frames.append(Frame(label, len(screws), T))
    home = T @ table.T_tool
    frames.append(Frame(table.tip, len(screws), home))
    return Chain(
        name=table.name,
        screws=np.array(screws).reshape(-1, 6),
        home=home,
        limits=table.limits,
        joint_names=table.joint_names,
        base=table.base,
        tip=table.tip,
        frames=tuple(frames),
        max_velocity=table.max_velocity,
        max_effort=table.max_effort,
        coupling=table.coupling,
    )
