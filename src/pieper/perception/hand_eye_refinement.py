"""Nonlinear least squares of ``A_i X B_i = Y``, over poses or over the corners in the images.

References
----------
Barfoot, "State estimation for robotics", Cambridge 2017, section 7.1.5: derivatives on rotations.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pieper.spatial import pose, rotation

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pieper.perception.board import Board
    from pieper.perception.board_views import BoardView
    from pieper.perception.camera import Camera
    from pieper.spatial._checks import FloatArray

_STEP = 1e-6  # of the differences that make derivatives [m], [rad]
_STEPS, _HALVINGS = 30, 12  # of Gauss and Newton
_NO_STEP, _NO_GAIN = 1e-13, 1e-14
_FLOOR = 1e-10  # [m], [rad] noise below which rounding decides


def left_over(X: FloatArray, Y: FloatArray, A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Position (n, 3) [m] and rotation vector (n, 3) [rad] of the board that was seen, in the board that should be."""
    E = pose.inverse(Y) @ A @ X @ B
    return E[:, :3, 3], rotation.as_rotation_vector(E[:, :3, :3])


def _moved(T: FloatArray, by: FloatArray) -> FloatArray:
    """Shifted and turned in the axes of the mount: position [m], then rotation vector [rad]; (..., 6)."""
    out = np.array(np.broadcast_to(T, (*by.shape[:-1], 4, 4)))
    out[..., :3, 3] += by[..., :3]
    out[..., :3, :3] = rotation.from_rotation_vector(by[..., 3:]) @ T[:3, :3]
    return out


def _slopes(of: Callable[[FloatArray, FloatArray], FloatArray], X: FloatArray, Y: FloatArray) -> FloatArray:
    """Derivatives of residuals by the twelve numbers, (m, 12), by central differences."""
    columns = []
    for k in range(12):
        step = np.zeros(12)
        step[k] = _STEP
        ahead = of(_moved(X, step[:6]), _moved(Y, step[6:]))
        columns.append((ahead - of(_moved(X, -step[:6]), _moved(Y, -step[6:]))) / (2 * _STEP))
    return np.stack(columns, axis=-1)


def _least_squares(
    of: Callable[[FloatArray, FloatArray], FloatArray],
    slopes: Callable[[FloatArray, FloatArray], FloatArray],
    X: FloatArray,
    Y: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Gauss and Newton on the poses themselves: a step is a shift and a turn from where they are, halved while it does not help."""
    r = of(X, Y)
    cost = float(r @ r)
    for _ in range(_STEPS):
        step: FloatArray = np.asarray(np.linalg.lstsq(slopes(X, Y), -r, rcond=None)[0], dtype=np.float64)
        for _ in range(_HALVINGS):
            X_next, Y_next = _moved(X, step[:6]), _moved(Y, step[6:])
            r_next = of(X_next, Y_next)
            if float(r_next @ r_next) <= cost:
                break
            step = step / 2
        else:
            break
        gained = cost - float(r_next @ r_next)
        X, Y, r, cost = X_next, Y_next, r_next, float(r_next @ r_next)
        if np.abs(step).max() < _NO_STEP or gained <= _NO_GAIN * cost:
            break
    return X, Y


def pose_slopes(X: FloatArray, Y: FloatArray, A: FloatArray, B: FloatArray) -> FloatArray:
    """Derivatives of `left_over` by the twelve numbers, (n, 6, 12)."""
    n = len(A)
    R_A, R_X, R_Y, R_B = A[:, :3, :3], X[:3, :3], Y[:3, :3], B[:, :3, :3]
    arm = B[:, :3, 3] @ R_X.T  # from the camera to the board, in the axes of the mount
    reach = np.einsum("nij,nj->ni", R_A, arm + X[:3, 3]) + A[:, :3, 3] - Y[:3, 3]
    to_target = R_Y.T @ R_A
    _, w = left_over(X, Y, A, B)
    out = np.zeros((n, 6, 12))
    out[:, :3, :3] = to_target
    out[:, :3, 3:6] = -to_target @ _cross(arm)
    out[:, :3, 6:9] = -R_Y.T
    out[:, :3, 9:] = R_Y.T @ _cross(reach)
    out[:, 3:, 3:6] = _inverse_right_jacobian(w) @ np.swapaxes(R_X @ R_B, 1, 2)
    out[:, 3:, 9:] = -_inverse_right_jacobian(w) @ np.swapaxes(R_A @ R_X @ R_B, 1, 2)
    return out


def _cross(v: FloatArray) -> FloatArray:
    """The matrices of ``v x``, (n, 3, 3)."""
    M = np.zeros((len(v), 3, 3))
    M[:, 0, 1], M[:, 0, 2], M[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return M - np.swapaxes(M, 1, 2)


def _inverse_right_jacobian(w: FloatArray) -> FloatArray:
    """Of the exponential map of rotations: ``log(exp(w) exp(d)) = w + J^-1 d`` (Barfoot 2017, eq. 7.77), (n, 3, 3)."""
    angle = np.linalg.norm(w, axis=1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    share = np.where(small, 1.0 / 12.0, 1.0 / safe**2 - (1.0 + np.cos(safe)) / (2.0 * safe * np.sin(safe)))
    M = _cross(w)
    return np.asarray(np.eye(3) + 0.5 * M + share[:, None, None] * (M @ M))


def refine(X: FloatArray, Y: FloatArray, A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Least squares over poses; position and rotation weigh by their own noise, which is read from what is left. Returns (12, 12) covariance too."""
    far = float(np.median(np.linalg.norm(B[:, :3, 3], axis=1)))
    weights = np.array([1.0, 1.0, 1.0, *[max(far, 1e-6)] * 3])
    free = 3 * len(A) - 6

    def of(X: FloatArray, Y: FloatArray) -> FloatArray:
        return np.asarray((np.concatenate(left_over(X, Y, A, B), axis=1) * weights).reshape(-1))

    def slopes(X: FloatArray, Y: FloatArray) -> FloatArray:
        return np.asarray((pose_slopes(X, Y, A, B) * weights[:, None]).reshape(-1, 12))

    for _ in range(3):
        X, Y = _least_squares(of, slopes, X, Y)
        noise = [max(float(np.sqrt((part**2).sum() / free)), _FLOOR) for part in left_over(X, Y, A, B)]
        weights = 1.0 / np.repeat(noise, 3)
    J = slopes(X, Y)
    return X, Y, np.asarray(np.linalg.inv(J.T @ J), dtype=np.float64)


def refine_over_pixels(
    X: FloatArray, Y: FloatArray, A: FloatArray, views: Sequence[BoardView], board: Board, camera: Camera
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Least squares over the corners in the images. Returns the (12, 12) covariance, and the RMS distance of the corners [px], too."""
    points = [np.pad(board.corners[view.ids], ((0, 0), (0, 1)), constant_values=0.0) for view in views]
    uv = np.concatenate([view.uv for view in views])
    inverse_A = pose.inverse(A)
    rows = np.cumsum([0, *(2 * len(p) for p in points)])

    def of(X: FloatArray, Y: FloatArray) -> FloatArray:
        Ts = pose.inverse(X) @ inverse_A @ Y
        p = np.concatenate([q @ T[:3, :3].T + T[:3, 3] for q, T in zip(points, Ts, strict=True)])
        return np.asarray(
            np.nan_to_num(camera.project(p) - uv, nan=1e3).reshape(-1)
        )  # beyond the reach of the lens: far off

    X, Y = _least_squares(of, lambda X, Y: _slopes(of, X, Y), X, Y)
    r, J = of(X, Y), _slopes(of, X, Y)
    bread = np.linalg.inv(J.T @ J)
    n = len(views)
    whole = np.linalg.inv(bread)
    spread = np.zeros((12, 12))
    for start, end in pairwise(rows):
        S, pull = J[start:end].T @ J[start:end], J[start:end].T @ r[start:end]
        moved = np.linalg.lstsq(whole - S, pull, rcond=None)[0]  # how far all is moved when this pose is left out
        spread += np.outer(moved, moved)
    clustered = spread * ((n - 1) / n)
    alone = bread * float(r @ r) / max(len(r) - 12, 1)
    covariance = clustered if np.trace(clustered[:6, :6]) > np.trace(alone[:6, :6]) else alone
    return X, Y, covariance, float(np.sqrt((r @ r) / (len(r) / 2)))


def pixels_off(X: FloatArray, Y: FloatArray, A: FloatArray, view: BoardView, board: Board, camera: Camera) -> float:
    """RMS distance of the corners of a view from where they should be [px]."""
    T = pose.inverse(A @ X) @ Y
    uv = camera.project(board.corners[view.ids] @ T[:3, :2].T + T[:3, 3])
    return float(np.sqrt(np.square(np.nan_to_num(uv - view.uv, nan=1e3)).sum(axis=1).mean()))


def rms(values: FloatArray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
