"""A font that has the letters of a label: Pillow's own, which is Latin, or one of this machine."""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import Any

from pieper.errors import PieperWarning

FALLBACKS = (
    "DejaVuSans.ttf",
    "NotoSans-Regular.ttf",
    "NotoSansCJK-Regular.ttc",
    "wqy-zenhei.ttc",
    "Arial Unicode.ttf",
    "Hiragino Sans GB.ttc",
    "arial.ttf",
    "msyh.ttc",
    "msgothic.ttc",
    "malgun.ttf",
)
"""Fonts of other alphabets that are looked for where the system keeps its fonts, in this order."""

_IN_NO_FONT = "\U0010fffe"


@lru_cache(maxsize=256)
def font_for(words: str, size: float) -> Any:
    """The font to draw some words in, `size` pixels high: the first one that has all letters of them.

    Warns
    -----
    PieperWarning
        None has; the letters that are missing become boxes.
    """
    from PIL import ImageFont

    usual: Any = ImageFont.load_default(size)
    letters = {letter for letter in words if not letter.isspace()}
    missing = _missing(usual, letters)
    if not missing:
        return usual
    for name in FALLBACKS:
        try:
            font = ImageFont.truetype(name, size)
        except OSError:
            continue
        if not _missing(font, letters):
            return font
    warnings.warn(
        f"no font found here has the letters {' '.join(sorted(missing))} of {words!r}, and they are drawn as boxes; install one that has, "
        "such as Debian's package fonts-noto-cjk, or take other names",
        PieperWarning,
        stacklevel=2,
    )
    return usual


def _missing(font: Any, letters: set[str]) -> set[str]:
    """The letters for which a font has no more than the box of what it does not have."""
    box = _drawn(font, _IN_NO_FONT)
    return {letter for letter in letters if _drawn(font, letter) == box}


def _drawn(font: Any, letter: str) -> tuple[Any, bytes]:
    mask = font.getmask(letter)
    return mask.size, bytes(mask)
