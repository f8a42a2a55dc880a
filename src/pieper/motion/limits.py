"""What an arm may do: where its joints may be, how fast joints and tip may move, how fast that may change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError, MotionError
from pieper.kinematics.joints import as_joints
from pieper.model._chain_check import check_chain
from pieper.motion import polynomial
from pieper.spatial._checks import FloatArray, stack

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.model.chain import Chain
    from pieper.motion.trajectory import Trajectory

DEFAULT_TURNING_SPEED = 1.0
"""Velocity limit of a joint that turns where the description gives none [rad/s]."""

DEFAULT_SLIDING_SPEED = 0.25
"""Velocity limit of a joint that slides where the description gives none [m/s]."""

DEFAULT_TIME_TO_FULL_SPEED = 0.5
"""No description gives accelerations: unless one is given, a joint takes this long to reach its velocity limit [s]."""

DEFAULT_TIME_TO_FULL_ACCELERATION = 0.1
"""Likewise for jerk: unless one is given, a joint takes this long to reach its acceleration limit [s]."""

ROUNDING = 1e-9
"""By how much a polynomial may exceed a limit [rad or m], or a fraction of a velocity limit: a trajectory made to touch its
limits touches them up to rounding."""


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the joints of an arm. Made by `of`.

    Attributes
    ----------
    chain : Chain
        Whose joints they are; the position limits are its own.
    velocity : (n,) array
        Largest speed [rad/s or m/s], finite.
    acceleration : (n,) array
        Largest acceleration [rad/s^2 or m/s^2], finite.
    jerk : (n,) array
        Largest jerk [rad/s^3 or m/s^3], finite. What moves with steps of acceleration does not look at it.
    """

    chain: Chain
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    @classmethod
    def of(
        cls,
        chain: Chain,
        *,
        max_velocity: ArrayLike | None = None,
        max_acceleration: ArrayLike | None = None,
        max_jerk: ArrayLike | None = None,
    ) -> JointLimits:
        """The limits of a chain, lowered or filled in by what is given.

        Parameters
        ----------
        chain : Chain
        max_velocity : float or (n,) array, optional
            Speed limit [rad/s or m/s]. It can lower a limit of the description and never raise one. Where neither gives one: 1 rad/s,
            or 0.25 m/s for a joint that slides.
        max_acceleration : float or (n,) array, optional
            [rad/s^2 or m/s^2]; when not given, what reaches the velocity limit in 0.5 s.
        max_jerk : float or (n,) array, optional
            [rad/s^3 or m/s^3]; when not given, what reaches the acceleration limit in 0.1 s.

        Returns
        -------
        JointLimits
            A limit for each joint, finite and above 0.

        Raises
        ------
        ArrayError
            A limit that is not positive and finite, or as many as there are joints.

        Examples
        --------
        >>> from pieper.model import catalog
        >>> limits = JointLimits.of(catalog.describe("mh12").chain(), max_velocity=4.0)
        >>> limits.velocity.round(2)
        array([3.84, 3.49, 3.84, 4.  , 4.  , 4.  ])
        """
        check_chain(chain)
        described = np.where(
            np.isfinite(chain.max_velocity),
            chain.max_velocity,
            np.inf
            if max_velocity is not None
            else np.where(_slides(chain), DEFAULT_SLIDING_SPEED, DEFAULT_TURNING_SPEED),
        )
        if (described <= 0.0).any():
            name = chain.joint_names[int(np.argmax(described <= 0.0))]
            raise ArrayError(
                f"the velocity limit of joint {name!r} must be above 0, and the description of {chain.name!r} gives 0, "
                "at which it could not move; correct the description"
            )
        velocity = described
        if max_velocity is not None:
            velocity = np.minimum(described, _positive(chain, max_velocity, "max_velocity"))
        acceleration = velocity / DEFAULT_TIME_TO_FULL_SPEED
        if max_acceleration is not None:
            acceleration = _positive(chain, max_acceleration, "max_acceleration")
        jerk = acceleration / DEFAULT_TIME_TO_FULL_ACCELERATION
        if max_jerk is not None:
            jerk = _positive(chain, max_jerk, "max_jerk")
        for values in (velocity, acceleration, jerk):
            values.setflags(write=False)
        return cls(chain, velocity, acceleration, jerk)

    def check_position(self, q: ArrayLike, *, name: str = "q") -> FloatArray:
        """`q` as a new (n,) array within the joint limits, or an error that says which joint is not.

        Raises
        ------
        ArrayError
            A wrong length, or a number that is not finite.
        MotionError
            A joint out of its limits.
        """
        values = self._vector(q, name)
        lower, upper = self.chain.limits.T
        outside = np.flatnonzero((values < lower) | (values > upper))
        if outside.size:
            raise MotionError(f"{name}: {self._position_words(int(outside[0]), float(values[outside[0]]))}")
        return values

    def check_velocity(self, dq: ArrayLike, *, name: str = "dq") -> FloatArray:
        """`dq` as a new (n,) array within the velocity limits, or an error that says which joint is not.

        Raises
        ------
        ArrayError
            A wrong length, or a number that is not finite.
        MotionError
            A joint faster than its limit.
        """
        values = self._vector(dq, name)
        outside = np.flatnonzero(np.abs(values) > self.velocity)
        if outside.size:
            raise MotionError(f"{name}: {self._velocity_words(int(outside[0]), float(values[outside[0]]))}")
        return values

    def check_trajectory(self, trajectory: Trajectory) -> None:
        """Nothing, or an error that says where a trajectory leaves the joint limits or exceeds the velocity limits first.

        The extrema of the polynomials between the points are found, not sampled. Accelerations are not checked.

        Parameters
        ----------
        trajectory : Trajectory
            Its columns in the order of the joints of the chain.

        Raises
        ------
        ArrayError
            A number of columns that is not that of the joints.
        MotionError
            A joint out of its limits or too fast, at the points or between them.
        """
        if trajectory.dof != self.chain.dof:
            raise ArrayError(
                f"the trajectory must have {self.chain.dof} columns, one for each joint, got {trajectory.dof}"
            )
        lower, upper = self.chain.limits.T
        fastest = self.velocity * (1.0 + ROUNDING)
        if len(trajectory.t) == 1:  # no polynomial; the same rounding
            q = trajectory.q[0]
            near = np.clip(q, lower, upper)
            self.check_position(np.where(np.abs(q - near) <= ROUNDING, near, q), name="the trajectory's only point")
        broken = _first_outside(trajectory, 0, lower - ROUNDING, upper + ROUNDING)
        if broken is not None:
            t, joint, value = broken
            raise MotionError(f"at {t:.6g} s of the trajectory: {self._position_words(joint, value)}")
        broken = _first_outside(trajectory, 1, -fastest, fastest)
        if broken is not None:
            t, joint, value = broken
            raise MotionError(f"at {t:.6g} s of the trajectory: {self._velocity_words(joint, value)}")

    def surely_hold(self, trajectory: Trajectory) -> bool:
        """Whether a quick test shows that :meth:`check_trajectory` has nothing to say; False leaves it open.

        The test bounds each polynomial, a few per cent too widely, and takes a hundredth of a millisecond. Planners use it.

        Parameters
        ----------
        trajectory : Trajectory
            Its columns in the order of the joints of the chain.

        Returns
        -------
        bool
            True is certain; False is not.
        """
        if len(trajectory.t) == 1:
            return bool(((trajectory.q >= self.chain.limits[:, 0]) & (trajectory.q <= self.chain.limits[:, 1])).all())
        lower, upper = self.chain.limits.T
        for derivative, least_allowed, greatest_allowed in ((0, lower, upper), (1, -self.velocity, self.velocity)):
            least, greatest = polynomial.bounds(trajectory.polynomials(derivative))
            if (least < least_allowed).any() or (greatest > greatest_allowed).any():
                return False
        return True

    def _vector(self, values: ArrayLike, name: str) -> FloatArray:
        vector = as_joints(self.chain, values, name=name)
        if vector.ndim != 1:
            raise ArrayError(f"{name} must have shape ({self.chain.dof},), got {vector.shape}")
        return vector.copy()

    def _unit(self, joint: int) -> str:
        return "m" if _slides(self.chain)[joint] else "rad"

    def _position_words(self, joint: int, value: float) -> str:
        lower, upper = self.chain.limits[joint]
        return (
            f"joint {self.chain.joint_names[joint]!r} at {value:.9g} {self._unit(joint)} is outside its limits "
            f"[{lower:.9g}, {upper:.9g}] {self._unit(joint)}"
        )

    def _velocity_words(self, joint: int, value: float) -> str:
        return (
            f"joint {self.chain.joint_names[joint]!r} at {value:.9g} {self._unit(joint)}/s is faster than its limit "
            f"of {self.velocity[joint]:.9g} {self._unit(joint)}/s"
        )


@dataclass(frozen=True)
class TcpLimits:
    """What the tip may do; infinite where nothing is said.

    Attributes
    ----------
    velocity, acceleration, jerk : float
        Of its origin [m/s, m/s^2, m/s^3].
    angular_velocity, angular_acceleration : float
        [rad/s, rad/s^2]
    """

    velocity: float = np.inf
    acceleration: float = np.inf
    jerk: float = np.inf
    angular_velocity: float = np.inf
    angular_acceleration: float = np.inf

    def __post_init__(self) -> None:
        for name in ("velocity", "acceleration", "jerk", "angular_velocity", "angular_acceleration"):
            value = getattr(self, name)
            if not (isinstance(value, (int, float, np.number)) and value > 0.0):
                raise ArrayError(f"the limit {name} of the tip must be above 0, got {value!r}")

    @property
    def say_something(self) -> bool:
        """Whether there is a limit at all."""
        values = (self.velocity, self.acceleration, self.jerk, self.angular_velocity, self.angular_acceleration)
        return bool(np.isfinite(values).any())


def _slides(chain: Chain) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """(n,) mask of the joints that turn no axis."""
    turns = (chain.coupling != 0.0) & chain.is_revolute[:, None]
    return np.asarray((chain.coupling != 0.0).any(axis=0) & ~turns.any(axis=0))


def _positive(chain: Chain, value: ArrayLike, name: str) -> FloatArray:
    given = stack(value, (), name)
    if given.ndim > 1 or given.shape not in ((), (chain.dof,)):
        raise ArrayError(f"{name} must be one number or have shape ({chain.dof},), got {given.shape}")
    if (given <= 0.0).any():
        raise ArrayError(f"{name} must be above 0, got {float(given.min())}")
    return np.array(np.broadcast_to(given, (chain.dof,)))


def _first_outside(
    trajectory: Trajectory, derivative: int, lower: FloatArray, upper: FloatArray
) -> tuple[float, int, float] | None:
    """Time [s], joint and value of the first extremum outside `lower` or `upper`, both (n,); None when there is none."""
    c = trajectory.polynomials(derivative)
    least, greatest = polynomial.bounds(c)
    segment, joint = np.nonzero((least < lower) | (greatest > upper))  # those that may be outside
    if not segment.size:
        return None
    c = c[segment, joint]
    u = polynomial.stationary(c)
    values = polynomial.evaluate(c[:, None, :], u)
    outside = (values < lower[joint, None]) | (values > upper[joint, None])
    if not outside.any():
        return None
    starts = trajectory.t[segment, None]
    t = starts + u * (trajectory.t[segment + 1, None] - starts)
    row, column = np.unravel_index(int(np.argmin(np.where(outside, t, np.inf))), t.shape)
    return float(t[row, column]), int(joint[row]), float(values[row, column])
