"""What can be done with an arm, simulated or real: read it, send it somewhere, stop it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from pieper.model.chain import FloatArray
    from pieper.motion.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class RobotState:
    """Where an arm is.

    Attributes
    ----------
    time : float
        Of the robot's own clock [s].
    q, dq : (n,) arrays
        Joint values [rad or m] and velocities [rad/s or m/s].
    """

    time: float
    q: FloatArray
    dq: FloatArray


class Robot(Protocol):
    """An arm that can be read, sent to a joint vector, and stopped.

    A command that is malformed or must not be carried out raises a `pieper.errors.PieperError` that says why, before anything changes.
    """

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of ``q``."""
        ...

    def read(self) -> RobotState:
        """Where the arm is now."""
        ...

    def command(self, q: ArrayLike | Mapping[str, float]) -> None:
        """Move to joint values (n,) [rad or m], from now on; a mapping names joints, and the others stay."""
        ...

    def stop(self) -> None:
        """Come to rest."""
        ...


class Simulator(Robot, Protocol):
    """A robot whose time the caller moves on, with the other ways to send it somewhere."""

    def command_velocity(self, dq: ArrayLike | Mapping[str, float]) -> None:
        """Move with joint velocities (n,) [rad/s or m/s], from now on; a mapping names joints, and the others rest."""
        ...

    def follow(self, trajectory: Trajectory) -> None:
        """Follow a trajectory, from now on."""
        ...

    def step(self, dt: float) -> RobotState:
        """Let `dt` seconds pass, and read."""
        ...
