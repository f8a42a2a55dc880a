"""Motions to look at: trajectories and the steps of an iteration, played, stopped and run through by hand, several at once.

`Track` is one motion with the path of its tip, `Player` the clock that all of them follow. Neither knows a browser.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.kinematics.joints import periodic_joints
from pieper.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from pieper.arm import Arm
    from pieper.ik.iteration import Step
    from pieper.spatial._checks import FloatArray
    from pieper.viewer.surface import Color

COLORS: tuple[Color, ...] = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (230, 159, 0),
    (86, 180, 233),
)
"""Colours of the motions, in turn; they stay apart for people who see red and green alike (Okabe and Ito, 2008)."""

_TRACE = 400  # points of a trace; more cannot be told apart on a screen
_PLOTTED = 300  # points of a curve in a plot
_STEP_SECONDS = 0.1  # of one step of an iteration


class Plot(NamedTuple):
    """Curves over one axis: `x` (m,), `y` (k, m) and a name for each curve."""

    x: FloatArray
    y: FloatArray
    names: tuple[str, ...]
    x_label: str
    y_label: str


@dataclass(frozen=True, eq=False)
class Track:
    """One motion of an arm. Made by `of` and `from_steps`.

    Attributes
    ----------
    name : str
    arm : Arm
    trajectory : Trajectory
        Its columns in the order of the arm's joints.
    color : tuple of 3 int
        0..255.
    errors : (m,) array, optional
        What was left after each step of an iteration [m, or m and rad together].
    """

    name: str
    arm: Arm
    trajectory: Trajectory
    color: Color = COLORS[0]
    errors: FloatArray | None = None

    @classmethod
    def of(cls, arm: Arm, trajectory: Trajectory, *, name: str = "trajectory", color: Color = COLORS[0]) -> Track:
        """The motion of a trajectory.

        Raises
        ------
        UnknownNameError, ArrayError
            The trajectory is of other joints than the arm's.
        """
        return cls(name, arm, trajectory.in_order(arm.joint_names), color)

    @classmethod
    def from_steps(
        cls,
        arm: Arm,
        steps: Iterable[Step],
        *,
        name: str = "iteration",
        color: Color = COLORS[0],
        seconds: float = _STEP_SECONDS,
    ) -> Track:
        """The steps of an iteration as a motion, each `seconds` long [s]; joints go straight from step to step.

        Raises
        ------
        ArrayError
            There is no step, or a time that is not positive.

        Examples
        --------
        The tip of a UR5e on its way to (0.50, -0.60, 0.20) with a small gain stays near the straight line.

        >>> import pieper
        >>> from pieper.ik.iteration import iterate
        >>> arm = pieper.load("ur5e")
        >>> q_start = [-1.28, 4.41, 1.54, -1.16, -1.56, 0.0]
        >>> steps = iterate(arm.chain, [0.5, -0.6, 0.2], q_start, orientation="hold", k1=0.1, position_stop=1e-3)
        >>> print(Track.from_steps(arm, steps).summary)
        61 steps; the tip goes 0.572 m, at most 10.1 mm off the straight line; 9.2e-04 left
        """
        listed = list(steps)
        if not listed:
            raise ArrayError("an iteration must have at least one step to be played; its start is step 0")
        if not 0.0 < seconds < np.inf:
            raise ArrayError(f"seconds must be a positive time for each step, got {seconds!r}")
        q = np.array([step.q for step in listed])
        made = Trajectory(np.arange(len(listed), dtype=np.float64) * seconds, q, joint_names=arm.joint_names)
        return cls(name, arm, made, color, np.array([step.norm for step in listed]))

    @property
    def duration(self) -> float:
        """[s]."""
        return self.trajectory.duration

    def at(self, t: float) -> FloatArray:
        """(n,) joint values `t` seconds after the beginning [rad or m]; before it and after the end the joints rest."""
        return np.asarray(self.trajectory.sample(float(self.trajectory.t[0]) + t).q)

    @property
    def times(self) -> FloatArray:
        """(m,) times since the beginning at which the path is drawn: the points themselves of an iteration, else evenly spread [s]."""
        t = self.trajectory.t - self.trajectory.t[0]
        if self.errors is not None or len(t) < 2:
            return np.asarray(t)
        return np.unique(np.concatenate([t[:: -(-len(t) // _TRACE)], np.linspace(0.0, self.duration, _TRACE)]))

    def tips(self, t: FloatArray) -> FloatArray:
        """(m, 3) where the tip is at some times since the beginning, in the base frame [m]."""
        q = self.trajectory.sample(self.trajectory.t[0] + t).q
        return np.asarray(self.arm.fk(q)[..., :3, 3])

    @property
    def straightness(self) -> float:
        """How far the path of the tip strays from the straight line between its ends [m]."""
        return straightness(self.tips(self.times))

    @property
    def summary(self) -> str:
        """The motion in one line."""
        tips = self.tips(self.times)
        length = float(np.linalg.norm(np.diff(tips, axis=0), axis=1).sum())
        made = f"{len(self.errors) - 1} steps" if self.errors is not None else f"{self.duration:.3g} s"
        left = f"; {self.errors[-1]:.1e} left" if self.errors is not None else ""
        return f"{made}; the tip goes {length:.3g} m, at most {1e3 * straightness(tips):.3g} mm off the straight line{left}"

    # --- as curves

    def joint_plot(self) -> Plot:
        """The joint values over time, angles in degrees."""
        t = self._plotted()
        q = self.trajectory.sample(self.trajectory.t[0] + t).q
        turning = periodic_joints(self.arm.chain)
        label = "deg" if turning.all() else "m" if not turning.any() else "deg or m"
        return Plot(t, np.where(turning, np.degrees(q), q).T, self.arm.joint_names, "t [s]", label)

    def tip_plot(self) -> Plot:
        """The position of the tip over time, in metres."""
        t = self._plotted()
        return Plot(t, self.tips(t).T, ("x", "y", "z"), "t [s]", "m")

    def error_plot(self) -> Plot | None:
        """What is left after each step of an iteration; None for other motions."""
        if self.errors is None:
            return None
        keep = np.unique(np.linspace(0, len(self.errors) - 1, min(len(self.errors), _PLOTTED)).astype(int))
        return Plot(keep.astype(np.float64), self.errors[keep][None], ("error",), "step", "m")

    def _plotted(self) -> FloatArray:
        return np.linspace(0.0, self.duration, _PLOTTED if self.duration > 0.0 else 1)


class Player:
    """The clock of some motions: it runs, stops, is put anywhere, and begins again or not at the end.

    Parameters
    ----------
    tracks : sequence of Track
    loop : bool
        Whether it begins again at the end.
    speed : float
        Seconds of the motion in one second.

    Examples
    --------
    >>> import pieper
    >>> arm = pieper.load("so101")
    >>> up = Trajectory([0.0, 2.0], [[0.0] * 5, [0.5] * 5])
    >>> player = Player([Track.of(arm, up)], loop=False)
    >>> player.play()
    >>> player.advance(1.5), player.advance(1.5), player.playing
    (1.5, 2.0, False)
    """

    def __init__(self, tracks: Sequence[Track], *, loop: bool = True, speed: float = 1.0) -> None:
        self.tracks = list(tracks)
        self.loop = loop
        self.playing = False
        self.time = 0.0
        """Seconds since the beginning."""
        self._speed = 1.0
        self.speed = speed

    @property
    def duration(self) -> float:
        """Of the longest motion [s]."""
        return max((track.duration for track in self.tracks), default=0.0)

    @property
    def speed(self) -> float:
        """Seconds of the motion in one second."""
        return self._speed

    @speed.setter
    def speed(self, value: float) -> None:
        if not 0.0 < value < np.inf:
            raise ArrayError(f"speed must be a positive number, got {value!r}")
        self._speed = float(value)

    def play(self) -> None:
        """Run on; from the beginning where the end has been reached."""
        if self.time >= self.duration:
            self.time = 0.0
        self.playing = self.duration > 0.0

    def pause(self) -> None:
        """Stay where it is."""
        self.playing = False

    def seek(self, time: float) -> float:
        """Go to a time [s], held between beginning and end; one that is not a number changes nothing."""
        if np.isfinite(time):
            self.time = float(min(max(time, 0.0), self.duration))
        return self.time

    def advance(self, seconds: float) -> float:
        """Let the clock run for some seconds, if it runs; the time then [s]."""
        if self.playing and np.isfinite(seconds):
            ahead = self.time + self._speed * seconds
            if ahead < self.duration:
                self.time = ahead
            elif self.loop:
                self.time = ahead % self.duration
            else:
                self.time, self.playing = self.duration, False
        return self.time

    def poses(self) -> list[FloatArray]:
        """Joint values of every motion now."""
        return [track.at(self.time) for track in self.tracks]


def straightness(points: FloatArray) -> float:
    """The largest distance of points (m, 3) from the line segment between the first and the last of them [m].

    >>> straightness(np.array([[0.0, 0.0, 0.0], [0.5, 0.1, 0.0], [1.0, 0.0, 0.0]]))
    0.1
    """
    start, end = points[0], points[-1]
    along = end - start
    length = float(along @ along)
    share = np.clip((points - start) @ along / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(points))
    return float(np.linalg.norm(points - start - share[:, None] * along, axis=1).max())
