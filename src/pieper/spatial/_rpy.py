"""Roll, pitch and yaw as URDF defines them: ``R = Rz(yaw) Ry(pitch) Rx(roll)``."""

from __future__ import annotations

from math import atan2, cos, hypot, sin
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pieper.spatial._checks import FloatArray


def rpy_rows(cosines: Any, sines: Any) -> list[list[Any]]:
    """Rows of the rotation matrix; cosines and sines of roll, pitch and yaw are numbers or arrays."""
    (cr, cp, cy), (sr, sp, sy) = cosines, sines
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> FloatArray:
    """The rotation matrix of one frame; plain floats, because a description has many frames and each is small."""
    angles = (roll, pitch, yaw)
    return np.array(rpy_rows(map(cos, angles), map(sin, angles)))


def rpy_from_rotation(R: FloatArray) -> tuple[float, float, float]:
    """Roll, pitch and yaw that give R back to rounding, also at a pitch of +-90 degrees.

    Near the lock the yaw that the first column yields is noise, but any yaw is good as long as the roll is then taken
    from Rz(yaw)^T R instead of from the last row.
    """
    cos_pitch = hypot(float(R[0, 0]), float(R[1, 0]))
    yaw = atan2(R[1, 0], R[0, 0]) if cos_pitch > 0.0 else 0.0
    pitch = atan2(-R[2, 0], cos_pitch)
    sy, cy = sin(yaw), cos(yaw)
    roll = atan2(sy * R[0, 2] - cy * R[1, 2], cy * R[1, 1] - sy * R[0, 1])
    return roll, pitch, yaw
