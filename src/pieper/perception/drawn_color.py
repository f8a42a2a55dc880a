"""The colours in which things are drawn over an image, by name or as ``#rrggbb``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import VisionError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.spatial._checks import FloatArray

Bgr = tuple[int, int, int]
DRAWN: dict[str, Bgr] = {
    "red": (0, 0, 255),
    "green": (0, 200, 0),
    "blue": (255, 64, 0),
    "yellow": (0, 230, 255),
    "orange": (0, 140, 255),
    "pink": (180, 105, 255),
    "cyan": (255, 220, 0),
    "lime": (0, 255, 160),
    "purple": (200, 0, 140),
    "magenta": (255, 0, 255),
    "white": (255, 255, 255),
    "rojo": (0, 0, 255),
    "verde": (0, 200, 0),
    "azul": (255, 64, 0),
    "amarillo": (0, 230, 255),
    "naranja": (0, 140, 255),
    "rosa": (180, 105, 255),
}
"""Blue, green and red in which colours of these names are drawn."""


def draw_color(text: str) -> Bgr:
    """Return the blue, green and red of ``#rrggbb`` or of a word.

    Raises
    ------
    VisionError
        It is neither; the message lists the words.

    Examples
    --------
    >>> draw_color("#ff8000")
    (0, 128, 255)
    """
    word = text.strip().lower()
    if word in DRAWN:
        return DRAWN[word]
    if len(word) == 7 and word[0] == "#" and all(c in "0123456789abcdef" for c in word[1:]):
        r, g, b = (int(word[i : i + 2], 16) for i in (1, 3, 5))
        return b, g, r
    raise VisionError(f"a draw colour must be #rrggbb or one of {', '.join(DRAWN)}, got {text!r}")


def default_draw(name: str) -> Bgr | None:
    """Return the colour of a name that is one, as in ``"Red"`` or ``"red 2"``; None if it is not."""
    first = name.strip().lower().replace("_", " ").replace("-", " ").split(" ")[0]
    return DRAWN.get(first)


def as_hex(bgr: Sequence[int]) -> str:
    """``#rrggbb``."""
    b, g, r = bgr
    return f"#{r:02x}{g:02x}{b:02x}"


def from_hsv(hsv: FloatArray) -> Bgr:
    """Blue, green and red of OpenCV's hue (0 to 180), saturation and value."""
    import colorsys

    r, g, b = colorsys.hsv_to_rgb(hsv[0] % 180.0 / 180.0, *(np.clip(hsv[1:], 0, 255) / 255.0))
    return round(255 * b), round(255 * g), round(255 * r)
