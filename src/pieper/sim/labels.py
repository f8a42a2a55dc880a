"""Names beside what they name in a picture, none over another."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pieper.sim.font import font_for
from pieper.sim.framing import Camera, grid_width
from pieper.sim.offscreen import import_pillow

if TYPE_CHECKING:
    from pieper.sim.stage import Stage

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]


class Name(NamedTuple):
    """Words, and the point that they name, in the unit of the drawing."""

    text: str
    at: FloatArray


def with_names(image: Image, stage: Stage, names: list[Name], camera: Camera, scale: float) -> Image:
    """The picture with names beside what they name, none over another, and the width of the grid in a corner."""
    size = stage.size
    notes = []
    if stage.grid:
        notes.append(f"grid {grid_width(1.0 / scale):g} m")
    if not names and not notes:
        return image
    pillow = import_pillow()
    from PIL import ImageDraw

    canvas = pillow.fromarray(image)
    pen = ImageDraw.Draw(canvas)
    text, halo = stage.theme.text, stage.theme.halo
    taken: list[tuple[float, float, float, float]] = []
    for name in names:
        x, y = camera.pixel(name.at, size)
        words = name.text
        font = font_for(words, max(9.0, 0.019 * size[1]))
        left, top, right, bottom = pen.textbbox((0, 0), words, font=font)
        w, h = right - left, bottom - top
        box = _free_place(x, y, w, h, taken, size)
        taken.append(box)
        beside = (box[0] if box[0] > x else box[2], 0.5 * (box[1] + box[3]))
        if np.hypot(beside[0] - x, beside[1] - y) > 0.9 * h:
            pen.line([(x, y), beside], fill=stage.theme.metal, width=1)
        pen.text((box[0] - left, box[1] - top), words, font=font, fill=text, stroke_width=2, stroke_fill=halo)
    for note in notes:
        small = font_for(note, max(9.0, 0.016 * size[1]))
        bottom = pen.textbbox((0, 0), note, font=small)[3]
        pen.text((8, size[1] - bottom - 7), note, font=small, fill=stage.theme.metal)
    return np.array(canvas)


def _free_place(
    x: float, y: float, w: float, h: float, taken: list[tuple[float, float, float, float]], size: tuple[int, int]
) -> tuple[float, float, float, float]:
    """Where w times h pixels near a spot cover no others: right or left of it, higher and lower in turn."""
    gap, edge = 0.8 * h, 2.0
    for step in range(60):
        for side in (1.0, -1.0):
            left = x + gap if side > 0.0 else x - gap - w
            middle = y - 0.6 * h + ((step + 1) // 2) * (1.25 * h) * (1.0 if step % 2 else -1.0)
            left = min(max(left, edge), max(size[0] - w - edge, edge))
            top = min(max(middle - 0.5 * h, edge), max(size[1] - h - edge, edge))
            box = (left, top, left + w, top + h)
            if not any(
                box[0] < b[2] + 3 and b[0] < box[2] + 3 and box[1] < b[3] + 2 and b[1] < box[3] + 2 for b in taken
            ):
                return box
    return box
