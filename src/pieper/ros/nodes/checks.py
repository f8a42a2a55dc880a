"""What the parameters of nodes may be: checks that are handed to `pieper.ros.bus.Bus.parameter`, which names the parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def between(least: float, most: float) -> Callable[[float], None]:
    """A number within bounds.

    >>> between(1, 10)(11)
    Traceback (most recent call last):
        ...
    ValueError: must be from 1 to 10, got 11
    """

    def check(value: float) -> None:
        if not least <= value <= most:
            raise ValueError(f"must be from {least:g} to {most:g}, got {value!r}")

    return check


def one_of(*words: str) -> Callable[[str], None]:
    """One of some words."""

    def check(value: str) -> None:
        if value not in words:
            raise ValueError(f"must be one of {', '.join(words)}, got {value!r}")

    return check


def seconds(value: float) -> None:
    """Some time [s], or none."""
    if not 0.0 <= value < float("inf"):
        raise ValueError(f"seconds must be at least 0 and finite, got {value!r}")
