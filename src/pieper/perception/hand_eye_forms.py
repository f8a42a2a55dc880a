"""Closed forms of ``A_i X B_i = Y``: two of our own, and those of OpenCV where it has them (its Python package 5.0.0 has not).

OpenCV's solvers answer without a word when nothing can be known (zeros, NaN, or a number), so that the turns of the hand are looked at first.

References
----------
Park, Martin, "Robot sensor calibration: solving AX = XB on the Euclidean group", IEEE Trans. Robotics and Automation 1994, eq. (19), (22).

Shah, "Solving the robot-world/hand-eye calibration problem using the Kronecker product", J. Mechanisms and Robotics 2013, section 3.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.perception.opencv import opencv
from pieper.spatial import pose, rotation

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.spatial._checks import FloatArray


def by_pairs(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Park and Martin: for all pairs ``A_ij X = X B_ij``; axes of turns are matched, then positions are linear."""
    i, j = np.array(list(combinations(range(len(A)), 2))).T
    A_ij, B_ij = pose.inverse(A[j]) @ A[i], B[j] @ pose.inverse(B[i])
    a, b = rotation.as_rotation_vector(A_ij[:, :3, :3]), rotation.as_rotation_vector(B_ij[:, :3, :3])
    plain = np.linalg.norm(a, axis=1) < 3.0  # an axis of a half turn has two signs
    if plain.sum() >= 3:
        a, b, A_ij, B_ij = a[plain], b[plain], A_ij[plain], B_ij[plain]
    X = np.eye(4)
    X[:3, :3] = _turn_onto(b, a)
    rows = (A_ij[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    X[:3, 3] = np.linalg.lstsq(rows, (B_ij[:, :3, 3] @ X[:3, :3].T - A_ij[:, :3, 3]).reshape(-1), rcond=None)[0]
    return X, mean_target(X, A, B)


def by_product(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shah: ``vec(R_A R_X R_B) = (R_A kron R_B^T) vec(R_X)``; both rotations from one singular pair, then positions are linear."""
    R_A, R_B = A[:, :3, :3], B[:, :3, :3]
    K = np.einsum("nij,nlk->ikjl", R_A, R_B).reshape(9, 9)
    U, _, V = np.linalg.svd(K)
    R_X, R_Y = V[0].reshape(3, 3), U[:, 0].reshape(3, 3)
    if np.linalg.det(R_X) < 0:
        R_X, R_Y = -R_X, -R_Y
    R_X, R_Y = _nearest(R_X), _nearest(R_Y)
    n = len(A)
    rows = np.concatenate([R_A, np.tile(-np.eye(3), (n, 1, 1))], axis=2).reshape(-1, 6)
    known = -(A[:, :3, 3] + np.einsum("nij,jk,nk->ni", R_A, R_X, B[:, :3, 3])).reshape(-1)
    t = np.linalg.lstsq(rows, known, rcond=None)[0]
    return pose.from_position_rotation(t[:3], R_X), pose.from_position_rotation(t[3:], R_Y)


def opencv_methods() -> dict[str, Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]]:
    """OpenCV's solvers by name: none where its Python package lacks them."""
    cv2 = opencv("a hand-eye calibration")

    def hand_eye(number: int) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
        def solve(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
            R, t = cv2.calibrateHandEye(*_split(A), *_split(B), method=number)
            X = _assembled(R, t)
            return X, mean_target(X, A, B)

        return solve

    def robot_world(number: int) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
        def solve(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
            # OpenCV's "world" is the board and its "gripper" what A leads from: it returns the inverses of Y and X
            R_Y, t_Y, R_X, t_X = cv2.calibrateRobotWorldHandEye(*_split(B), *_split(pose.inverse(A)), method=number)
            return pose.inverse(_assembled(R_X, t_X)), pose.inverse(_assembled(R_Y, t_Y))

        return solve

    found: dict[str, Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]] = {}
    if hasattr(cv2, "calibrateHandEye"):
        for name in ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS"):
            found[f"OpenCV {name.title()}"] = hand_eye(getattr(cv2, f"CALIB_HAND_EYE_{name}"))
    if hasattr(cv2, "calibrateRobotWorldHandEye"):
        for name in ("SHAH", "LI"):
            found[f"OpenCV {name.title()}"] = robot_world(getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}"))
    return found


def _split(Ts: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    return [T[:3, :3].copy() for T in Ts], [T[:3, 3].copy() for T in Ts]


def _assembled(R: Any, t: Any) -> FloatArray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.ravel(t)
    return T


def _turn_onto(b: FloatArray, a: FloatArray) -> FloatArray:
    """The rotation that brings vectors b, (n, 3), nearest to a."""
    U, _, V = np.linalg.svd(a.T @ b)
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V)


def _nearest(M: FloatArray) -> FloatArray:
    U, _, V = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V)


def mean_target(X: FloatArray, A: FloatArray, B: FloatArray) -> FloatArray:
    """The mean of ``A_i X B_i``, with the rotation that is nearest to all of them."""
    Ys = A @ X @ B
    return pose.from_position_rotation(Ys[:, :3, 3].mean(axis=0), _nearest(Ys[:, :3, :3].sum(axis=0)))
