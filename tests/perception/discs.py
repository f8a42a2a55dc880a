"""Frames of anti-aliased discs whose centres are known exactly."""

from __future__ import annotations

import numpy as np

from pieper.perception.color_table import ColorTable

BACKGROUND = (60, 90, 60)
RED, BLUE = (20, 20, 230), (230, 40, 20)
SUBPIXELS = 16
_REACH = 95.0  # of a colour in the table, in grey levels


def _ball_table() -> ColorTable:
    middle = np.arange(64) * 4 + 1.5
    cells = np.stack(np.meshgrid(middle, middle, middle, indexing="ij"), axis=-1)
    labels = np.zeros((64, 64, 64), np.uint8)
    for k, color in enumerate((RED, BLUE)):
        labels[np.linalg.norm(cells - np.array(color), axis=-1) < _REACH] = k + 1
    return ColorTable(("red", "blue"), labels)


TWO_COLORS = _ball_table()


def coverage(x: float, y: float, radius: float, side: int) -> np.ndarray:
    """Part of each pixel of a square that a disc covers."""
    at = (np.arange(side * SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    inside = (at[None, :] - x) ** 2 + (at[:, None] - y) ** 2 <= radius**2
    return inside.reshape(side, SUBPIXELS, side, SUBPIXELS).mean(axis=(1, 3))


def disc_frame(
    rng: np.random.Generator, count: int, *, noise: float = 0.0, blurred: bool = False, gap: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """A frame (480, 640, 3) and the centres (count, 2) of its discs, red and blue in turn, far apart or in pairs with a gap."""
    frame = np.full((480, 640, 3), BACKGROUND, float)
    side, centers = 40, []
    for k in range(count):
        radius = rng.uniform(11.0, 12.0) if gap is None else 11.5
        place = np.array([60.0 + 130 * (k % 4), 60.0 + 130 * (k // 4)]) + rng.uniform(-0.5, 0.5, 2)
        if gap is not None and k % 2 == 1:
            angle = rng.uniform(-np.pi, np.pi)
            place = centers[-1] + (2 * 11.5 + gap) * np.array([np.cos(angle), np.sin(angle)])
        corner = np.floor(place).astype(int) - side // 2
        cover = coverage(*(place - corner), radius, side)[..., None]
        part = frame[corner[1] : corner[1] + side, corner[0] : corner[0] + side]
        part[:] = part * (1 - cover) + cover * np.array(RED if k % 2 == 0 else BLUE)
        centers.append(place)
    if blurred:  # a symmetric kernel moves no centre
        for axis in (0, 1):
            frame = (np.roll(frame, 1, axis) + 2 * frame + np.roll(frame, -1, axis)) / 4
    frame += rng.normal(0.0, noise, frame.shape) if noise else 0.0
    return np.clip(np.rint(frame), 0, 255).astype(np.uint8), np.array(centers)
