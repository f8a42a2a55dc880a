"""The figure of two models side by side, and of their difference while each joint sweeps its range."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pieper.errors import ArrayError
from pieper.ik.solve import solve
from pieper.kinematics.fk import fk_frames
from pieper.kinematics.joints import as_joints, without_turns
from pieper.spatial import rotation
from pieper.viewer.compare import Comparison
from pieper.viewer.figure_joints import sliding_joints
from pieper.viewer.figure_look import (
    DASHES,
    PAGE,
    SMALL,
    TEXT,
    Colors,
    Theme,
    dress,
    dress_3d,
    legend_below,
    new_figure,
)
from pieper.viewer.stance import stance

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from pieper.arm import Arm
    from pieper.spatial._checks import FloatArray

Question = Literal["fk", "ik"]
_DECADES = 30.0  # greatest over median difference from which an axis is logarithmic
_ROUNDING = 1e-9  # [mm, mrad] differences below are rounding


def compare(
    arm: Arm,
    other: Arm,
    *,
    question: Question = "fk",
    q: ArrayLike | None = None,
    samples: int = 121,
    signs: Sequence[float] | None = None,
    turn_tip: bool = True,
    degrees: bool = False,
    title: str = "",
    theme: Theme = "light",
) -> Figure:
    """Two models of an arm side by side, and their difference while each joint sweeps its range.

    Above, both arms with the frame of the tip, and its pose or the joint values in numbers. Below, over the value of the joint
    that moves:

    - ``"fk"``: distance [mm] and angle [mrad] between the tips at the same joint values;
    - ``"ik"``: both bring the tip to where the first has it. How far the other misses when it is given the answer of the
      first [mm], and the largest difference of a joint between the two answers [mrad]. Its answer is the one nearest to that
      of the first, within limits or not.

    Parameters
    ----------
    arm, other : Arm
        Both in the same base frame. Which joint is which, the signs and the tip frames: see `pieper.viewer.compare`.
    question : "fk" or "ik"
    q : (n,) array, optional
        Joint values of the first; one joint at a time leaves them [rad or m]. Default: `pieper.viewer.stance.stance`.
    samples : int
        Number of values per joint, 2 or more.
    signs, turn_tip
        See `pieper.viewer.compare.Comparison`.
    degrees : bool
        Values of joints that turn are given in degrees along the axes.
    title : str
    theme : "light" or "dark"

    Returns
    -------
    Figure

    Raises
    ------
    ArrayError
        A wrong shape, a number that is not finite, joints that do not belong together, or an unknown question.
    MissingExtraError
        Matplotlib is not installed.
    """
    if question not in ("fk", "ik"):
        raise ArrayError(f"question must be 'fk' or 'ik', got {question!r}")
    if samples < 2:
        raise ArrayError(f"samples must be at least 2, got {samples!r}")
    both = Comparison(arm, other, signs=signs, turn_tip=turn_tip)
    here = stance(arm.chain) if q is None else as_joints(arm.chain, q)
    if here.ndim != 1:
        raise ArrayError(f"q must have shape ({arm.dof},), got {here.shape}")
    here = both.common(here)
    there = _other_answers(both, here[None])[0] if question == "ik" else both.as_other(here)
    colors, figure = new_figure(theme, PAGE, 6.3, title)
    rows = figure.add_gridspec(2, 2, height_ratios=[1.35, 1.0])
    _side_by_side(figure, rows, colors, both, here, there, question=question, degrees=degrees)
    panels = [figure.add_subplot(rows[1, 0]), figure.add_subplot(rows[1, 1])]
    unreached, swept = _draw_sweeps(panels, colors, both, here, question=question, samples=samples, degrees=degrees)
    panels[0].set_ylabel("distance of the tips [mm]" if question == "fk" else "miss of the other tip [mm]")
    panels[1].set_ylabel(
        "angle between the tips [mrad]" if question == "fk" else f"largest joint difference [{_thousandth(other)}]"
    )
    for axes in panels:
        _scale_differences(axes)
        dress(axes, colors)
    if unreached:
        said = f"out of reach of {other.name}: {unreached} of {samples * swept} poses"
        panels[1].set_title(said, fontsize=SMALL, color=colors.alarm)
    legend_below(figure, colors, panels[0], columns=min(swept, 4))
    return figure


def _draw_sweeps(
    panels: Sequence[Any],
    colors: Colors,
    both: Comparison,
    here: FloatArray,
    *,
    question: Question,
    samples: int,
    degrees: bool,
) -> tuple[int, int]:
    """Draw the differences over each joint that both arms have, the others at `here`; how many poses the other misses, and of how many joints."""
    slides = sliding_joints(both.arm)
    moving = [pair.joint for pair in both.pairs if pair.joint is not None and pair.other is not None]
    unreached = 0
    for place, i in enumerate(moving):
        values = np.linspace(both.limits[i, 0], both.limits[i, 1], samples)
        sweep = np.repeat(here[None], samples, axis=0)
        sweep[:, i] = values
        found = both.difference(sweep)
        ordinates = [1e3 * found.distance, 1e3 * found.angle]
        if question == "ik":
            answers = _other_answers(both, sweep)
            ordinates[1] = 1e3 * np.abs(_least_turn(both.other, answers - both.as_other(sweep))).max(axis=1)
            unreached += int(np.isnan(ordinates[1]).sum())
        scale = np.degrees(1.0) if degrees and not slides[i] else 1.0
        for axes, ordinate in zip(panels, ordinates, strict=True):
            axes.plot(values * scale, ordinate, lw=1.3, color=colors.series[place % len(colors.series)],
                      ls=DASHES[place % len(DASHES)], label=both.arm.joint_names[i])  # fmt: skip
    kinds = {"m" if slides[i] else "deg" if degrees else "rad" for i in moving}
    for axes in panels:
        axes.set_xlabel(f"joint value [{' or '.join(sorted(kinds, reverse=True))}]")
    return unreached, len(moving)


def _side_by_side(
    figure: Figure,
    rows: Any,
    colors: Colors,
    both: Comparison,
    here: FloatArray,
    there: FloatArray,
    *,
    question: Question,
    degrees: bool,
) -> None:
    """Both arms as lines between their frames, in boxes of the same size, with the same words of each above it."""
    drawn: list[tuple[Arm, FloatArray, FloatArray]] = []
    for model, values, R_tip in ((both.arm, here, np.eye(3)), (both.other, there, both.R_tip_other)):
        Ts = fk_frames(model.chain, values) if np.isfinite(values).all() else np.empty((0, 4, 4))
        Ts[-1:, :3, :3] = Ts[-1:, :3, :3] @ R_tip
        drawn.append((model, values, Ts))
    shown = np.vstack([Ts[:, :3, 3] for _, _, Ts in drawn])
    for column, (model, values, Ts) in enumerate(drawn):
        axes: Any = figure.add_subplot(rows[0, column], projection="3d", computed_zorder=False)
        _skeleton(axes, colors, Ts, shown)
        numbers = _joint_text(model, values, degrees) if question == "ik" else _pose_text(Ts[-1])
        axes.set_title(f"{model.name}\n{numbers}", fontsize=SMALL, color=colors.ink, linespacing=1.4, y=0.9)


def _other_answers(both: Comparison, q: FloatArray) -> FloatArray:
    """(m, n2) answers of the other model for the poses that the first takes at `q`, the nearest to the same values; NaN: none.

    Inside the limits or not, so that a joint at its limit does not change the branch.
    """
    near = both.as_other(q)
    T = both.arm.fk(q)
    T[:, :3, :3] = T[:, :3, :3] @ both.R_tip_other.T
    answers = solve(both.other.chain, T, seed=near)
    turned = _least_turn(both.other, answers.q - near[:, None])
    distance = np.where(answers.valid, np.linalg.norm(turned, axis=-1), np.inf)
    best = np.argmin(distance, axis=-1)[:, None]
    taken = near + np.take_along_axis(turned, best[..., None], axis=1)[:, 0]
    return np.where(np.isfinite(np.take_along_axis(distance, best, axis=1)), taken, np.nan)


def _least_turn(arm: Arm, change: FloatArray) -> FloatArray:
    """Changes of joint values, without whole turns."""
    return without_turns(~sliding_joints(arm), change)


def _thousandth(arm: Arm) -> str:
    """The unit of a thousandth of a joint value."""
    slides = sliding_joints(arm)
    return "mm" if slides.all() else "mrad or mm" if slides.any() else "mrad"


def _scale_differences(axes: Any) -> None:
    """From zero, or logarithmic where the least and the greatest are far apart, as they are beside singular poses."""
    drawn = np.concatenate([line.get_ydata() for line in axes.lines])
    positive = drawn[np.isfinite(drawn) & (drawn > 0.0)]
    if len(positive) and positive.max() > _DECADES * np.median(positive) and positive.min() > _ROUNDING:
        axes.set_yscale("log")
    else:
        greatest = float(positive.max(initial=0.0))
        axes.set_ylim(0.0, 1.12 * greatest if greatest > _ROUNDING else 1.0)


def _skeleton(axes: Any, colors: Colors, Ts: FloatArray, shown: FloatArray) -> None:
    """An arm as lines between its frames `Ts` (k, 4, 4), with the axes of the last one; empty for an arm that cannot be there."""
    dress_3d(axes, colors, np.vstack([shown, np.zeros((1, 3))]), -60.0, zoom=0.84)
    if not len(Ts):
        axes.text2D(0.5, 0.5, "out of reach", transform=axes.transAxes, ha="center", color=colors.alarm, fontsize=TEXT)
        return
    points = Ts[:, :3, 3]
    axes.plot(*points.T, color=colors.series[0], lw=3.2, solid_capstyle="round", solid_joinstyle="round", zorder=3)
    axes.plot(*points.T, ls="none", marker="o", ms=4, mfc=colors.paper, mec=colors.series[0], mew=1.1, zorder=4)
    length = 0.16 * float(np.ptp(shown, axis=0).max())
    for name, axis, color in zip("xyz", Ts[-1, :3, :3].T, colors.triad, strict=True):
        end = points[-1] + length * axis
        axes.plot(*np.array([points[-1], end]).T, color=color, lw=1.8, zorder=6)
        axes.text(
            *(points[-1] + 1.35 * length * axis),
            name,
            color=color,
            fontsize=SMALL,
            ha="center",
            va="center",
            zorder=7,
        )


def _pose_text(T: FloatArray) -> str:
    x, y, z = T[:3, 3] + 0.0
    quaternion = rotation.as_quaternion(T[:3, :3])
    return f"x={x:.6f}  y={y:.6f}  z={z:.6f} m\nq=({', '.join(f'{value:.6f}' for value in quaternion)})"


def _joint_text(arm: Arm, q: FloatArray, degrees: bool) -> str:
    if not np.isfinite(q).all():
        return "no answer"
    scale = np.where(sliding_joints(arm), 1.0, np.degrees(1.0) if degrees else 1.0)
    unit = "" if sliding_joints(arm).any() else (" deg" if degrees else " rad")
    listed = ", ".join(f"{value:.3f}" if degrees else f"{value:.4f}" for value in q * scale + 0.0)
    return f"({listed}){unit}"
