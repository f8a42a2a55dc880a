"""Forward kinematics as the textbook writes it: a product of matrix exponentials, slow and clear."""

from __future__ import annotations

import numpy as np


def exponential(screw: np.ndarray, angle: float) -> np.ndarray:
    """exp([S] q) of one unit screw, linear part first, (4, 4); Modern Robotics, proposition 3.25."""
    v, w = np.asarray(screw)[:3], np.asarray(screw)[3:]
    T = np.eye(4)
    if not w.any():
        T[:3, 3] = v * angle
        return T
    W = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    one_minus_cos = 2.0 * np.sin(0.5 * angle) ** 2
    T[:3, :3] += np.sin(angle) * W + one_minus_cos * (W @ W)
    # revolute joints have no pitch, so v is across w and W W v = -v
    T[:3, 3] = np.sin(angle) * v + one_minus_cos * (W @ v)
    return T


def fk(chain, q) -> np.ndarray:
    """Base to tip, (4, 4), for one joint vector (n,)."""
    T = np.eye(4)
    for screw, angle in zip(chain.screws, chain.coupling @ np.asarray(q, dtype=float), strict=True):
        T = T @ exponential(screw, angle)
    return T @ chain.home


def fk_frame(chain, q, frame) -> np.ndarray:
    """Base to a named frame of the chain, (4, 4)."""
    T = np.eye(4)
    angles = chain.coupling @ np.asarray(q, dtype=float)
    for screw, angle in zip(chain.screws[: frame.after], angles[: frame.after], strict=True):
        T = T @ exponential(screw, angle)
    return T @ frame.home
