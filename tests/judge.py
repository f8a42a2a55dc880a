"""The judge of inverse kinematics: the textbook product of exponentials with a measure of its own, so that solver and judge share no code."""

from __future__ import annotations

import numpy as np

from pieper.model.chain import Chain
from tests.reference import product_of_exponentials as textbook

TOLERANCE = 1e-9  # [m, rad]: what a solver is asked for by default
MEASURED = TOLERANCE + 1e-13  # the judge multiplies exponentials, and rounds differently


def joints(arm: Chain, count: int, seed: int) -> np.ndarray:
    """(count, n) random joint values within limits, half a turn where there are none."""
    lower, upper = np.clip(arm.limits, -np.pi, np.pi).T
    return np.random.default_rng(seed).uniform(lower, upper, (count, arm.dof))


def poses(arm: Chain, q: np.ndarray) -> np.ndarray:
    """(k, 4, 4) poses of joint values (k, n)."""
    return np.stack([textbook.fk(arm, x) for x in q])


def left(T: np.ndarray, target: np.ndarray) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    R = target[:3, :3].T @ T[:3, :3]
    sine = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.linalg.norm(T[:3, 3] - target[:3, 3])), float(np.arctan2(sine, np.trace(R) - 1.0))


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Largest difference of some joint [rad], whole turns aside."""
    return np.abs(np.remainder(a - b + np.pi, 2.0 * np.pi) - np.pi).max(axis=-1)


def inside(arm: Chain, q: np.ndarray) -> np.ndarray:
    """(...): whether joint values (..., n) keep the limits."""
    return np.all((q >= arm.limits[:, 0]) & (q <= arm.limits[:, 1]), axis=-1)
