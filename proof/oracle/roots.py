"""From the polynomial back to joint angles, with a proof of how many there are.

What is exact: the polynomial, its multiplicities, and the number of its real roots (isolated with ball arithmetic). What is
done with 640 bits: the null space at a root, the way back to the joints, and the check on the exact arm.

A simple real root has one null vector, which is real, so there are at most as many solutions as real roots; each root whose
joints close the loop on the exact arm to 1e-45 is one. A multiple root with as many null vectors as its multiplicity is
shared by solutions that differ in the other joints (spherical wrists). Fewer null vectors mean a truly multiple root, about
which nothing is claimed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import flint
import mpmath
import numpy as np
from flint import arb, fmpq_mat
from mpmath import mp, mpf

from proof.oracle.elimination import Elimination, Vanishes, eliminate, matrix
from proof.oracle.rational import RationalArm, as_float, fraction, inverse

BITS = 640
CLOSED = mpf(10) ** -45  # [m, -] what the loop may be open by
SINGULAR = mpf(10) ** -90  # relative: what counts as zero at a root, of which 190 digits are known
AGREE = mpf(10) ** -30  # rad, between two eliminations

mp.prec = BITS
flint.ctx.prec = BITS


@dataclass
class Root:
    """A real root of the polynomial."""

    tangent: mpf
    multiplicity: int
    null_space: int = 0
    solutions: list[list[mpf]] = field(default_factory=list)
    settled: bool = False
    """True when every real solution with this root is known."""


@dataclass
class Solved:
    """What one elimination says about a pose."""

    elimination: Elimination
    roots: list[Root]
    nearest_complex_root: float
    """Of the angles that are no real roots, the least distance from the real line [rad]."""

    @property
    def status(self) -> str:
        """``"proved"``, or ``"multiple"`` where some root is truly multiple."""
        return "proved" if all(root.settled for root in self.roots) else "multiple"

    @property
    def solutions(self) -> list[list[mpf]]:
        """Joint angles in (-pi, pi] [rad], sorted."""
        return sorted(q for root in self.roots for q in root.solutions)

    @property
    def extraneous(self) -> int:
        return sum(root.settled and not root.solutions for root in self.roots)


def solve(arm: RationalArm, pose: fmpq_mat, joint: int, offsets: Sequence[Fraction]) -> Solved:
    """Every real solution of a pose, with one joint remaining.

    Raises
    ------
    Vanishes, ValueError
        See `eliminate`.
    """
    elimination = eliminate(arm, pose, joint, offsets)
    roots, complex_roots = [], [math.inf]
    for factor, multiplicity in elimination.polynomial.factor_squarefree()[1]:
        for root, _ in factor.complex_roots():
            if root.imag == 0:
                roots.append(Root(_number(root.real), multiplicity))
            else:
                z = complex(float(root.real.mid()), float(root.imag.mid()))
                complex_roots.append(abs((2.0 * np.arctan(z)).imag))
    for root in roots:
        _lift(arm, pose, elimination, root)
    return Solved(elimination, roots, min(complex_roots))


def prove(
    arm: RationalArm, pose: fmpq_mat, rng: np.random.Generator, *, confirm: bool = True
) -> tuple[Solved | None, Solved | None]:
    """The first elimination that proves a count, and a second one that agrees with it.

    All six joints are tried as the one that remains. Without a proof the best attempt is returned, or None where every
    determinant vanishes. A second elimination that proves something else is an error.
    """
    first: Solved | None = None
    for joint in rng.permutation(6):
        try:
            found = _with_offsets(arm, pose, int(joint), rng)
        except Vanishes:
            continue
        if found.status != "proved":
            first = first or found
        elif first is None or first.status != "proved":
            first = found
            if not confirm:
                return first, None
        else:
            _agree(first.solutions, found.solutions)
            return first, found
    return first, None


def _with_offsets(arm: RationalArm, pose: fmpq_mat, joint: int, rng: np.random.Generator) -> Solved:
    while True:
        offsets = [Fraction(int(rng.integers(150, 850)), int(rng.integers(900, 1000))) for _ in range(3)]
        try:
            return solve(arm, pose, joint, offsets)
        except ValueError:
            continue


def _agree(one: list[list[mpf]], other: list[list[mpf]]) -> None:
    if len(one) != len(other):
        raise ArithmeticError(f"one elimination proves {len(one)} solutions, another {len(other)}")
    left = list(other)
    for q in one:
        nearest = min(left, key=lambda candidate: apart(q, candidate))
        if apart(q, nearest) > AGREE:
            raise ArithmeticError("two eliminations prove different solutions")
        left.remove(nearest)


def apart(a: Sequence[mpf], b: Sequence[mpf]) -> mpf:
    """The largest difference of a joint, full turns aside."""
    return max(abs(_wrapped(x - y)) for x, y in zip(a, b, strict=True))


def forward(arm: RationalArm, q: Sequence[mpf]) -> mpmath.matrix:
    """The pose of the exact arm, with 640 bits."""
    T = _matrix(arm.base)
    for value, link in zip(q, arm.links, strict=True):
        T = T * _turn(value) * _matrix(link)
    return T


def residual(T: mpmath.matrix, pose: mpmath.matrix) -> mpf:
    return max(abs(x) for x in (T - pose))


# The way back


def _lift(arm: RationalArm, pose: fmpq_mat, elimination: Elimination, root: Root) -> None:
    """Finds the solutions of a root, and settles whether they are all."""
    rows = np.moveaxis(elimination.coefficients, 1, 0)
    scaled = [np.array([mpf(int(x)) for x in row.ravel()], dtype=object).reshape(row.shape) for row in rows]
    # not by what a row is at the root: that may be nothing but rounding
    coefficients = np.stack([row / np.abs(row).max() for row in scaled], axis=1)
    kernel = _null_space(matrix(coefficients, root.tangent, mpf(0)) / (1 + root.tangent**2))
    root.null_space = kernel.shape[1]
    vectors, whole = _solution_vectors(kernel)
    for vector in vectors:
        for q in _joints(elimination, root.tangent, vector):
            if residual(forward(arm, q), _matrix(pose)) < CLOSED and all(apart(q, p) > AGREE for p in root.solutions):
                root.solutions.append(q)
    if root.multiplicity == 1:
        # One null vector: it is a solution, or the root belongs to none (mixed equations).
        root.settled = root.null_space == 1 and (bool(root.solutions) or elimination.rank < 8)
    else:
        root.settled = whole and root.null_space == root.multiplicity and len(root.solutions) == len(vectors)


def _null_space(M: np.ndarray) -> np.ndarray:
    """(12, k) by elimination with full pivoting."""
    M = M.copy()
    n, order, rank = len(M), list(range(len(M))), 0
    for step in range(n):
        sizes = np.abs(M[step:, step:])
        i, j = divmod(int(np.argmax(sizes)), n - step)
        if sizes[i, j] < SINGULAR:
            break
        M[[step, step + i]] = M[[step + i, step]]
        M[:, [step, step + j]] = M[:, [step + j, step]]
        order[step], order[step + j] = order[step + j], order[step]
        M[step] = M[step] / M[step, step]
        for row in range(n):
            if row != step:
                M[row] = M[row] - M[row, step] * M[step]
        rank += 1
    kernel = np.full((n, n - rank), mpf(0), dtype=object)
    for k in range(n - rank):
        kernel[order[rank + k], k] = mpf(1)
        for i in range(rank):
            kernel[order[i], k] = -M[i, rank + k]
    return kernel


def _solution_vectors(kernel: np.ndarray) -> tuple[list[np.ndarray], bool]:
    """Real vectors of the form (s4^3, s4^2 k4, s4 k4^2, k4^3) x (s5^2, s5 k5, k5^2) in a null space, and whether the
    space is spanned by vectors of that form, complex ones included.

    Multiplying such a vector by x4 = s4 / k4 shifts it by three places, and by x5 by one: both shifts map the space to itself.
    """
    k = kernel.shape[1]
    if k == 1:
        return [kernel[:, 0]], True
    blocks = kernel.reshape(4, 3, k)
    by_x4, fits4 = _shift(blocks[:3].reshape(9, k), blocks[1:].reshape(9, k))
    by_x5, fits5 = _shift(blocks[:, :2].reshape(8, k), blocks[:, 1:].reshape(8, k))
    if not (fits4 and fits5):
        return [], False
    mixed = mpmath.matrix((by_x4 + mpf(2) / 7 * by_x5).tolist())
    try:
        values, vectors = mp.eig(mixed)
    except (mpmath.libmp.NoConvergence, ZeroDivisionError):
        return [], False
    gaps = [abs(values[i] - values[j]) for i in range(k) for j in range(i)]
    if min(gaps) < mpf(10) ** -40:
        return [], False
    real = []
    for i in range(k):
        if abs(mpmath.im(values[i])) > mpf(10) ** -60 * (1 + abs(values[i])):
            continue
        z = np.array([vectors[j, i] for j in range(k)], dtype=object)
        z = z / max(z, key=abs)
        real.append(kernel.dot(np.array([mpmath.re(x) for x in z], dtype=object)))
    return real, True


def _shift(upper: np.ndarray, lower: np.ndarray) -> tuple[np.ndarray, bool]:
    """A with ``upper = lower A``, and whether there is one."""
    square = mpmath.matrix(lower.T.dot(lower).tolist())
    try:
        A = mp.inverse(square) * mpmath.matrix(lower.T.dot(upper).tolist())
    except ZeroDivisionError:
        return upper, False
    found = np.array(A.tolist(), dtype=object)
    rest = np.abs(upper - lower.dot(found)).max()
    return found, bool(rest < mpf(10) ** -60 * (1 + np.abs(upper).max()))


def _joints(elimination: Elimination, x3: mpf, vector: np.ndarray) -> list[list[mpf]]:
    """Joint angles of the arm from the angle that remains and a null vector; two or none where a joint is not unique."""
    blocks = vector.reshape(4, 3)
    x4 = (blocks[:3] * blocks[1:]).sum() / (blocks[1:] ** 2).sum()
    x5 = (blocks[:, :2] * blocks[:, 1:]).sum() / (blocks[:, 1:] ** 2).sum()
    t3, t4, t5 = (2 * mp.atan(x) for x in (x3, x4, x5))
    K = [_matrix(k) for k in elimination.K]
    M = K[1] * _turn(t3) * K[2] * _turn(t4) * K[3] * _turn(t5) * K[4]
    back, last = _matrix(inverse(elimination.K[0])), _matrix(inverse(elimination.K[5]))
    target = _line_numbers(M)
    samples = [_line_numbers(back * _turn(-t) * last) for t in (mpf(0), mp.pi / 2, mp.pi)]
    kept = (2, 5, 6, 7, 10, 13)  # those that a turn about z does not change
    equations = []
    for i in kept:
        mean = (samples[0][i] + samples[2][i]) / 2
        equations.append(((samples[0][i] - samples[2][i]) / 2, samples[1][i] - mean, target[i] - mean))
    found = []
    for t1 in _circle(equations):
        mine = _line_numbers(back * _turn(-t1) * last)
        # Rz(t2) takes the pairs of the target to mine
        cosine = sum((target[i] * mine[i] + target[i + 1] * mine[i + 1] for i in (0, 3, 8, 11)), mpf(0))
        sine = sum((target[i] * mine[i + 1] - target[i + 1] * mine[i] for i in (0, 3, 8, 11)), mpf(0))
        t2 = mp.atan2(sine, cosine)
        rest = (_turn(t1) * K[0] * _turn(t2) * M) ** -1 * last
        t6 = mp.atan2(rest[1, 0], rest[0, 0])
        shift = [2 * mp.atan(mpf(o.numerator) / o.denominator) for o in elimination.offsets]
        values = [t1, t2, t3 + shift[0], t4 + shift[1], t5 + shift[2], t6]
        q = [mpf(0)] * 6
        for i, value in zip(elimination.angle_indices(), values, strict=True):
            q[i] = _wrapped(value)
        found.append(q)
    return found


def _circle(equations: list[tuple[mpf, mpf, mpf]]) -> list[mpf]:
    """Angles with ``a cos + b sin = c`` for all (a, b, c): one, or two where the equations are one and the same."""
    aa, ab, bb, ac, bc = (
        sum((e[i] * e[j] for e in equations), mpf(0)) for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2))
    )
    determinant, size = aa * bb - ab * ab, aa + bb
    if size < SINGULAR:
        return []
    if determinant > SINGULAR**0.5 * size * size:
        return [mp.atan2(aa * bc - ab * ac, bb * ac - ab * bc)]
    a, b, c = max(equations, key=lambda e: abs(e[0]) + abs(e[1]))
    middle, reach = mp.atan2(b, a), c / mp.sqrt(a * a + b * b)
    if abs(reach) > 1 + mpf(10) ** -60:
        return []
    half = mp.acos(min(max(reach, mpf(-1)), mpf(1)))
    return [middle + half, middle - half]


def _line_numbers(T: mpmath.matrix) -> list[mpf]:
    l, p = [T[i, 2] for i in range(3)], [T[i, 3] for i in range(3)]  # noqa: E741
    pp, pl = sum(x * x for x in p), sum(x * y for x, y in zip(p, l, strict=True))
    cross = [p[i - 2] * l[i - 1] - p[i - 1] * l[i - 2] for i in range(3)]
    return [*l, *p, pp, pl, *cross, *(pp * x - 2 * pl * y for x, y in zip(l, p, strict=True))]


def _matrix(T: fmpq_mat) -> mpmath.matrix:
    return mpmath.matrix([[_ratio(fraction(T[i, j])) for j in range(4)] for i in range(4)])


def _ratio(x: Fraction) -> mpf:
    return mpf(x.numerator) / x.denominator


def _turn(angle: mpf) -> mpmath.matrix:
    c, s = mp.cos(angle), mp.sin(angle)
    return mpmath.matrix([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def _wrapped(angle: mpf) -> mpf:
    """To (-pi, pi]."""
    turns = mp.floor((angle + mp.pi) / (2 * mp.pi))
    angle = angle - 2 * mp.pi * turns
    return mp.pi if angle + mp.pi < mpf(10) ** -100 else angle


def _number(x: arb) -> mpf:
    mantissa, exponent = x.mid().man_exp()
    return mp.ldexp(mpf(int(mantissa)), int(exponent))


# How a solution answers to rounding


def sensitivity(arm: RationalArm, pose: fmpq_mat, q: list[mpf]) -> tuple[float, float]:
    """Least singular value of the Jacobian (m and rad mixed), and how far the solution moves when arm and pose are
    rounded to double precision [rad]: infinite where it does not survive that.
    """
    base, target = _rounded(arm.base), _rounded(pose)
    links = [_rounded(link) for link in arm.links]
    J, _ = _jacobian(_matrix(arm.base), [_matrix(link) for link in arm.links], q)
    least = float(np.linalg.svd(np.array(J.tolist(), dtype=float), compute_uv=False)[-1])
    at = list(q)
    for _ in range(60):
        J, T = _jacobian(base, links, at)
        try:  # rounded rotations are not quite rotations: the step is least squares on all twelve numbers
            step = mp.lu_solve(J, _difference(T, target))
        except ZeroDivisionError:
            return least, math.inf
        at = [x + d for x, d in zip(at, step, strict=True)]
        size = max(abs(x) for x in step)
        if size < mpf(10) ** -40:
            return least, float(apart(at, q))
        if size > 1:
            break
    return least, math.inf


def _rounded(T: fmpq_mat) -> mpmath.matrix:
    return mpmath.matrix(as_float(T).tolist())


def _jacobian(base: mpmath.matrix, links: list[mpmath.matrix], q: Sequence[mpf]) -> tuple[mpmath.matrix, mpmath.matrix]:
    T, axes = base, []
    for value, link in zip(q, links, strict=True):
        axes.append(([T[i, 2] for i in range(3)], [T[i, 3] for i in range(3)]))
        T = T * _turn(value) * link
    columns = []
    for z, p in axes:
        r = [T[i, 3] - p[i] for i in range(3)]
        columns.append([*(z[i - 2] * r[i - 1] - z[i - 1] * r[i - 2] for i in range(3)), *z])
    return mpmath.matrix(columns).T, T


def _difference(T: mpmath.matrix, target: mpmath.matrix) -> mpmath.matrix:
    """The twist, to first order, from one pose to another."""
    turn = target[:3, :3] * T[:3, :3].T
    rotation = [(turn[2, 1] - turn[1, 2]) / 2, (turn[0, 2] - turn[2, 0]) / 2, (turn[1, 0] - turn[0, 1]) / 2]
    return mpmath.matrix([*(target[i, 3] - T[i, 3] for i in range(3)), *rotation])
