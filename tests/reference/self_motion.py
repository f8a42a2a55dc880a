"""Following the curve of joint values that reach one pose, step by step: slow and clear."""

from __future__ import annotations

import numpy as np

STEP = 0.01  # rad
ROUND = 1000  # steps: once around a joint and a half


def twist(T: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(..., 6) small motion from one pose to another: translation, and rotation vector to first order."""
    turn = target[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2)
    rotation = 0.5 * np.stack(
        [turn[..., 2, 1] - turn[..., 1, 2], turn[..., 0, 2] - turn[..., 2, 0], turn[..., 1, 0] - turn[..., 0, 1]],
        axis=-1,
    )
    return np.concatenate([target[..., :3, 3] - T[..., :3, 3], rotation], axis=-1)


def connected(q, answers, forward, jacobian, tolerance: float) -> np.ndarray:
    """Whether some answer can be reached from joint values without leaving their pose by more than a tolerance.

    Where none is next to them: along the least singular vector of the Jacobian in steps of 0.01 rad either way, corrected in the other directions.

    Parameters
    ----------
    q : (m, n) array
        Joint values, each near a singularity [rad].
    answers : (m, k, n) array
        Other joint values for the pose of each; NaN where there is none.
    forward, jacobian : functions
        From (m, n) to (m, 4, 4) and (m, 6, n).
    tolerance : float
        How far the pose may be off on the way [m and rad].

    Returns
    -------
    (m,) bool array
    """
    found = near(q[:, None], answers).any(axis=1)
    for sign in (1.0, -1.0):
        rows = np.flatnonzero(~found)
        at, previous, target = q[rows], None, forward(q[rows])
        for _ in range(ROUND):
            if not len(rows):
                break
            way = np.linalg.svd(jacobian(at))[2][:, -1]
            turned = sign if previous is None else np.sign((way * previous).sum(axis=1, keepdims=True))
            previous = way * turned
            at = at + STEP * previous
            for _ in range(3):
                U, s, Vt = np.linalg.svd(jacobian(at), full_matrices=False)
                error = np.einsum("mji,mj->mi", U, twist(forward(at), target))
                error[:, -1] = 0.0
                at = at + np.einsum("mi,mij->mj", error / np.maximum(s, 1e-3), Vt)
            on_curve = np.abs(twist(forward(at), target)).max(axis=1) <= tolerance
            found[rows] |= on_curve & near(at[:, None], answers[rows]).any(axis=1)
            left = on_curve & ~found[rows]
            rows, at, previous, target = rows[left], at[left], previous[left], target[left]
    return found


def near(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether all joints agree to within a step, full turns aside."""
    gap = np.abs(np.remainder(a - b + np.pi, 2 * np.pi) - np.pi).max(axis=-1)
    return np.asarray(gap <= STEP)
