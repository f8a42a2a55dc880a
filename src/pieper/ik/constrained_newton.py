"""The least of a smooth function over the joint values that meet some rows of a target, for many targets and starts at once.

Minimise ``f(q)`` subject to ``c(q) = 0`` by Newton steps on the conditions of Lagrange,

    grad f = J^T lambda,    c = 0,        J = dc/dq,

with true second derivatives of both, so that the last steps are quadratic whatever is left of f. The reduced Hessian takes
the magnitudes of its eigenvalues, which makes every step one downhill (Nocedal and Wright, Numerical Optimization,
2006, sections 3.4 and 18.3).

The functions f are ``1 - cos(angle)`` of a rotation or of an axis that is left over, or ``|q - seed|^2 / 2``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

_LONGEST_STEP = 0.3  # [rad, or m in units of the size of the arm]
_ARRIVED = 1e-13  # a step this small changes nothing more
_CONVERGED = 1e-8  # one Newton step from here is within rounding
_REGULAR = 1e-9  # singular values of J below this, in units of the largest, count as 0: their directions are free
_FLAT = 1e-9  # curvatures below this count as 0, and there is no step along them
_LEVEL = 1e-7  # a slope along a flat direction that is rounding, or of no account
_NOT_DOWNHILL = -1e-6
_INSIDE = 0.995  # of half a joint's range


class State(NamedTuple):
    """Kinematics of B configurations."""

    q: FloatArray
    """(B, n) joint values [rad or m]."""
    T: FloatArray
    """(B, 4, 4) poses of the tip."""
    jacobian: FloatArray
    """(B, 6, n) geometric Jacobians."""
    hessian: FloatArray
    """(B, n, 6, n) their derivatives, the joint that is moved first."""
    which: NDArray[np.intp]
    """(B,) the target of each."""


class Rows(NamedTuple):
    """Rows that have to vanish: values (B, m), first (B, m, n) and second derivatives (B, m, n, n)."""

    values: FloatArray
    first: FloatArray
    second: FloatArray


class Objective(NamedTuple):
    """What is to be small: value (B,), gradient (B, n), second derivative (B, n, n)."""

    value: FloatArray
    first: FloatArray
    second: FloatArray


class Minima(NamedTuple):
    """Where the starts came to rest."""

    q: FloatArray
    """(B, n)"""
    converged: NDArray[np.bool_]
    """(B,): the rows are met, and the last step was small."""
    minimum: NDArray[np.bool_]
    """(B,): nothing nearby is less, to second order."""


def minimise(
    chain: Chain,
    q: FloatArray,
    which: NDArray[np.intp],
    rows: Callable[[State], Rows],
    objective: Callable[[State], Objective],
    *,
    limits: FloatArray | None = None,
    iterations: int = 40,
) -> Minima:
    """Newton's method from B starts.

    Parameters
    ----------
    chain : Chain
    q : (B, n) array
        Starts [rad or m]; they need not meet the rows.
    which : (B,) array of int
        The target that belongs to each start; handed on to `rows` and `objective`.
    rows, objective : callables
        Give a `Rows` and an `Objective` at a `State`. Rows should be of the size of radians.
    limits : (n, 2) array, optional
        Bounds to keep [rad or m]; a joint with an infinite one has none.
    iterations : int
        Steps at most.

    Returns
    -------
    Minima
    """
    bounds = _Bounds.of(np.tile([-np.inf, np.inf], (chain.dof, 1)) if limits is None else limits)
    y = bounds.inwards(np.array(q, dtype=np.float64))
    converged, minimum = np.zeros(len(y), dtype=bool), np.zeros(len(y), dtype=bool)
    active = np.arange(len(y))
    for _ in range(iterations):
        if not len(active):
            break
        here = bounds.joints(y[active])
        state = State(
            here, chain.native.fk(here), chain.native.jacobian(here), chain.native.hessian(here), which[active]
        )
        step, curvature, off, slope = _step(*bounds.substituted(y[active], rows(state), objective(state)))
        size = np.abs(step).max(axis=-1)
        y[active] += step * np.minimum(1.0, _LONGEST_STEP / np.maximum(size, 1e-300))[:, None]
        converged[active] = (size < _CONVERGED) & (off < _CONVERGED) & (slope < _LEVEL)
        minimum[active] = curvature > _NOT_DOWNHILL
        active = active[size > _ARRIVED]
    return Minima(bounds.joints(y), converged, converged & minimum)


class _Bounds(NamedTuple):
    """Joints as functions of numbers without bounds, ``q = middle + half sin(y / half)``: where a bound holds back, the slope vanishes."""

    low: FloatArray
    high: FloatArray
    middle: FloatArray
    half: FloatArray
    bounded: NDArray[np.bool_]

    @classmethod
    def of(cls, limits: FloatArray) -> _Bounds:
        bounded = np.asarray(np.isfinite(limits).all(axis=-1))
        low, high = np.where(bounded[:, None], limits, [-1.0, 1.0]).T
        return cls(low, high, 0.5 * (high + low), np.maximum(0.5 * (high - low), 1e-12), bounded)

    def joints(self, y: FloatArray) -> FloatArray:
        q = self.middle + self.half * np.sin(y / self.half)
        return np.where(self.bounded, np.clip(q, self.low, self.high), y)

    def inwards(self, q: FloatArray) -> FloatArray:
        """Numbers for joint values, which are brought a little inside where a slope would vanish."""
        sine = np.clip((q - self.middle) / self.half, -_INSIDE, _INSIDE)
        return np.where(self.bounded, self.half * np.arcsin(sine), q)

    def substituted(self, y: FloatArray, rows: Rows, objective: Objective) -> tuple[Rows, Objective]:
        """Derivatives by y instead of q."""
        if not self.bounded.any():
            return rows, objective
        once = np.where(self.bounded, np.cos(y / self.half), 1.0)
        twice = np.where(self.bounded, -np.sin(y / self.half) / self.half, 0.0)
        n = y.shape[-1]
        outer = once[:, :, None] * once[:, None, :]
        rows = Rows(
            rows.values,
            rows.first * once[:, None],
            rows.second * outer[:, None] + (rows.first * twice[:, None])[..., None] * np.eye(n),
        )
        second = objective.second * outer + (objective.first * twice)[..., None] * np.eye(n)
        return rows, Objective(objective.value, objective.first * once, second)


def _step(rows: Rows, objective: Objective) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """(B, n) Newton steps, the least curvature along the rows, what is left of the rows, and the slope along flat directions."""
    J, gradient = rows.first, objective.first
    n = J.shape[-1]
    left, sizes, right = np.linalg.svd(J, full_matrices=False)
    regular = sizes > _REGULAR * np.maximum(sizes[:, :1], _REGULAR)
    inverse = np.where(regular, 1.0 / np.where(regular, sizes, 1.0), 0.0)
    back = right.swapaxes(-1, -2) @ (inverse[..., None] * left.swapaxes(-1, -2))  # (B, n, m), the pseudo-inverse
    multipliers = (gradient[:, None, :] @ back)[:, 0]
    along = np.eye(n) - back @ J
    hessian = objective.second - np.einsum("bk,bkij->bij", multipliers, rows.second)
    towards = -(back @ rows.values[..., None])[..., 0]
    against = -(along @ (gradient[..., None] + hessian @ towards[..., None]))[..., 0]
    reduced = along @ hessian @ along
    values, vectors = np.linalg.eigh(0.5 * (reduced + reduced.swapaxes(-1, -2)) + (np.eye(n) - along))
    inwards = (vectors.swapaxes(-1, -2) @ against[..., None])[..., 0]
    flat = np.abs(values) < _FLAT
    parts = np.where(flat, 0.0, inwards / np.where(flat, 1.0, np.abs(values)))
    downhill = (along @ (vectors @ parts[..., None]))[..., 0]
    slope = np.where(flat, np.abs(inwards), 0.0).max(axis=-1)
    return towards + downhill, values.min(axis=-1), np.abs(rows.values).max(axis=-1, initial=0.0), slope


# Rows


def position_rows(state: State, p: FloatArray, scale: float) -> Rows:
    """The position of the tip is p, (targets, 3) [m]; divided by the size of the arm."""
    values = (state.T[:, :3, 3] - p[state.which]) / scale
    second = np.moveaxis(state.hessian[:, :, :3, :], 2, 1) / scale
    return Rows(values, state.jacobian[:, :3] / scale, second)


def axis_rows(state: State, across: FloatArray, axis_tip: FloatArray) -> Rows:
    """A tool axis has no part along `across`, (targets, 2, 3), two directions across where it is to point.

    An axis that points the wrong way meets them too; errors are measured afterwards.
    """
    axis, first, second = _derivatives_of_axis(state, axis_tip)
    B = across[state.which]
    return Rows((B @ axis[..., None])[..., 0], B @ first, np.einsum("bkc,bicj->bkij", B, second))


def stacked(*parts: Rows) -> Rows:
    """Several rows as one."""
    return Rows(*(np.concatenate(list(values), axis=1) for values in zip(*parts, strict=True)))


# Objectives


def rotation_objective(state: State, R: FloatArray) -> Objective:
    """1 - cos of the angle between the rotation of the tip and R, (targets, 3, 3)."""
    E = state.T[:, :3, :3] @ R[state.which].swapaxes(-1, -2)
    e = 0.5 * np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=-1)
    trace = np.trace(E, axis1=-2, axis2=-1)
    turns = 0.5 * (trace[:, None, None] * np.eye(3) - E)
    return _of_turns(state, 0.5 * (3.0 - trace), e, turns)


def axis_objective(state: State, direction: FloatArray, axis_tip: FloatArray) -> Objective:
    """1 - cos of the angle between a tool axis and where it is to point, (targets, 3)."""
    axis, wanted = state.T[:, :3, :3] @ axis_tip, direction[state.which]
    cosine = np.einsum("bi,bi->b", axis, wanted)
    turns = cosine[:, None, None] * np.eye(3) - axis[:, :, None] * wanted[:, None, :]
    return _of_turns(state, 1.0 - cosine, np.cross(wanted, axis), turns)


def distance_objective(state: State, seed: FloatArray) -> Objective:
    """Half the squared distance of the joint values from `seed`, (targets, n)."""
    away = state.q - seed[state.which]
    n = away.shape[-1]
    return Objective(0.5 * (away * away).sum(axis=-1), away, np.broadcast_to(np.eye(n), (len(away), n, n)))


def _of_turns(state: State, value: FloatArray, e: FloatArray, turns: FloatArray) -> Objective:
    """A function whose derivative by a turn w of the tip is w . e, and de = turns @ w."""
    w = state.jacobian[:, 3:]
    first = np.einsum("bci,bc->bi", w, e)
    second = np.einsum("bicj,bc->bij", state.hessian[:, :, 3:, :], e) + w.swapaxes(-1, -2) @ turns.swapaxes(-1, -2) @ w
    return Objective(value, first, second)


def _derivatives_of_axis(state: State, axis_tip: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A direction carried by the tip, (B, 3), with first (B, 3, n) and second derivatives (B, n, 3, n)."""
    axis = state.T[:, :3, :3] @ axis_tip
    w = state.jacobian[:, 3:].swapaxes(-1, -2)  # (B, n, 3)
    first = np.cross(w, axis[:, None])  # (B, n, 3)
    second = np.cross(state.hessian[:, :, 3:, :].swapaxes(-1, -2), axis[:, None, None])
    second = second + np.cross(w[:, None, :, :], first[:, :, None, :])
    return axis, first.swapaxes(-1, -2), second.swapaxes(-1, -2)
