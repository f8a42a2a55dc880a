"""The figure of manipulability, and of the distance to a singularity, along a path."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError
from pieper.kinematics.manipulability import distance_to_singularity
from pieper.kinematics.manipulability import manipulability as _manipulability
from pieper.viewer.figure_joints import joint_curves, sliding_joints
from pieper.viewer.figure_look import COLUMN, DASHES, Theme, dress, legend, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from pieper.arm import Arm
    from pieper.motion.trajectory import Trajectory


def manipulability(
    arm: Arm,
    q: Trajectory | ArrayLike | Mapping[str, Trajectory | ArrayLike],
    *,
    title: str = "",
    theme: Theme = "light",
) -> Figure:
    """Yoshikawa's manipulability along a path, and the distance to the nearest singularity; the least is marked.

    Parameters
    ----------
    arm : Arm
    q : Trajectory, (m, n) array, or a mapping of labels to such
        Joint values along the path [rad or m]; a trajectory is drawn over time, an array over the number of the row.
    title : str
    theme : "light" or "dark"

    Returns
    -------
    Figure

    Raises
    ------
    ArrayError, UnknownNameError
        No rows, a wrong shape, a number that is not finite, or columns that are not the joints of the arm.
    MissingExtraError
        Matplotlib is not installed.

    Notes
    -----
    See `pieper.kinematics.manipulability` for both measures. One metre counts as one radian.
    """
    named = q if isinstance(q, Mapping) else {arm.name: q}
    if not named:
        raise ArrayError("q must hold at least one path, got an empty mapping")
    curves = {str(label): joint_curves(arm, given) for label, given in named.items()}
    timed = {c.dq is not None for c in curves.values()}
    if len(timed) > 1:
        raise ArrayError(
            "q must hold trajectories or arrays, got both: one runs over time, the other over the number of the row"
        )
    colors, figure = new_figure(theme, COLUMN, 4.6, title)
    panels = figure.subplots(2, 1, sharex=True)
    for i, (label, given) in enumerate(curves.items()):
        J = arm.jacobian(given.q)
        for axes, measure in zip(panels, (_manipulability(J), distance_to_singularity(J)), strict=True):
            color = colors.series[i % len(colors.series)]
            least = int(np.argmin(measure))
            where = f"{given.t[least]:.3g} s" if given.dq is not None else f"step {given.t[least]:g}"
            axes.plot(given.t, measure, color=color, ls=DASHES[i % len(DASHES)], lw=1.4, zorder=3, label=label)
            axes.plot(given.t[least], measure[least], ls="none", marker="v", ms=6, color=color, mec=colors.paper, zorder=4,
                      label=f"least {measure[least]:.3g} at {where}")  # fmt: skip
    unit = "m$^3$" if arm.dof >= 6 and not sliding_joints(arm).any() else "mixed units"
    panels[0].set_ylabel(f"manipulability $w$ [{unit}]")
    panels[1].set_ylabel(r"least singular value $\sigma$ [-]")
    panels[1].set_xlabel("time $t$ [s]" if timed == {True} else "iteration")
    for axes in panels:
        axes.set_ylim(bottom=0.0, top=axes.get_ylim()[1] * 1.05)
        dress(axes, colors)
        legend(axes, colors, loc="best")
    return figure
