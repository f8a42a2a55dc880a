"""``--size WxH``: pixels across and down."""

from __future__ import annotations

from pieper.errors import ArrayError


def pixels(text: str) -> tuple[int, int]:
    """Width and height of ``WxH``.

    Raises
    ------
    ArrayError
        It is something else.

    Examples
    --------
    >>> pixels("640x480")
    (640, 480)
    """
    words = text.lower().split("x")
    if len(words) != 2 or not all(word.strip().isdecimal() for word in words):
        raise ArrayError(f"--size must be width x height in pixels, such as 640x480, got {text!r}")
    return int(words[0]), int(words[1])
