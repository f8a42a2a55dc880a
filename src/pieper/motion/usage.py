"""How much of its limits a motion uses, measured: by its joints, and by its tip.

Joints are judged by the extrema of the polynomials between the points of a trajectory, the tip at sixteen places between each two, with
parabolas through them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.motion import polynomial
from pieper.motion._tip_motion import tip_jerk, twist_and_rate
from pieper.motion.limits import TcpLimits

if TYPE_CHECKING:
    from pieper.model.chain import Chain
    from pieper.motion.limits import JointLimits
    from pieper.motion.trajectory import Trajectory
    from pieper.spatial._checks import FloatArray


class Usage(NamedTuple):
    """The largest share of each limit that a trajectory uses; 1 is all of it."""

    velocity: float
    acceleration: float
    jerk: float
    tcp_velocity: float
    tcp_acceleration: float
    tcp_jerk: float

    @property
    def stretch(self) -> float:
        """By which factor the trajectory would have to be slower to hold every limit; below 1 where it could be quicker."""
        return float(
            max(
                self.velocity,
                self.tcp_velocity,
                np.sqrt(max(self.acceleration, self.tcp_acceleration)),
                np.cbrt(max(self.jerk, self.tcp_jerk)),
            )
        )


def usage(trajectory: Trajectory, limits: JointLimits, tcp: TcpLimits | None = None) -> Usage:
    """How much of its limits a trajectory uses.

    Parameters
    ----------
    trajectory : Trajectory
        With velocities and accelerations, its columns in the order of the joints.
    limits : JointLimits
    tcp : TcpLimits, optional

    Returns
    -------
    Usage
        For the joints from the extrema of the polynomials; for the tip from sixteen places between each two points, and parabolas through them.
    """
    if len(trajectory.t) == 1:
        return Usage(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    shares = []
    for order, most in ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk)):
        c = trajectory.polynomials(order)
        least, greatest = polynomial.bounds(c)
        share = np.maximum(np.abs(least), np.abs(greatest)) / most
        near = share >= 0.9 * share.max()  # the bounds are a little wide: look closely where they matter
        places = polynomial.stationary(c[near])
        exact = np.abs(polynomial.evaluate(c[near][:, None, :], places)).max(axis=-1)
        share[near] = exact / np.broadcast_to(most, share.shape)[near]
        shares.append(float(share.max()))
    velocity, acceleration, jerk = shares
    return Usage(velocity, acceleration, jerk, *_tip_usage(limits.chain, trajectory, tcp or TcpLimits()))


def _tip_usage(chain: Chain, trajectory: Trajectory, tcp: TcpLimits) -> tuple[float, float, float]:
    if not tcp.say_something:
        return 0.0, 0.0, 0.0
    u = np.arange(16) / 16.0
    lengths = np.diff(trajectory.t)
    t = np.append((trajectory.t[:-1, None] + u * lengths[:, None]).ravel(), trajectory.t[-1])
    q, dq, ddq = trajectory.sample(t)
    twist, rate = twist_and_rate(chain, q, dq, ddq)
    speed = _peak(np.linalg.norm(twist[:, :3], axis=1)) / tcp.velocity
    spin = _peak(np.linalg.norm(twist[:, 3:], axis=1)) / tcp.angular_velocity
    linear = _peak(np.linalg.norm(rate[:, :3], axis=1)) / tcp.acceleration
    angular = _peak(np.linalg.norm(rate[:, 3:], axis=1)) / tcp.angular_acceleration
    jerk = 0.0
    if np.isfinite(tcp.jerk):
        c = trajectory.polynomials(3)
        which = np.append(np.repeat(np.arange(len(lengths)), 16), len(lengths) - 1)
        dddq = polynomial.evaluate(c[which], np.append(np.tile(u, len(lengths)), 1.0)[:, None])
        jerk = _peak(np.linalg.norm(tip_jerk(chain, q, dq, ddq, dddq), axis=1)) / tcp.jerk
    return float(max(speed, spin)), float(max(linear, angular)), jerk


def _peak(f: FloatArray) -> float:
    """The largest value of a curve by its samples: that of the parabola through each and its neighbours, where it is the largest of the three."""
    if len(f) < 3:
        return float(f.max())
    before, here, after = f[:-2], f[1:-1], f[2:]
    top = (here >= before) & (here >= after)
    bend = 2.0 * here - before - after
    more = np.where(top & (bend > 0.0), (after - before) ** 2 / (8.0 * np.maximum(bend, 1e-300)), 0.0)
    return float(max(f.max(), (here + more).max()))
