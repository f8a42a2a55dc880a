"""Blobs as a camera over a field would see them, without an image: exact, or with stated noise, missing and false ones."""

from __future__ import annotations

import numpy as np

from pieper.perception.blobs import Blobs
from pieper.perception.camera import Camera
from pieper.perception.field_view import FieldView

DOWN = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2.4], [0, 0, 0, 1]])


def overhead(mm_per_px=3.0, size=(640, 480), distortion=()):
    """A camera 2.4 m above the middle of the field."""
    f = 2400.0 / mm_per_px
    return FieldView(Camera([[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1]], distortion, size), DOWN)


def rotation(heading):
    return np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])


def blobs_of(view, patterns, poses, *, noise=0.0, rng=None, miss=0.0, clutter=0, ball=None, names=None):
    """Blobs of robots ``{name: (x, y, heading)}`` [m] and a ball at ``(x, y)``; `noise` [px]."""
    rng = rng or np.random.default_rng(0)
    known = {robot.name: robot for robot in patterns.robots}
    names = names or tuple(sorted(patterns.colors))
    uv, color, radius = [], [], []
    for name, (x, y, heading) in poses.items():
        for m in known[name].markers:
            p = rotation(heading) @ m.position + (x, y)
            uv.append(view.to_image(p, height=m.height))
            color.append(names.index(m.color))
            radius.append(m.radius / np.sqrt(abs(np.linalg.det(view.jacobian(uv[-1], height=m.height)))))
    if ball is not None:
        uv.append(view.to_image(np.array(ball), height=patterns.ball.radius))
        color.append(names.index(patterns.ball.color))
        radius.append(
            patterns.ball.radius / np.sqrt(abs(np.linalg.det(view.jacobian(uv[-1], height=patterns.ball.radius))))
        )
    uv, color, radius = np.array(uv).reshape(-1, 2), np.array(color, int), np.array(radius)
    stays = rng.random(len(uv)) >= miss
    uv, color, radius = uv[stays], color[stays], radius[stays]
    if clutter:
        width, height = view.camera.size if hasattr(view, "camera") else (640, 480)
        uv = np.concatenate([uv, rng.uniform((0, 0), (width, height), (clutter, 2))])
        color = np.concatenate([color, rng.integers(0, len(names), clutter)])
        radius = np.concatenate([radius, np.full(clutter, np.median(radius) if len(radius) else 6.0)])
    uv = uv + rng.normal(0.0, noise, uv.shape) if noise else uv
    return made(names, color, uv, max(noise, 0.02), radius)


def made(names, color, uv, sigma=0.02, radius=6.0):
    n = len(uv)
    area = np.pi * np.broadcast_to(radius, (n,)).astype(float) ** 2
    covariance = np.tile(np.eye(2) * sigma**2, (n, 1, 1))
    extent = np.zeros((n, 4), dtype=np.int64)
    return Blobs(tuple(names), np.asarray(color, np.int64), np.asarray(uv, float), covariance, area, extent, np.ones(n))
