"""The figure of a path of the tip, and how far it strays from a straight line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.spatial._checks import FloatArray, stack
from pieper.viewer.figure_look import COLUMN, ELEVATION, Theme, dress_3d, in_metres, legend_below, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class StraightLine:
    """How far a path strays from the straight line between its ends.

    Attributes
    ----------
    ends : (2, 3) array
        Where the line begins and ends [m].
    distance : (m,) array
        Distance of each point of the path from the line [m].
    foot : (m, 3) array
        The points of the line, which goes on beyond its ends, nearest to those of the path [m].
    """

    ends: FloatArray
    distance: FloatArray
    foot: FloatArray

    @property
    def farthest(self) -> int:
        """Number of the point that is farthest from the line."""
        return int(np.argmax(self.distance))

    @property
    def largest(self) -> float:
        """Largest distance of the points [m]."""
        return float(self.distance.max())


def straight_line(points: ArrayLike, target: ArrayLike | None = None) -> StraightLine:
    """How far a path strays from the straight line from its first point to `target`, or to its last one.

    Parameters
    ----------
    points : (m, 3) array
        Positions in one frame [m].
    target : (3,) array, optional
        Where the line ends [m].

    Returns
    -------
    StraightLine
        Where both ends are the same point, the distances from that point.

    Raises
    ------
    ArrayError
        No points, a wrong shape, or a number that is not finite.

    Examples
    --------
    >>> straight_line([[0.0, 0.0, 0.0], [1.0, 0.2, 0.0], [2.0, 0.0, 0.0]]).largest
    0.2
    """
    path = _positions(points, "points")
    end = path[-1] if target is None else _target(target)
    along = end - path[0]
    length = float(np.linalg.norm(along))
    direction = along / length if length > 0.0 else np.zeros(3)
    foot = path[0] + np.outer((path - path[0]) @ direction, direction)
    return StraightLine(np.array([path[0], end]), np.asarray(np.linalg.norm(path - foot, axis=1)), foot)


def path(
    points: ArrayLike | Mapping[str, ArrayLike],
    *,
    target: ArrayLike | None = None,
    straight: bool = True,
    title: str = "",
    theme: Theme = "light",
) -> Figure:
    """The path of the tip in three dimensions, and how far it strays from a straight line.

    Parameters
    ----------
    points : (m, 3) or (m, 4, 4) array, or a mapping of labels to such arrays
        Positions or poses of the tip in the base frame [m], for example ``arm.fk(trajectory.q)``. One alone is labelled
        "TCP trajectory".
    target : (3,) array, optional
        Where the path should lead [m]; drawn, and the end of the straight line.
    straight : bool
        Draw the straight line and the largest distance from it.
    title : str
    theme : "light" or "dark"

    Returns
    -------
    Figure

    Raises
    ------
    ArrayError
        No points, a wrong shape, or a number that is not finite.
    MissingExtraError
        Matplotlib is not installed.
    """
    named = points if isinstance(points, Mapping) else {"TCP trajectory": points}
    if not named:
        raise ArrayError("points must hold at least one path, got an empty mapping")
    paths = {str(label): _positions(given, f"points of {label!r}") for label, given in named.items()}
    goal = None if target is None else _target(target)
    lines = {label: straight_line(given, goal) for label, given in paths.items()}
    colors, figure = new_figure(theme, COLUMN, 4.7, title)
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    drawn: list[FloatArray] = []
    for i, (label, given) in enumerate(paths.items()):
        color = colors.series[i % len(colors.series)]
        line = lines[label]
        if straight and len(given) > 1:
            if not any(np.allclose(line.ends, other, rtol=0.0, atol=1e-9) for other in drawn):
                drawn.append(line.ends)
                axes.plot(*line.ends.T, color=colors.faint, lw=1.1, ls=(0, (5, 2.5)), zorder=2,
                          label="straight line" if len(drawn) == 1 else "_")  # fmt: skip
            worst, mark = line.farthest, colors.alarm if len(paths) == 1 else color
            said = f"largest distance from it: {in_metres(line.largest)}"
            axes.plot(*np.array([given[worst], line.foot[worst]]).T, color=mark, lw=1.5, zorder=3,
                      label=said if len(paths) == 1 else f"{label}: {in_metres(line.largest)} from it at most")  # fmt: skip
        axes.plot(*given.T, ls="-", marker=".", ms=4.5, lw=1.2, color=color, zorder=4, label=label)
        axes.plot(*given[:1].T, ls="none", marker="o", ms=6, mfc=colors.paper, mec=color, mew=1.3, zorder=5,
                  label="start" if i == 0 else "_")  # fmt: skip
    if goal is not None:
        axes.plot(*goal[:, None], ls="none", marker="*", ms=11, color=colors.ink, mec=colors.paper, mew=0.6, zorder=6,
                  label="target")  # fmt: skip
    everything = np.vstack([*paths.values(), *([] if goal is None else [goal[None]])])
    worst_label = max(lines, key=lambda label: lines[label].largest)
    dress_3d(axes, colors, everything, _azimuth(paths[worst_label], lines[worst_label]))
    legend_below(figure, colors, axes, columns=2, first=[*paths, "start", "target", "straight line"])
    return figure


def _positions(value: ArrayLike, name: str) -> FloatArray:
    """(m, 3) positions, of points or of poses."""
    given = np.asarray(value)
    if given.ndim == 3:
        given = stack(given, (4, 4), name)[:, :3, 3]
    points = stack(given, (3,), name)
    if points.ndim != 2 or not len(points):
        raise ArrayError(f"{name} must have shape (m, 3) or (m, 4, 4) with at least one row, got {np.shape(value)}")
    return points


def _target(value: ArrayLike) -> FloatArray:
    target = stack(value, (3,), "target")
    if target.ndim != 1:
        raise ArrayError(f"target must have shape (3,), got {target.shape}")
    return target


def _azimuth(points: FloatArray, line: StraightLine) -> float:
    """The direction to look from [deg], not far from the usual one, in which the farthest point stands clear of the line."""
    along, across = line.ends[1] - line.ends[0], points[line.farthest] - line.foot[line.farthest]
    views = np.arange(-70.0, -29.0, 5.0)
    seen = []
    for view in np.radians(views):
        right = np.array([-np.sin(view), np.cos(view), 0.0])
        up = np.cross([np.cos(view) * np.cos(ELEVATION), np.sin(view) * np.cos(ELEVATION), np.sin(ELEVATION)], right)
        seen.append(abs(float((right @ along) * (up @ across) - (up @ along) * (right @ across))))
    return float(views[int(np.argmax(seen))])
