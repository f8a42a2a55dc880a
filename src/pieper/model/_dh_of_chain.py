"""The Denavit-Hartenberg table of a chain: a walk from axis to axis that writes down the moves."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from math import atan2, hypot, pi
from typing import TYPE_CHECKING, cast

import numpy as np

from pieper.errors import ArrayError, DhError, PieperWarning
from pieper.model._chain_check import check_chain
from pieper.model._dh_pose import move_x, turn_z
from pieper.model._dh_table import CONVENTIONS, Convention, DhRow, DhTable, JointType

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.model._arrays import FloatArray
    from pieper.model.chain import Chain


_NEARLY_PARALLEL = 0.1  # sine below which rows for parallel axes are considered: their factor is then below 1.006

_WARN_ABOVE = 1e2  # amplification at which a table can no longer keep 1e-12

_TIDY = 2e-15  # rounding left by poses of a few metres: closer numbers are taken for 0 or a quarter turn


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
        ``signs`` is not m numbers +1 or -1, or what is given is no chain.
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
    check_chain(chain)
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
    _warn_of_rounding(chain, walk, table)
    return table


def _warn_of_rounding(chain: Chain, walk: _Walk, table: DhTable) -> None:
    """Warn where a row cannot keep full accuracy."""
    worst = int(np.argmax(table.amplification)) if len(table.rows) else 0
    if not len(table.rows) or table.amplification[worst] <= _WARN_ABOVE:
        return
    neighbours = worst if table.convention == "modified" else worst + 1
    warnings.warn(
        f"{chain.name}: axes {neighbours} and {neighbours + 1} are parallel but for "
        f"{walk.tilts[neighbours]:.2g} rad; row {worst + 1} amplifies rounding {table.amplification[worst]:.2g} times; "
        "convention='hayati' keeps full accuracy",
        PieperWarning,
        stacklevel=3,
    )


@dataclass(frozen=True)
class _Way:
    """The constant part X between two axes."""

    a: float = 0.0
    alpha: float = 0.0
    beta: float = 0.0
    amplification: float = 1.0

    @property
    def pose(self) -> FloatArray:
        return move_x(self.a, self.alpha, self.beta)


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
        return cast("FloatArray", direction / np.linalg.norm(direction))

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
        self.T_base = turn_z(self.theta[0], self.d[0])
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
            self.R = self.R @ turn_z(theta, 0.0)[:3, :3]
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
        turn = turn_z(theta, 0.0)[:3, :3]
        u, delta = turn.T @ u, turn.T @ delta
        ux, uy, uz = (float(v) for v in u)
        height = self.c + d  # of the new x axis above the present point
        alpha = _tidy_angle(atan2(-uy, uz))
        beta = _tidy_angle(atan2(ux, hypot(uy, uz))) if choice.tilted else 0.0
        # the next axis as the row writes it, and its point at the height of x or nearest to it
        written = move_x(0.0, alpha, beta)[:3, 2]
        if abs(written[1]) > abs(written[2]):
            t = -float(delta[1]) / float(written[1])
        else:
            t = (height - float(delta[2])) / float(written[2])
        a = _tidy_length(float(delta[0]) + t * float(written[0]), self.scale)
        self.theta.append(theta)
        self.d.append(d)
        self.tilts.append(tilt)
        self.R = self.R @ turn @ move_x(0.0, alpha, beta)[:3, :3]
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
