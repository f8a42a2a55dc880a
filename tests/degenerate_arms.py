"""Arms that no one would build: axes that coincide, are parallel, have no length between them, or nearly so."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pieper.model.chain import Chain
from pieper.spatial import rotation

NEARLY = (1e-3, 1e-6, 1e-9, 1e-12)


def degenerate_arm(choose: Callable[[int], int], number: Callable[[], float], joints: int, *, slides: bool) -> Chain:
    """A chain of `joints` axes. `choose(k)` gives a whole number below k, `number()` one from -1 to 1."""
    directions: list[np.ndarray] = []
    points: list[np.ndarray] = []
    for i in range(joints):
        kind = choose(5)
        if kind == 0 and i:  # parallel or anti-parallel to one before
            w = directions[choose(i)] * (1.0 if choose(2) else -1.0)
        elif kind == 1 and i:  # nearly parallel
            w = directions[i - 1] + NEARLY[choose(4)] * np.array([number(), number(), number()])
        elif kind == 2:
            w = np.array([number(), number(), number()]) + np.array([0.0, 0.0, 1e-3])
        else:
            w = np.eye(3)[choose(3)]
        directions.append(w / np.linalg.norm(w))
        kind = choose(5)
        if kind == 0 and i:  # the same point
            p = points[choose(i)].copy()
        elif kind == 1 and i:  # somewhere along the axis before
            p = points[i - 1] + number() * directions[i - 1]
        elif kind == 2 and i:  # nearly the same point
            p = points[i - 1] + NEARLY[choose(4)] * np.array([number(), number(), number()])
        else:
            p = np.array([number(), number(), number()])
        points.append(p)
    w, p = np.array(directions), np.array(points)
    screws = np.hstack([np.cross(p, w), w])
    if slides:
        for i in range(joints):
            if choose(4) == 0:
                screws[i] = [*w[i], 0.0, 0.0, 0.0]
    home = np.eye(4)
    if choose(2):
        home[:3, :3] = rotation.from_rotation_vector([number(), number(), number()])
    home[:3, 3] = [number(), number(), number()] if choose(3) else p[-1]
    names = tuple(f"joint_{i + 1}" for i in range(joints))
    return Chain("degenerate", screws, home, [[-np.pi, np.pi]] * joints, names)
