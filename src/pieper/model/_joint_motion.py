"""Joints as screws and as transforms."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pieper.model._arrays import FloatArray
    from pieper.model.joint import Joint

ON_AXIS = 1e-13  # [m, relative beyond 1 m] rounding left by composing poses; a real offset is far larger


def screw_of(T_base_joint: FloatArray, joint: Joint, sign: float) -> FloatArray:
    w = sign * (T_base_joint[:3, :3] @ joint.axis)
    if joint.type == "prismatic":
        return np.concatenate([w, np.zeros(3)])
    v = np.cross(T_base_joint[:3, 3], w)
    pitch = float(v @ w)  # rounding; more than that only where the joint lies far along its own axis
    return np.concatenate([v - pitch * w if abs(pitch) > ON_AXIS else v, w])


def moved(joint: Joint, value: float) -> FloatArray:
    """The motion of a joint in its own frame, (4, 4); Rodrigues' formula for a turn."""
    T = np.eye(4)
    if joint.type == "prismatic":
        T[:3, 3] = joint.axis * value
        return T
    x, y, z = joint.axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    T[:3, :3] += np.sin(value) * K + 2.0 * np.sin(0.5 * value) ** 2 * (K @ K)
    return T


def inverse(T: FloatArray) -> FloatArray:
    inverse = np.eye(4)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse


def limits_of(joint: Joint) -> tuple[float, float]:
    return (-inf, inf) if joint.type == "continuous" else (joint.lower, joint.upper)
