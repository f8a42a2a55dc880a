"""The rows of a target as equations for the joints, and the steps of Newton that meet them."""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from pieper.ik.family import size_of
from pieper.spatial.rotation import as_rotation_vector

if TYPE_CHECKING:
    from pieper.ik.target import Target
    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

RESIDUAL = 1e-11
"""What may be left of the rows of a target at a point of a curve [m and rad]."""

RESIDUAL_OF_FAMILIES = 9e-10
"""The same for curves at singular poses: those of an arm whose description rounds right angles are curves only so far."""


class Equations:
    """The rows of one target as equations ``r(q) = 0``, lengths in units of the size of the arm.

    Parameters
    ----------
    chain : Chain
    target : Target
        One target.
    held : (int, float), optional
        A joint, and the value that it is to keep: one more row.
    """

    def __init__(self, chain: Chain, target: Target, held: tuple[int, float] | None = None) -> None:
        self.chain = chain
        self.target = target
        self.held = held
        self.rank = chain.dof - 1
        self.length = size_of(chain)
        T = np.asarray(target.T_base_tip)
        self._p, self._R = T[:3, 3], T[:3, :3]
        self._R_T = np.ascontiguousarray(self._R.T)
        weights = np.asarray(target.weights) != 0.0
        self._position = np.flatnonzero(weights[:3])
        self._turned = target.position_axes == "tool"
        self._axis: FloatArray | None = None
        if target.axis is not None:
            self._axis = np.asarray(target.axis)
            self._wanted = self._R @ self._axis
            self._across = np.linalg.svd(self._wanted[None])[2][1:]
            self._rotation = np.arange(2)
        else:
            self._rotation = np.flatnonzero(weights[3:])
            self._rotation_axes = self._R_T if target.rotation_axes == "tool" else np.eye(3)
        self.whole = bool(weights.all()) and self._axis is None and not self._turned
        self.count = len(self._position) + len(self._rotation) + (held is not None)
        self.tolerance = RESIDUAL / max(1.0, self.length)
        singular = self.count > self.rank
        self.accepted = RESIDUAL_OF_FAMILIES / max(1.0, self.length) if singular else self.tolerance

    def __call__(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (..., m) and their derivative (..., m, n) at joint values (..., n)."""
        rows, derivative = self._rows(q)
        if self.held is None:
            return rows, derivative
        joint, value = self.held
        one = np.zeros((*derivative.shape[:-2], 1, derivative.shape[-1]))
        one[..., joint] = 1.0
        return np.concatenate([rows, q[..., [joint]] - value], axis=-1), np.concatenate([derivative, one], axis=-2)

    def _rows(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        native = self.chain.native
        T, J = native.fk(q), native.jacobian(q)
        off = (T[..., :3, 3] - self._p) / self.length
        linear, angular = J[..., :3, :] / self.length, J[..., 3:, :]
        if self.whole:  # for small angles the rotation vector is the antisymmetric part
            left = (T[..., :3, :3] @ self._R_T).reshape(*q.shape[:-1], 9)
            turn = 0.5 * (left[..., [7, 2, 3]] - left[..., [5, 6, 1]])
            return np.concatenate([off, turn], axis=-1), np.concatenate([linear, angular], axis=-2)
        if self._turned:
            off, linear = off @ self._R, self._R_T @ linear
        turn, turning = self._rotation_rows(T[..., :3, :3], angular)
        rows = np.concatenate([off[..., self._position], turn], axis=-1)
        return rows, np.concatenate([linear[..., self._position, :], turning], axis=-2)

    def _rotation_rows(self, R: FloatArray, angular: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self._axis is not None:  # what is left across the wanted direction d: B (a x d)
            a = R @ self._axis
            along = (angular * self._wanted[:, None]).sum(axis=-2)
            turning = (self._across @ a[..., None]) * along[..., None, :]
            turning -= (a @ self._wanted)[..., None, None] * (self._across @ angular)
            return np.asarray(np.cross(a, self._wanted) @ self._across.T), np.asarray(turning)
        if not len(self._rotation):
            return np.asarray(R[..., 0, :0]), np.asarray(angular[..., :0, :])
        e = as_rotation_vector(R @ self._R_T)
        turning = self._rotation_axes @ _left_jacobian_inverse(e) @ angular
        return np.asarray((e @ self._rotation_axes.T)[..., self._rotation]), turning[..., self._rotation, :]

    def errors(self, q: FloatArray) -> FloatArray:
        """(...): the largest error in any row [m or rad]; opposite orientations are told apart."""
        rows, _ = self(q)
        units = np.where(np.arange(self.count) < len(self._position), self.length, 1.0)
        largest = np.asarray(np.abs(rows * units).max(axis=-1))
        R = self.chain.native.fk(q)[..., :3, :3]
        if self.whole:
            angle = np.linalg.norm(R - self._R, axis=(-2, -1)) / np.sqrt(2.0)
            return np.asarray(np.maximum(largest, angle))
        if self._axis is not None:
            return np.asarray(np.maximum(largest, np.linalg.norm(R @ self._axis - self._wanted, axis=-1)))
        return largest

    def correct(self, q: FloatArray, iterations: int = 12) -> tuple[FloatArray, FloatArray, float, bool]:
        """The point of the curve near `q` (n,), its tangent (n,), the least singular value that should not vanish, and whether
        the residual was met.
        """
        before = np.inf
        rank = self.rank
        for _ in range(iterations):
            r, J = self(q)
            U, s, Vt = np.linalg.svd(J)
            worst = sqrt(float(r @ r))
            if worst <= self.tolerance:
                return q, Vt[rank], float(s[rank - 1]), True
            if not worst < 0.9 * before or s[rank - 1] <= 0.0:
                break
            before = worst
            q = q - ((r @ U[:, :rank]) / s[:rank]) @ Vt[:rank]
        return q, Vt[rank], float(s[rank - 1]), worst <= self.accepted

    def correct_many(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `correct`, for points (k, n) that are on the curve but for interpolation: the points and their tangents."""
        rank = self.rank
        for _ in range(4):
            r, J = self(q)
            U, s, Vt = np.linalg.svd(J)
            if (r * r).sum(axis=-1).max(initial=0.0) <= (0.1 * self.tolerance) ** 2:
                break
            across = np.where(s[:, :rank] > 1e-9, 1.0 / np.maximum(s[:, :rank], 1e-9), 0.0)
            weights = across * (np.swapaxes(U[:, :, :rank], -1, -2) @ r[..., None])[..., 0]
            q = q - (weights[:, None] @ Vt[:, :rank])[:, 0]
        return q, Vt[:, rank]


def _left_jacobian_inverse(e: FloatArray) -> FloatArray:
    """(..., 3, 3): the rate of a rotation vector for angular velocities in base axes (Barfoot, State Estimation for Robotics, eq. 7.83)."""
    angle = np.linalg.norm(e, axis=-1)[..., None, None]
    zero = np.zeros_like(e[..., 0])
    x, y, z = e[..., 0], e[..., 1], e[..., 2]
    E = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*e.shape, 3)
    small = angle < 1e-2
    safe = np.where(small, 1.0, angle)
    c = np.where(small, 1.0 / 12.0 + angle**2 / 720.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    return np.asarray(np.eye(3) - 0.5 * E + c * (E @ E))
