"""Boards and fields as an exact camera sees them: every pixel is the mean of rays that are followed to the plane."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from pieper.perception.camera import Camera


class RayCaster:
    """Rays of a camera: one through each corner of each pixel, exact, and `sides` x `sides` within, linear between those.

    Linear within one pixel is 2e-4 px from exact for the lenses of these tests. Pixels whose surroundings are of one colour need no rays.
    """

    def __init__(self, camera: Camera, sides: int = 6) -> None:
        self.camera = camera
        width, height = camera.size
        u, v = np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5
        self.rays = camera.directions(np.stack(np.meshgrid(u, v), axis=-1))[..., :2]
        at = (np.arange(sides) + 0.5) / sides
        s, t = (part.reshape(-1) for part in np.meshgrid(at, at))
        self.weights = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=-1)

    def image(self, T_camera_plane, value, *, noise=0.0, seed=0, blur=0.0):
        """Gray image of a plane that has `value(points (..., 2)) -> 0..1`; what is not seen is mid gray."""
        corners = self._value(np.asarray(T_camera_plane), value, self.rays)
        four = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, :-1], corners[1:, 1:]])
        mean = four.mean(axis=0)
        mixed = np.ptp(four, axis=0) > 0
        mixed[1:] |= mixed[:-1]
        mixed[:-1] |= mixed[1:]
        mixed[:, 1:] |= mixed[:, :-1]
        mixed[:, :-1] |= mixed[:, 1:]
        v, u = np.nonzero(mixed)
        around = np.stack([self.rays[v, u], self.rays[v, u + 1], self.rays[v + 1, u], self.rays[v + 1, u + 1]], axis=1)
        mean[v, u] = self._value(np.asarray(T_camera_plane), value, self.weights @ around).mean(axis=1)
        if blur:
            mean = gaussian_filter(mean, blur, mode="nearest")
        levels = 25 + 205 * mean
        if noise:
            levels = levels + np.random.default_rng(seed).normal(0, noise, mean.shape)
        return np.clip(np.rint(levels), 0, 255).astype(np.uint8)

    @staticmethod
    def _value(T, value, rays):
        d = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (T[:3, 2] @ T[:3, 3]) / (d @ T[:3, 2])
            p = (along[..., None] * d - T[:3, 3]) @ T[:3, :2]
        seen = (along > 0) & np.isfinite(p).all(axis=-1)
        return np.where(seen, np.asarray(value(np.where(seen[..., None], p, 1e3)), dtype=np.float64), 0.5)


def looking_at(point, *, distance, tilt, turn, roll=0.0):
    """Pose of a plane (x right, y down, z away) whose `point` is on the axis, turned by angles [rad]."""
    R = Rotation.from_euler("zxy", [roll, tilt, turn]).as_matrix()
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = np.array([0, 0, distance]) - R @ np.array([*point, 0.0])
    return T


def overhead(height, *, tilt=0.0, turn=0.0, yaw=0.0):
    """Pose of a field (z up) under a camera that looks down, turned by angles [rad]; the origin stays on the axis."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", [np.pi + tilt, turn, yaw]).as_matrix()
    T[:3, 3] = 0, 0, height
    return T
