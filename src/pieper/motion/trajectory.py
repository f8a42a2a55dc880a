"""Joint values over time: points, and the polynomials between them.

Between two points the joints follow the polynomial of least degree that meets what the points give, which is the rule that the
joint_trajectory_controller of ros2_control documents for its spline interpolation
(https://control.ros.org, *Trajectory Representation*):

==================================  ==========  ================================================
Points give                         Polynomial  Without jumps of
==================================  ==========  ================================================
positions                           linear      position
positions, velocities               cubic       position and velocity
positions, velocities, accelerat.   quintic     position, velocity and acceleration
==================================  ==========  ================================================
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.errors import ArrayError, unknown_name
from pieper.motion import polynomial
from pieper.spatial._checks import FloatArray, stack

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

# Hermite interpolation over 0 <= u <= 1. Rows: coefficients of 1, u, u^2, ...; columns: what both ends give,
# times the length h of the segment once for a velocity and twice for an acceleration.
_LINEAR = np.array([[1.0, 0.0], [-1.0, 1.0]])  # columns q0 q1
_CUBIC = np.array(  # columns q0 q1 h*dq0 h*dq1
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-3.0, 3.0, -2.0, -1.0], [2.0, -2.0, 1.0, 1.0]]
)
_QUINTIC = np.array(  # columns q0 q1 h*dq0 h*dq1 h^2*ddq0 h^2*ddq1
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.5, 0.0],
        [-10.0, 10.0, -6.0, -4.0, -1.5, 0.5],
        [15.0, -15.0, 8.0, 7.0, 1.5, -1.0],
        [-6.0, 6.0, -3.0, -3.0, -0.5, 0.5],
    ]
)


class Sample(NamedTuple):
    """Where the joints are at some times: `q`, `dq`, `ddq`, each (..., n) [rad or m, per s, per s^2]."""

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Points in time for the joints of an arm. Arrays are copied and read-only.

    Attributes
    ----------
    t : (m,) array
        Times [s], strictly increasing. One point is enough.
    q : (m, n) array
        Joint values [rad or m].
    dq : (m, n) array, optional
        Joint velocities [rad/s or m/s].
    ddq : (m, n) array, optional
        Joint accelerations [rad/s^2 or m/s^2]; only together with velocities.
    joint_names : tuple of n str
        Whose values the columns are; empty for "in the order of the arm".

    Raises
    ------
    ArrayError
        A wrong shape, a number that is not finite, times that do not increase, accelerations without velocities, or names that are
        not n different ones.

    Examples
    --------
    >>> move = Trajectory([0.0, 2.0], [[0.0], [1.0]], dq=[[0.0], [0.0]])
    >>> move.sample(1.0).q, move.sample(1.0).dq
    (array([0.5]), array([0.75]))
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray | None = None
    ddq: FloatArray | None = None
    joint_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        t = stack(self.t, (), "t")
        if t.ndim != 1 or t.size == 0:
            raise ArrayError(f"t must have shape (m,) with at least one time, got {t.shape}")
        short = np.flatnonzero(t[1:] <= t[:-1])
        if short.size:
            i = int(short[0])
            raise ArrayError(
                f"t must be strictly increasing [s], got t[{i}] = {t[i]} and t[{i + 1}] = {t[i + 1]}; "
                "sort the points and leave out repeated times"
            )
        q = stack(self.q, (), "q")
        if q.ndim != 2 or len(q) != len(t):
            raise ArrayError(f"q must have shape (m, n) with m = {len(t)} rows, one for each time, got {q.shape}")
        self._put("t", t)
        self._put("q", q)
        for name in ("dq", "ddq"):
            given = getattr(self, name)
            if given is None:
                continue
            values = stack(given, (), name)
            if values.shape != q.shape:
                raise ArrayError(
                    f"{name} must have the shape of q, {q.shape}, got {values.shape}; leave it out if unknown"
                )
            self._put(name, values)
        if self.ddq is not None and self.dq is None:
            raise ArrayError(
                "ddq needs dq: an interpolation through accelerations takes velocities too; give both or neither"
            )
        names = tuple(self.joint_names)
        if names and (len(names) != q.shape[1] or len(set(names)) != len(names)):
            raise ArrayError(
                f"joint_names must be {q.shape[1]} different names, one for each column of q, got {len(names)}: "
                f"{', '.join(map(str, names))}"
            )
        object.__setattr__(self, "joint_names", names)
        self._check_finite_between()

    def _put(self, name: str, values: FloatArray) -> None:
        values = np.array(values)
        values.setflags(write=False)
        object.__setattr__(self, name, values)

    def _check_finite_between(self) -> None:
        with np.errstate(all="ignore"):
            largest = 100.0 * np.abs(self._coefficients).sum(axis=(1, 2)) / self._lengths**2
        wrong = np.flatnonzero(~np.isfinite(largest))
        if wrong.size:
            i = int(wrong[0])
            raise ArrayError(
                f"points {i} and {i + 1} must be joined by finite velocities and accelerations; they are {self._lengths[i]:.3g} s "
                "apart, which is too short for how much they differ"
            )

    def __reduce__(self) -> tuple[type[Trajectory], tuple[Any, ...]]:
        return type(self), (self.t, self.q, self.dq, self.ddq, self.joint_names)

    def __repr__(self) -> str:
        return f"Trajectory({len(self.t)} points, {self.dof} joints, {self.duration:.6g} s)"

    @property
    def dof(self) -> int:
        """Number of joints n."""
        return int(self.q.shape[1])

    @property
    def duration(self) -> float:
        """From the first point to the last [s]."""
        return float(self.t[-1] - self.t[0])

    @cached_property
    def _lengths(self) -> FloatArray:
        """(m - 1,) lengths of the segments [s]."""
        return np.asarray(np.diff(self.t))

    @cached_property
    def _coefficients(self) -> FloatArray:
        """(m - 1, n, d + 1) coefficients of the positions over ``u = (t - t_k) / h_k``."""
        h = self._lengths[:, None]
        ends = [self.q[:-1], self.q[1:]]
        matrix = _LINEAR
        with np.errstate(all="ignore"):  # what overflows is refused by name
            if self.dq is not None:
                ends += [h * self.dq[:-1], h * self.dq[1:]]
                matrix = _CUBIC
            if self.ddq is not None:
                ends += [h * h * self.ddq[:-1], h * h * self.ddq[1:]]
                matrix = _QUINTIC
            return np.asarray(np.stack(ends, axis=-1) @ matrix.T)

    def polynomials(self, derivative: int = 0) -> FloatArray:
        """Coefficients of the polynomials between the points, ascending, over ``u = (t - t_k) / (t_{k+1} - t_k)`` from 0 to 1.

        Parameters
        ----------
        derivative : int
            0 for positions, 1 for velocities, 2 for accelerations, by time in seconds.

        Returns
        -------
        (m - 1, n, d + 1 - derivative) array
            Of polynomials of degree d; at least one coefficient.
        """
        c = self._coefficients
        for _ in range(derivative):
            c = polynomial.differentiate(c) / self._lengths[:, None, None]
        return c

    def sample(self, t: ArrayLike) -> Sample:
        """Positions, velocities and accelerations at any times.

        Parameters
        ----------
        t : (...) array
            Times [s]. Before the first point and after the last one the joints rest there.

        Returns
        -------
        Sample
            `q`, `dq`, `ddq`, each (..., n). At a time of a point the values are those of the segment that begins there; at the last
            point those of the one that ends.

        Raises
        ------
        ArrayError
            A time that is not finite.
        """
        times = stack(t, (), "t")
        first, last = self.t[0], self.t[-1]
        resting = ((times < first) | (times > last))[..., None]
        if len(self.t) == 1:
            point = [self.q[0], *(np.zeros(self.dof) if d is None else d[0] for d in (self.dq, self.ddq))]
            q, dq, ddq = (np.broadcast_to(value, (*times.shape, self.dof)).copy() for value in point)
        else:
            k = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 2)
            u = (np.clip(times, first, last) - self.t[k]) / self._lengths[k]
            h, c_q = self._lengths[k][..., None, None], self._coefficients[k]
            c_dq = polynomial.differentiate(c_q) / h
            c_ddq = polynomial.differentiate(c_dq) / h
            q, dq, ddq = (polynomial.evaluate(c, u[..., None]) for c in (c_q, c_dq, c_ddq))
            for values, given in ((q, self.q), (dq, self.dq), (ddq, self.ddq)):
                if given is not None:  # the end itself, without rounding
                    values[times >= last] = given[-1]
        return Sample(q, np.where(resting, 0.0, dq), np.where(resting, 0.0, ddq))

    def at_rate(self, rate: float) -> Trajectory:
        """Points at an even rate, the last one at the end, which may come sooner than the others.

        Parameters
        ----------
        rate : float
            Points a second [Hz].

        Returns
        -------
        Trajectory
            With velocities and accelerations as `sample` gives them.

        Raises
        ------
        ArrayError
            A rate that is not above 0, or so high that there would be more than ten million points.

        Examples
        --------
        >>> Trajectory([0.0, 1.0], [[0.0], [1.0]]).at_rate(4.0).t
        array([0.  , 0.25, 0.5 , 0.75, 1.  ])
        """
        if not (np.isfinite(rate) and rate > 0.0):
            raise ArrayError(f"rate must be above 0 [Hz], got {rate!r}")
        if self.duration * rate > 1e7:
            raise ArrayError(
                f"{self.duration:.6g} s at {rate:g} Hz would be more than ten million points; take a lower rate"
            )
        t = self.t[0] + np.arange(int(np.floor(self.duration * rate + 1e-9)) + 1) / rate
        t = np.append(t[t < self.t[-1] - 1e-9], self.t[-1])
        return Trajectory(t, *self.sample(t), self.joint_names)

    def as_message(self) -> dict[str, Any]:
        """The trajectory in the shape of ``trajectory_msgs/msg/JointTrajectory``: plain dictionaries, lists and numbers.

        Times count from the first point. What the trajectory does not give is an empty list, as ROS has it.

        Examples
        --------
        >>> Trajectory([0.0, 1.5], [[0.0], [1.0]], joint_names=("lift",)).as_message()["points"][1]
        {'positions': [1.0], 'velocities': [], 'accelerations': [], 'effort': [], 'time_from_start': {'sec': 1, 'nanosec': 500000000}}
        """
        points = []
        for k, time in enumerate((self.t - self.t[0]).tolist()):
            seconds, rest = divmod(round(time * 1e9), 10**9)
            points.append(
                {
                    "positions": self.q[k].tolist(),
                    "velocities": [] if self.dq is None else self.dq[k].tolist(),
                    "accelerations": [] if self.ddq is None else self.ddq[k].tolist(),
                    "effort": [],
                    "time_from_start": {"sec": seconds, "nanosec": rest},
                }
            )
        header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
        return {"header": header, "joint_names": list(self.joint_names), "points": points}

    def in_order(self, joint_names: Sequence[str]) -> Trajectory:
        """The same trajectory with its columns in another order of joints.

        Parameters
        ----------
        joint_names : sequence of n str
            The joints of the arm. A trajectory without names is taken to be in this order already.

        Returns
        -------
        Trajectory
            Its ``joint_names`` are those asked for.

        Raises
        ------
        UnknownNameError
            A joint of the trajectory that is not in `joint_names`.
        ArrayError
            A joint that the trajectory lacks, or a number of columns that does not fit.

        Examples
        --------
        >>> Trajectory([0.0], [[1.0, 2.0]], joint_names=("b", "a")).in_order(["a", "b"]).q
        array([[2., 1.]])
        """
        wanted = tuple(joint_names)
        for name in self.joint_names:
            if name not in wanted:
                raise unknown_name("joint", name, wanted)
        missing = [name for name in wanted if name not in self.joint_names]
        if self.joint_names and missing:
            raise ArrayError(f"the trajectory must move all joints of the arm; it lacks {', '.join(missing)}")
        if self.dof != len(wanted):
            raise ArrayError(
                f"the trajectory must have {len(wanted)} columns, one for each of {', '.join(wanted)}, got {self.dof}"
            )
        if not self.joint_names or self.joint_names == wanted:
            return replace(self, joint_names=wanted)
        columns = [self.joint_names.index(name) for name in wanted]
        dq, ddq = (None if values is None else values[:, columns] for values in (self.dq, self.ddq))
        return Trajectory(self.t, self.q[:, columns], dq, ddq, wanted)


def one_after_another(moves: Sequence[Trajectory]) -> Trajectory:
    """Motions from rest to rest as one.

    Parameters
    ----------
    moves : sequence of Trajectory
        At least one; each begins where the one before ends, and all give velocities and accelerations.

    Returns
    -------
    Trajectory
        It begins when the first one does.

    Raises
    ------
    ArrayError
        There are none, one gives no velocities or accelerations, or begins elsewhere.
    """
    if not moves:
        raise ArrayError("one_after_another needs at least one motion, got none")
    t, q, dq, ddq = [moves[0].t[:1]], [moves[0].q[:1]], [], []
    for number, move in enumerate(moves):
        if move.dq is None or move.ddq is None:
            raise ArrayError(f"motion {number} must give velocities and accelerations, as those that are timed do")
        if not np.allclose(q[-1][-1], move.q[0]):
            raise ArrayError(f"motion {number} must begin where the one before ends, {q[-1][-1]}, got {move.q[0]}")
        first = 0 if number == 0 else 1
        t.append(t[-1][-1] + move.t[1:] - move.t[0])
        q.append(move.q[1:])
        dq.append(move.dq[first:])
        ddq.append(move.ddq[first:])
    return Trajectory(
        np.concatenate(t), np.concatenate(q), np.concatenate(dq), np.concatenate(ddq), moves[0].joint_names
    )
