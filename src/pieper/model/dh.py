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

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import atan2, hypot, inf, isfinite, pi
from numbers import Real
from typing import Any, Literal, TypeAlias, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pieper.errors import ArrayError, DhError, PieperWarning
from pieper.model.chain import Chain, Frame, default_joint_names

FloatArray = NDArray[np.float64]
Convention: TypeAlias = Literal["standard", "modified", "hayati"]
JointType: TypeAlias = Literal["revolute", "prismatic", "fixed"]

CONVENTIONS: tuple[Convention, ...] = get_args(Convention)
JOINT_TYPES: tuple[str, ...] = get_args(JointType)

_NEARLY_PARALLEL = 0.1  # sine below which rows for parallel axes are considered: their factor is then below 1.006
_WARN_ABOVE = 1e2  # amplification at which a table can no longer keep 1e-12
_TIDY = 2e-15  # rounding left by poses of a few metres: closer numbers are taken for 0 or a quarter turn
_ROTATION_TOLERANCE = 1e-9  # as for Chain


# --------------------------------------------------------------------------------------------------------------------
# one row as a pose


def standard_dh(a: ArrayLike, alpha: ArrayLike, d: ArrayLike, theta: ArrayLike) -> FloatArray:
    """Pose of a standard (distal) row, ``Rz(theta) Tz(d) Tx(a) Rx(alpha)``.

    Parameters
    ----------
    a, d : (...) arrays
        Lengths along x and z [m].
    alpha, theta : (...) arrays
        Angles about x and z [rad].

    Returns
    -------
    (..., 4, 4) array
        The arguments broadcast. Sine and cosine are exact at the doubles nearest to multiples of pi/2.

    Raises
    ------
    ArrayError
        An argument is not a finite number, or the shapes do not broadcast.

    References
    ----------
    Denavit, Hartenberg (1955).

    Examples
    --------
    >>> standard_dh(0.5, np.pi / 2, 0.1, 0.0)
    array([[ 1. ,  0. ,  0. ,  0.5],
           [ 0. ,  0. , -1. ,  0. ],
           [ 0. ,  1. ,  0. ,  0.1],
           [ 0. ,  0. ,  0. ,  1. ]])
    """
    a, alpha, d, theta = _numbers(a=a, alpha=alpha, d=d, theta=theta)
    return _turn_z(theta, d) @ _move_x(a, alpha, np.zeros_like(a))


def modified_dh(alpha: ArrayLike, a: ArrayLike, d: ArrayLike, theta: ArrayLike) -> FloatArray:
    """Pose of a modified (proximal, Craig) row, ``Rx(alpha) Tx(a) Rz(theta) Tz(d)``.

    The order of the arguments is the order in which Craig's tables print them: alpha_{i-1}, a_{i-1}, d_i, theta_i.

    Parameters
    ----------
    alpha, theta : (...) arrays
        Angles about x and z [rad].
    a, d : (...) arrays
        Lengths along x and z [m].

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        An argument is not a finite number, or the shapes do not broadcast.

    References
    ----------
    Craig, Introduction to Robotics, eq. 3.6.

    Examples
    --------
    >>> modified_dh(np.pi / 2, 0.5, 0.1, 0.0)
    array([[ 1. ,  0. ,  0. ,  0.5],
           [ 0. ,  0. , -1. , -0.1],
           [ 0. ,  1. ,  0. ,  0. ],
           [ 0. ,  0. ,  0. ,  1. ]])
    """
    alpha, a, d, theta = _numbers(alpha=alpha, a=a, d=d, theta=theta)
    return _move_x(a, alpha, np.zeros_like(a)) @ _turn_z(theta, d)


def hayati_dh(a: ArrayLike, alpha: ArrayLike, beta: ArrayLike, d: ArrayLike, theta: ArrayLike) -> FloatArray:
    """Pose of a Hayati row, ``Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)``; with ``beta = 0`` a standard row.

    Parameters
    ----------
    a, d : (...) arrays
        Lengths along x and z [m].
    alpha, beta, theta : (...) arrays
        Angles about x, y and z [rad].

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        An argument is not a finite number, or the shapes do not broadcast.

    References
    ----------
    Hayati, Mirmirani (1985).

    Examples
    --------
    >>> hayati_dh(0.5, 0.0, 0.001, 0.0, 0.0)[:3, 2].round(6).tolist()
    [0.001, 0.0, 1.0]
    """
    a, alpha, beta, d, theta = _numbers(a=a, alpha=alpha, beta=beta, d=d, theta=theta)
    return _turn_z(theta, d) @ _move_x(a, alpha, beta)


def _numbers(**arguments: ArrayLike) -> list[FloatArray]:
    arrays = []
    for name, value in arguments.items():
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError) as cause:
            raise ArrayError(f"{name} must be a number or an array of numbers, got {value!r}") from cause
        if not np.isfinite(array).all():
            raise ArrayError(f"{name} must be finite, got {array.tolist()}")
        arrays.append(array)
    try:
        return list(np.broadcast_arrays(*arrays))
    except ValueError as cause:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in zip(arguments, arrays, strict=True))
        raise ArrayError(f"the arguments must broadcast to one shape, got {shapes}") from cause


def _sin_cos(angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Sine and cosine, exactly 0 and +-1 at the doubles nearest to multiples of pi/2."""
    angle = np.asarray(angle, dtype=np.float64)
    quarters = np.rint(angle / (0.5 * pi))
    exact = angle == quarters * (0.5 * pi)
    quadrant = np.where(exact, quarters, 0.0).astype(np.int64) % 4
    sine = np.where(exact, np.array([0.0, 1.0, 0.0, -1.0])[quadrant], np.sin(angle))
    cosine = np.where(exact, np.array([1.0, 0.0, -1.0, 0.0])[quadrant], np.cos(angle))
    return sine, cosine


def _turn_z(theta: ArrayLike, d: ArrayLike) -> FloatArray:
    """Z = Rz(theta) Tz(d), (..., 4, 4)."""
    s, c = _sin_cos(theta)
    T = np.zeros((*s.shape, 4, 4))
    T[..., 0, 0], T[..., 0, 1] = c, -s
    T[..., 1, 0], T[..., 1, 1] = s, c
    T[..., 2, 2] = T[..., 3, 3] = 1.0
    T[..., 2, 3] = d
    return T


def _move_x(a: ArrayLike, alpha: ArrayLike, beta: ArrayLike) -> FloatArray:
    """X = Tx(a) Rx(alpha) Ry(beta), (..., 4, 4)."""
    s, c = _sin_cos(alpha)
    sb, cb = _sin_cos(beta)
    T = np.zeros((*s.shape, 4, 4))
    T[..., 0, 0], T[..., 0, 2], T[..., 0, 3] = cb, sb, a
    T[..., 1, 0], T[..., 1, 1], T[..., 1, 2] = s * sb, c, -s * cb
    T[..., 2, 0], T[..., 2, 1], T[..., 2, 2] = -c * sb, s, c * cb
    T[..., 3, 3] = 1.0
    return T


# --------------------------------------------------------------------------------------------------------------------
# tables


@dataclass(frozen=True)
class DhRow:
    """One row of a table.

    Attributes
    ----------
    a, d : float
        Lengths along x and z [m]; in a prismatic row d is the value at joint value 0.
    alpha, theta : float
        Angles about x and z [rad]; in a revolute row theta is the value at joint value 0.
    sign : int
        +1 or -1: the joint moves with or against z.
    type : str
        ``"revolute"``, ``"prismatic"``, or ``"fixed"`` for a row without a joint.
    beta : float
        Hayati's second tilt, about y [rad]; 0 in standard and modified tables.
    """

    a: float
    alpha: float
    d: float
    theta: float
    sign: int = 1
    type: JointType = "revolute"
    beta: float = 0.0


def _not_given() -> FloatArray:
    """Stands for a field that was left out."""
    return np.empty(0)


def _absent(value: Any) -> bool:
    return value is None or (isinstance(value, np.ndarray) and value.size == 0)


@dataclass(frozen=True, eq=False)
class DhTable:
    """A Denavit-Hartenberg table with everything that the arm needs besides its rows.

    Attributes
    ----------
    rows : tuple of DhRow
        m of them have a joint, the others are fixed.
    convention : str
        ``"standard"``, ``"modified"`` or ``"hayati"``.
    T_base, T_tool : (4, 4) arrays
        Constant poses before the first and after the last row [m, -].
    joint_names : tuple of n str
    limits : (n, 2) array
        Lower and upper joint limits [rad or m].
    name, base, tip : str
        Names of the arm and of its end frames.
    max_velocity, max_effort : (n,) arrays
        [rad/s or m/s, N m or N]; infinite where not known.
    coupling : (m, n) array
        Row values from joint values; the identity unless mimic joints move several rows.
    amplification : (rows,) array
        How many times rounding errors grow in the row when an arm is turned into it [-]: 1 for exactly parallel axes, at
        most 10 for axes that are clearly not parallel, about 1/sin(twist) for axes that are nearly parallel; 1 for rows
        that were typed in.

    Raises
    ------
    DhError
        A row is not made of finite numbers, or a sign, a joint type or the convention is unknown.
    ArrayError
        Another field has the wrong shape or is not finite.
    """

    rows: tuple[DhRow, ...]
    convention: Convention = "standard"
    T_base: FloatArray = field(default_factory=_not_given)
    T_tool: FloatArray = field(default_factory=_not_given)
    joint_names: tuple[str, ...] = ()
    limits: FloatArray = field(default_factory=_not_given)
    name: str = "arm"
    base: str = "base"
    tip: str = "tip"
    max_velocity: FloatArray = field(default_factory=_not_given)
    max_effort: FloatArray = field(default_factory=_not_given)
    coupling: FloatArray = field(default_factory=_not_given)
    amplification: FloatArray = field(default_factory=_not_given)

    def __post_init__(self) -> None:
        def put(key: str, value: Any) -> None:
            object.__setattr__(self, key, value)

        if self.convention not in CONVENTIONS:
            raise DhError(self.name, "convention", f"must be one of {', '.join(CONVENTIONS)}, got {self.convention!r}")
        put("rows", tuple(_row(row, i, self.convention, self.name) for i, row in enumerate(self.rows, start=1)))
        m = len(self.moving)
        put("joint_names", tuple(self.joint_names) or tuple(default_joint_names(m)))
        n = len(self.joint_names)
        if _absent(self.coupling) and n != m:
            raise DhError(self.name, "joint names", f"the table has {m} joints, got {n} names")
        for key, default in (("T_base", np.eye(4)), ("T_tool", np.eye(4))):
            value = getattr(self, key)
            put(key, _pose(default if _absent(value) else value, key))
        for key, shape, fill in (
            ("limits", (n, 2), np.tile([-inf, inf], (n, 1))),
            ("max_velocity", (n,), np.full(n, inf)),
            ("max_effort", (n,), np.full(n, inf)),
            ("coupling", (m, n), np.eye(n)),
            ("amplification", (len(self.rows),), np.ones(len(self.rows))),
        ):
            value = getattr(self, key)
            put(key, _array(fill if _absent(value) else value, shape, key))

    @property
    def dof(self) -> int:
        """Number of joints n."""
        return len(self.joint_names)

    @property
    def moving(self) -> tuple[int, ...]:
        """Indices of the rows that have a joint."""
        return tuple(i for i, row in enumerate(self.rows) if row.type != "fixed")

    def __str__(self) -> str:
        """The table as text, angles in degrees."""
        hayati = self.convention == "hayati"
        head = ["row", "joint", "a [m]", "alpha [deg]", "d [m]", "theta [deg]", "amplification"]
        if hayati:
            head.insert(4, "beta [deg]")
        cells = [head]
        axis = 0
        for i, row in enumerate(self.rows):
            joint, d, theta = "fixed", f"{row.d:.10g}", f"{np.degrees(row.theta):.10g}"
            if row.type != "fixed":
                joint = self._variable(axis)
                axis += 1
                term = f"{'-' if row.sign < 0 else '+'} q"
                if row.type == "revolute":
                    theta = f"{theta} {term}"
                else:
                    d = f"{d} {term}"
            line = [str(i + 1), joint, f"{row.a:.10g}", f"{np.degrees(row.alpha):.10g}", d, theta]
            line.append(f"{self.amplification[i]:.2g}")
            if hayati:
                line.insert(4, f"{np.degrees(row.beta):.10g}")
            cells.append(line)
        widths = [max(len(line[k]) for line in cells) for k in range(len(head))]
        lines = [f"{self.name}, {self.convention} DH"]
        lines += ["  ".join(c.rjust(w) for c, w in zip(line, widths, strict=True)) for line in cells]
        for key in ("T_base", "T_tool"):
            T = getattr(self, key)
            if not np.array_equal(T, np.eye(4)):
                lines.append(f"{key} = {np.array2string(T, precision=9, suppress_small=True, prefix=f'{key} = ')}")
        return "\n".join(lines)

    def _variable(self, axis: int) -> str:
        """What moves a row: a joint name, or a sum of them where joints are coupled."""
        terms = [
            name if factor == 1.0 else f"{factor:.10g} {name}"
            for name, factor in zip(self.joint_names, self.coupling[axis].tolist(), strict=True)
            if factor != 0.0
        ]
        return " + ".join(terms)


def from_rows(
    rows: Any,
    *,
    convention: Convention = "standard",
    name: str = "arm",
    joint_names: Sequence[str] | None = None,
    limits: ArrayLike | None = None,
    T_base: ArrayLike | None = None,
    T_tool: ArrayLike | None = None,
) -> DhTable:
    """A table from bare rows.

    Parameters
    ----------
    rows : sequence
        Each row is a `DhRow`; a mapping with the keys ``a, alpha, d, theta`` and, where needed, ``sign, type, beta``
        (a key left out is 0, +1 or ``"revolute"``); or four numbers in the order of the convention's own function:
        ``(a, alpha, d, theta)`` for standard and Hayati rows, ``(alpha, a, d, theta)`` for modified ones. [m, rad]
    convention : str
        ``"standard"``, ``"modified"`` or ``"hayati"``.
    name : str
    joint_names : sequence of n str, optional
        ``joint_1`` ... unless given.
    limits : (n, 2) array, optional
        [rad or m]; without limits unless given.
    T_base, T_tool : (4, 4) arrays, optional
        The identity unless given.

    Returns
    -------
    DhTable

    Raises
    ------
    DhError
        Naming the row (counted from 1) and the column that is not a finite number.

    Examples
    --------
    >>> table = from_rows([(0.3, 0.0, 0.0, 0.0), (0.2, 0.0, 0.0, 0.0)], name="planar")
    >>> forward_kinematics(table, [0.0, np.pi / 2])[:3, 3].tolist()
    [0.3, 0.2, 0.0]
    """
    if isinstance(rows, str | bytes | Mapping) or not hasattr(rows, "__iter__"):
        raise DhError(name, "rows", f"must be a sequence of rows, got {rows!r}")
    return DhTable(
        rows=tuple(rows),
        convention=convention,
        name=name,
        joint_names=tuple(joint_names or ()),
        limits=cast(FloatArray, limits),
        T_base=cast(FloatArray, T_base),
        T_tool=cast(FloatArray, T_tool),
    )


def from_record(record: Mapping[str, Any]) -> DhTable:
    """A table from plain data as `as_record` writes it; keys that it does not know are left alone.

    Raises
    ------
    DhError
        Not a mapping, a key is missing or malformed, or a row is not made of finite numbers.

    Examples
    --------
    >>> from_record({"convention": "standard", "rows": [{"a": 0.3, "alpha": 0, "d": 0, "theta": 0}]}).dof
    1
    """
    if not isinstance(record, Mapping):
        raise DhError(
            "<record>", "record", f"must be a mapping with 'convention' and 'rows', got {type(record).__name__}"
        )
    name = str(record.get("name", "arm"))
    for key in ("convention", "rows"):
        if key not in record:
            raise DhError(name, key, "is missing")
    known = {key: record[key] for key in _RECORD_KEYS if record.get(key) is not None}
    try:
        for key in ("limits", "max_velocity", "max_effort"):
            if key in known:
                known[key] = _with_infinity(known[key], lower=key == "limits")
    except (TypeError, ValueError):
        wanted = "pairs of numbers" if key == "limits" else "numbers"
        raise DhError(name, key, f"must be a list of {wanted} or nulls, got {known[key]!r}") from None
    rows = known.pop("rows")
    if isinstance(rows, str | bytes) or not hasattr(rows, "__iter__"):
        raise DhError(name, "rows", f"must be a list of rows, got {type(rows).__name__}")
    return DhTable(rows=tuple(rows), **known)


def as_record(table: DhTable) -> dict[str, Any]:
    """The table as plain data, ready for JSON or YAML; infinite limits become None.

    Examples
    --------
    >>> as_record(from_rows([(0.3, 0.0, 0.0, 0.0)]))["rows"]
    [{'a': 0.3, 'alpha': 0.0, 'd': 0.0, 'theta': 0.0, 'sign': 1, 'type': 'revolute', 'beta': 0.0}]
    """
    record: dict[str, Any] = {}
    for key in _RECORD_KEYS:
        value = getattr(table, key)
        if key == "rows":
            value = [{column: getattr(row, column) for column in (*_COLUMNS, "sign", "type", "beta")} for row in value]
        elif isinstance(value, np.ndarray):
            value = _without_infinity(value.tolist())
        elif isinstance(value, tuple):
            value = list(value)
        record[key] = value
    return record


_COLUMNS = ("a", "alpha", "d", "theta")
_RECORD_KEYS = (
    "name", "convention", "rows", "T_base", "T_tool", "joint_names", "limits", "base", "tip", "max_velocity", "max_effort",
    "coupling", "amplification",
)  # fmt: skip


def _without_infinity(value: Any) -> Any:
    if isinstance(value, list):
        return [_without_infinity(v) for v in value]
    return value if isfinite(value) else None


def _with_infinity(value: Any, *, lower: bool) -> Any:
    """None becomes +inf, and -inf in the first column of limits."""
    if lower:
        return [[-inf if low is None else low, inf if high is None else high] for low, high in value]
    return [inf if v is None else v for v in value]


def _row(row: Any, number: int, convention: str, source: str) -> DhRow:
    """A checked row from a `DhRow`, a mapping, or four numbers."""
    element = f"row {number}"
    if isinstance(row, DhRow):
        values: dict[str, Any] = {key: getattr(row, key) for key in (*_COLUMNS, "sign", "type", "beta")}
    elif isinstance(row, Mapping):
        values = {"sign": 1, "type": "revolute", "beta": 0.0, **dict.fromkeys(_COLUMNS, 0.0), **row}
        unknown = sorted(set(map(str, values)) - {*_COLUMNS, "sign", "type", "beta"})
        if unknown:
            raise DhError(
                source, element, f"unknown column {unknown[0]!r}; columns are: a, alpha, d, theta, sign, type, beta"
            )
    else:
        order = ("alpha", "a", "d", "theta") if convention == "modified" else _COLUMNS
        try:
            numbers = [] if isinstance(row, str | bytes) else list(row)
        except TypeError:
            numbers = []
        if len(numbers) != 4:
            raise DhError(source, element, f"needs four numbers ({', '.join(order)}), got {row!r}")
        values = {"sign": 1, "type": "revolute", "beta": 0.0, **dict(zip(order, numbers, strict=True))}
    for column in (*_COLUMNS, "beta"):
        value = values[column]
        if isinstance(value, bool | np.bool_) or not isinstance(value, Real) or not isfinite(value):
            raise DhError(source, f"{element}, column {column!r}", f"must be a finite number, got {value!r}")
        values[column] = float(value)
    if values["sign"] not in (1, -1) or isinstance(values["sign"], bool):
        raise DhError(source, f"{element}, column 'sign'", f"must be +1 or -1, got {values['sign']!r}")
    values["sign"] = int(values["sign"])
    if values["type"] not in JOINT_TYPES:
        raise DhError(
            source, f"{element}, column 'type'", f"must be one of {', '.join(JOINT_TYPES)}, got {values['type']!r}"
        )
    if values["beta"] != 0.0 and convention != "hayati":
        raise DhError(source, f"{element}, column 'beta'", f"must be 0 in a {convention} table, got {values['beta']!r}")
    return DhRow(**values)


def _array(value: ArrayLike, shape: tuple[int, ...], name: str) -> FloatArray:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as cause:
        raise ArrayError(f"{name} must be numbers of shape {shape}, got {value!r}") from cause
    if 0 in shape and array.size == 0:
        array = array.reshape(shape)
    if array.shape != shape:
        raise ArrayError(f"{name} must have shape {shape}, got {array.shape}")
    if np.isnan(array).any():
        raise ArrayError(f"{name} must not hold NaN, got {array.tolist()}")
    array.setflags(write=False)
    return array


def _pose(value: ArrayLike, name: str) -> FloatArray:
    T = _array(value, (4, 4), name)
    R = T[:3, :3]
    deviation = float(np.abs(R @ R.T - np.eye(3)).max())
    if not deviation <= _ROTATION_TOLERANCE or np.linalg.det(R) < 0.0 or not np.isfinite(T).all():
        raise ArrayError(f"{name} must be a pose; its 3x3 block deviates from a rotation by {deviation:.3g}")
    if T[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise ArrayError(f"{name} must have the last row 0 0 0 1, got {T[3].tolist()}")
    return T


# --------------------------------------------------------------------------------------------------------------------
# rows in


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
        T = T @ _row_pose(row, table.convention, value)
    return T @ table.T_tool if up_to_joint is None else T


def _row_pose(row: DhRow, convention: str, value: FloatArray | float = 0.0) -> FloatArray:
    """Pose of a row at a joint value, (..., 4, 4)."""
    moved = row.sign * np.asarray(value, dtype=np.float64)
    Z = _turn_z(
        row.theta + moved if row.type == "revolute" else np.full(moved.shape, row.theta),
        row.d + moved if row.type == "prismatic" else row.d,
    )
    X = _move_x(row.a, row.alpha, row.beta)
    return X @ Z if convention == "modified" else Z @ X


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
        axis = T @ _move_x(row.a, row.alpha, row.beta) if table.convention == "modified" else T
        if row.type != "fixed":
            z = row.sign * axis[:3, 2]
            z = z / np.linalg.norm(z)
            if row.type == "revolute":
                v = np.cross(axis[:3, 3], z)
                screws.append(np.concatenate([v - z * (v @ z), z]))  # a far origin leaves rounding along z
            else:
                screws.append(np.concatenate([z, np.zeros(3)]))
        T = T @ _row_pose(row, table.convention)
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


# --------------------------------------------------------------------------------------------------------------------
# rows out


def as_dh(chain: Chain, *, convention: Convention = "standard", signs: Sequence[int] | None = None) -> DhTable:
    """The table of a chain.

    Parameters
    ----------
    chain : Chain
    convention : str
        ``"standard"``, ``"modified"`` or ``"hayati"``.
    signs : sequence of m +-1, optional
        Whether z runs with (+1) or against (-1) each joint axis. Unless given, against it only where that makes z
        parallel instead of antiparallel to the z before it.

    Returns
    -------
    DhTable
        Its chain, ``from_dh(as_dh(chain))``, has the screws and the home pose of ``chain``: within 1e-12 while
        ``amplification`` stays below 100, else within ``1e-14 * sum(amplification)`` radians, and metres per metre of
        reach.

    Raises
    ------
    ArrayError
        ``signs`` is not m numbers +1 or -1.
    DhError
        Unknown convention.

    Warns
    -----
    PieperWarning
        Neighbouring axes are so nearly parallel that the table may miss 1e-12; the message names them and
        the factor. ``convention="hayati"`` does not.

    Notes
    -----
    What four numbers per row leave open is chosen like this. x points along the common normal, turned so that the theta
    offset lies within a quarter turn. Between parallel axes d is 0. A sliding axis has no place of its own: it goes
    through the origin before it, or through the next turning axis where it is parallel to the axis before it. Numbers
    within rounding of 0, of quarter turns or of nine decimals are written as such.

    References
    ----------
    Hayati, Mirmirani (1985) for rows between nearly parallel axes.

    Examples
    --------
    >>> from pieper.model.catalog import describe
    >>> table = as_dh(describe("ur5e", nominal=True).chain())
    >>> [row.d for row in table.rows]
    [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996]
    >>> [row.a for row in table.rows]
    [0.0, 0.425, 0.3922, 0.0, 0.0, 0.0]
    """
    if convention not in CONVENTIONS:
        raise DhError(chain.name, "convention", f"must be one of {', '.join(CONVENTIONS)}, got {convention!r}")
    walk = _Walk(chain, signs, tilted=convention == "hayati")
    links = walk.links()
    types: list[JointType] = ["revolute" if turns else "prismatic" for turns in chain.is_revolute]
    first, T_base = links[0], walk.T_base
    if convention == "modified":
        ways, T_tool = links[:-1], walk.T_tool_after(links[-1])
    else:
        # the way to the first axis has no row in front of it
        ways, T_tool, T_base = links[1:], walk.T_tool, T_base @ first.pose
    rows = tuple(
        DhRow(way.a, way.alpha, d, theta, sign, kind, way.beta)
        for way, d, theta, sign, kind in zip(ways, walk.d[1:], walk.theta[1:], walk.signs, types, strict=True)
    )
    amplification = np.array([way.amplification for way in ways])
    table = DhTable(
        rows=rows,
        convention=convention,
        T_base=T_base,
        T_tool=T_tool,
        joint_names=chain.joint_names,
        limits=chain.limits,
        name=chain.name,
        base=chain.base,
        tip=chain.tip,
        max_velocity=chain.max_velocity,
        max_effort=chain.max_effort,
        coupling=chain.coupling,
        amplification=amplification,
    )
    worst = int(np.argmax(amplification)) if len(rows) else 0
    if len(rows) and amplification[worst] > _WARN_ABOVE:
        neighbours = worst if convention == "modified" else worst + 1
        warnings.warn(
            f"{chain.name}: axes {neighbours} and {neighbours + 1} are parallel but for "
            f"{walk.tilts[neighbours]:.2g} rad; row {worst + 1} amplifies rounding {amplification[worst]:.2g} times; "
            "convention='hayati' keeps full accuracy",
            PieperWarning,
            stacklevel=2,
        )
    return table


@dataclass(frozen=True)
class _Way:
    """The constant part X between two axes."""

    a: float = 0.0
    alpha: float = 0.0
    beta: float = 0.0
    amplification: float = 1.0

    @property
    def pose(self) -> FloatArray:
        return _move_x(self.a, self.alpha, self.beta)


@dataclass(frozen=True)
class _Choice:
    """One way to write a row: turn x to this direction, put the origin at height f on the axis, go X."""

    x: tuple[float, float]
    f: float
    amplification: float
    tilted: bool = False


class _Walk:
    """Goes along the arm from axis to axis and writes down the moves.

    Axis i is kept as a point p near the arm, and the place of the frame's origin as a height c along z above p. Origins may
    be far away where axes are nearly parallel; points are not, so their differences lose nothing.
    """

    def __init__(self, chain: Chain, signs: Sequence[int] | None, *, tilted: bool) -> None:
        self.home = chain.home
        self.revolute = chain.is_revolute
        self.tilted = tilted
        m = len(chain.screws)
        self.directions = [self._direction(screw) for screw in chain.screws]
        self.points = self._points(chain)
        self.scale = max([1e-3, *(float(np.linalg.norm(p)) for p in [*self.points, self.home[:3, 3]])])
        self.signs = self._signs(signs, m)
        self.R = np.eye(3)
        self.p = np.zeros(3)
        self.c = 0.0
        self.theta: list[float] = []
        self.d: list[float] = []
        self.tilts: list[float] = []
        self.T_base = np.eye(4)
        self.T_tool = np.eye(4)

    @staticmethod
    def _direction(screw: FloatArray) -> FloatArray:
        direction = screw[3:] if screw[3:].any() else screw[:3]
        return cast(FloatArray, direction / np.linalg.norm(direction))

    def _points(self, chain: Chain) -> list[FloatArray]:
        """The point of each turning axis that is nearest to the point before it; sliding axes have none of their own."""
        points, near = [], np.zeros(3)
        for screw, direction, turns in zip(chain.screws, self.directions, self.revolute, strict=True):
            if turns:
                w = screw[3:]
                foot = np.cross(w, screw[:3]) / (w @ w)
                near = foot + direction * float(direction @ (near - foot))
            points.append(near)
        return points

    def _signs(self, signs: Sequence[int] | None, m: int) -> list[int]:
        if signs is not None:
            given = list(signs)
            if len(given) != m or any(sign not in (1, -1) for sign in given):
                raise ArrayError(f"signs must be {m} numbers +1 or -1, got {given}")
            return [int(sign) for sign in given]
        chosen, before = [], np.array([0.0, 0.0, 1.0])
        for direction in self.directions:
            antiparallel = (
                float(before @ direction) < 0.0 and np.linalg.norm(np.cross(before, direction)) < _NEARLY_PARALLEL
            )
            chosen.append(-1 if antiparallel else 1)
            before = chosen[-1] * direction
        return chosen

    # ---- the walk

    def links(self) -> list[_Way]:
        """The ways X_0 ... X_n; fills theta and d (of Z_0 ... Z_n), T_base and T_tool on the way."""
        m = len(self.directions)
        ways = [self._base_way()]
        ways.extend(self._way(self.signs[i] * self.directions[i], self._target(i)) for i in range(1, m))
        if m == 0:
            self.T_tool = self.home
        else:
            ways.append(self._tool_way())
        return ways

    def T_tool_after(self, last: _Way) -> FloatArray:
        """Tool pose behind the last joint, when its way has no row of its own."""
        return _tidy_pose(last.pose @ self.T_tool)

    def _base_way(self) -> _Way:
        """From the base z axis to the first axis: Z_0 goes to `T_base`."""
        if not self.directions:
            self.theta, self.d, self.tilts = [0.0], [0.0], [0.0]
            return _Way()
        z, p = self.signs[0] * self.directions[0], self._target(0)
        _, _, tilt = self._local(z, p)
        if tilt < _NEARLY_PARALLEL and self._choose(z, p).amplification > 1.0:
            # the base pose is free to be anything: no reason to go along a far common normal
            self.theta, self.d, self.tilts = [0.0], [0.0], [tilt]
            x = np.array([1.0, 0.0, 0.0]) - z[0] * z
            x = x / np.linalg.norm(x)
            self.R = np.column_stack([x, np.cross(z, x), z])
            self.p = p
            self.T_base = np.eye(4)
            self.T_base[:3, :3], self.T_base[:3, 3] = self.R, p
            return _Way()
        way = self._way(z, p)
        self.T_base = _turn_z(self.theta[0], self.d[0])
        return way

    def _tool_way(self) -> _Way:
        """From the last axis to the tool; its z axis has a common normal with the last axis, or all goes to `T_tool`."""
        z, p = self.home[:3, 2], self.home[:3, 3]
        _, delta, tilt = self._local(z, p)
        if tilt >= _NEARLY_PARALLEL:
            way = self._way(z, p)
        else:
            x = self.R.T @ self.home[:3, 0]
            theta = _tidy_angle(atan2(float(x[1]), float(x[0])))
            d = _tidy_length(float(delta[2]) - self.c, self.scale)
            self.theta.append(theta)
            self.d.append(d)
            self.tilts.append(tilt)
            self.R = self.R @ _turn_z(theta, 0.0)[:3, :3]
            self.c += d
            way = _Way()
        T = np.eye(4)
        T[:3, :3] = self.R.T @ self.home[:3, :3]
        T[:3, 3] = self.R.T @ (p - self.p) - [0.0, 0.0, self.c]
        self.T_tool = _tidy_pose(T)
        return way

    def _target(self, i: int) -> FloatArray:
        """A point of axis i."""
        if self.revolute[i]:
            return self.points[i]
        origin = self.p + (self.c if self._near() else 0.0) * self.R[:, 2]
        if np.linalg.norm(np.cross(self.R[:, 2], self.directions[i])) > _TIDY:
            return origin
        for k in range(i + 1, len(self.directions)):
            if self.revolute[k]:
                along = self.directions[k]
                return self.points[k] + along * float(along @ (origin - self.points[k]))
        return self.home[:3, 3]

    def _near(self) -> bool:
        """Whether the origin is still near the arm, and not left far away by a common normal."""
        return abs(self.c) <= 10.0 * self.scale

    def _local(self, z: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Next axis seen from the present one: direction, point, sine of the angle between them."""
        u = self.R.T @ z
        return u, self.R.T @ (p - self.p), hypot(float(u[0]), float(u[1]))

    def _choose(self, z: FloatArray, p: FloatArray) -> _Choice:
        """The way to write the row that loses least."""
        u, delta, tilt = self._local(z, p)
        ux, uy, uz = (float(v) for v in u)
        normal = (-uy / tilt, ux / tilt) if tilt > 0.0 else (1.0, 0.0)
        choices = []
        if tilt < _NEARLY_PARALLEL:
            f = self.c if self._near() else float(delta[2])
            t = (f - float(delta[2])) / uz
            lx, ly = float(delta[0]) + t * ux, float(delta[1]) + t * uy  # where the next axis meets that height
            a = hypot(lx, ly)
            toward = (lx / a, ly / a) if a > _TIDY * self.scale else (1.0, 0.0)
            if self.tilted:
                return _Choice(toward, f, 1.0, tilted=True)
            left_out = abs(ux * toward[0] + uy * toward[1])  # tilt about y, which the row cannot hold
            choices.append(_Choice(toward, f, max(1.0, left_out / _TIDY)))
            aside = abs(-lx * normal[1] + ly * normal[0])  # distance to the common normal's plane
            choices.append(_Choice(normal, f, max(1.0, aside / (_TIDY * self.scale))))
        if tilt > _TIDY:
            nx, ny = normal
            beyond = (float(delta[1]) * nx - float(delta[0]) * ny) / tilt
            f = float(delta[2]) + uz * beyond
            choices.append(_Choice(normal, f, 1.0 / tilt))
        return min(choices, key=lambda choice: choice.amplification)

    def _way(self, z: FloatArray, p: FloatArray) -> _Way:
        """Write Z of the present axis and X to the axis along z through p, and go there."""
        choice = self._choose(z, p)
        u, delta, tilt = self._local(z, p)
        x, y = choice.x
        along = float(delta[0]) * x + float(delta[1]) * y
        if x < -1e-12 or (
            abs(x) <= 1e-12 and (along < -_TIDY * self.scale or (abs(along) <= _TIDY * self.scale and y < 0))
        ):
            x, y = -x, -y
        theta = _tidy_angle(atan2(y, x))
        d = _tidy_length(choice.f - self.c, self.scale)
        turn = _turn_z(theta, 0.0)[:3, :3]
        u, delta = turn.T @ u, turn.T @ delta
        ux, uy, uz = (float(v) for v in u)
        height = self.c + d  # of the new x axis above the present point
        alpha = _tidy_angle(atan2(-uy, uz))
        beta = _tidy_angle(atan2(ux, hypot(uy, uz))) if choice.tilted else 0.0
        # the next axis as the row writes it, and its point at the height of x or nearest to it
        written = _move_x(0.0, alpha, beta)[:3, 2]
        if abs(written[1]) > abs(written[2]):
            t = -float(delta[1]) / float(written[1])
        else:
            t = (height - float(delta[2])) / float(written[2])
        a = _tidy_length(float(delta[0]) + t * float(written[0]), self.scale)
        self.theta.append(theta)
        self.d.append(d)
        self.tilts.append(tilt)
        self.R = self.R @ turn @ _move_x(0.0, alpha, beta)[:3, :3]
        self.p, self.c = p, t
        return _Way(a, alpha, beta, choice.amplification)


def _tidy_angle(angle: float) -> float:
    """An angle in (-pi, pi]; within rounding of a quarter turn, that quarter turn."""
    quarters = round(angle / (0.5 * pi))
    if abs(angle - quarters * 0.5 * pi) <= _TIDY:
        return pi if quarters == -2 else quarters * 0.5 * pi
    return angle


def _tidy_length(length: float, scale: float) -> float:
    """A length; within rounding of nine decimals, those decimals."""
    rounded = round(length, 9)
    if abs(length - rounded) <= 0.5 * _TIDY * max(scale, abs(length)):
        return rounded + 0.0  # no negative zero
    return length


def _tidy_pose(T: FloatArray) -> FloatArray:
    """A pose; entries within rounding of whole numbers are whole."""
    rounded = np.rint(T)
    return np.where(np.abs(T - rounded) <= _TIDY, rounded + 0.0, T)
