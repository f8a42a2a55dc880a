"""Figures as papers print them: the path of the tip, joints against their limits, errors, manipulability, two models.

Every function returns a Matplotlib `Figure` that belongs to the caller. None of them opens a window, changes a global
setting of Matplotlib or touches pyplot, so that they work in any thread and beside any other figure. `save` writes one to
a file, `show` opens windows. Colours are those of Okabe and Ito, which stay apart for colour-blind readers, and lines that
share axes differ in their dashes as well. Needs the extra ``plot``.

>>> figure = path([[0.2, -0.3, 0.6], [0.3, -0.4, 0.5], [0.5, -0.6, 0.2]])
>>> figure.axes[0].get_xlabel()
'x [m]'
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from pieper.atomic_file import replacing
from pieper.errors import ArrayError, MissingExtraError, PieperError
from pieper.ik.iteration import Step
from pieper.ik.solve import solve
from pieper.kinematics.fk import fk_frames
from pieper.kinematics.joints import as_joints
from pieper.kinematics.manipulability import distance_to_singularity
from pieper.kinematics.manipulability import manipulability as _manipulability
from pieper.motion.trajectory import Trajectory
from pieper.spatial import rotation
from pieper.spatial._checks import FloatArray, stack
from pieper.viewer.compare import Comparison
from pieper.viewer.stance import stance

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray

    from pieper.arm import Arm

Theme = Literal["light", "dark"]
Question = Literal["fk", "ik"]

FORMATS = (".png", ".pdf", ".svg")
"""What `save` writes."""

_WITHOUT_WINDOWS = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")
_DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (9, 2)),
    (0, (3, 1, 1, 1, 1, 1)),
)
_SMALL, _TEXT, _HEAD = 7.5, 8.5, 9.5  # [pt] as in the captions, the text and the headings of a two-column paper
_COLUMN, _PAGE = 5.2, 7.2  # [inch] width of a figure beside text, and across a page
_MOST_MARKED = 200  # points of a line that still get a marker each
_PER_SEGMENT = 24  # samples between two points of a trajectory
_ELEVATION = np.radians(22.0)  # of the eye above a path
_DECADES = 30.0  # greatest over median difference from which an axis is logarithmic
_ROUNDING = 1e-9  # [mm, mrad] differences below are rounding
_FLAT = 0.4  # least side of the box of a path, relative to the longest: a straight path has a box too


class _Colours(NamedTuple):
    paper: str
    ink: str
    faint: str
    grid: str
    beyond: str  # what lies outside the limits
    alarm: str
    triad: tuple[str, str, str]  # axes x, y, z
    series: tuple[str, ...]


_THEMES = {
    "light": _Colours(
        "#ffffff", "#1f2328", "#8b949e", "#e4e7eb", "#f3dfd3", "#d55e00", ("#d55e00", "#009e73", "#0072b2"),
        ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#4d4d4d"),
    ),
    "dark": _Colours(
        "#15181d", "#e6e9ee", "#7d8590", "#2b3038", "#43302a", "#ff8a4c", ("#ff8a4c", "#2fc79a", "#56b4e9"),
        ("#56b4e9", "#e69f00", "#2fc79a", "#e79bc6", "#f0e442", "#ff8a4c", "#c8ccd2"),
    ),
}  # fmt: skip


# --- the path of the tip


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
    colours, figure = _new(theme, _COLUMN, 4.7, title)
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    drawn: list[FloatArray] = []
    for i, (label, given) in enumerate(paths.items()):
        colour = colours.series[i % len(colours.series)]
        line = lines[label]
        if straight and len(given) > 1:
            if not any(np.allclose(line.ends, other, rtol=0.0, atol=1e-9) for other in drawn):
                drawn.append(line.ends)
                axes.plot(*line.ends.T, color=colours.faint, lw=1.1, ls=(0, (5, 2.5)), zorder=2,
                          label="straight line" if len(drawn) == 1 else "_")  # fmt: skip
            worst, mark = line.farthest, colours.alarm if len(paths) == 1 else colour
            said = f"largest distance from it: {_metres(line.largest)}"
            axes.plot(*np.array([given[worst], line.foot[worst]]).T, color=mark, lw=1.5, zorder=3,
                      label=said if len(paths) == 1 else f"{label}: {_metres(line.largest)} from it at most")  # fmt: skip
        axes.plot(*given.T, ls="-", marker=".", ms=4.5, lw=1.2, color=colour, zorder=4, label=label)
        axes.plot(*given[:1].T, ls="none", marker="o", ms=6, mfc=colours.paper, mec=colour, mew=1.3, zorder=5,
                  label="start" if i == 0 else "_")  # fmt: skip
    if goal is not None:
        axes.plot(*goal[:, None], ls="none", marker="*", ms=11, color=colours.ink, mec=colours.paper, mew=0.6, zorder=6,
                  label="target")  # fmt: skip
    everything = np.vstack([*paths.values(), *([] if goal is None else [goal[None]])])
    worst_label = max(lines, key=lambda label: lines[label].largest)
    _dress_3d(axes, colours, everything, _azimuth(paths[worst_label], lines[worst_label]))
    _figure_legend(figure, colours, axes, columns=2, first=[*paths, "start", "target", "straight line"])
    return figure


# --- joints over time


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
    given = _joint_curves(arm, q)
    slides = _slides(arm)
    scale = np.where(slides, 1.0, np.degrees(1.0) if degrees else 1.0)
    fastest = np.minimum(arm.chain.max_velocity, np.inf if max_velocity is None else _speeds(arm, max_velocity))
    columns = 1 if given.dq is None else 2
    colours, figure = _new(theme, _PAGE if columns == 2 else _COLUMN, 1.05 * arm.dof + 0.95, title)
    grid = figure.subplots(arm.dof, columns, sharex=True, squeeze=False)
    outside = False
    for i, name in enumerate(arm.joint_names):
        unit = "m" if slides[i] else ("deg" if degrees else "rad")
        lower, upper = arm.limits[i] * scale[i]
        outside |= _limited(grid[i, 0], colours, given.t, given.q[:, i] * scale[i], lower, upper)
        grid[i, 0].plot(given.t_points, given.q_points[:, i] * scale[i], ls="none", marker=".", ms=_dot(given.t_points),
                        color=colours.series[0], zorder=4, label="points")  # fmt: skip
        grid[i, 0].set_title(name, loc="left", fontsize=_TEXT, color=colours.ink, pad=3)
        grid[i, 0].set_ylabel(f"$q_{{{i + 1}}}$ [{unit}]")
        if given.dq is not None:
            speed = float(fastest[i] * scale[i])
            outside |= _limited(grid[i, 1], colours, given.t, given.dq[:, i] * scale[i], -speed, speed)
            grid[i, 1].set_ylabel(rf"$\dot q_{{{i + 1}}}$ [{unit}/s]")
    for axes in grid.flat:
        _dress(axes, colours)
        axes.set_xlim(given.t[0], given.t[-1] if given.t[-1] > given.t[0] else given.t[0] + 1.0)
    for axes in grid[-1]:
        axes.set_xlabel("iteration" if given.dq is None else "time $t$ [s]")
    figure.align_ylabels(grid)
    _limit_legend(figure, colours, outside=outside)
    return figure


# --- error against iteration


def error(
    steps: Sequence[Step] | ArrayLike | Mapping[str, Sequence[Step] | ArrayLike],
    *,
    rate: float | None = None,
    stop: float | None = None,
    title: str = "",
    theme: Theme = "light",
) -> Figure:
    """What is left to go against the iteration, on a logarithmic axis.

    Parameters
    ----------
    steps : sequence of Step, (m,) array, or a mapping of labels to such
        Steps of `pieper.ik.iteration.iterate`, or distances [m]. Where steps carry a rotation that is left, it gets axes of its
        own: metres and radians do not add up.
    rate : float, optional
        Draws the line of an error that shrinks by this factor in each iteration, ``1 - alpha * k1`` for the iteration.
    stop : float, optional
        Draws where the iteration ends [m].
    title : str
    theme : "light" or "dark"

    Returns
    -------
    Figure

    Raises
    ------
    ArrayError
        No steps, a wrong shape, an error that is negative or not finite, or a `rate` or `stop` that is not positive.
    MissingExtraError
        Matplotlib is not installed.
    """
    named = steps if isinstance(steps, Mapping) else {"error": steps}
    if not named:
        raise ArrayError("steps must hold at least one run, got an empty mapping")
    for name, value in (("rate", rate), ("stop", stop)):
        if value is not None and not 0.0 < value < np.inf:
            raise ArrayError(f"{name} must be a positive number, got {value!r}")
    runs = {str(label): _errors(given, str(label)) for label, given in named.items()}
    turning = any(turn is not None for _, _, turn in runs.values())
    colours, figure = _new(theme, _COLUMN, 5.0 if turning else 3.2, title)
    panels = figure.subplots(2 if turning else 1, 1, sharex=True, squeeze=False)[:, 0]
    for i, (label, (count, left, turn)) in enumerate(runs.items()):
        look: dict[str, Any] = {
            "color": colours.series[i % len(colours.series)],
            "ls": _DASHES[i % len(_DASHES)],
            "lw": 1.4,
        }
        look |= {"marker": ".", "ms": _dot(count), "label": label, "zorder": 3}
        panels[0].plot(count, _above_zero(left), **look)
        if turn is not None:
            panels[1].plot(count, _above_zero(turn), **look)
    if rate is not None:
        count, left, _ = next(iter(runs.values()))
        with np.errstate(under="ignore"):
            expected = left[0] * rate ** (count - count[0])
        panels[0].plot(
            count, _above_zero(expected), color=colours.faint, lw=4.5, alpha=0.5, zorder=2, label=f"${rate:g}^k$"
        )
    if stop is not None:
        panels[0].axhline(stop, color=colours.faint, lw=1.0, ls=(0, (6, 3)), zorder=2, label=f"stop at {_metres(stop)}")
    panels[0].set_ylabel("position error [m]")
    panels[-1].set_xlabel("iteration $k$")
    if turning:
        panels[1].set_ylabel("rotation error [rad]")
    for axes in panels:
        axes.set_yscale("log")
        _dress(axes, colours)
    if len(runs) > 1 or rate is not None or stop is not None:
        _legend(panels[0], colours, loc="upper right")
    return figure


# --- manipulability along a path


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
    curves = {str(label): _joint_curves(arm, given) for label, given in named.items()}
    timed = {c.dq is not None for c in curves.values()}
    if len(timed) > 1:
        raise ArrayError(
            "q must hold trajectories or arrays, got both: one runs over time, the other over the number of the row"
        )
    colours, figure = _new(theme, _COLUMN, 4.6, title)
    panels = figure.subplots(2, 1, sharex=True)
    for i, (label, given) in enumerate(curves.items()):
        J = arm.jacobian(given.q)
        for axes, measure in zip(panels, (_manipulability(J), distance_to_singularity(J)), strict=True):
            colour = colours.series[i % len(colours.series)]
            least = int(np.argmin(measure))
            where = f"{given.t[least]:.3g} s" if given.dq is not None else f"step {given.t[least]:g}"
            axes.plot(given.t, measure, color=colour, ls=_DASHES[i % len(_DASHES)], lw=1.4, zorder=3, label=label)
            axes.plot(given.t[least], measure[least], ls="none", marker="v", ms=6, color=colour, mec=colours.paper, zorder=4,
                      label=f"least {measure[least]:.3g} at {where}")  # fmt: skip
    unit = "m$^3$" if arm.dof >= 6 and not _slides(arm).any() else "mixed units"
    panels[0].set_ylabel(f"manipulability $w$ [{unit}]")
    panels[1].set_ylabel(r"least singular value $\sigma$ [-]")
    panels[1].set_xlabel("time $t$ [s]" if timed == {True} else "iteration")
    for axes in panels:
        axes.set_ylim(bottom=0.0, top=axes.get_ylim()[1] * 1.05)
        _dress(axes, colours)
        _legend(axes, colours, loc="best")
    return figure


# --- two models


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
    colours, figure = _new(theme, _PAGE, 6.3, title)
    rows = figure.add_gridspec(2, 2, height_ratios=[1.35, 1.0])
    _side_by_side(figure, rows, colours, both, here, there, question=question, degrees=degrees)
    panels = [figure.add_subplot(rows[1, 0]), figure.add_subplot(rows[1, 1])]
    slides, moving = (
        _slides(arm),
        [pair.joint for pair in both.pairs if pair.joint is not None and pair.other is not None],
    )
    unreached = 0
    for place, i in enumerate(moving):
        values = np.linspace(both.limits[i, 0], both.limits[i, 1], samples)
        sweep = np.repeat(here[None], samples, axis=0)
        sweep[:, i] = values
        found = both.difference(sweep)
        ordinates = [1e3 * found.distance, 1e3 * found.angle]
        if question == "ik":
            answers = _other_answers(both, sweep)
            ordinates[1] = 1e3 * np.abs(_least_turn(other, answers - both.as_other(sweep))).max(axis=1)
            unreached += int(np.isnan(ordinates[1]).sum())
        scale = np.degrees(1.0) if degrees and not slides[i] else 1.0
        for axes, ordinate in zip(panels, ordinates, strict=True):
            axes.plot(values * scale, ordinate, lw=1.3, color=colours.series[place % len(colours.series)],
                      ls=_DASHES[place % len(_DASHES)], label=arm.joint_names[i])  # fmt: skip
    kinds = {"m" if slides[i] else "deg" if degrees else "rad" for i in moving}
    panels[0].set_ylabel("distance of the tips [mm]" if question == "fk" else "miss of the other tip [mm]")
    panels[1].set_ylabel(
        "angle between the tips [mrad]" if question == "fk" else f"largest joint difference [{_thousandth(other)}]"
    )
    for axes in panels:
        axes.set_xlabel(f"joint value [{' or '.join(sorted(kinds, reverse=True))}]")
        _scale_differences(axes)
        _dress(axes, colours)
    if unreached:
        said = f"out of reach of {other.name}: {unreached} of {samples * len(moving)} poses"
        panels[1].set_title(said, fontsize=_SMALL, color=colours.alarm)
    _figure_legend(figure, colours, panels[0], columns=min(len(moving), 4))
    return figure


def _side_by_side(
    figure: Figure,
    rows: Any,
    colours: _Colours,
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
        _skeleton(axes, colours, Ts, shown)
        numbers = _joint_text(model, values, degrees) if question == "ik" else _pose_text(Ts[-1])
        axes.set_title(f"{model.name}\n{numbers}", fontsize=_SMALL, color=colours.ink, linespacing=1.4, y=0.9)


# --- files and windows


def save(figure: Figure, file: str | os.PathLike[str], *, dpi: int = 200) -> Path:
    """Write a figure as PNG, PDF or SVG, by the suffix; the file is there whole, or not at all.

    Parameters
    ----------
    figure : Figure
    file : path
        Ends in ``.png``, ``.pdf`` or ``.svg``. A file of that name is replaced.
    dpi : int
        Dots per inch of a PNG.

    Returns
    -------
    Path

    Raises
    ------
    PieperError
        Another suffix.
    OSError
        The folder is missing or cannot be written.
    """
    place = checked_file(file)
    kind = place.suffix.lower()[1:]
    dated = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}[kind]  # the same figure, the same file
    with replacing(place) as unfinished:
        figure.savefig(unfinished, format=kind, dpi=dpi, facecolor=figure.get_facecolor(), metadata=dated)
    return place


def checked_file(file: str | os.PathLike[str]) -> Path:
    """The path of a figure, refused before any work where its suffix or its folder cannot be.

    Raises
    ------
    PieperError
        A suffix other than those of `FORMATS`.
    OSError
        No such folder, or a folder of that name.
    """
    place = Path(file)
    if place.suffix.lower() not in FORMATS:
        raise PieperError(
            f"{place}: a figure is written as {', '.join(FORMATS[:-1])} or {FORMATS[-1]}, by the suffix of the file"
        )
    if not place.parent.is_dir():
        raise FileNotFoundError(2, "no such folder", str(place.parent))
    if place.is_dir():
        raise IsADirectoryError(21, "is a folder, not a file", str(place))
    return place


def need_screen() -> None:
    """Complain where `show` would have no screen to open a window on.

    Raises
    ------
    PieperError
        No screen, no toolkit for windows, or a backend of Matplotlib that only writes files.
    """
    _need_matplotlib()
    from matplotlib import pyplot as plt

    if plt.get_backend().lower() in _WITHOUT_WINDOWS:
        raise PieperError(
            "there is no screen to show a figure on; write it to a file with --out FILE, or with plot.save"
        )


def show(*figures: Figure) -> None:
    """Open a window for each figure and wait until the last one is closed.

    Raises
    ------
    PieperError
        No screen, see `need_screen`.
    """
    need_screen()
    from matplotlib import pyplot as plt

    for figure in figures:
        # a figure made without pyplot gets the window of one that was made with it
        window: Any = plt.figure(figsize=tuple(figure.get_size_inches())).canvas.manager
        window.canvas.figure = figure
        figure.set_canvas(window.canvas)
        for axes in figure.axes:
            getattr(axes, "mouse_init", lambda: None)()  # so that a picture in three dimensions can be turned
    plt.show(block=True)


# --- what the figures take


class _Curves(NamedTuple):
    """Joint values to draw: `q` (m, n) and `dq` over `t` (m,), densely, and the points `q_points` over `t_points` themselves."""

    t: FloatArray
    q: FloatArray
    dq: FloatArray | None
    t_points: FloatArray
    q_points: FloatArray


def _joint_curves(arm: Arm, q: Trajectory | ArrayLike) -> _Curves:
    if isinstance(q, Trajectory):
        trajectory = q.in_order(arm.joint_names)
        u = np.linspace(0.0, 1.0, _PER_SEGMENT + 1)[:-1]
        t = (trajectory.t[:-1, None] + u * np.diff(trajectory.t)[:, None]).ravel()
        t = np.append(t, trajectory.t[-1])
        sample = trajectory.sample(t)
        return _Curves(t, sample.q, sample.dq, trajectory.t, trajectory.q)
    rows = as_joints(arm.chain, q)
    if rows.ndim != 2 or not len(rows):
        raise ArrayError(f"q must be a Trajectory or have shape (m, {arm.dof}) with at least one row, got {rows.shape}")
    count = np.arange(len(rows), dtype=np.float64)
    return _Curves(count, rows, None, count, rows)


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


def _speeds(arm: Arm, value: ArrayLike) -> FloatArray:
    speeds = np.broadcast_to(stack(value, (), "max_velocity"), (arm.dof,))
    if (speeds <= 0.0).any():
        raise ArrayError(f"max_velocity must be above 0, got {np.asarray(value).tolist()}")
    return speeds


def _errors(steps: Sequence[Step] | ArrayLike, label: str) -> tuple[NDArray[np.int64], FloatArray, FloatArray | None]:
    """Numbers of the iterations, distances left [m], and angles left [rad] where a rotation is asked for."""
    if isinstance(steps, (list, tuple)) and steps and all(isinstance(step, Step) for step in steps):
        count = np.array([step.iteration for step in steps])
        left = np.array([np.linalg.norm(step.error[:3]) for step in steps])
        turn = np.array([np.linalg.norm(step.error[3:]) for step in steps])
        if not (np.isfinite(left).all() and np.isfinite(turn).all()):
            raise ArrayError(
                f"steps of {label!r} must be finite: the iteration went astray; use a smaller gain or a damping"
            )
        return count, left, turn if turn.any() else None
    left = stack(steps, (), f"steps of {label!r}")  # type: ignore[arg-type]  # an array by now, or refused
    if left.ndim != 1 or not len(left):
        raise ArrayError(
            f"steps of {label!r} must be steps of the iteration or have shape (m,), at least one, got {left.shape}"
        )
    if (left < 0.0).any():
        raise ArrayError(f"steps of {label!r} must be distances of at least 0 m, got {left.min()}")
    return np.arange(len(left)), left, None


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
    return np.where(_slides(arm), change, (change + np.pi) % (2.0 * np.pi) - np.pi)


def _thousandth(arm: Arm) -> str:
    """The unit of a thousandth of a joint value."""
    slides = _slides(arm)
    return "mm" if slides.all() else "mrad or mm" if slides.any() else "mrad"


def _slides(arm: Arm) -> NDArray[np.bool_]:
    """(n,) mask of the joints whose values are lengths."""
    chain = arm.chain
    return np.array([not chain.is_revolute[axes].all() for axes in (chain.coupling != 0.0).T], dtype=np.bool_)


# --- how they look


def _need_matplotlib() -> None:
    try:
        import matplotlib as mpl  # noqa: F401
    except ImportError as cause:
        raise MissingExtraError("matplotlib", "plot", "a figure") from cause


def _new(theme: Theme, width: float, height: float, title: str) -> tuple[_Colours, Figure]:
    if theme not in _THEMES:
        raise ArrayError(f"theme must be 'light' or 'dark', got {theme!r}")
    _need_matplotlib()
    from matplotlib.figure import Figure

    colours = _THEMES[theme]
    figure = Figure(figsize=(width, height), facecolor=colours.paper, layout="constrained")
    if title:
        figure.suptitle(title, fontsize=_HEAD, color=colours.ink, fontweight="bold")
    return colours, figure


def _dress(axes: Any, colours: _Colours) -> None:
    axes.set_facecolor("none")
    axes.grid(True, color=colours.grid, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=_SMALL, labelcolor=colours.ink, color=colours.faint, length=3, which="major")
    axes.tick_params(labelsize=_SMALL, labelcolor=colours.ink, color=colours.faint, length=1.8, which="minor")
    for side, spine in axes.spines.items():
        spine.set_color(colours.faint)
        spine.set_visible(side in ("left", "bottom"))
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set(fontsize=_TEXT, color=colours.ink)


def _dress_3d(axes: Any, colours: _Colours, points: FloatArray, azimuth: float, *, zoom: float = 0.88) -> None:
    from matplotlib.ticker import MaxNLocator

    lower, upper = points.min(axis=0), points.max(axis=0)
    size = upper - lower
    longest = max(float(size.max()), 1e-3)
    size = 1.08 * np.maximum(size, _FLAT * longest)
    for name, middle, side in zip("xyz", 0.5 * (lower + upper), size, strict=True):
        getattr(axes, f"set_{name}lim")(middle - 0.5 * side, middle + 0.5 * side)
        axis = getattr(axes, f"{name}axis")
        axis.set_label_text(f"{name} [m]", fontsize=_TEXT, color=colours.ink)
        axis.set_pane_color((0.0, 0.0, 0.0, 0.0))
        axis.line.set_color(colours.faint)
        axis._axinfo["grid"].update(
            color=colours.grid, linewidth=0.6
        )  # the one way to colour a grid in three dimensions
        axis.set_tick_params(labelsize=_SMALL, colors=colours.ink, pad=0)
        axis.set_major_locator(MaxNLocator(5 if side > 0.75 * size.max() else 3))
    axes.set_facecolor("none")
    axes.set_box_aspect(size, zoom=zoom)  # metres are equally long along the three axes
    axes.view_init(elev=float(np.degrees(_ELEVATION)), azim=azimuth)


def _azimuth(points: FloatArray, line: StraightLine) -> float:
    """The direction to look from [deg], not far from the usual one, in which the farthest point stands clear of the line."""
    along, across = line.ends[1] - line.ends[0], points[line.farthest] - line.foot[line.farthest]
    views = np.arange(-70.0, -29.0, 5.0)
    seen = []
    for view in np.radians(views):
        right = np.array([-np.sin(view), np.cos(view), 0.0])
        up = np.cross([np.cos(view) * np.cos(_ELEVATION), np.sin(view) * np.cos(_ELEVATION), np.sin(_ELEVATION)], right)
        seen.append(abs(float((right @ along) * (up @ across) - (up @ along) * (right @ across))))
    return float(views[int(np.argmax(seen))])


def _scale_differences(axes: Any) -> None:
    """From zero, or logarithmic where the least and the greatest are far apart, as they are beside singular poses."""
    drawn = np.concatenate([line.get_ydata() for line in axes.lines])
    positive = drawn[np.isfinite(drawn) & (drawn > 0.0)]
    if len(positive) and positive.max() > _DECADES * np.median(positive) and positive.min() > _ROUNDING:
        axes.set_yscale("log")
    else:
        greatest = float(positive.max(initial=0.0))
        axes.set_ylim(0.0, 1.12 * greatest if greatest > _ROUNDING else 1.0)


def _limited(axes: Any, colours: _Colours, t: FloatArray, value: FloatArray, lower: float, upper: float) -> bool:
    """Draw a value with its limits, and what is beyond them; True where the value is beyond."""
    axes.plot(t, value, color=colours.series[0], lw=1.3, zorder=3, label="value")
    finite = [limit for limit in (lower, upper) if np.isfinite(limit)]
    least, most = min([float(value.min()), *finite]), max([float(value.max()), *finite])
    margin = 0.08 * (most - least) or 0.1
    least, most = least - margin, most + margin
    for limit, edge in ((lower, least), (upper, most)):
        if np.isfinite(limit):
            axes.axhspan(limit, edge, color=colours.beyond, lw=0.0, zorder=0)
            axes.axhline(limit, color=colours.alarm, lw=0.8, zorder=1)
    axes.set_ylim(least, most)
    rounding = 1e-9 * max(1.0, abs(lower) if np.isfinite(lower) else 0.0, abs(upper) if np.isfinite(upper) else 0.0)
    beyond = (value < lower - rounding) | (value > upper + rounding)
    if beyond.any():
        axes.plot(t, np.where(beyond, value, np.nan), color=colours.alarm, lw=2.6, zorder=5, label="beyond a limit",
                  marker=".", ms=2.6)  # fmt: skip
    return bool(beyond.any())


def _limit_legend(figure: Figure, colours: _Colours, *, outside: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], color=colours.series[0], lw=1.3, marker=".", ms=5, label="value, points given"),
        Patch(facecolor=colours.beyond, edgecolor=colours.alarm, lw=0.8, label="beyond the limits"),
    ]
    if outside:
        handles.append(Line2D([], [], color=colours.alarm, lw=2.6, label="value beyond a limit"))
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles),
        fontsize=_SMALL,
        frameon=False,
        labelcolor=colours.ink,
    )


def _figure_legend(figure: Figure, colours: _Colours, axes: Any, *, columns: int, first: Sequence[str] = ()) -> None:
    """The legend below the figure, where it hides nothing; the labels of `first` before the others."""
    handles, labels = axes.get_legend_handles_labels()
    rank = {label: i for i, label in enumerate(first)}
    order = sorted(range(len(labels)), key=lambda i: rank.get(labels[i], len(rank)))
    figure.legend([handles[i] for i in order], [labels[i] for i in order], loc="outside lower center", ncols=columns, fontsize=_SMALL, frameon=False,
                  labelcolor=colours.ink, handlelength=2.8)  # fmt: skip


def _legend(axes: Any, colours: _Colours, **where: Any) -> None:
    axes.legend(
        fontsize=_SMALL,
        framealpha=0.85,
        facecolor=colours.paper,
        edgecolor=colours.grid,
        labelcolor=colours.ink,
        **where,
    )


def _skeleton(axes: Any, colours: _Colours, Ts: FloatArray, shown: FloatArray) -> None:
    """An arm as lines between its frames `Ts` (k, 4, 4), with the axes of the last one; empty for an arm that cannot be there."""
    _dress_3d(axes, colours, np.vstack([shown, np.zeros((1, 3))]), -60.0, zoom=0.84)
    if not len(Ts):
        axes.text2D(
            0.5, 0.5, "out of reach", transform=axes.transAxes, ha="center", color=colours.alarm, fontsize=_TEXT
        )
        return
    points = Ts[:, :3, 3]
    axes.plot(*points.T, color=colours.series[0], lw=3.2, solid_capstyle="round", solid_joinstyle="round", zorder=3)
    axes.plot(*points.T, ls="none", marker="o", ms=4, mfc=colours.paper, mec=colours.series[0], mew=1.1, zorder=4)
    length = 0.16 * float(np.ptp(shown, axis=0).max())
    for name, axis, colour in zip("xyz", Ts[-1, :3, :3].T, colours.triad, strict=True):
        end = points[-1] + length * axis
        axes.plot(*np.array([points[-1], end]).T, color=colour, lw=1.8, zorder=6)
        axes.text(
            *(points[-1] + 1.35 * length * axis),
            name,
            color=colour,
            fontsize=_SMALL,
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
    scale = np.where(_slides(arm), 1.0, np.degrees(1.0) if degrees else 1.0)
    unit = "" if _slides(arm).any() else (" deg" if degrees else " rad")
    listed = ", ".join(f"{value:.3f}" if degrees else f"{value:.4f}" for value in q * scale + 0.0)
    return f"({listed}){unit}"


def _metres(value: float) -> str:
    """Three digits, and as few zeros as can be.

    >>> _metres(0.010113), _metres(0.3267), _metres(1.2e-7)
    ('0.0101 m', '0.327 m', '1.2e-07 m')
    """
    return f"{value:.3g} m"


def _dot(points: NDArray[Any]) -> float:
    """Size of the marker of each point; none where they would run into each other."""
    return 4.0 if len(points) <= _MOST_MARKED else 0.0


def _above_zero(values: FloatArray) -> FloatArray:
    """What a logarithmic axis can show."""
    return np.where(values > 0.0, values, np.nan)
