"""Denavit-Hartenberg tables: the rows, and all that an arm needs besides them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, cast, get_args

import numpy as np

from pieper.errors import ArrayError, DhError
from pieper.model._arrays import pose_fault
from pieper.model._dh_pose import move_x, turn_z
from pieper.model.chain import default_joint_names

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model._arrays import FloatArray

Convention: TypeAlias = Literal["standard", "modified", "hayati"]

JointType: TypeAlias = Literal["revolute", "prismatic", "fixed"]

CONVENTIONS: tuple[Convention, ...] = get_args(Convention)

JOINT_TYPES: tuple[str, ...] = get_args(JointType)


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
    >>> from pieper.model.dh import forward_kinematics
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
        limits=cast("FloatArray", limits),
        T_base=cast("FloatArray", T_base),
        T_tool=cast("FloatArray", T_tool),
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
    if not np.isfinite(T).all():
        raise ArrayError(f"{name} must be finite, got {T.tolist()}")
    fault = pose_fault(T)
    if fault is not None:
        raise ArrayError(f"{name} {fault}")
    return T


def row_pose(row: DhRow, convention: str, value: FloatArray | float = 0.0) -> FloatArray:
    """Pose of a row at a joint value, (..., 4, 4)."""
    moved = row.sign * np.asarray(value, dtype=np.float64)
    Z = turn_z(
        row.theta + moved if row.type == "revolute" else np.full(moved.shape, row.theta),
        row.d + moved if row.type == "prismatic" else row.d,
    )
    X = move_x(row.a, row.alpha, row.beta)
    return X @ Z if convention == "modified" else Z @ X
