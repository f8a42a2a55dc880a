"""A colour table for rendered scenes without learning: the nearest paint in chroma."""

from __future__ import annotations

import numpy as np

from pieper.perception.color_table import ColorTable
from pieper.perception.scene import COLORS

NEAR = 0.32  # of log-chroma; the paints are further apart than twice that
DARK = 50  # grey levels below which a pixel has no colour


def table_of(names):
    names = tuple(sorted(names))
    level = np.arange(64) * 4 + 2.0
    pixels = np.stack(np.meshgrid(level, level, level, indexing="ij"), axis=-1).reshape(-1, 3)
    chroma = np.log(pixels + 6)
    chroma -= chroma.mean(axis=1, keepdims=True)
    paint = np.log(np.array([COLORS[name] for name in names]) + 6)
    paint -= paint.mean(axis=1, keepdims=True)
    distance = np.stack([((chroma - p) ** 2).sum(axis=1) for p in paint], axis=1) ** 0.5
    near = distance.argmin(axis=1)
    good = (distance.min(axis=1) < NEAR) & (pixels.max(axis=1) >= DARK)
    return ColorTable(names, np.where(good, near + 1, 0).astype(np.uint8).reshape(64, 64, 64))
