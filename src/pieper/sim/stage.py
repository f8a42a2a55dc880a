"""What a picture shows, as data: arms with their motions and surfaces, frames, lines, and from where one looks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pieper.errors import ArrayError
from pieper.kinematics.fk import fk_frames

if TYPE_CHECKING:
    from pieper.model.chain import Chain
    from pieper.model.shape import Triangles
    from pieper.motion.trajectory import Trajectory

FloatArray = NDArray[np.float64]

VIEWS = {
    "corner": (-50.0, 18.0),
    "front": (0.0, 8.0),
    "back": (180.0, 8.0),
    "left": (90.0, 8.0),
    "right": (-90.0, 8.0),
    "top": (-90.0, 89.0),
}
"""Where one looks from: degrees about the vertical, from the x axis of the base, and degrees above the horizon."""

ARM_COLORS = ("#f28c28", "#2f7fd1", "#3aa655", "#b5485d", "#8a63c7", "#c9a227")
"""Colours of the first arm, the second, ..."""

AXIS_COLORS = ("#e5322d", "#2fa84f", "#2b6be4")
"""x, y and z of a frame."""


class Theme(NamedTuple):
    """Colours of what is not the arm."""

    background: str
    floor: str
    lines: str
    metal: str
    text: str
    halo: str


THEMES = {
    "light": Theme("#f5f6f8", "#eceef1", "#cfd4da", "#41464d", "#1b1f24", "#ffffff"),
    "dark": Theme("#15181d", "#1d2127", "#363d47", "#8b949e", "#f0f3f6", "#15181d"),
}


@dataclass(frozen=True, eq=False)
class ShownArm:
    """An arm in a picture, and how it is shown."""

    chain: Chain
    motion: Trajectory
    color: str
    opacity: float
    frames: tuple[str | int, ...]
    axes: bool
    trace: bool
    labels: bool
    bodies: tuple[Body, ...]

    def joints(self, t: float) -> FloatArray:
        """(n,) joint values at a time [s] from the beginning of the motion."""
        return self.motion.sample(self.motion.t[0] + t).q


class Body(NamedTuple):
    """A surface in the frame ``chain.frame(link)`` [m], and its colour."""

    link: int
    color: str
    mesh: Triangles


class ShownFrame(NamedTuple):
    """A frame in a picture: its `label` and where it is, `T_base_frame` (4, 4)."""

    label: str
    T_base_frame: FloatArray


@dataclass(frozen=True, eq=False)
class ShownLine:
    """A line in a picture: `points` (k, 3) in the base frame [m]."""

    points: FloatArray
    color: str


@dataclass(eq=False)
class Stage:
    """Everything that a picture shows.

    Attributes
    ----------
    size : (int, int)
        Pixels.
    theme : Theme
    view : (float, float)
        Azimuth and elevation of the eye [rad].
    grid, smooth : bool
        Whether there is a floor, and whether edges are smoothed.
    arms : list of ShownArm
    still_frames : list of ShownFrame
        Those that belong to no arm.
    lines : list of ShownLine
    """

    size: tuple[int, int]
    theme: Theme
    view: tuple[float, float]
    grid: bool
    smooth: bool
    arms: list[ShownArm] = field(default_factory=list)
    still_frames: list[ShownFrame] = field(default_factory=list)
    lines: list[ShownLine] = field(default_factory=list)

    def frames(self, t: float) -> list[ShownFrame]:
        """Every frame with its label, at a time [s] of the motions."""
        found = list(self.still_frames)
        for arm in self.arms:
            Ts = fk_frames(arm.chain, arm.joints(t), frames=arm.frames)
            found += [ShownFrame(str(name) if arm.labels else "", T) for name, T in zip(arm.frames, Ts, strict=True)]
        return found


def rgb(color: str) -> FloatArray:
    """Red, green and blue from 0 to 1 of a colour ``"#rrggbb"``.

    >>> rgb("#ff8000").round(2)
    array([1. , 0.5, 0. ])
    """
    digits = str(color).removeprefix("#")
    try:
        if len(digits) != 6:
            raise ValueError
        return np.array([int(digits[k : k + 2], 16) for k in (0, 2, 4)]) / 255.0
    except ValueError:
        raise ArrayError(f"a colour must be written #rrggbb, got {color!r}") from None


def mixed(color: str, other: str, amount: float) -> str:
    """A colour between two: the first with `amount` 0, the other with 1."""
    mix = (1.0 - amount) * rgb(color) + amount * rgb(other)
    return "#" + "".join(f"{round(255 * part):02x}" for part in mix)
