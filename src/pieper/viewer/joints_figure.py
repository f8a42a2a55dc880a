"""The figure of joint values and velocities over time, against their limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.spatial._checks import FloatArray, stack
from pieper.viewer.figure_joints import joint_curves, sliding_joints
from pieper.viewer.figure_look import COLUMN, PAGE, SMALL, TEXT, Colors, Theme, dot_size, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from pieper.arm import Arm
    from pieper.motion.trajectory import Trajectory


def joints(
    arm: Arm,
    q: Trajectory | ArrayLike,
    *,
    max_velocity: ArrayLike | None = None,
    degrees: bool = False,
    title: str = "",
    theme: Theme = "light",
) -> Figure:
    """Joint values, and for a trajectory their velocities, over time; what the limits forbid is shaded.

    Parameters
    ----------
    arm : Arm
    q : Trajectory, or (m, n) array
        A trajectory is drawn as it runs between its points. An array is drawn over the number of the row, as the steps of an
        iteration are, without velocities [rad or m].
    max_velocity : float or (n,) array, optional
        Velocity limits where the description gives none, or lower ones [rad/s or m/s].
    degrees : bool
        Joints that turn are drawn in degrees.
    title : str
    theme : "light" or "dark"

    Returns
    -------
    Figure
        A row of axes for each joint: its value, and beside it its velocity.

    Raises
    ------
    ArrayError, UnknownNameError
        No rows, a wrong shape, a number that is not finite, or columns that are not the joints of the arm.
    MissingExtraError
        Matplotlib is not installed.
    """
    given = joint_curves(arm, q)
    slides = sliding_joints(arm)
    scale = np.where(slides, 1.0, np.degrees(1.0) if degrees else 1.0)
    fastest = np.minimum(arm.chain.max_velocity, np.inf if max_velocity is None else _speeds(arm, max_velocity))
    columns = 1 if given.dq is None else 2
    colors, figure = new_figure(theme, PAGE if columns == 2 else COLUMN, 1.05 * arm.dof + 0.95, title)
    grid = figure.subplots(arm.dof, columns, sharex=True, squeeze=False)
    outside = False
    for i, name in enumerate(arm.joint_names):
        unit = "m" if slides[i] else ("deg" if degrees else "rad")
        lower, upper = arm.limits[i] * scale[i]
        outside |= _limited(grid[i, 0], colors, given.t, given.q[:, i] * scale[i], lower, upper)
        grid[i, 0].plot(given.t_points, given.q_points[:, i] * scale[i], ls="none", marker=".", ms=dot_size(given.t_points),
                        color=colors.series[0], zorder=4, label="points")  # fmt: skip
        grid[i, 0].set_title(name, loc="left", fontsize=TEXT, color=colors.ink, pad=3)
        grid[i, 0].set_ylabel(f"$q_{{{i + 1}}}$ [{unit}]")
        if given.dq is not None:
            speed = float(fastest[i] * scale[i])
            outside |= _limited(grid[i, 1], colors, given.t, given.dq[:, i] * scale[i], -speed, speed)
            grid[i, 1].set_ylabel(rf"$\dot q_{{{i + 1}}}$ [{unit}/s]")
    for axes in grid.flat:
        dress(axes, colors)
        axes.set_xlim(given.t[0], given.t[-1] if given.t[-1] > given.t[0] else given.t[0] + 1.0)
    for axes in grid[-1]:
        axes.set_xlabel("iteration" if given.dq is None else "time $t$ [s]")
    figure.align_ylabels(grid)
    _limit_legend(figure, colors, outside=outside)
    return figure


def _speeds(arm: Arm, value: ArrayLike) -> FloatArray:
    speeds = np.broadcast_to(stack(value, (), "max_velocity"), (arm.dof,))
    if (speeds <= 0.0).any():
        raise ArrayError(f"max_velocity must be above 0, got {np.asarray(value).tolist()}")
    return speeds


def _limited(axes: Any, colors: Colors, t: FloatArray, value: FloatArray, lower: float, upper: float) -> bool:
    """Draw a value with its limits, and what is beyond them; True where the value is beyond."""
    axes.plot(t, value, color=colors.series[0], lw=1.3, zorder=3, label="value")
    finite = [limit for limit in (lower, upper) if np.isfinite(limit)]
    least, most = min([float(value.min()), *finite]), max([float(value.max()), *finite])
    margin = 0.08 * (most - least) or 0.1
    least, most = least - margin, most + margin
    for limit, edge in ((lower, least), (upper, most)):
        if np.isfinite(limit):
            axes.axhspan(limit, edge, color=colors.beyond, lw=0.0, zorder=0)
            axes.axhline(limit, color=colors.alarm, lw=0.8, zorder=1)
    axes.set_ylim(least, most)
    rounding = 1e-9 * max(1.0, abs(lower) if np.isfinite(lower) else 0.0, abs(upper) if np.isfinite(upper) else 0.0)
    beyond = (value < lower - rounding) | (value > upper + rounding)
    if beyond.any():
        axes.plot(t, np.where(beyond, value, np.nan), color=colors.alarm, lw=2.6, zorder=5, label="beyond a limit",
                  marker=".", ms=2.6)  # fmt: skip
    return bool(beyond.any())


def _limit_legend(figure: Figure, colors: Colors, *, outside: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], color=colors.series[0], lw=1.3, marker=".", ms=5, label="value, points given"),
        Patch(facecolor=colors.beyond, edgecolor=colors.alarm, lw=0.8, label="beyond the limits"),
    ]
    if outside:
        handles.append(Line2D([], [], color=colors.alarm, lw=2.6, label="value beyond a limit"))
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles),
        fontsize=SMALL,
        frameon=False,
        labelcolor=colors.ink,
    )
