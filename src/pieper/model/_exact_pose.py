"""Poses multiplied out in formulas, with the numbers that decimals and angles mean."""

from __future__ import annotations

from fractions import Fraction
from math import cos, pi, sin
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pieper.model._arrays import FloatArray


_ULPS = 4  # a home pose is a product of poses: its numbers carry this much rounding


class Product:
    """A product of poses in which turns about one z axis are collected before they are multiplied out."""

    def __init__(self, sympy: Any, T: FloatArray) -> None:
        self.sympy = sympy
        self.done = self._exact(T)
        self.angle = sympy.S.Zero
        self.place = sympy.zeros(3, 1)

    def _exact(self, T: FloatArray) -> Any:
        return self.sympy.Matrix(4, 4, [_entry(self.sympy, float(value)) for value in T.ravel()])

    def turn_z(self, angle: Any) -> None:
        self.angle += angle

    def move(self, x: Any, y: Any, z: Any) -> None:
        c, s = self.sympy.cos(self.angle), self.sympy.sin(self.angle)
        self.place += self.sympy.Matrix([c * x - s * y, s * x + c * y, z])

    def tilt(self, alpha: float, beta: float) -> None:
        if alpha == 0.0 and beta == 0.0:
            return
        sa, ca = _sin_cos(self.sympy, alpha)
        sb, cb = _sin_cos(self.sympy, beta)
        rows = [[cb, 0, sb, 0], [sa * sb, ca, -sa * cb, 0], [-ca * sb, sa, ca * cb, 0], [0, 0, 0, 1]]
        self._multiply(self.sympy.Matrix(rows))

    def then(self, T: FloatArray) -> None:
        self._multiply(self._exact(T))

    def _multiply(self, X: Any) -> None:
        c, s = self.sympy.cos(self.angle), self.sympy.sin(self.angle)
        x, y, z = self.place
        self.done = self.done * self.sympy.Matrix([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]]) * X
        self.angle, self.place = self.sympy.S.Zero, self.sympy.zeros(3, 1)

    def matrix(self) -> Any:
        return self.done


def _entry(sympy: Any, value: float) -> Any:
    """An entry of a constant pose: a short decimal, or the sine of a multiple of pi/12."""
    for k in range(7):
        exact = sin(k * pi / 12.0)
        if abs(abs(value) - exact) <= _ULPS * np.spacing(max(exact, 0.25)):
            return sympy.sign(sympy.Integer(1 if value >= 0.0 else -1)) * sympy.sin(k * sympy.pi / 12)
    return exact_length(sympy, value)


def exact_length(sympy: Any, value: float) -> Any:
    """A number: the fraction that a decimal of up to nine places means, else the double itself."""
    value = float(value)
    decimal = round(value, 9)
    if abs(value - decimal) <= _ULPS * np.spacing(abs(value)) or abs(value) < np.spacing(1.0):
        fraction = Fraction(repr(decimal))
        return sympy.Rational(fraction.numerator, fraction.denominator)
    return _float(sympy, value)


def exact_angle(sympy: Any, value: float) -> Any:
    """An angle: the multiple of pi/12 that it is, else the double itself."""
    twelfths = round(value / (pi / 12.0))
    if abs(value - twelfths * (pi / 12.0)) <= _ULPS * np.spacing(abs(value)):
        return twelfths * sympy.pi / 12
    return _float(sympy, value)


def _sin_cos(sympy: Any, value: float) -> tuple[Any, Any]:
    angle = exact_angle(sympy, value)
    if angle.has(sympy.pi) or angle == 0:
        return sympy.sin(angle), sympy.cos(angle)
    return _float(sympy, sin(value)), _float(sympy, cos(value))


def _float(sympy: Any, value: float) -> Any:
    return sympy.Float(repr(float(value)), 17)
