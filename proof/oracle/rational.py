"""Arms and poses in rational numbers.

A rotation by an angle with a rational half-angle tangent t has the rational cosine (1 - t^2) / (1 + t^2) and sine
2t / (1 + t^2), so that an arm whose twists are such angles and whose lengths are fractions has rational poses wherever its
joints are such angles. t is None for half a turn.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import flint
import numpy as np
from flint import fmpq, fmpq_mat

Tangent = Fraction | None
ROBOTS = Path(__file__).parents[2] / "src" / "pieper" / "model" / "robots"
QUARTER_TURNS: tuple[Tangent, ...] = (Fraction(0), Fraction(1), None, Fraction(-1))


def number(x: Fraction | int | str) -> fmpq:
    """A fraction as flint has it."""
    x = Fraction(x)
    return fmpq(x.numerator, x.denominator)


def fraction(x: fmpq) -> Fraction:
    return Fraction(int(x.p), int(x.q))


def cosine_sine(t: Tangent) -> tuple[Fraction, Fraction]:
    """Of the angle with half-angle tangent t."""
    if t is None:
        return Fraction(-1), Fraction(0)
    return (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)


def angle(t: Tangent) -> float:
    return math.pi if t is None else 2.0 * math.atan(t)


def nearest_tangent(value: float, denominator: int) -> Tangent:
    """A half-angle tangent close to that of an angle [rad], with a denominator no greater."""
    value = math.remainder(value, 2.0 * math.pi)
    if math.isclose(abs(value), math.pi, abs_tol=1e-12):
        return None
    return Fraction(math.tan(0.5 * value)).limit_denominator(denominator)


def motion(rows: Sequence[Sequence[Fraction | int]]) -> fmpq_mat:
    """Three rows of four numbers as a 4x4 motion."""
    return fmpq_mat([[number(x) for x in row] for row in (*rows, (0, 0, 0, 1))])


def about_z(t: Tangent) -> fmpq_mat:
    c, s = cosine_sine(t)
    return motion([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0]])


def about(axis: int, t: Tangent) -> fmpq_mat:
    """A turn about x, y or z (0, 1, 2)."""
    c, s = cosine_sine(t)
    rows = [[Fraction(int(i == j)) for j in range(4)] for i in range(3)]
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rows[i][i], rows[i][j], rows[j][i], rows[j][j] = c, -s, s, c
    return motion(rows)


def moved(offset: Iterable[Fraction | int]) -> fmpq_mat:
    x, y, z = offset
    return motion([[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z]])


def inverse(T: fmpq_mat) -> fmpq_mat:
    """Of a motion: the rotation transposed."""
    R = [[T[j, i] for j in range(3)] for i in range(3)]
    p = [-sum((R[i][j] * T[j, 3] for j in range(3)), fmpq(0)) for i in range(3)]
    return fmpq_mat([[*R[i], p[i]] for i in range(3)] + [[fmpq(0), fmpq(0), fmpq(0), fmpq(1)]])


def rows(T: fmpq_mat) -> list[list[str]]:
    """The first three rows as text."""
    return [[str(fraction(T[i, j])) for j in range(4)] for i in range(3)]


def from_rows(text: Sequence[Sequence[str]]) -> fmpq_mat:
    return motion([[Fraction(x) for x in row] for row in text])


def as_float(T: fmpq_mat) -> np.ndarray:
    return np.array([[float(fraction(T[i, j])) for j in range(4)] for i in range(4)])


@dataclass(frozen=True)
class RationalArm:
    """``base Rz(q1) L1 Rz(q2) L2 ... Rz(q6) L6``, every number a fraction [m, -]."""

    name: str
    kind: str
    base: fmpq_mat
    links: tuple[fmpq_mat, ...]
    table: tuple[tuple[Tangent, Fraction, Fraction], ...] = ()
    """Rows (tangent of half the twist, a, d) where the arm is written in standard DH."""

    def forward(self, tangents: Sequence[Tangent]) -> fmpq_mat:
        """The exact pose at rational joints."""
        T = self.base
        for t, link in zip(tangents, self.links, strict=True):
            T = T * about_z(t) * link
        return T

    def data(self) -> dict:
        """As it is stored; see tests/golden/README.md."""
        table = [["inf" if t is None else str(t), str(a), str(d)] for t, a, d in self.table]
        return {
            "name": self.name,
            "arm_class": self.kind,
            **({"dh_tanhalf_a_d": table} if table else {}),
            "base_exact": rows(self.base),
            "links_exact": [rows(link) for link in self.links],
            "base": as_float(self.base).tolist(),
            "links": [as_float(link).tolist() for link in self.links],
        }

    @classmethod
    def read(cls, data: dict) -> RationalArm:
        links = tuple(from_rows(link) for link in data["links_exact"])
        return cls(data["name"], data["arm_class"], from_rows(data["base_exact"]), links)


def from_dh(name: str, kind: str, table: Sequence[tuple[Tangent, Fraction, Fraction]]) -> RationalArm:
    """Standard DH: ``Rz(q) Tz(d) Tx(a) Rx(twist)`` for every row (tangent of half the twist, a, d)."""
    links = tuple(moved((a, 0, d)) * about(0, t) for t, a, d in table)
    return RationalArm(name, kind, moved((0, 0, 0)), links, tuple(table))


def built_in(name: str, *, denominator: int = 997) -> RationalArm:
    """A built-in arm with six axes. Its lengths are those printed; angles that are no quarter turns are rounded."""
    table = json.loads((ROBOTS / f"{name}.json").read_text(encoding="utf-8"), parse_float=Fraction, parse_int=Fraction)
    exact, parts, T = True, [], moved((0, 0, 0))
    for joint in table["joints"]:
        roll, pitch, yaw = (float(x) for x in joint.get("rpy_nominal", joint["rpy"]))
        tangents = [nearest_tangent(x, denominator) for x in (yaw, pitch, roll)]
        exact &= all(t in QUARTER_TURNS for t in tangents)
        T = T * moved(joint["xyz"])
        for axis, t in zip((2, 1, 0), tangents, strict=True):
            T = T * about(axis, t)
        if joint["type"] != "fixed":
            turn = _onto([int(x) for x in joint["axis"]])
            parts.append(T * turn)
            T = inverse(turn)
    if len(parts) != 6:
        raise ValueError(f"{name} has {len(parts)} axes")
    return RationalArm(name + ("" if exact else "_like"), "real_arm", parts[0], (*parts[1:], T))


def _onto(axis: list[int]) -> fmpq_mat:
    """A quarter-turn rotation that takes z to a coordinate axis."""
    which, sign = next((i, x) for i, x in enumerate(axis) if x)
    if which == 2:
        return about(0, Fraction(0) if sign > 0 else None)
    other = 1 if which == 0 else 0
    t = Fraction(1) if (which == 0) == (sign > 0) else Fraction(-1)
    return about(other, t)


assert flint.__version__  # the whole room needs it; see the dependency group `oracle`
