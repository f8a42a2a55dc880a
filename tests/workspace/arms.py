"""Arms whose workspace is known on paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pieper.model.chain import Chain

TURN = np.pi


def planar(*lengths: float, limits: Sequence[Sequence[float]] | None = None) -> Chain:
    """Links in the plane z = 0, every joint free to turn once round."""
    home = np.eye(4)
    home[0, 3] = sum(lengths)
    places = np.cumsum([0.0, *lengths[:-1]])
    screws = [[0.0, -x, 0.0, 0.0, 0.0, 1.0] for x in places]
    names = tuple(f"joint_{i + 1}" for i in range(len(lengths)))
    return Chain("planar", screws, home, limits or [[-TURN, TURN]] * len(lengths), names)


def elbow_arm(upper: float, fore: float, tool: float) -> Chain:
    """An arm without offsets: axes 1 and 2 meet at the origin, a spherical wrist at the end, the tip `tool` beyond its centre.

    Every joint turns once round, so that the wrist centre reaches all between the difference and the sum of the two lengths.
    """
    axes = [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((upper, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((upper + fore, 0.0, 0.0), (1.0, 0.0, 0.0)),
        ((upper + fore, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((upper + fore, 0.0, 0.0), (1.0, 0.0, 0.0)),
    ]
    screws = [[*np.cross(point, axis), *axis] for point, axis in axes]
    home = np.eye(4)
    home[0, 3] = upper + fore + tool
    names = tuple(f"joint_{i + 1}" for i in range(6))
    return Chain("elbow", screws, home, [[-TURN, TURN]] * 6, names)


def scara(upper: float, fore: float) -> Chain:
    """Two joints and a turn about vertical axes, and a vertical slide of 0.2 m."""
    home = np.eye(4)
    home[0, 3] = upper + fore
    screws = [
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        [0.0, -upper, 0.0, 0.0, 0.0, 1.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, -(upper + fore), 0.0, 0.0, 0.0, 1.0],
    ]
    limits = [[-TURN, TURN], [-TURN, TURN], [0.0, 0.2], [-TURN, TURN]]
    return Chain("scara", screws, home, limits, ("joint_1", "joint_2", "slide", "joint_4"))
