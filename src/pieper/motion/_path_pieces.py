"""The pieces that Cartesian paths are made of: lines, arcs, splines and rounded corners, each by its own length.

`pieper.motion.path` puts them one behind another.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from pieper.errors import MotionError
from pieper.spatial import rotation

if TYPE_CHECKING:
    from pieper.spatial._checks import FloatArray

HALF_TURN = 1e-6
"""Nearer to half a turn than this [rad] the shortest way between two orientations is not defined by them."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_CELLS = 32  # cells of the table of lengths for each piece of a curve


class Piece(Protocol):
    """A smooth curve of poses by its length; what is asked of it lies in 0 <= s <= length."""

    @property
    def length(self) -> float: ...

    def poses(self, s: FloatArray) -> FloatArray:
        """(k,) -> (k, 4, 4)."""
        ...

    def twists(self, s: FloatArray) -> FloatArray:
        """Motion by length, (k,) -> (k, 6): linear part first, base axes."""
        ...


@dataclass(frozen=True, eq=False)
class Straight:
    """Position on a line, rotation about one axis, both at an even rate."""

    T: FloatArray
    step: FloatArray  # (3,) whole way of the tip [m]
    turn: FloatArray  # (3,) whole rotation vector, base axes [rad]
    radius: float

    @classmethod
    def between(cls, start: FloatArray, goal: FloatArray, radius: float, names: str) -> Straight:
        return cls(start, goal[:3, 3] - start[:3, 3], turn_between(start, goal, names), radius)

    @property
    def length(self) -> float:
        return float(np.hypot(np.linalg.norm(self.step), self.radius * np.linalg.norm(self.turn)))

    def poses(self, s: FloatArray) -> FloatArray:
        share = s / self.length if self.length else np.zeros_like(s)
        return _turned(self.T, self.T[:3, 3] + share[:, None] * self.step, share[:, None] * self.turn)

    def twists(self, s: FloatArray) -> FloatArray:
        return np.tile(np.concatenate([self.step, self.turn]) / (self.length or 1.0), (len(s), 1))


@dataclass(frozen=True, eq=False)
class Arc:
    """Position on a circle, rotation about one axis, both at an even rate."""

    T: FloatArray
    centre: FloatArray
    axis: FloatArray
    angle: float
    turn: FloatArray
    radius: float

    @property
    def length(self) -> float:
        arc = self.angle * float(np.linalg.norm(self.T[:3, 3] - self.centre))
        return float(np.hypot(arc, self.radius * np.linalg.norm(self.turn)))

    def poses(self, s: FloatArray) -> FloatArray:
        share = s / self.length if self.length else np.zeros_like(s)
        out = self.T[:3, 3] - self.centre
        side = np.cross(self.axis, out)
        along = share[:, None] * self.angle
        p = self.centre + np.cos(along) * out + np.sin(along) * side
        p[s == 0.0] = self.T[:3, 3]
        return _turned(self.T, p, share[:, None] * self.turn)

    def twists(self, s: FloatArray) -> FloatArray:
        rate = self.angle / (self.length or 1.0)
        out = self.T[:3, 3] - self.centre
        side = np.cross(self.axis, out)
        along = (rate * s)[:, None]
        linear = rate * (np.cos(along) * side - np.sin(along) * out)
        return np.concatenate([linear, np.tile(self.turn / (self.length or 1.0), (len(s), 1))], axis=1)


class Curve(Protocol):
    """A smooth curve of poses by any parameter u."""

    def __call__(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Poses (k, 4, 4), and twists by u (k, 6), at parameters (k,)."""
        ...


@dataclass(frozen=True, eq=False)
class Measured:
    """A curve by another parameter u, with a table of lengths.

    The length of each cell by Gauss and Legendre with 8 points; u of a length by the table and two steps of Newton.
    """

    curve: Curve
    knots: FloatArray  # (c + 1,) values of u
    lengths: FloatArray  # (c + 1,) length up to each [m]
    radius: float

    @classmethod
    def of(cls, curve: Curve, edges: FloatArray, radius: float) -> Measured:
        knots = np.unique(np.concatenate([np.linspace(a, b, _CELLS + 1) for a, b in itertools.pairwise(edges)]))
        half = np.diff(knots) / 2.0
        u = (knots[:-1] + half)[:, None] + half[:, None] * _NODES
        speed = _speed(curve(u.ravel())[1], radius).reshape(u.shape)
        return cls(curve, knots, np.concatenate([[0.0], np.cumsum(half * (speed @ _WEIGHTS))]), radius)

    @property
    def length(self) -> float:
        return float(self.lengths[-1])

    def _parameter(self, s: FloatArray) -> FloatArray:
        cell = np.clip(np.searchsorted(self.lengths, s, side="right") - 1, 0, len(self.knots) - 2)
        low, width = self.knots[cell], np.diff(self.knots)[cell]
        wanted = s - self.lengths[cell]
        u = low + width * wanted / np.maximum(np.diff(self.lengths)[cell], 1e-300)
        for _ in range(2):
            half = (u - low) / 2.0
            points = low[:, None] + half[:, None] * (1.0 + _NODES)
            speeds = _speed(self.curve(np.append(points.ravel(), u))[1], self.radius)
            there = half * (speeds[: points.size].reshape(points.shape) @ _WEIGHTS)
            u = np.clip(u - (there - wanted) / np.maximum(speeds[points.size :], 1e-12), low, low + width)
        return u

    def poses(self, s: FloatArray) -> FloatArray:
        return self.curve(self._parameter(s))[0]

    def twists(self, s: FloatArray) -> FloatArray:
        by_parameter = self.curve(self._parameter(s))[1]
        return np.asarray(by_parameter / _speed(by_parameter, self.radius)[:, None])


@dataclass(frozen=True, eq=False)
class Spline:
    """The curve of `pieper.motion.path.spline`: a cubic spline of positions, a spline of rotations."""

    knots: FloatArray
    position: Any  # scipy.interpolate.CubicSpline
    turns: Any  # scipy.spatial.transform.RotationSpline

    def __call__(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        inside = np.clip(u, self.knots[0], self.knots[-1])
        T = np.zeros((len(u), 4, 4))
        T[:, 3, 3] = 1.0
        T[:, :3, 3] = self.position(inside)
        turned = self.turns(inside)
        T[:, :3, :3] = turned.as_matrix()
        # RotationSpline gives angular velocities in carried axes
        spin = turned.apply(self.turns(inside, 1))
        return T, np.concatenate([self.position(inside, 1), spin], axis=1)


@dataclass(frozen=True, eq=False)
class Part:
    """What is left of a piece between roundings."""

    whole: Piece
    first: float
    length: float

    def poses(self, s: FloatArray) -> FloatArray:
        return self.whole.poses(np.clip(self.first + s, 0.0, self.whole.length))

    def twists(self, s: FloatArray) -> FloatArray:
        return self.whole.twists(np.clip(self.first + s, 0.0, self.whole.length))


@dataclass(frozen=True, eq=False)
class Rounding:
    """The curve from one piece to the next that leaves out the corner between them, over 0 <= u <= 1; see `pieper.motion.path.join`."""

    before: Piece
    after: Piece
    reach: float

    @cached_property
    def _corner(self) -> FloatArray:
        return np.asarray(self.after.poses(np.zeros(1))[0])

    def __call__(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        S = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        way = 2.0 * u**4 * (2.5 - 3.0 * u + u * u)  # the integral of 2 S
        before, after, reach, corner = self.before, self.after, self.reach, self._corner
        one, other = before.length - reach + reach * (2.0 * u - way), reach * way
        A, B = before.poses(np.clip(one, 0.0, before.length)), after.poses(np.clip(other, 0.0, after.length))
        turned = A[:, :3, :3] @ corner[:3, :3].T
        T = A.copy()
        T[:, :3, 3] += B[:, :3, 3] - corner[:3, 3]
        T[:, :3, :3] = _clean(turned @ B[:, :3, :3])
        first, second = before.twists(one), after.twists(other)
        second[:, 3:] = (turned @ second[:, 3:, None])[..., 0]
        return T, 2.0 * reach * ((1.0 - S)[:, None] * first + S[:, None] * second)


def slope_at_end(piece: Piece) -> tuple[FloatArray, FloatArray]:
    """Direction and curvature at the end of a piece: its twist, and the derivative of that by length."""
    return _slope(piece, piece.length, -1.0)


def slope_at_start(piece: Piece) -> tuple[FloatArray, FloatArray]:
    return _slope(piece, 0.0, 1.0)


def _slope(piece: Piece, s: float, inward: float) -> tuple[FloatArray, FloatArray]:
    h = inward * 1e-4 * piece.length
    twists = piece.twists(s + h * np.arange(3.0))
    # of second order: Fornberg 1988, Generation of finite difference formulas, Mathematics of Computation 51, table 3
    return twists[0], np.asarray((-1.5 * twists[0] + 2.0 * twists[1] - 0.5 * twists[2]) / h)


def _turned(T: FloatArray, p: FloatArray, turn: FloatArray) -> FloatArray:
    """(k, 4, 4): the orientation of T turned by rotation vectors (k, 3) in base axes, at positions (k, 3)."""
    made = np.zeros((len(p), 4, 4))
    made[:, 3, 3] = 1.0
    made[:, :3, 3] = p
    made[:, :3, :3] = rotation.from_rotation_vector(turn) @ T[:3, :3]
    return made


def _clean(R: FloatArray) -> FloatArray:
    """Products of rotations, whose rounding is taken away: one step of Newton towards the nearest rotation."""
    return np.asarray(1.5 * R - 0.5 * R @ np.swapaxes(R, -1, -2) @ R)


def turn_between(start: FloatArray, goal: FloatArray, names: str) -> FloatArray:
    """(3,) rotation vector in base axes from one orientation to the other, or an error where it is half a turn."""
    turn = rotation.as_rotation_vector(_clean(goal[:3, :3] @ start[:3, :3].T))
    angle = float(np.linalg.norm(turn))
    if angle > np.pi - HALF_TURN:
        raise MotionError(
            f"the orientations of {names} are half a turn apart ({angle:.9g} rad), and both ways round are equally short; "
            "put a pose between them"
        )
    return turn


def _speed(twists: FloatArray, radius: float) -> FloatArray:
    return np.asarray(np.sqrt((twists[:, :3] ** 2).sum(axis=1) + radius**2 * (twists[:, 3:] ** 2).sum(axis=1)))
