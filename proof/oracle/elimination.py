"""From an arm and a pose to a polynomial in one half-angle tangent, in exact arithmetic.

The loop ``Rz(t1) K1 Rz(t2) K2 ... Rz(t6) K6 = 1`` is shifted so that the joint that remains is its third. Applied to the axis
of the last joint, a line with direction l through p, it says

    K2 Rz(t3) K3 Rz(t4) K4 Rz(t5) K5 (axis) = Rz(-t2) K1^-1 Rz(-t1) K6^-1 (axis).

Of both sides the fourteen numbers l, p, p.p, p.l, p x l, (p.p) l - 2 (p.l) p are taken [Raghavan and Roth 1993]. On either side
each of them is of degree one in cos and sin of each angle, so sampling at 0, 90 and 180 degrees gives all coefficients, exactly.
Rows that annihilate the eight terms of the right side with t1 or t2 leave six equations in t3, t4, t5; with the half-angle
tangents x4, x5 as homogeneous unknowns and multiplied by x4 once more they are the 12x12 matrix of Dixon and Sylvester. Its
determinant is a polynomial of degree 24 in x = tan(t3 / 2), of which (1 + x^2)^4 is no more than an artefact of x.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import numpy as np
from flint import fmpq, fmpq_mat, fmpz, fmpz_mat, fmpz_poly

from proof.oracle.rational import RationalArm, about_z, inverse, motion

DEGREE = 24
_SAMPLES = ((1, 0), (0, 1), (-1, 0))  # cosine and sine of 0, 90 and 180 degrees
_HALF = fmpq(1, 2)
_FROM_SAMPLES = np.array([[_HALF, 0, _HALF], [_HALF, 0, -_HALF], [-_HALF, 1, -_HALF]], dtype=object)
_TO_HALF_ANGLES = np.array([[1, -1, 0], [0, 0, 2], [1, 1, 0]], dtype=object)
"""Coefficients on s^2, s k, k^2 (s, k sine and cosine of half the angle) from those on 1, cos, sin."""


class Vanishes(ArithmeticError):
    """The determinant is zero whatever the angle: another joint has to remain."""


@dataclass(frozen=True)
class Elimination:
    """What is left of the loop when one joint remains.

    Attributes
    ----------
    joint : int
        The joint that remains, counted from 0.
    K : six exact motions of the shifted loop, with the offsets in them.
    offsets : half-angle tangents; joints 3, 4, 5 of the loop are counted from there, so that no ordinary angle is infinite.
    coefficients : (3, 6, 3, 3) integers
        Of x^0, x^1, x^2 in the six equations on (s4^2, s4 k4, k4^2) x (s5^2, s5 k5, k5^2).
    polynomial : fmpz_poly
        The determinant without its factors 1 + x^2.
    removed : int
        How many of those there were.
    rank : int
        Of the eight terms that were eliminated.
    """

    joint: int
    K: tuple[fmpq_mat, ...]
    offsets: tuple[Fraction, Fraction, Fraction]
    coefficients: np.ndarray
    polynomial: fmpz_poly
    removed: int
    rank: int

    def angle_indices(self) -> list[int]:
        """Which joint of the arm each joint of the loop is."""
        return [(i + self.joint - 2) % 6 for i in range(6)]


def loop(arm: RationalArm, pose: fmpq_mat, joint: int) -> list[fmpq_mat]:
    """K1 ... K6, shifted so that `joint` is the third."""
    K = [*arm.links[:5], arm.links[5] * inverse(pose) * arm.base]
    return [K[(i + joint - 2) % 6] for i in range(6)]


def eliminate(arm: RationalArm, pose: fmpq_mat, joint: int, offsets: Sequence[Fraction]) -> Elimination:
    """All of it, for one joint that remains.

    Raises
    ------
    Vanishes
        The determinant is the zero polynomial.
    ValueError
        A root lies at half a turn from an offset: take other offsets.
    """
    K = loop(arm, pose, joint)
    for i, offset in zip((2, 3, 4), offsets, strict=True):
        K[i] = about_z(offset) * K[i]
    before, last = inverse(K[0]), inverse(K[5])
    right = _coefficients(lambda t1, t2: _back(t2) * before * _back(t1) * last, 2).reshape(9, 14)
    left = _coefficients(lambda t3, t4, t5: K[1] * _turn(t3) * K[2] * _turn(t4) * K[3] * _turn(t5) * K[4], 3)
    annihilators, rank = _left_null_space(right[1:])
    left[0, 0, 0] = left[0, 0, 0] - right[0]
    equations = np.tensordot(left, annihilators.T, axes=1)  # (3, 3, 3, 6)
    for axis in range(3):
        equations = np.moveaxis(np.tensordot(_TO_HALF_ANGLES, equations, axes=(1, axis)), 0, axis)
    cleared = np.stack([_integers(equations[..., row]) for row in range(6)], axis=-1)
    coefficients = np.moveaxis(cleared[::-1], 3, 1)  # lowest power of x first: (3, 6, 3, 3)
    polynomial, removed = _without_artefacts(_determinant(coefficients))
    return Elimination(joint, tuple(K), tuple(offsets), coefficients, polynomial, removed, rank)


def matrix(coefficients: np.ndarray, x: object, zero: object) -> np.ndarray:
    """The 12x12 matrix at a value of x, of whatever kind of number x is."""
    A, B, C = np.moveaxis(coefficients[0] + x * (coefficients[1] + x * coefficients[2]), 1, 0)  # each (6, 3)
    nothing = np.full((6, 3), zero, dtype=object)
    return np.vstack([np.hstack([A, B, C, nothing]), np.hstack([nothing, A, B, C])])


def _turn(cs: tuple[int, int]) -> fmpq_mat:
    c, s = cs
    return motion([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0]])


def _back(cs: tuple[int, int]) -> fmpq_mat:
    return _turn((cs[0], -cs[1]))


def _fourteen(T: fmpq_mat) -> list[fmpq]:
    """Of the z axis and origin of a frame."""
    direction, p = [T[i, 2] for i in range(3)], [T[i, 3] for i in range(3)]
    pp = sum((x * x for x in p), fmpq(0))
    pl = sum((x * y for x, y in zip(p, direction, strict=True)), fmpq(0))
    cross = [p[i - 2] * direction[i - 1] - p[i - 1] * direction[i - 2] for i in range(3)]
    return [*direction, *p, pp, pl, *cross, *(pp * x - 2 * pl * y for x, y in zip(direction, p, strict=True))]


def _coefficients(frame: Callable[..., fmpq_mat], angles: int) -> np.ndarray:
    """(3, ..., 3, 14): the fourteen numbers of a frame on (1, cos, sin) of every angle."""
    values = np.empty((3,) * angles + (14,), dtype=object)
    for index in np.ndindex(*(3,) * angles):
        values[index] = _fourteen(frame(*(_SAMPLES[i] for i in index)))
    for axis in range(angles):
        values = np.moveaxis(np.tensordot(_FROM_SAMPLES, values, axes=(1, axis)), 0, axis)
    return values


def _left_null_space(terms: np.ndarray) -> tuple[np.ndarray, int]:
    """Six rows (6, 14) that annihilate the terms (8, 14), and the rank of those."""
    reduced, rank = fmpq_mat([list(row) for row in terms]).rref()
    pivots = [next(j for j in range(14) if reduced[i, j] != 0) for i in range(rank)]
    basis = []
    for free in (j for j in range(14) if j not in pivots):
        row = [fmpq(0)] * 14
        row[free] = fmpq(1)
        for i, pivot in enumerate(pivots):
            row[pivot] = -reduced[i, free]
        basis.append(row)
    found = np.array(basis, dtype=object)
    if len(found) > 6:  # more equations than needed: six mixtures of them, whose extra roots are sorted out later
        mix = np.array(
            [[fmpq((7 * i + 3 * j) ** 2 % 11 - 5) for j in range(len(found))] for i in range(6)], dtype=object
        )
        mix[:, :6] += np.array([[fmpq(17 * (i == j)) for j in range(6)] for i in range(6)], dtype=object)
        found = mix.dot(found)
    return found, rank


def _integers(values: np.ndarray) -> np.ndarray:
    """An equation times the common denominator of its coefficients, divided by what they have in common."""
    flat = values.ravel()
    denominator = math.lcm(*(int(fmpq(x).q) for x in flat))
    whole = [int((x * denominator).p) for x in flat]
    common = math.gcd(*whole) or 1
    return np.array([fmpz(x // common) for x in whole], dtype=object).reshape(values.shape)


def _determinant(coefficients: np.ndarray) -> fmpz_poly:
    """As a polynomial, from its values at 25 integers."""
    points = range(-DEGREE // 2, DEGREE // 2 + 1)
    values = []
    for count, x in enumerate(points):
        values.append(fmpz_mat(matrix(coefficients, fmpz(x), fmpz(0)).tolist()).det())
        if count == 2 and not any(values):
            raise Vanishes("zero at three integers")
    if not any(values):
        raise Vanishes("zero at 25 integers")
    solved, denominator = (_vandermonde_inverse() * fmpq_mat([[fmpq(v)] for v in values])).numer_denom()
    if int(denominator) != 1:
        raise ArithmeticError("a determinant of integer polynomials with fractions in it")
    return fmpz_poly([solved[i, 0] for i in range(DEGREE + 1)])


@cache
def _vandermonde_inverse() -> fmpq_mat:
    points = range(-DEGREE // 2, DEGREE // 2 + 1)
    return fmpq_mat([[fmpq(fmpz(x) ** k) for k in range(DEGREE + 1)] for x in points]).inv()


def _without_artefacts(determinant: fmpz_poly) -> tuple[fmpz_poly, int]:
    """The determinant without its factors 1 + x^2, and how many there were; at least four [Raghavan and Roth 1993]."""
    if determinant.degree() < DEGREE:
        raise ValueError("a root at half a turn from the offset")
    polynomial, removed, artefact = determinant, 0, fmpz_poly([1, 0, 1])
    while True:
        quotient, rest = divmod(polynomial, artefact)
        if rest != 0:
            break
        polynomial, removed = quotient, removed + 1
    if removed < 4:
        raise ArithmeticError(f"only {removed} factors 1 + x^2")
    return polynomial // polynomial.content(), removed
