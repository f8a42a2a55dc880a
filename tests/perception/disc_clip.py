"""A clip with coloured discs whose places are known, its colours learnt from regions, for tests of the whole chain in pixels."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from pieper.perception.color_learning import learn
from pieper.perception.color_regions import Region
from tests.perception.clips import write_clip

SIZE = (200, 150)
RADIUS = 11.0
FPS = 25.0
PAINT = {"Red": (40, 40, 215), "Blue": (215, 80, 40), "Green": (60, 190, 60)}
HIDDEN = range(20, 26)
"""Frames in which a bar hides the red disc."""


def places(n: int) -> dict[str, list[tuple[float, float]]]:
    """Where the discs of each colour are in a frame."""
    return {
        "Red": [(40 + 1.5 * n, 40.0)],
        "Blue": [(160 - 1.2 * n, 80.0)],
        "Green": [(30 + n, 120.0), (110 + n, 115.0)],
    }


def picture(n: int) -> np.ndarray:
    noise = np.random.default_rng(n).normal(0, 2, (SIZE[1], SIZE[0], 3))
    image = np.clip(np.array([95.0, 90.0, 92.0]) + noise, 0, 255).astype(np.uint8)
    for name, points in places(n).items():
        for x, y in points:
            cv2.circle(image, (round(x * 16), round(y * 16)), round(RADIUS * 16), PAINT[name], -1, cv2.LINE_AA, 4)
    if n in HIDDEN:
        image[20:60, :] = (30, 30, 30)
    return image


def disc_clip(folder: Path, count: int = 40) -> Path:
    return write_clip(folder / "discs.avi", map(picture, range(count)), fps=FPS, code="MJPG")


def disc_colors(folder: Path) -> Path:
    regions = [
        Region(name, n, round(x) - 8, round(y) - 8, 17, 17)
        for n in (0, 30)
        for name, points in places(n).items()
        for x, y in points[:1]
    ]
    learned = learn(picture, regions, source={"source": "discs.avi"})
    learned.model.save(folder / "colors.yaml")
    return folder / "colors.yaml"
