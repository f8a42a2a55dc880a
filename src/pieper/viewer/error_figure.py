"""The figure of what an iteration has left to go."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.ik.iteration import Step
from pieper.spatial._checks import FloatArray, stack
from pieper.viewer.figure_look import COLUMN, DASHES, Theme, dot_size, dress, in_metres, legend, new_figure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray


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
    colors, figure = new_figure(theme, COLUMN, 5.0 if turning else 3.2, title)
    panels = figure.subplots(2 if turning else 1, 1, sharex=True, squeeze=False)[:, 0]
    for i, (label, (count, left, turn)) in enumerate(runs.items()):
        look: dict[str, Any] = {
            "color": colors.series[i % len(colors.series)],
            "ls": DASHES[i % len(DASHES)],
            "lw": 1.4,
        }
        look |= {"marker": ".", "ms": dot_size(count), "label": label, "zorder": 3}
        panels[0].plot(count, _above_zero(left), **look)
        if turn is not None:
            panels[1].plot(count, _above_zero(turn), **look)
    if rate is not None:
        count, left, _ = next(iter(runs.values()))
        with np.errstate(under="ignore"):
            expected = left[0] * rate ** (count - count[0])
        panels[0].plot(
            count, _above_zero(expected), color=colors.faint, lw=4.5, alpha=0.5, zorder=2, label=f"${rate:g}^k$"
        )
    if stop is not None:
        panels[0].axhline(
            stop, color=colors.faint, lw=1.0, ls=(0, (6, 3)), zorder=2, label=f"stop at {in_metres(stop)}"
        )
    panels[0].set_ylabel("position error [m]")
    panels[-1].set_xlabel("iteration $k$")
    if turning:
        panels[1].set_ylabel("rotation error [rad]")
    for axes in panels:
        axes.set_yscale("log")
        dress(axes, colors)
    if len(runs) > 1 or rate is not None or stop is not None:
        legend(panels[0], colors, loc="upper right")
    return figure


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


def _above_zero(values: FloatArray) -> FloatArray:
    """What a logarithmic axis can show."""
    return np.where(values > 0.0, values, np.nan)
