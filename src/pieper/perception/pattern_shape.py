"""Shapes: places of markers, and the patterns that have their markers there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from pieper.perception.pattern import Pattern
    from pieper.spatial._checks import FloatArray


@dataclass(frozen=True, eq=False)
class Shape:
    """Places of markers, and the patterns that have their markers there."""

    places: NDArray[np.complex128]
    heights: tuple[float, ...]
    level: NDArray[np.int64]
    """Which of the heights each place has."""
    radii: FloatArray
    patterns: tuple[Pattern, ...]

    @cached_property
    def least(self) -> int:
        """Markers without which a robot is not believed."""
        n = len(self.places)
        return max(2, -(-3 * n // 5))

    @cached_property
    def gate(self) -> float:
        """How far from its place a marker may be [m]: less than half of the way to the next."""
        apart = np.abs(self.places[:, None] - self.places[None]) + np.where(np.eye(len(self.places)), np.inf, 0.0)
        return float(0.2 * apart.min())

    @cached_property
    def reach(self) -> float:
        """Greatest distance between two places [m]."""
        return float(np.abs(self.places[:, None] - self.places[None]).max())

    @cached_property
    def span(self) -> float:
        """Greatest distance of a place from their middle [m]: two robots are never nearer to each other."""
        return float(np.abs(self.places - self.places.mean()).max())

    @cached_property
    def anchors(self) -> NDArray[np.int64]:
        """Pairs of places to start from, ``(q, 2)``: enough to meet every robot that has `least` markers, the telling ones kept."""
        n = len(self.places)
        pairs = list(combinations(range(n), 2))
        length = {pair: abs(self.places[pair[1]] - self.places[pair[0]]) for pair in pairs}
        alike = {p: sum(abs(length[p] - length[o]) < self.gate for o in pairs) for p in pairs}
        kept = set(pairs)
        for pair in sorted(pairs, key=lambda p: (-alike[p], length[p])):
            fewer = kept - {pair}
            if all(any(p in fewer for p in combinations(c, 2)) for c in combinations(range(n), min(self.least, n))):
                kept = fewer
        return np.array(sorted(kept), dtype=np.int64)

    def colors(self, names: tuple[str, ...]) -> NDArray[np.int64]:
        """Index of the colour of each marker of each pattern, ``(p, n)``."""
        index = {name: i for i, name in enumerate(names)}
        return np.array([[index.get(m.color, -2) for m in p.markers] for p in self.patterns], dtype=np.int64)


def shapes_of(robots: Sequence[Pattern], *, mirrored: bool) -> list[Shape]:
    """Sort patterns by where their markers are; in pixels, where y goes down, left and right change places."""
    groups: dict[Any, list[Pattern]] = {}
    for robot in robots:
        ordered = tuple(sorted(robot.markers, key=lambda m: (m.position, m.height, m.color)))
        key = tuple((m.position, m.height, m.radius) for m in ordered)
        groups.setdefault(key, []).append(replace(robot, markers=ordered))
    shapes = []
    for key, patterns in groups.items():
        places = np.array([x + 1j * y for (x, y), _, _ in key])
        heights = (0.0,) if mirrored else tuple(sorted({h for _, h, _ in key}))
        level = np.array([0 if mirrored else heights.index(h) for _, h, _ in key], dtype=np.int64)
        radii = np.array([r for _, _, r in key])
        shapes.append(Shape(places.conj() if mirrored else places, heights, level, radii, tuple(patterns)))
    return shapes
